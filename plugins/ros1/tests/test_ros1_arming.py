"""Commands to a robot that nobody has armed, and a robot that arms once by itself."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from benchmarks.board_faults import BOARDS
from txt1 import Robot, run
from txt1.board.board import Board, BoardEvent
from txt1.errors import StopNotVerified
from txt1.sidecar import Request
from txt1_ros1.robot_end import Ros1Desk

IGNORED = "commands of 'ros1' are ignored: the robot is not armed"


class Node:
    """The node, without ROS: it drives, and hears what it is told."""

    def __init__(self, robot: Robot, auto_arm: bool = False) -> None:
        self.robot = robot
        self.end = Ros1Desk(robot, auto_arm)
        self.heard: list[dict[str, Any]] = []
        self.began = False

    def begin(self) -> None:
        self.began = True
        self.end.request(Request("begin", {}, 0.0))

    async def drive(self, v: float | None, duration: float) -> None:
        """Command a speed ten times a second; None commands nothing. The first command may come before it begins."""
        for k in range(round(duration / 0.025)):
            if v is not None and k % 4 == 0:
                self.end.request(Request("drive", {"v": v, "omega": 0.0}, 0.0))
            if not self.began:
                self.begin()
            self.heard += json.loads(self.end.telemetry() or b"{}").get("log", [])
            await asyncio.sleep(0.025)

    def told(self, text: str) -> list[dict[str, Any]]:
        return [each for each in self.heard if text in each["msg"]]


@asynccontextmanager
async def original(auto_arm: bool = False) -> AsyncIterator[tuple[Node, Board]]:
    try:
        async with Robot.open("serial", settings=BOARDS["original"], seed=1, arm=False) as robot:
            await robot.load_gains()
            yield Node(robot, auto_arm), robot.hal.port.board  # type: ignore[attr-defined]
    except StopNotVerified as error:
        # a test that failed
        if error.__cause__ is not None:
            raise error.__cause__ from None


def test_commands_to_a_robot_that_nobody_armed_are_told_once_with_the_way_to_arm_it() -> None:
    async def main() -> None:
        async with original() as (node, _):
            await node.drive(0.3, 3.0)
            (told,) = node.told(IGNORED)
            assert "(not armed yet)" in told["msg"] and "rosservice call /arm" in told["msg"]
            assert told["level"] == 30, "a warning"
            assert told["msg"] in [event.text for event in node.robot.runtime.state.events], "on the terminal, too"
            node.robot.arm()
            await node.drive(0.3, 1.0)
            node.robot.stop()
            await node.drive(0.0, 1.0)
            assert len(node.told(IGNORED)) == 1, "a zero asks for nothing"
            await node.drive(0.3, 1.0)
            assert len(node.told(IGNORED)) == 2, "once more after each stop"

    run(main(), speed="max")


@pytest.mark.parametrize("v", [0.0, None], ids=["zeros", "silence"])
def test_it_arms_by_itself_after_a_second_of_zeros_or_silence(v: float | None) -> None:
    async def main() -> None:
        async with original(auto_arm=True) as (node, _):
            await node.drive(0.3, 3.0)
            assert not node.robot.armed, "a program that drives already would move it at once"
            assert "send zeros, or nothing, for 1 s" in node.told(IGNORED)[0]["msg"]
            await node.drive(v, 0.9)
            assert not node.robot.armed
            await node.drive(v, 0.2)
            assert node.robot.armed
            assert "programs of ROS may move it from now on" in node.told("armed by itself")[0]["msg"]
            await node.drive(0.3, 2.0)
            assert node.robot.odometry.v > 0.2

    run(main(), speed="max")


def test_without_the_option_it_never_arms_by_itself() -> None:
    async def main() -> None:
        async with original() as (node, _):
            await node.drive(None, 5.0)
            assert not node.robot.armed

    run(main(), speed="max")


def test_it_does_not_arm_by_itself_while_the_car_rolls() -> None:
    async def main() -> None:
        async with original(auto_arm=True) as (node, board):
            for _ in range(15):
                x, y, theta, _, *rest = board.vehicle.motion
                board.vehicle.motion = x, y, theta, 0.3, *rest  # pushed
                await node.drive(None, 0.2)
                assert not node.robot.armed

    run(main(), speed="max")


@pytest.mark.parametrize("what", ["disarm", "stop", "fault"])
def test_after_a_stop_it_is_never_armed_by_itself_again(what: str) -> None:
    async def main() -> None:
        async with original(auto_arm=True) as (node, board):
            await node.drive(None, 2.0)
            assert node.robot.armed
            if what == "fault":
                board.happen(BoardEvent("encoders", 0.0))
                await node.drive(0.6, 3.0)
            else:
                getattr(node.robot, what)()
            await node.drive(0.0, 5.0)
            assert not node.robot.armed

    run(main(), speed="max")


@pytest.mark.parametrize("what", ["stop", "board", "node"])
def test_a_stop_or_a_restart_before_leaves_arming_to_a_person(what: str) -> None:
    async def main() -> None:
        async with original(auto_arm=True) as (node, board):
            await node.drive(0.3, 1.0)
            if what == "stop":
                node.robot.stop()
            elif what == "board":
                board.happen(BoardEvent("restart", 1.0))
                await node.drive(0.3, 1.0)
            else:
                node.end.lost()
                await asyncio.sleep(2.0)
                node.begin()
            await node.drive(0.0, 5.0)
            assert not node.robot.armed
            (told,) = node.told("does not arm by itself any more")
            assert "call /arm" in told["msg"]
            assert "zeros" not in node.end.how_to_arm(), "they help no more"

    run(main(), speed="max")
