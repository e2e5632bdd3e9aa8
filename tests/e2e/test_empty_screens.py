"""An empty screen says what to type to fill it."""

import re

import pytest

from txt1.cli import parsed
from txt1.hal.base import Button
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.screens import installed
from txt1.ui.terminal_process import drawn
from txt1.ui.viewer import Viewer

COLOUR = re.compile(r"\x1b\[[\d;]*m")


def snapshot_on(screen: str) -> Snapshot:
    """A plain robot's snapshot with this screen chosen."""
    presses = list(installed()).index(screen)

    async def main() -> Snapshot:
        async with Robot.open() as robot:
            for _ in range(presses):
                robot.press(Button.RIGHT)
            await robot.drive(0.0, 0.0, 0.5)
            return robot.snapshot

    return run(main(), speed="max")


@pytest.mark.parametrize("screen", ["SENSORS", "FLEET"])
@pytest.mark.parametrize(("columns", "rows"), [(60, 20), (80, 24), (120, 40)])
def test_an_empty_screen_has_a_command_that_exists(screen: str, columns: int, rows: int) -> None:
    lines = [COLOUR.sub("", line) for line in drawn(snapshot_on(screen), Viewer(), columns, rows)]
    assert f"[{screen}]" in lines[0]
    typed = [found[1] for line in lines if (found := re.search(r"txt1 ((?:run|fleet|sensor) [^│]*?) *│", line))]
    assert typed, lines
    for words in typed:
        assert parsed(words.split()).main
