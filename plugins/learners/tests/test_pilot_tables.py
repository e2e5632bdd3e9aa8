"""A stored table of the pilot is refused if its survey cannot be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.config import Config
from txt1.errors import QTableError
from txt1.learning.qtable import save
from txt1.learning.registry import from_table, make
from txt1_learners.sensor_map import HEIGHT, POWER


@pytest.mark.long
def test_a_survey_of_a_light_that_hangs_nowhere_is_refused(tmp_path: Path) -> None:
    table = make("pilot", Config(), rng := np.random.default_rng(1)).table()
    path = tmp_path / "qtable.json"
    save(path, table)
    assert from_table(path, Config(), rng).name == "pilot"
    table.about["knows"]["survey"][HEIGHT] = -1.0
    save(path, table)
    with pytest.raises(QTableError, match="squared height is -1 m2, below 0"):
        from_table(path, Config(), rng)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("survey", lambda knows: knows["survey"].__setitem__(POWER, 40.0)),
        ("survey", lambda knows: knows["survey"].__setitem__(0, 1e300)),
        ("spread", lambda knows: knows["spread"].__setitem__(1, 0.0)),
        ("trust", lambda knows: knows["trust"].__setitem__(1, -1.0)),
        ("goal", lambda knows: knows.__setitem__("goal", -0.5)),
        ("past", lambda knows: knows.__setitem__("past", [[[0.0] * 10]])),
        ("effects", lambda knows: knows["effects"].__setitem__("k", [[1e300, 0.0]] * 17)),
        ("effects", lambda knows: knows["effects"].__setitem__("error", [0.0])),
    ],
)
def test_a_survey_with_numbers_out_of_their_range_is_refused(
    tmp_path: Path, name: str, wrong: Callable[[Any], None]
) -> None:
    """A variance of 0 ended the drive with a singular matrix."""
    table = make("pilot", Config(), rng := np.random.default_rng(1)).table()
    wrong(table.about["knows"])
    save(tmp_path / "qtable.json", table)
    with pytest.raises(QTableError, match=f"keeps '{name}' with numbers out of their range"):
        from_table(tmp_path / "qtable.json", Config(), rng)
