"""Why the car does not obey, as whoever drives it is told: on every screen, with the remedy first."""

import asyncio
import time

import pexpect
import pytest

from rigs.terminals import Watched, start
from txt1.errors import NotArmed
from txt1.hal.base import Button
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.tasks.fields import EVENTS
from txt1.ui.status import notes_of

AT_THE_WALL = ("sim.start=[2.0, 0.0, 0.0]",)


def test_after_a_stop_by_a_safety_rule_a_press_within_a_second_does_not_arm() -> None:
    async def main() -> None:
        async with Robot.open(settings=AT_THE_WALL) as robot:
            await robot.load_gains()
            with pytest.raises(NotArmed):
                await robot.drive(0.5, 0.0, 5.0)
            with pytest.raises(NotArmed, match="look first, then press again: look what is in its way, arm"):
                robot.arm_by_hand()
            await asyncio.sleep(1.0)
            robot.arm_by_hand()
            assert robot.armed
            robot.stop()
            robot.arm_by_hand()
            assert robot.armed, "whoever has stopped it himself need not wait"

    run(main(), speed="max")


def test_a_mode_and_a_switch_that_make_it_disobey_are_told_on_every_screen() -> None:
    async def main() -> list[str]:
        async with Robot.open() as robot:
            robot.press(Button.CENTRE)
            robot.toggle_esc()
            await asyncio.sleep(0.5)
            return list(notes_of(robot.snapshot))

    notes = run(main(), speed="max")
    assert [note[:2] for note in notes] == ["c:", "e:"] and all(len(note) <= 60 for note in notes), notes


def test_what_repeats_is_one_line_with_a_count() -> None:
    async def main() -> list[str]:
        async with Robot.open() as robot:
            for _ in range(17):
                robot.tell("bridge 'web' is silent")
            robot.tell("bridge 'web' answers")
            return [event.text for event in robot.snapshot[EVENTS]][-2:]

    assert run(main(), speed="max") == ["bridge 'web' is silent (17 times)", "bridge 'web' answers"]


def press(watched: Watched, key: bytes, answer: str) -> None:
    """Press a key, and again every few seconds: an answer is on the screen for a while, and gives way to another."""
    again = 0.0

    def seen(text: str) -> bool:
        nonlocal again
        if answer in text:
            return True
        if time.monotonic() >= again:
            again = time.monotonic() + 5.0
            watched.child.send(key)
        return False

    watched.until_seen(seen, answer)


@pytest.mark.parametrize(("columns", "rows"), [(60, 20), (80, 24)])
def test_the_keys_answer_at_once_and_q_after_a_wall_ends_with_0(columns: int, rows: int) -> None:
    child = start(columns, rows, "run", "--screen", "5", "--seed", "1", "--set", AT_THE_WALL[0], "--drive", "0.5,0")
    watched = Watched(child, columns, rows)
    watched.until("[MAP]", "disarmed", "look what is in its way, arm (m), drive back (s)", "a wall of the 5 x 5")
    for key, answer in {
        b"+": "w and s drive 0.",
        b"w": "press m to arm",
        b"c": "c: back to controller mode",
        b"e": "e: switch the ESC on",
    }.items():
        press(watched, key, answer)
    child.send(b"q")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
