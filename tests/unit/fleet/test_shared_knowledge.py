"""What a robot hears of others' learning is checked before it is believed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.fleet.shared_knowledge import NUMBERS_MAX, learned_of
from txt1.learning.agent import Learned


@given(st.lists(st.lists(st.floats(-1e9, 1e9), min_size=2, max_size=2), min_size=1, max_size=9), st.integers(0, 10**9))
def test_what_was_learned_survives_the_way(rows: list[list[float]], count: int) -> None:
    sound = Learned("thesis", count, (count,) * len(rows), tuple(map(tuple, rows)))  # type: ignore[arg-type]
    assert learned_of({**sound._asdict(), "from": "txt01"}) == sound


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"rows": [[float("nan")], [1.0]]}, "number nan in row 0"),
        ({"rows": [[1.0], [float("-inf")]]}, "number -inf in row 1"),
        ({"rows": [[1.0], [1e10]]}, "number 1e\\+10 in row 1"),
        ({"rows": [[1.0], [10**400]]}, "is no table: OverflowError"),
        ({"rows": [[1.0], [1.0, 2.0]]}, "not each row is as long"),
        ({"rows": [[1.0]]}, "1 rows, visits of 2"),
        ({"rows": [], "visits": []}, "0 rows"),
        ({"rows": [[0.0] * NUMBERS_MAX] * 2}, f"numbers, more than {NUMBERS_MAX}"),
        ({"rows": "all of them"}, "is no table: ValueError"),
        ({"rows": None}, "is no table: TypeError"),
        ({"visits": [1, -1]}, "counts -1 visits"),
        ({"visits": [1, 10**12]}, "visits or episodes"),
        ({"episodes": -3}, "counts -3"),
        ({"learner": "x" * 1000}, "by 1000 letters"),
    ],
)
def test_what_is_no_table_is_refused_and_why(change: dict[str, object], why: str) -> None:
    sound = {"learner": "thesis", "episodes": 1, "visits": [1, 1], "rows": [[1.0], [2.0]]}
    assert learned_of(sound)
    with pytest.raises(ValueError, match=why):
        learned_of({**sound, **change})
    with pytest.raises(ValueError, match="is no table: KeyError"):
        learned_of({})
