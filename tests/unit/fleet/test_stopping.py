"""A stop of all as its console sees it: who stands, who is stopped, who is not, and who has not answered."""

from __future__ import annotations

import json

import pytest

from txt1.fleet.messages import StopAnswer, stop_of
from txt1.fleet.stopping import Standing, StopOfAll

STANDS, SLOWS, DRIVES = (
    StopAnswer(True, stands=True),
    StopAnswer(True, why="slowing down"),
    StopAnswer(False, why="armed"),
)


@pytest.mark.parametrize(
    ("answers", "standing", "closed", "complete", "told"),
    [
        ({}, Standing(), False, False, "no robot of the fleet is heard"),
        ({"b": STANDS, "a": STANDS}, Standing(("a", "b")), True, True, "stands: a, b"),
        ({"a": SLOWS}, Standing((), (("a", "slowing down"),)), True, False,
         "stopped, not seen to stand: a (slowing down)"),
        ({"a": STANDS, "b": StopAnswer(True)}, Standing(("a",), (("b", ""),)), True, False,
         "stands: a; stopped, not seen to stand: b (it does not say how it goes)"),
        ({"a": STANDS, "b": DRIVES}, Standing(("a",), (), (("b", "armed"),)), False, False,
         "stands: a; not stopped: b (armed)"),
        ({"a": StopAnswer(False)}, Standing((), (), (("a", ""),)), False, False,
         "not stopped: a (it does not say why)"),
        ({"a": STANDS, "b": None}, Standing(("a",), silent=("b",)), False, False, "stands: a; no answer: b"),
        ({"b": None, "a": None}, Standing(silent=("a", "b")), False, False, "no answer: a, b"),
    ],
)  # fmt: skip
def test_a_stop_of_all_names_who_stands_who_does_not_and_who_has_not_answered(
    answers: dict[str, StopAnswer | None], standing: Standing, closed: bool, complete: bool, told: str
) -> None:
    stop = StopOfAll([], 7.0)
    for name, answer in answers.items():
        if answer is None:
            stop.expect([name])
        else:
            stop.answered(name, answer)
    assert stop.standing() == standing
    assert (standing.closed, standing.complete, str(standing)) == (closed, complete, told)


def test_the_newest_answer_of_each_robot_counts_and_who_was_expected_stays_so() -> None:
    stop = StopOfAll(["a"], 7.0)
    stop.expect(["b"])
    assert stop.began == 7.0 and stop.standing() == Standing(silent=("a", "b"))
    for answer, standing in (
        (STANDS, Standing(("a",), silent=("b",))),
        (DRIVES, Standing((), (), (("a", "armed"),), ("b",))),
        (SLOWS, Standing((), (("a", "slowing down"),), (), ("b",))),
    ):
        stop.answered("a", answer)
        assert stop.standing() == standing


def test_every_stop_has_an_identity_of_its_own_that_others_read() -> None:
    own = [StopOfAll([], 0.0).identity for _ in range(3)]
    assert len(set(own)) == 3
    assert [stop_of(json.dumps({"from": "a", "stop": each}).encode()) for each in own] == own
