"""A world that no learner can solve is refused by its setting, with what to set."""

from __future__ import annotations

from pathlib import Path

import pytest

from txt1.config import load
from txt1.errors import ConfigError
from txt1.learning.solvable import refuse_unsolvable

WORLDS = Path(__file__).parents[3] / "config" / "worlds"


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("learning.actions=[[0.3, 0.0], [0.2, 0.0]]", "learning.actions: .* none of them turns; give"),
        ("learning.actions=[[0.0, 0.5], [0.0, 0.0]]", "learning.actions: none of them drives; give"),
        ("sim.room.light=[9, 0]", "sim.room.light: 9, 0 is outside learning.boundary, 8 m; set"),
        ("learning.start_radius=12", "learning.start_radius: 12: every start .* set at most 8"),
        ("learning.goal_radius=2", "learning.goal_radius: 2: every start, .* set less"),
        ("learning.goal_radius=0.01", "learning.goal_radius: 0.01: .* set at least 0.015"),
        (
            "sim.obstacles=[{kind: post, x: 1.25, y: 0, radius: 0.1}]",
            "sim.obstacles: number 0, at 1.25, 0, stands where episodes begin, .* move it",
        ),
    ],
)
def test_what_cannot_be_solved_is_refused(setting: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        refuse_unsolvable(load(None, [setting]).config)


def test_every_world_of_ours_can_be_solved() -> None:
    for file in WORLDS.rglob("*.yaml"):
        refuse_unsolvable(load(file).config)
