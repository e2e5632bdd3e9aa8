"""`txt1 run --explore`: a room is mapped without hands, a hand takes over, and nothing that was seen is lost."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from itertools import combinations
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.cli import execute
from txt1.errors import CommandRefused
from txt1.exploring import explorer
from txt1.exploring.frontiers import SAME_PLACE, Frontier, View
from txt1.kernel.loop import run
from txt1.maps import files
from txt1.maps.grid import FREE
from txt1.model.reeds_shepp import Pose
from txt1.navigation import NoPath
from txt1.robot import Robot
from txt1.sim.obstacles import distance
from txt1.sim.parameters import Box

ROOM = ("sim.room.length=3.4", "sim.room.width=2.6", "sim.battery.used_1=null")
LASER = "sensors.laser.driver=sim_laser"
BOX = Box(0.9, 0.95, 0.4, 0.3)
OBSTACLE = f"sim.obstacles=[{{kind: box, x: {BOX.x}, y: {BOX.y}, length: {BOX.length}, width: {BOX.width}}}]"


def arguments(*settings: str) -> list[str]:
    given = [word for each in (*ROOM, *settings) for word in ("--set", each)]
    return ["run", "--hal", "sim", "--headless", "--speed", "max", "--seed", "1", *given]


def explored(name: Path, do: Callable[[Robot], Awaitable[None]], *more: str) -> None:
    """Do something beside a robot that explores; `more` are settings."""

    async def main() -> None:
        settings = (*ROOM, LASER, OBSTACLE, f"mapping.make={name}", *more)
        async with Robot.open("sim", seed=1, settings=settings, additions={"exploring": str(name)}) as robot:
            assert await robot.load_gains()
            await do(robot)

    run(main(), speed="max")


def test_a_room_with_a_box_is_mapped_and_the_robot_comes_back(tmp_path, capfd):
    name = tmp_path / "room"
    assert execute([*arguments(LASER, OBSTACLE), "--duration", "300", "--explore", "-o", str(name)]) == 0
    out, told = capfd.readouterr()
    assert "no frontiers left" in told and "m2 of floor in" in told
    words = [line for line in out.splitlines() if " x=" in line][-1].split()
    x, y = (float(words[words.index("map") + k]) for k in (1, 2))
    assert hypot(x, y) < 0.1
    grid = files.read(f"{name}.yaml").grid
    xs, ys = (each.ravel() for each in np.meshgrid(np.arange(-1.6, 1.6, 0.05), np.arange(-1.2, 1.2, 0.05)))
    away = np.array([distance(BOX, x, y) for x, y in zip(xs, ys, strict=True)])
    assert grid.is_free(xs, ys)[away > 0.1].mean() > 0.97
    assert not grid.is_free(xs, ys)[away < -0.05].any()


def test_what_was_mapped_is_saved_when_the_run_is_interrupted(tmp_path):
    name = tmp_path / "room"

    async def interrupted(robot: Robot) -> None:
        await asyncio.sleep(4.0)
        assert robot.driver.name == explorer.SOURCE
        raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError):
        explored(name, interrupted)
    assert (files.read(f"{name}.yaml").grid.cells == FREE).sum() * 0.05**2 > 4.0


def test_a_run_that_ends_too_early_says_so(tmp_path, capsys):
    name = tmp_path / "room"
    assert execute([*arguments(LASER), "--duration", "3", "--explore", "-o", str(name)]) == 1
    assert "ended before all was explored" in capsys.readouterr().err
    assert name.with_suffix(".yaml").exists()


def test_a_hand_and_a_stop_end_the_drive_until_the_robot_is_armed_anew(tmp_path):
    async def driven(robot: Robot) -> None:
        async def drives(name: str, seconds: float) -> bool:
            ends = robot.now + seconds
            while robot.now < ends and robot.driver.name != name:
                await asyncio.sleep(0.05)
            return robot.driver.name == name

        assert await drives(explorer.SOURCE, 5.0)
        keys = robot.source("keys")
        assert keys.hold(0.0, 0.0) and robot.driver.name == "keys"
        await asyncio.sleep(0.3)
        keys.release()
        assert not await drives(explorer.SOURCE, 3.0)
        robot.disarm()
        robot.arm()
        assert await drives(explorer.SOURCE, 3.0)
        robot.stop()
        # its last command lapses
        await asyncio.sleep(0.5)
        assert not await drives(explorer.SOURCE, 3.0)
        robot.arm()
        assert await drives(explorer.SOURCE, 3.0)

    explored(tmp_path / "room", driven)


def test_screens_see_the_frontiers_and_the_one_to_which_it_drives(tmp_path):
    async def driven(robot: Robot) -> None:
        bus, seen = robot.runtime.bus, []
        while not robot.alongside[-1].done() and robot.now < 300.0:
            seen.append((robot.driver.name, bus.read(explorer.FRONTIERS)))
            await asyncio.sleep(0.2)
        ways = [shown for driver, shown in seen if driver == explorer.SOURCE and shown.goal]
        assert ways and all(np.hypot(*(np.array(shown.cells) - shown.goal).T).min() < 0.01 for shown in ways)
        assert len({shown.goal for shown in ways}) > 1
        assert bus.read(explorer.FRONTIERS) == ((), None)

    explored(tmp_path / "room", driven)


@pytest.mark.long
def test_it_turns_round_to_drive_back_as_its_laser_looks_ahead(tmp_path):
    async def driven(robot: Robot) -> None:
        ways = {True: 0.0, False: 0.0}
        while not robot.alongside[-1].done() and robot.now < 300.0:
            ways[robot.odometry.v > 0.0] += 0.05 * abs(robot.odometry.v)
            await asyncio.sleep(0.05)
        assert ways[False] < 0.25 * ways[True]

    explored(tmp_path / "hall", driven, "sim.room.length=14.0", "sim.room.width=3.0")


@pytest.mark.parametrize(
    ("left", "beyond", "words"),
    [
        (0, [], "no frontiers left"),
        (0, [(1.0, 2.0)], "1 frontier that the car cannot come near, at (1.00 m, 2.00 m)"),
        (0, [(1.0, 2.0)] * 2, "2 frontiers that the car cannot come near, the first at (1.00 m, 2.00 m)"),
        (1, [], "1 frontier left"),
        (2, [(1.0, 2.0)], "2 frontiers left and 1 frontier that the car cannot come near, at (1.00 m, 2.00 m)"),
    ],
)
def test_what_remains_is_told_in_one_sentence(left, beyond, words):
    assert explorer.remaining(left, beyond) == words


def test_a_frontier_to_which_no_way_leads_is_told_with_its_place(tmp_path, capsys, monkeypatch):
    async def refused(robot: Robot, goal: Pose, **_: object) -> None:
        raise NoPath(goal)

    monkeypatch.setattr(explorer, "go_to", refused)
    name = tmp_path / "room"
    assert execute([*arguments(LASER), "--duration", "60", "--explore", "-o", str(name)]) == 1
    told = capsys.readouterr().err
    assert "a frontier is left at (" in told and "no path leads to" in told and "did not come back" in told


def test_a_frontier_looked_at_in_vain_is_tried_from_other_places_and_told(tmp_path, capsys, monkeypatch):
    goals: list[Pose] = []

    async def stays(robot: Robot, goal: Pose, **_: object) -> None:
        goals.append(goal)

    monkeypatch.setattr(explorer, "go_to", stays)
    assert execute([*arguments(LASER), "--duration", "60", "--explore", "-o", str(tmp_path / "room")]) == 1
    assert "a frontier is left at (" in (told := capsys.readouterr().err) and "looked there in vain" in told
    *views, _home = goals
    assert len(views) > 1
    assert all(hypot(one[0] - other[0], one[1] - other[1]) >= SAME_PLACE for one, other in combinations(views, 2))


def test_a_frontier_with_one_place_to_look_from_is_tried_again_after_somebody_left(tmp_path, monkeypatch):
    drive, view, stood = explorer.go_to, explorer.best_view, []

    async def blocked_once(robot: Robot, goal: Pose, **options: Any) -> None:
        if not any(hypot(goal[0] - x, goal[1] - y) < SAME_PLACE for x, y, _ in stood):
            stood.append(goal)
            raise CommandRefused("somebody stands there")
        await drive(robot, goal, **options)

    def single_place(every: list[Frontier], *more: Any) -> View | None:
        return view([each for each in every if not each.vain], *more)

    monkeypatch.setattr(explorer, "go_to", blocked_once)
    monkeypatch.setattr(explorer, "best_view", single_place)
    name = tmp_path / "room"
    assert execute([*arguments(LASER, OBSTACLE), "--duration", "300", "--explore", "-o", str(name)]) == 0
    assert stood


def test_exploring_goes_on_after_somebody_left_the_only_way(tmp_path, monkeypatch):
    view, looks = explorer.best_view, iter(range(8))
    # somebody stands there at the first eight looks
    monkeypatch.setattr(explorer, "best_view", lambda *given: None if next(looks, None) is not None else view(*given))
    name = tmp_path / "room"
    assert execute([*arguments(LASER, OBSTACLE), "--duration", "300", "--explore", "-o", str(name)]) == 0


def test_a_frontier_that_is_gone_was_not_looked_at_in_vain(tmp_path, capsys, monkeypatch):
    # the border has moved on, before most of what was behind it is known
    monkeypatch.setattr(Frontier, "gone", lambda *_: True)
    monkeypatch.setattr(Frontier, "known", lambda *_: False)
    name = tmp_path / "room"
    assert execute([*arguments(LASER, OBSTACLE), "--duration", "60", "--explore", "-o", str(name)]) == 1
    told = capsys.readouterr().err
    assert "it comes again and again" in told and "in vain" not in told


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--explore", "--set", LASER], "name it with -o"),
        (["-o", "room"], "add --explore"),
        (["--explore", "-o", "there", "--set", LASER], "there.graph already"),
        (["--explore", "-o", "room", "--map", "other", "--set", LASER], "mapping.make (--map) names other"),
        (["--explore", "-o", "room", "--drive", "0.5,0", "--set", LASER], "leave --drive and --source out"),
        (["--explore", "-o", "room"], "no laser is configured; give one"),
    ],
)
def test_what_cannot_work_is_refused(tmp_path, monkeypatch, capsys, options, word):
    monkeypatch.chdir(tmp_path)
    Path("there.graph").touch()
    assert execute([*arguments(), "--duration", "1", *options]) == 2
    assert word in capsys.readouterr().err


def test_without_numba_the_command_that_installs_it_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("txt1.commands.find_spec", lambda module: None)
    assert execute([*arguments(LASER), "--duration", "1", "--explore", "-o", "room"]) == 2
    assert "--explore needs the extra 'fast': " in capsys.readouterr().err
