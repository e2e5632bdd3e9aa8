"""What sweeps decides is recorded."""

from __future__ import annotations

from math import isnan
from pathlib import Path

import numpy as np
import pytest

from tests.e2e.test_record_learn import CONFIG, OVER, episodes, messages, recorded
from txt1.learning.registry import make


@pytest.mark.long
def test_the_recorded_steps_are_rows_of_its_table(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "--learn", "sweeps")
    steps = messages(path, "/learning/step")
    assert len(steps) > 200
    assert {step.action for step in steps} == {OVER, 0, 1, 2}
    rows = make("sweeps", CONFIG, np.random.default_rng(1)).table().values.shape[0]
    assert all(0 <= step.state < rows and len(step.values) == 3 for step in steps)
    chosen = [step for step in steps if step.episode > 2 and step.action != OVER]
    best = sum(step.action == int(np.argmax(step.values)) for step in chosen)
    assert best > 0.85 * len(chosen), "between cells it weighs the neighbours, too"
    assert all(isnan(group[0].reward) for group in episodes(steps)), "nothing came of anything yet"
