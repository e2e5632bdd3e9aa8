"""The pictures of learning name no learner: what a learner adds to them stands in its own module."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest

from rigs.figure_texts import faults
from txt1.cli import execute
from txt1.learning import plots, thesis
from txt1.learning.registry import LEARNERS, of_module
from txt1.unknown import brought


def test_the_pictures_import_no_learner_and_name_none() -> None:
    tree = ast.parse(Path(plots.__file__).read_text("utf-8"))
    names = {
        each.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom | ast.Import) for each in node.names
    }
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert not (names | texts) & {*LEARNERS.table, *brought(LEARNERS.group)}


def test_a_learners_module_says_which_way_it_drives_and_whether_its_table_is_shown() -> None:
    assert of_module("thesis", "courses", None) is thesis.courses
    assert of_module("thesis", "TABLE_IS_DRAWN", True)
    assert of_module("ppo", "courses", None) is None, "which is no learner of this repository's plug-ins"


def test_no_text_of_the_pictures_is_cut_or_stands_over_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = pytest.importorskip("matplotlib.figure")
    found: dict[str, list[str]] = {}
    legends: dict[str, list[str]] = {}

    def kept(self: Any, path: Path, **_: object) -> None:
        found[path.name] = faults(self)
        told = [axes.get_legend() for axes in self.axes if axes.get_legend() is not None]
        legends[path.name] = [text.get_text() for legend in told for text in legend.get_texts()]

    monkeypatch.setattr(figure.Figure, "savefig", kept)
    words = ["learn", "--agent", "thesis", "--trials", "2", "--episodes", "4", "--jobs", "1", "--seed", "1"]
    assert execute([*words, "--out", str(tmp_path)]) == 0
    assert found.keys() == {"times.png", "learning_curve.png", "paths.png", "qtable.png"}
    assert not any(found.values()), found
    assert legends["qtable.png"] == ["left", "straight", "right", "sensors", "goal"]
    assert {"each trial", "mean of successes", "optimum"} <= set(legends["learning_curve.png"])


def test_a_learner_that_shows_no_table_has_the_other_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    words = ["learn", "--agent", "locator", "--trials", "1", "--episodes", "1", "--seed", "1", "--out", str(tmp_path)]
    assert execute(words) == 0
    assert {path.name for path in tmp_path.glob("*.png")} == {"times.png", "learning_curve.png", "paths.png"}
