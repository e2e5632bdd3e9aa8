"""`make steady` goes on where it was ended, and tells what failed in any round."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests import steady
from tests.steady import ROUNDS, Round

QUIET: dict[str, Any] = {"seconds": 1, "passed": 7, "failed": []}


@pytest.fixture
def go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Runs it with rounds of the test's making."""
    monkeypatch.setattr(steady, "KEPT", tmp_path / "build" / "steady.json")

    def go(ran: Callable[[Round], dict[str, Any]], *words: str, state: str = "these files") -> int:
        monkeypatch.setattr(steady, "ran", ran)
        monkeypatch.setattr(steady, "state", lambda: state)
        monkeypatch.setattr(sys, "argv", ["steady", *words])
        return steady.main()

    return go


def test_tests_that_wait_run_20_times_and_the_whole_suite_5_times() -> None:
    (loaded,) = [each for each in ROUNDS if each.busy == 30]
    assert steady.CONFORMANCE in loaded.words and steady.WAITING in loaded.words
    waiting = [each for each in ROUNDS if "waits" in " ".join(each.words[0]) and each is not loaded]
    assert (len(waiting), sum(each.busy == 4 for each in waiting)) == (20, 5)
    others = [each.words for each in ROUNDS if each not in waiting and each is not loaded]
    assert others == [(steady.SUITE, steady.BROWSER)] * 5


def test_it_goes_on_after_an_interruption_and_begins_anew_with_other_files(go: Callable[..., int]) -> None:
    seen: list[Round] = []

    def interrupted(one: Round) -> dict[str, Any]:
        if len(seen) == 3:
            raise KeyboardInterrupt
        seen.append(one)
        return QUIET

    def run(one: Round) -> dict[str, Any]:
        seen.append(one)
        return QUIET

    with pytest.raises(KeyboardInterrupt):
        go(interrupted)
    assert go(run) == 0
    assert tuple(seen) == ROUNDS
    assert go(run) == 0 and len(seen) == len(ROUNDS)
    assert go(run, state="other files") == 0 and len(seen) == 2 * len(ROUNDS)
    assert go(run, "--anew") == 0 and len(seen) == 3 * len(ROUNDS)


def test_a_failure_in_one_round_is_the_verdict_and_the_rest_runs_nevertheless(
    go: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    failed = QUIET | {"failed": ["tests/unit/test_x.py::test_y"]}
    assert go(lambda one: failed if one is ROUNDS[6] else QUIET) == 1
    told = capsys.readouterr().out.splitlines()
    assert told[6] == "the tests that wait, 6 of 20: 1 s, failed: tests/unit/test_x.py::test_y"
    assert told[5] == "the tests that wait, 5 of 20 beside 4 busy loops: 1 s, 7 passed"
    assert told[-1] == "1 failures: tests/unit/test_x.py::test_y"
    assert len(told) == len(ROUNDS) + 1
    assert go(lambda one: QUIET) == 1, "as kept"
    assert json.loads(steady.KEPT.read_text())["rounds"][ROUNDS[6].name] == failed


def test_the_short_form_is_one_round_at_a_load_of_30_and_nothing_is_kept(go: Callable[..., int]) -> None:
    seen: list[Round] = []

    def run(one: Round) -> dict[str, Any]:
        seen.append(one)
        return QUIET

    assert go(run, "--short") == 0
    assert seen == [steady.LOADED] and steady.LOADED.busy == 30
    assert not steady.KEPT.exists()
    assert go(lambda one: QUIET | {"failed": ["tests/x.py::test_y"]}, "--short") == 1
