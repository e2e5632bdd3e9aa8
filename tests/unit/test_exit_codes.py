"""One exit code for each thing that may happen: one table, which the page, the help and the program share."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from txt1.cli import EPILOG, told
from txt1.commands import DISARMED, EXIT_CODES, FAULT, OK, UNGUARDED, UNSTOPPED, USAGE
from txt1.control.guarding import GuardFault
from txt1.errors import (
    CommandRefused,
    ConfigError,
    HalError,
    MissingExtra,
    MissingPlugin,
    NotArmed,
    RecordingError,
    StopNotVerified,
    TaskFault,
    TerminalLost,
)

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "exit-codes.md"

CASES: dict[str, tuple[Exception, int]] = {
    "hardware": (HalError("the port is silent"), FAULT),
    "task": (TaskFault("mine", ValueError("wrong")), FAULT),
    "terminal": (TerminalLost("gone"), FAULT),
    "damaged file": (RecordingError("damaged"), FAULT),
    "refused command": (CommandRefused("refused"), FAULT),
    "full disk": (OSError(28, "No space left on device"), FAULT),
    "setting": (ConfigError("seed: -1; give more"), USAGE),
    "extra": (MissingExtra("a camera", "camera"), USAGE),
    "plug-in": (MissingPlugin("--ros1", "ros1"), USAGE),
    "not armed": (NotArmed("an empty battery"), DISARMED),
    "stop": (StopNotVerified("it still drives"), UNSTOPPED),
    "guard": (GuardFault("fence", "it returned None"), UNGUARDED),
}


@pytest.mark.parametrize("what", CASES)
def test_each_error_ends_a_command_with_its_own_code_in_one_line(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    error, code = CASES[what]

    def perform() -> int:
        raise error

    assert told(perform) == code
    printed = capsys.readouterr().err
    assert printed.startswith("txt1: ") and printed.count("\n") == 1


def test_the_page_has_the_programs_table() -> None:
    rows = re.findall(r"^\| (\d+) \| (.*?) \|", PAGE.read_text("utf-8"), re.MULTILINE)
    assert {int(code): meaning for code, meaning in rows} == EXIT_CODES


def test_the_help_names_every_code() -> None:
    named = {int(code) for code in re.findall(r"\b(\d) ", EPILOG)}
    assert named == set(EXIT_CODES) and OK in named
