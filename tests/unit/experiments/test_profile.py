"""Profiles are checked, and their mistakes told in one line."""

from pathlib import Path

import pytest

from txt1.errors import ConfigError
from txt1.experiments.profile import load_profile, names


def test_the_thesis_experiments_are_there_and_valid() -> None:
    assert names() == ["angular-steps", "battery-run", "circle-fast", "circle-slow", "linear-steps", "waypoints"]
    for name in names():
        assert load_profile(name).duration > 0.0


def test_the_linear_test_takes_81_seconds() -> None:
    assert load_profile("linear-steps").duration == pytest.approx(9 * 3.0 + 2 * (10.0 + 8.0 + 5.0 + 4.0))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("title: t\nfigure: path\n", "give either steps or waypoints"),
        ("title: t\nfigure: pat\nsteps: [{v: 0, omega: 0, seconds: 1}]\n", "figure: 'pat'"),
        ("title: t\nfigure: path\nsteps: [{v: 2.0, omega: 0, seconds: 1}]\n", r"steps\.0\.v: 2\.0"),
        ("title: t\nfigure: path\nsteps: [{v: .nan, omega: 0, seconds: 1}]\n", r"steps\.0\.v"),
        ("title: t\nfigure: path\nsteps: [{v: 0, omega: 0, second: 1}]\n", "second"),
        ("title: t\nfigure: battery\nsteps: [{v: 0, omega: 0, seconds: 1}]\n", "needs waypoints"),
        ("title: [", "is no YAML"),
        ("- 1\n", "the profile"),
    ],
)
def test_a_mistake_is_told_with_its_place(tmp_path: Path, text: str, complaint: str) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint) as told:
        load_profile(str(file))
    assert "\n" not in str(told.value)


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="did you mean 'linear-steps'"):
        load_profile("linear-step")
