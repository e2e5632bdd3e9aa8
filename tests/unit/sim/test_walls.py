"""The walls of a map stop a vehicle where they stand, and end a laser's beams."""

import asyncio
from math import cos, inf, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import txt1
from tests.unit.maps.test_rays import CELL, hall
from txt1.config import load
from txt1.errors import ConfigError
from txt1.fleet.law import make_law
from txt1.kernel.loop import run
from txt1.learning.env import DriveVectorEnv
from txt1.maps.files import Map
from txt1.maps.grid import Grid
from txt1.model.light_sensors import LUX_MIN
from txt1.model.vehicle import Geometry
from txt1.sensors.light import eyes
from txt1.sensors.sim_laser import standing
from txt1.sim import rays
from txt1.sim.rays import shapes_of, walls_of
from txt1.sim.room import Room, clearance
from txt1.sim.view import Camera, Scene, distances, draw
from txt1.sim.walls import PLENTY, Walls
from txt1.tasks.fields import SURROUNDINGS, WALLS
from txt1.tasks.markers import MARKERS

BODY = Geometry()


def walls_around(grid: Grid) -> Walls:
    return Walls(Map("hall", Path("hall.yaml"), grid, ""))


HALL = walls_around(hall())


def written(folder: Path, grid: Grid, name: str = "hall") -> Path:
    """The grid as a map's files."""
    pixels = np.where(grid.cells == 0, 254, 0).astype(np.uint8)[::-1]
    (folder / f"{name}.pgm").write_bytes(b"P5 %d %d 255\n" % pixels.shape[::-1] + pixels.tobytes())
    file = folder / f"{name}.yaml"
    file.write_text(f"image: {name}.pgm\nresolution: {grid.resolution}\norigin: {list(grid.origin)}\n")
    return file


@given(st.floats(-2.3, 2.3), st.floats(-1.8, 1.8), st.floats(-pi, pi))
def test_clearance_in_a_rectangle_is_that_of_four_walls(x: float, y: float, theta: float) -> None:
    exact = clearance(x, y, theta, Room(4.0, 3.0), BODY)
    found = HALL.clearance(x, y, theta, BODY)
    if exact > PLENTY or found > PLENTY:
        assert exact > 0.0 and found > 0.0
    elif exact >= -0.5 * CELL:
        # beside a wall the cells' edges are exact; in a corner the distance is rounded off
        assert found == pytest.approx(exact, abs=0.5 * CELL)
    else:
        assert found < 0.0


@given(st.floats(-2.0, 2.0), st.floats(-1.5, 1.5))
def test_where_it_may_roam_no_wall_is_in_reach(x: float, y: float) -> None:
    reach = 0.3
    roam = HALL.roam(x, y, reach)
    if roam > 0.0:
        for dx, dy in ((roam, roam), (-roam, roam), (roam, -roam), (-roam, -roam)):
            assert HALL.distance(x + dx, y + dy) >= reach


async def driven(settings: list[str], v: float, seconds: float) -> Any:
    async with txt1.Robot.open("sim", settings=settings) as robot:
        await robot.load_gains()
        await robot.drive(v, 0.0, seconds)
        return robot.runtime.hal


@pytest.mark.parametrize("theta", [0.0, 0.3, pi / 2])
def test_a_robot_that_drives_against_a_wall_stands_there(tmp_path: Path, theta: float) -> None:
    file = written(tmp_path, hall())
    start = f"sim.start=[{-0.5 * cos(theta)},{-0.5 * sin(theta)},{theta}]"
    settings = [f"sim.room.map={file}", start, "safety.runaway_time=60"]
    hal = run(driven(settings, 0.5, 8.0), speed="max")
    left = clearance(*hal.vehicle.pose, Room(4.0, 3.0), BODY)
    assert -0.25 * CELL < left < 0.02
    assert hal.blocked_by() == f"a wall of the map {file}"


def test_a_start_within_a_wall_is_refused_with_the_remedy(tmp_path: Path) -> None:
    file = written(tmp_path, hall())
    with pytest.raises(ConfigError, match=r"sim\.start: .*sticks into a wall of the map .*; choose another start"):
        run(driven([f"sim.room.map={file}", "sim.start=[1.9, 0, 0]"], 0.0, 0.1), speed="max")
    with pytest.raises(ConfigError, match=r"sim\.start: .*sticks into a wall of the map"):
        run(driven([f"sim.room.map={file}", "sim.start=[50, 0, 0]"], 0.0, 0.1), speed="max")


