"""Contenders beside each other: what the raw file becomes, and when it is carried on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Any

import pytest

from rigs.figure_texts import faults
from tests.size import ROOT
from txt1.config import Config, load
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.trials.provenance import provenance
from txt1.trials.run import run
from txt1_learners.studies import compare, contenders, obstacles, thesis

CONFIG = load().config
QUICK, SLOW, LOST = [5.0, 1, 4.0, 4.5], [9.0, 1, 4.0, 4.5], [300.0, 0, 4.0, 4.5]  # time, success, optimum, floor


def line(rows: list[list[float]], name: str = "pilot", number: int = 1) -> dict[str, Any]:
    return {"contender": name, "trial": number, "code": "0123", "curve": [[0.0, rows]]}


def raw(file: Path, lines: list[dict[str, Any]], **other: Any) -> Path:
    told = CONFIG.model_dump(mode="json", exclude={"seed"})
    head = {
        "format": compare.FORMAT,
        "version": 1,
        "seed": 1,
        "episodes": 12,
        "columns": contenders.COLUMNS,
        "config": told,
        "provenance": provenance(),
    } | other
    file.write_text("".join(json.dumps(each) + "\n" for each in [head, *lines]))
    return file


def test_a_failure_is_counted_and_is_in_no_ratio() -> None:
    one = contenders.figures([line([LOST] * 7 + [QUICK] * 4 + [LOST])])
    assert (one["episodes"], one["failures"], one["success"]) == (5, 1, 0.8)
    assert one["to_floor"] == pytest.approx(5.0 / 4.5) and one["to_optimum"] == pytest.approx(1.25)
    assert one["driven"] == 7 * 300.0 + 4 * 5.0 + 300.0, "the robot drove them"


def test_no_text_of_the_picture_is_cut_or_over_another(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = pytest.importorskip("matplotlib.figure")
    found: list[list[str]] = []
    monkeypatch.setattr(figure.Figure, "savefig", lambda self, path: found.append(faults(self)))
    contenders.draw(Path("compared.png"), compare.read(ROOT / "docs/results/learning/compared.jsonl")[1])
    assert found == [[]]


def here(work: Callable[[Any], Any], trials: Mapping[Any, Any], keep: Callable[[Any, Any], None]) -> int:
    """Where the work is done: here."""
    return run(work, trials, None, keep)


def test_who_is_skilled_has_ten_in_a_row_near_the_floor_and_the_seconds_before_count() -> None:
    assert contenders.until_skill(line([LOST, SLOW, SLOW] + [QUICK] * 10)) == 309.0
    assert contenders.until_skill(line([QUICK] * 9 + [LOST] + [QUICK] * 9)) == inf
    assert contenders.until_skill(line([SLOW] * 12)) == inf
    trained = {"contender": "ppo", "trial": 1, "curve": [[100.0, [LOST] * 10], [200.0, [QUICK] * 10]]}
    assert contenders.until_skill(trained) == 200.0


def test_who_never_reaches_the_light_has_no_ratio_and_comes_first_in_the_table(tmp_path: Path) -> None:
    head, lines = compare.read(raw(tmp_path / "a.jsonl", [line([QUICK] * 12), line([LOST] * 12, "thesis")]))
    rows = contenders.table(head, lines).splitlines()
    assert rows[2].startswith("| thesis | ") and "| 0.00 % (" in rows[2] and "| - |" in rows[2] and "never" in rows[2]
    assert rows[3].startswith("| pilot | ") and "| 100.00 % (" in rows[3] and "1.111" in rows[3]


def test_a_whole_file_is_reported_on_and_a_line_cut_off_is_left_out(tmp_path: Path) -> None:
    file = raw(tmp_path / "a.jsonl", [line([QUICK] * 12), line([SLOW] * 12, number=2)])
    file.write_text(file.read_text() + '{"contender": "pil')
    lines, _ = compare.compare(file, ["pilot"], CONFIG, 2, 12, 1, here)
    assert [each["trial"] for each in lines] == [1, 2]
    table = file.with_suffix(".md").read_text()
    assert "| pilot | " in table and "| 2 |\n" in table and "Code 0123 (pilot)" in table, "other code than this is told"
    assert file.with_suffix(".png").stat().st_size > 10_000
    assert len(compare.read(file)[1]) == 2


def test_the_table_is_the_same_in_whatever_order_the_trials_were_done(tmp_path: Path) -> None:
    some = [[QUICK] * 12, [SLOW] * 12, [QUICK] * 11 + [LOST], [QUICK, SLOW] * 6]
    lines = [line(rows, name, number) for name in ("pilot", "sweeps") for number, rows in enumerate(some)]
    head, every = compare.read(raw(tmp_path / "a.jsonl", lines))
    assert contenders.table(head, every[::-1]) == contenders.table(head, every)


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({"seed": 2}, "another seed"),
        ({"config": {"sim": {"light": {"noise": 0.0}}}}, "another config"),
        ({"config": {"no such": 1}}, "another config"),
    ],
)
def test_what_was_begun_otherwise_is_not_carried_on(tmp_path: Path, other: dict[str, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=r"a\.jsonl") as caught:
        compare.compare(raw(tmp_path / "a.jsonl", [], **other), ["pilot"], CONFIG, 1, 12, 1, here)
    assert told in str(caught.value)


@pytest.mark.parametrize("content", [b"[1]\n", b"null\n", b'{"format": "x"}\n{"x": 1}\n', b"\xe8\xff\n", b"garbage\n"])
def test_a_file_of_something_else_is_refused_in_a_line_by_every_study(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "a.jsonl"
    file.write_bytes(content)
    for study in (
        lambda: compare.compare(file, ["pilot"], CONFIG, 1, 1, 1, here),
        lambda: thesis.study(file, 1, 1, here, print),
        lambda: obstacles.study(file, CONFIG, 1, 1, 1, here, print),
    ):
        with pytest.raises(ConfigError, match=r"a\.jsonl: .*; give another file"):
            study()
    assert file.read_bytes() == content, "nothing was added to it"


def test_a_file_that_did_not_know_a_value_yet_is_carried_on_with_its_default(tmp_path: Path) -> None:
    older = CONFIG.model_dump(mode="json", exclude={"seed": True, "sim": {"battery"}})
    file = raw(tmp_path / "a.jsonl", [line([QUICK] * 12)], config=older)
    assert len(compare.compare(file, ["pilot"], CONFIG, 1, 12, 1, here)[0]) == 1
    assert compare.read(file)[0]["config"] == older, "it says what it was begun with"


@pytest.mark.parametrize("values", [{"odometry.scale": 1.2}, {"learning.goal_radius": 2.0}])
def test_what_is_refused_begins_no_file(tmp_path: Path, values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(values))):
        compare.compare(tmp_path / "a.jsonl", ["pilot"], with_values(CONFIG, values), 1, 1, 1, here)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_comparison_is_done_and_carried_on(tmp_path: Path) -> None:
    told: list[str] = []
    for count in (1, 2):
        compare.compare(
            tmp_path / "a.jsonl",
            ["sweeps", "thesis-10"],
            CONFIG,
            count,
            1,
            1,
            here,
            lambda x: told.append(contenders.told(x)),
        )
    assert len(told) == 4
    assert {(each["contender"], each["trial"]) for each in compare.read(tmp_path / "a.jsonl")[1]} == {
        (name, k) for name in ("sweeps", "thesis-10") for k in (1, 2)
    }


@pytest.mark.long
def test_homing_is_a_contender_and_all_are_asked_for_the_goal_alike() -> None:
    config = with_values(Config(), {"sim.light.noise": 0.0})
    one = compare.run("homing", 1, config, 3, 1)
    (_, rows) = one["curve"][0]
    assert len(rows) == 3 and all(success for _, success, _, _ in rows)
    times = [row[0] for row in compare.run("thesis", 1, config, 6, 1)["curve"][0][1]]
    assert any(round(10.0 * time) % 5 for time in times)  # not at its own decisions alone, which are 0.5 s apart


@pytest.mark.long
def test_a_world_is_compared_in_too_beside_the_floor_without_what_it_does_not_know(tmp_path: Path) -> None:
    post = {"sim.obstacles": [{"kind": "post", "x": 4.0, "y": 0.0, "radius": 0.1}]}
    moving = {"learning.world": "composed", "learning.world_options": {"lamps": [{"velocity": [0.05, 0.0]}]}}
    config = with_values(Config(), post | moving | {"sim.light.noise": 0.0})
    (found,), code = compare.compare(tmp_path / "a.jsonl", ["homing"], config, 1, 3, 1, here)
    plain = compare.run("homing", 1, with_values(Config(), {"sim.light.noise": 0.0}), 3, 1)
    assert code == 0 and found["floor_leaves_out"] == ["sim.obstacles"]
    floors, usual = ([row[3] for row in one["curve"][0][1]] for one in (found, plain))
    assert floors != usual, "the floor knows where the light goes"
    assert "The floor is that without sim.obstacles." in (tmp_path / "a.md").read_text()


def test_the_table_has_seconds_first_then_failures_and_each_learners_inputs() -> None:
    lines = [line([LOST] * 7 + [QUICK] * 3 + [LOST])]
    head, _, row, *_ = contenders.table(
        {"seed": 1, "episodes": 11, "provenance": {"platform": "x"}}, lines
    ).splitlines()
    names, cells = ([each.strip() for each in text.split("|")] for text in (head, row))
    found = dict(zip(names, cells, strict=True))
    assert names[2:5] == ["is told", "seconds, failures with their time", "success"]
    assert float(found["seconds, failures with their time"]) > contenders.figures(lines)["seconds"]
