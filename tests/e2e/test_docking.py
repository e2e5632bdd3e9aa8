"""A robot finds itself by AprilTags on the walls, and docks to one, in rooms that its simulated camera sees."""

from __future__ import annotations

from math import hypot
from typing import Any

import pytest

pytest.importorskip("cv2", reason="AprilTags need the extra 'camera'")

from tests.unit.tags.drawn_tags import hang
from txt1 import Robot, run
from txt1.model.kinematics import wrap_angle
from txt1.navigation import fused_pose, go_to
from txt1.sim import view

PLACES = {5: (3.0, 0.0, 3.14159), 9: (3.0, 1.2, 3.14159)}
SIZE = 0.2
SETTINGS = (
    "sim.room.length=.inf",
    "sim.room.width=.inf",
    "sim.start=[1.2, 0.3, -0.2]",
    "sensors.front.driver=sim_camera",
    "sensors.front.options={width: 480, height: 360, quality: 90}",
    "sensors.tags.driver=apriltags",
    f"sensors.tags.options={{places: {{5: [3, 0, 3.14159], 9: [3, 1.2, 3.14159]}}, size: {SIZE}, field: 60}}",
    "estimation.sensors=[encoders, tags]",
    "obstacle_stop.enabled=never",
)


@pytest.fixture(autouse=True)
def tags_on_the_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = view.draw

    def draw(camera: view.Camera, scene: Any, x: float, y: float, z: float, theta: float) -> view.Picture:
        return hang(plain(camera, scene, x, y, z, theta), camera, (x, y, z, theta), PLACES, SIZE)

    monkeypatch.setattr("txt1.sensors.sim_camera.draw", draw)


@pytest.mark.long
def test_a_robot_that_knows_only_its_tags_docks_to_one() -> None:
    async def main() -> tuple[tuple[float, float, float], str]:
        async with Robot.open("sim", settings=SETTINGS, seed=1, arm=True) as robot:
            await robot.load_gains()
            poses = fused_pose(robot)
            while robot.estimate is None or not robot.estimate.located:
                await robot.sensor_stream("tags").__anext__()
            await go_to(robot, (2.2, 0.0, 0.0), pose_source=poses, speed=0.3)
            hal: Any = robot.hal
            state = robot.sensors["tags"].state()
            return hal.vehicle.pose, state.reason

    (x, y, theta), reason = run(main(), speed="max")
    assert hypot(x - 2.2, y) < 0.05 and abs(wrap_angle(theta)) < 0.06
    assert not reason