def test_the_laser_sees_the_walls(tmp_path: Path) -> None:
    file = written(tmp_path, hall())

    async def seen() -> Any:
        laser = "sensors.laser={driver: sim_laser, options: {noise: 0.0, noise_share: 0.0}}"
        async with txt1.Robot.open("sim", settings=[f"sim.room.map={file}", laser]) as robot:
            await asyncio.sleep(1.0)
            return robot.runtime.sensors["laser"].last.value

    scan = run(seen(), speed="max")
    ahead = scan.ranges[round(-scan.angle_min / scan.angle_step)]
    assert ahead == pytest.approx(2.0 - scan.mount.x, abs=1e-5)


def test_length_and_width_are_refused_beside_a_map(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"sim\.room: length, width: the walls are those of the map; take out"):
        load(overrides=["sim.room.map=corridor", "sim.room.length=8"])


def test_the_walls_are_told_to_screens_pages_and_views(tmp_path: Path) -> None:
    file = written(tmp_path, hall())

    async def told() -> tuple[Any, Any]:
        async with txt1.Robot.open("sim", settings=[f"sim.room.map={file}"]) as robot:
            return robot.runtime.snapshot(), robot.runtime.bus.read(MARKERS)

    snapshot, surroundings = run(told(), speed="max")
    (line,) = snapshot[WALLS]
    assert sorted(line) == [(-2.0, -1.5), (-2.0, 1.5), (2.0, -1.5), (2.0, 1.5)]
    assert snapshot[SURROUNDINGS].room is None
    assert surroundings.obstacles == (line,)


def test_a_wall_throws_a_shadow() -> None:
    lux = eyes(load(overrides=["sim.room.map=flat", "sim.light.noise=0"]).config, np.random.default_rng(1))
    bare = eyes(load(overrides=["sim.light.noise=0"]).config, np.random.default_rng(1))
    through_the_door, behind_the_wall, beside_it = (5.0, 0.0, 0.0), (6.0, -2.0, 0.0), (5.0, -0.85, 0.0)
    assert lux(through_the_door) == bare(through_the_door)
    assert lux(behind_the_wall) == (LUX_MIN,) * 4
    half = lux(beside_it)
    assert {each == LUX_MIN for each in half} == {False, True}, "some of the four see the lamp"


def test_a_lamp_that_hangs_on_a_wall_shines_into_the_room() -> None:
    settings = ["sim.room.map=flat", "sim.light.noise=0", "sim.room.light=[-2.02, 0]"]
    assert min(eyes(load(overrides=settings).config, np.random.default_rng(1))((0.0, 0.0, 0.0))) > LUX_MIN


def test_what_knows_no_walls_refuses_a_map() -> None:
    with pytest.raises(
        ConfigError, match=r"sim\.room\.map: flat: environments of many robots at once do not model it.*take it out"
    ):
        DriveVectorEnv(2, "light", load(overrides=["sim.room.map=flat"]).config)
    with pytest.raises(ConfigError, match=r"cooperate\.law: coverage sweeps a rectangle: give sim\.room\.length and"):
        make_law("a", ["a", "b"], (inf, inf), {"law": "coverage"})


def test_pictures_and_depth_show_the_walls_of_a_map_as_those_of_a_room() -> None:
    camera, nothing = Camera(64, 48), shapes_of(())
    seen = [
        Scene(walls_of(room), nothing, nothing, (0.0, 0.0))
        for room in (Room(4.0, 3.0), Room(walls=walls_around(hall())))
    ]
    depths = [distances(camera, scene, 0.3, -0.2, 0.2, 0.4) for scene in seen]
    assert depths[1] == pytest.approx(depths[0], abs=1e-6)
    assert np.array_equal(*(draw(camera, scene, 0.3, -0.2, 0.2, 0.4) for scene in seen))


def test_the_caster_is_compiled_before_a_sensor_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[bool] = []
    monkeypatch.setattr(rays, "prepare", lambda: compiled.append(True))
    standing(load(overrides=["sim.room.map=flat"]).config)
    assert compiled
    standing(load().config)
    assert len(compiled) == 1, "a room without a map needs no caster"
