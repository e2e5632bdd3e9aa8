"""A world that no learner can solve is refused by its setting, with what to set."""

from __future__ import annotations

import pytest

from txt1.config import load
from txt1.errors import ConfigError
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.world_presets import ours, world_named


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
        (
            "sim.obstacles=[{kind: post, x: 0, y: 0, radius: 0.6}]",
            "sim.obstacles: number 0, at 0, 0, keeps the robot from the goal, 0.5 m around the light; move it",
        ),
    ],
)
def test_what_cannot_be_solved_is_refused(setting: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        refuse_unsolvable(load(None, [setting]).config)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (["sim.room.map=corridor"], "learning.start_radius: 1.25: episodes begin .* a wall of the map corridor; set"),
        (["sim.room.map=corridor", "sim.room.light=[0, 3]"], "sim.room.light: 0, 3 is in a wall of the map corridor"),
    ],
)
def test_a_start_or_a_light_in_a_wall_is_refused(settings: list[str], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        refuse_unsolvable(load(None, settings).config)


def test_a_map_with_room_around_the_light_is_not_refused() -> None:
    refuse_unsolvable(load(None, ["sim.room.map=hall"]).config)


def test_every_world_of_ours_can_be_solved() -> None:
    for name in ours():
        refuse_unsolvable(load(world_named(name)).config)
