"""Profiles are checked, and their mistakes told in one line."""

import tomllib
from pathlib import Path

import pytest

from txt1.errors import ConfigError
from txt1.experiments.profile import EXAMPLE, load_profile, names


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
        ("title: waypoints\nfigure: [", r":2:10: is no YAML"),
        ("- 1\n", "holds no profile"),
        ("", "holds no profile"),
        ("title: t\nfigure: waypoints\nwaypoints: {points: [[0, 0], [1]]}\n", r"waypoints\.points\.1\.1"),
        (
            "title: t\nfigure: waypoints\nwaypoints: {points: [[0, 0], [1, 0], [1, 0]]}\n",
            r"points\.1 ends where it begins",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place(tmp_path: Path, text: str, complaint: str) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint) as told:
        load_profile(str(file))
    assert "\n" not in str(told.value)


def test_the_example_that_a_mistake_is_answered_with_is_a_profile(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(EXAMPLE.removeprefix("for example "))
    assert load_profile(str(file)).duration == 10.0


def test_a_wheel_takes_the_thesis_experiments_along() -> None:
    root = Path(__file__).parents[3]
    globs = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    taken = {file.resolve() for glob in globs["txt1.experiments"] for file in (root / "txt1/experiments").glob(glob)}
    assert {file.stem for file in taken} == set(names())


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="did you mean 'linear-steps'"):
        load_profile("linear-step")
