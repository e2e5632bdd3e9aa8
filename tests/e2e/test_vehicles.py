"""Vehicles other than the TXT-1: front-steered cars and rovers that turn in place, with and without encoders."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from math import hypot, pi
from pathlib import Path

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block
from txt1.cli import execute
from txt1.config import load
from txt1.config.sources import vehicles
from txt1.control.open_loop import counts_for
from txt1.errors import ConfigError, NotArmed
from txt1.kernel.loop import run
from txt1.navigation import go_to
from txt1.robot import Robot
from txt1.tasks.controller import MEASURED_BY
from txt1.tasks.fields import SURROUNDINGS

CARS = ("f1tenth", "donkeycar")
STILL_AIR = (*ENDLESS, "sim.noise.drag=0")


@pytest.fixture(autouse=True)
def a_vehicles_file_may_be_read(blocking_calls_fail: BlockBuster) -> None:
    """Before anything runs."""
    may_block(blocking_calls_fail, "txt1/config/sources.py", "load")


def configured(vehicle: str, *settings: str) -> tuple[str, ...]:
    return (f"vehicle={vehicle}", *STILL_AIR, *settings)


@asynccontextmanager
async def driven(settings: tuple[str, ...]) -> AsyncIterator[Robot]:
    """A simulated robot with its gains loaded."""
    async with Robot.open("sim", settings=settings) as robot:
        await robot.load_gains()
        yield robot


@pytest.mark.parametrize("vehicle", vehicles())
async def test_every_vehicle_drives_the_circle_it_is_asked_for(vehicle: str) -> None:
    async with driven(configured(vehicle)) as robot:
        await robot.drive(0.5, 0.4, 2.0)
        places = []
        for _ in range(3):
            places.append(robot.pose)
            await robot.drive(0.5, 0.4, 2.0 * pi / 0.4 / 3.0)
        (x1, y1, _), (x2, y2, _), (x3, y3, _) = (place for place in places if place is not None)
        # of the circle through three places of a turn: the radius is the sides' product over four times the area
        a, b, c = hypot(x2 - x3, y2 - y3), hypot(x1 - x3, y1 - y3), hypot(x1 - x2, y1 - y2)
        area = 0.5 * abs((x2 - x1) * (y3 - y1) - (x3 - x1) * (y2 - y1))
        assert a * b * c / (4.0 * area) == pytest.approx(0.5 / 0.4, rel=0.06)


@pytest.mark.parametrize("vehicle", CARS)
async def test_a_car_does_not_turn_at_rest_nor_sharper_than_it_can(vehicle: str) -> None:
    async with driven(configured(vehicle)) as robot:
        await robot.drive(0.0, 1.0, 2.0)
        assert robot.pose == (0.0, 0.0, 0.0)
        await robot.drive(0.5, 3.0, 1.0)
        radius_min = robot.config.geometry.radius_min
        assert robot.faults["yaw_rate_clipped"] > 0
        await robot.drive(0.5, 0.5 / radius_min, 1.0)
        _, _, theta = robot.pose or (0.0, 0.0, 9.0)
        assert 0.0 < theta < 2.0 * 0.5 / radius_min * 1.05


async def test_a_rover_turns_in_place_both_ways_and_keeps_its_sign_in_reverse() -> None:
    async with driven(configured("rover")) as robot:
        await robot.drive(0.0, 1.5, 3.0)
        x, y, theta = robot.pose or (9.0, 9.0, 9.0)
        assert hypot(x, y) < 0.02
        turned = theta % (2.0 * pi)
        assert turned == pytest.approx(4.5, abs=0.5)
        assert robot.armed and robot.faults["runaway"] == 0  # wheels that turn against each other are none here
        await robot.drive(-0.3, 0.6, 3.0)
        assert robot.odometry.omega == pytest.approx(0.6, abs=0.15)
        assert robot.odometry.v == pytest.approx(-0.3, abs=0.05)
        await robot.drive(0.0, -9.0, 1.0)
        assert robot.faults["yaw_rate_clipped"] > 0


async def test_a_rover_stops_at_a_wall_and_comes_away_from_it() -> None:
    settings = ("vehicle=rover", "sim.room.length=1.2", "sim.room.width=1.2", "safety.runaway_time=5")
    async with driven(settings) as robot:
        with pytest.raises(NotArmed, match="blocked: a wall"):
            await robot.drive(0.5, 0.0, 2.0)
        x, _, _ = robot.pose or (9.0, 0.0, 0.0)
        assert x == pytest.approx(0.6 - 0.115, abs=0.03)
        await asyncio.sleep(0.5)
        robot.arm()
        await robot.drive(-0.3, 0.0, 2.0)
        assert robot.pose is not None and robot.pose[0] < 0.45


async def test_without_encoders_odometry_is_dead_reckoning_and_says_so() -> None:
    async with driven(configured("donkeycar")) as robot:
        await robot.drive(0.5, 0.0, 3.0)
        assert robot.snapshot[MEASURED_BY] == "reckoned"
        assert any("dead reckoning" in event.text for event in robot.runtime.state.events)
        assert robot.odometry.x == pytest.approx(1.5, abs=0.05)  # of what was asked for
        assert robot.pose is not None and robot.pose[0] == pytest.approx(1.5, abs=0.25)  # the car takes time to follow
        assert robot.runtime.state.encoders == (None, None)
        await robot.drive(0.1, 0.0, 1.0)  # below the dead band of its speeds
        assert robot.runtime.state.control.outputs.motor == 0
        robot.stop()
        with pytest.raises(NotArmed):
            await robot.drive(0.5, 0.0, 1.0)


async def test_the_body_lies_ahead_of_the_rear_axle() -> None:
    settings = ("vehicle=f1tenth", "sim.room.length=3", "sim.room.width=3")
    async with driven(settings) as robot:
        length, _, centre = robot.snapshot[SURROUNDINGS].body
        with pytest.raises(NotArmed, match="blocked: a wall"):
            await robot.drive(0.5, 0.0, 4.0)
        nose = (robot.pose or (0.0,))[0] + centre + 0.5 * length
        assert nose == pytest.approx(1.5, abs=0.03)


def test_a_vehicle_is_chosen_by_name_or_file_and_what_is_set_besides_wins(tmp_path: Path) -> None:
    assert load(None, ["vehicle=f1tenth"], {}).config.geometry.steering == "front"
    own = tmp_path / "mine.yaml"
    own.write_text("geometry: {steering: front, wheelbase: 0.2}\n")
    loaded = load(None, [f"vehicle={own}", "geometry.wheelbase=0.21"], {}).config
    assert (loaded.geometry.steering, loaded.geometry.wheelbase) == ("front", 0.21)
    with pytest.raises(ConfigError, match=r"there is none 'truck'.*f1tenth"):
        load(None, ["vehicle=truck"], {})


def test_the_command_line_drives_a_vehicle(capsys: pytest.CaptureFixture[str]) -> None:
    script = ["--headless", "--duration", "2", "--speed", "max", "--drive=0.0,0.5", "--json"]
    assert execute(["run", "--vehicle", "rover", *script]) == 0
    assert json.loads(capsys.readouterr().out)["odometry"]["theta"] > 0.2


@pytest.mark.parametrize(
    ("v", "counts"), [(0.0, 0.0), (0.21, 1000.0), (0.7, 2500.0), (1.4, 4642.857), (-0.7, -2500.0), (0.1, 663.265)]
)
def test_the_speed_map_is_a_line_between_its_entries(v: float, counts: float) -> None:
    speed_map = ((-4000.0, -1.19), (-1000.0, -0.21), (1000.0, 0.21), (4000.0, 1.19))
    assert counts_for(v, speed_map) == pytest.approx(counts)
    assert counts_for(-v, speed_map) == pytest.approx(-counts)


@pytest.mark.parametrize(
    ("value", "why"),
    [("[[1000, 0.3], [900, 0.5]]", "must rise"), ("[[1000, -0.3]]", "same sign"), ("[[0, 0.1]]", "same sign")],
)
def test_a_speed_map_that_is_none_is_refused(value: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        load(None, [f"control.speed_map={value}"], {})


@pytest.mark.parametrize("vehicle", [v for v in vehicles() if v != "donkeycar"])
def test_a_vehicle_goes_where_it_is_sent(vehicle: str) -> None:
    async def drive() -> tuple[float, float, float] | None:
        async with driven(configured(vehicle)) as robot:
            await go_to(robot, (1.5, 1.0, 0.5))
            return robot.pose

    x, y, theta = run(drive(), speed="max") or (9.0, 9.0, 9.0)
    assert hypot(x - 1.5, y - 1.0) < 0.1
    assert theta == pytest.approx(0.5, abs=0.2)
