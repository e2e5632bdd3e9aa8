"""The dialogue of calibration with a person: lines that fit the terminal, and answers that are none."""

import asyncio
import os
import sys
from collections.abc import Callable, Iterator

import pytest

from txt1.errors import ConfigError
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


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], int]]:
    """Answers at the terminal, a line each."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda line: os.write(writing, f"{line}\n".encode())
    os.close(writing)


@pytest.mark.parametrize("word", ["n", "no", "No", "q", "quit"])
async def test_a_person_who_says_no_ends_it_before_anything_turns(answers: Callable[[str], int], word: str) -> None:
    answers(word)
    with pytest.raises(ConfigError, match=f"'{word}': ended; the results so far are kept"):
        await Person().ready("watch", "Watch the wheels: they are about to turn.")


@pytest.mark.parametrize("word", ["", "y", "Yes"])
async def test_only_enter_or_yes_goes_on(answers: Callable[[str], int], capsys: CAPTURED, word: str) -> None:
    answers("banana")
    asyncio.get_running_loop().call_later(0.1, answers, word)
    await Person().ready("blocks", "Put the vehicle on blocks.")
    assert "'banana' is none of Enter or yes to go on, no to end\n" in capsys.readouterr().out


@pytest.mark.parametrize("word", ["no", "stop"])
async def test_any_other_word_ends_a_movement(answers: Callable[[str], int], word: str) -> None:
    answers(word)
    with pytest.raises(ConfigError, match=f"'{word}' is not Enter: ended"):
        await Person().seen("turning", "Press Enter as soon as the wheels turn.")
