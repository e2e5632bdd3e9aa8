"""Speed and steering angle as F1TENTH's programs publish and hear them."""

from __future__ import annotations

import asyncio
from math import atan, tan

import pytest

from txt1.kernel.loop import run
from txt1.model.vehicle import Geometry
from txt1.robot import Robot
from txt1.ros.publisher import Publisher, Told
from txt1.ros.robot_end import Ros2RobotEnd
from txt1.ros.topics import steered
from txt1.sidecar import Request
from txt1.telemetry.messages import DEFINITIONS

CAR = ("vehicle=f1tenth", "sim.room.length=.inf", "sim.room.width=.inf")


def test_the_definition_is_the_published_one() -> None:
    # github.com/ros-drivers/ackermann_msgs, msg/AckermannDrive.msg
    fields = ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk")
    assert DEFINITIONS["ackermann_msgs/AckermannDrive"] == "\n".join(f"float32 {name}" for name in fields)


@pytest.mark.parametrize("v", [1.0, -1.0])
@pytest.mark.parametrize("angle", [-0.2, 0.0, 0.2])
def test_an_angle_is_that_of_a_bicycles_front_wheel_both_ways(v: float, angle: float) -> None:
    geometry = Geometry(steering="front", wheelbase=0.33, radius_min=0.74)
    omega = v * tan(angle) / 0.33
    assert steered(v, omega, geometry) == pytest.approx((v, angle))
    assert steered(0.0, 0.0, geometry) == (0.0, 0.0)


@pytest.mark.parametrize(("speed", "angle"), [(1.0, 0.2), (-1.0, 0.2), (1.0, -2.0), (0.0, 0.3)])
def test_drive_commands_as_cmd_vel_does(speed: float, angle: float) -> None:
    async def main() -> None:
        async with Robot.open(settings=CAR) as robot:
            end, geometry = Ros2RobotEnd(robot), robot.config.geometry
            for _ in range(10):
                end.request(Request("steer", {"speed": speed, "angle": angle, "age": 0.0}, 0.0))
                await asyncio.sleep(0.05)
            control = robot.runtime.state.control
            turned = min(max(angle, -geometry.steering_max), geometry.steering_max)
            assert control.v == pytest.approx(speed)
            assert control.omega == pytest.approx(speed * tan(turned) / geometry.wheelbase, abs=0.01)
            assert robot.driver.name == ("ros" if speed else "")
            end.request(Request("steer", {"speed": 1.0, "angle": float("nan")}, 0.0))
            assert "steering_angle must be a finite number" in robot.runtime.state.events[-1].text

    run(main(), speed="max")


@pytest.mark.parametrize("ackermann", [True, False])
def test_the_set_point_is_published_as_speed_and_angle_if_asked(ackermann: bool) -> None:
    async def main() -> None:
        async with Robot.open(settings=CAR) as robot:
            feed = Publisher(robot.runtime, print, Told(ackermann=ackermann))
            feed.begin()
            for _ in range(10):
                robot.command(1.0, 1.0)
                await asyncio.sleep(0.05)
            line = feed.line({})
            assert line is not None and (b'"~/drive"' in line) is ackermann
            feed.end()
            angle = steered(1.0, 1.0, robot.config.geometry).angle
            assert angle == pytest.approx(atan(robot.config.geometry.wheelbase), abs=0.01)

    run(main(), speed="max")
