"""The dialogue of calibration with a person: lines that fit the terminal, and answers that are none."""

import asyncio
import os
import sys

import pytest

from txt1.experiments.command.calibrate import Person

CAPTURED = pytest.CaptureFixture[str]


async def test_a_wrong_answer_is_told_with_the_right_ones(monkeypatch: pytest.MonkeyPatch, capsys: CAPTURED) -> None:
    reading, writing = os.pipe()
    os.write(writing, b"maybe\n")
    asyncio.get_running_loop().call_later(0.1, os.write, writing, b"back\n")
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert await Person().choose("turned", "Which way did the wheels turn?", ("forward", "backward")) == "backward"
    os.close(writing)
    assert "'maybe' is none of forward, backward\n" in capsys.readouterr().out


def test_lines_break_between_words_on_a_terminal(monkeypatch: pytest.MonkeyPatch, capsys: CAPTURED) -> None:
    text = "Watch the wheels: they are about to turn slowly, one way and then the other. Enter when it is so:"
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    Person().tell(text)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and max(map(len, lines)) < 60
    assert " ".join(line.strip() for line in lines) == text
