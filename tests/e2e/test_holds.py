"""Holds at the robot: a hand that has gone is noticed, and no hold outlives a change of hands."""

from __future__ import annotations

import asyncio

import pytest

from tests.e2e.conftest import Sample
from txt1.control.holding import HANDOVER, HOLD_LASTS
from txt1.record.attached_recorder import PanelHand
from txt1.robot import Robot

TICK = 0.02


async def pushed(robot: Robot, panel: PanelHand, seconds: float, *velocities: float) -> float:
    """The panel sends these velocities in turn, ten times a second; for how long the robot was to move, s."""
    began, moved = robot.now, 0.0
    while robot.now < began + seconds:
        panel.drive(velocities[round(10 * (robot.now - began)) % len(velocities)], 0.0, 0.0)
        await asyncio.sleep(0.1)
        if robot.runtime.state.control.v:
            moved = robot.now - began
    return moved


async def test_a_button_of_the_live_view_that_is_held_for_ever_drives_for_three_seconds(robot: Robot) -> None:
    panel = PanelHand(robot, robot.source("view"))
    assert await pushed(robot, panel, 10.0, 0.5) == pytest.approx(HOLD_LASTS, abs=0.3)
    panel.drive(0.0, 0.0, 0.0)
    assert await pushed(robot, panel, 1.0, 0.5) > 0.9, "after a zero it is a fresh press"
    await asyncio.sleep(1.0)
    assert await pushed(robot, panel, 1.0, 0.5) > 0.9, "after a pause, too"


async def test_a_stick_of_the_live_view_that_moves_keeps_its_hold(robot: Robot) -> None:
    panel = PanelHand(robot, robot.source("view"))
    assert await pushed(robot, panel, 6.0, 0.5, 0.45) > 5.8


@pytest.mark.parametrize(("first", "second"), [("gamepad", "keys"), ("program", "keys"), ("program", "gamepad")])
async def test_a_change_of_hands_passes_through_zero(
    robot: Robot, samples: list[Sample], first: str, second: str
) -> None:
    one = robot.program if first == "program" else robot.source(first)
    other = robot.source(second)
    for _ in range(20):
        one.command(0.5, 0.0)
        await asyncio.sleep(0.05)
    taken = robot.now
    for _ in range(20):
        other.hold(-0.4, 0.0)
        await asyncio.sleep(0.05)
    after = [each for each in samples if each.time > taken + TICK]
    rested = [each.time for each in after if each.command_v == 0.0]
    assert rested and max(rested) - taken >= HANDOVER - TICK
    assert after[-1].command_v == -0.4


async def test_a_hold_from_before_arming_does_not_drive(robot: Robot) -> None:
    pad = robot.source("gamepad")
    robot.disarm("a test")

    async def hold(seconds: float) -> None:
        ends = robot.now + seconds
        while robot.now < ends:
            pad.hold(0.5, 0.0)
            await asyncio.sleep(0.05)

    await hold(1.0)
    robot.arm()
    await hold(1.0)
    assert robot.runtime.state.control.v == 0.0
    pad.release()
    await hold(0.3)
    assert robot.runtime.state.control.v == 0.5
