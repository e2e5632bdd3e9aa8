"""Each figure of README and the benchmarks' page says how it was measured, and one that has grown old is listed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from docs import figures


@pytest.mark.parametrize("page", figures.PAGES)
def test_each_row_names_its_command_its_commit_and_its_day(page: str) -> None:
    assert len(figures.figures(page)) >= 3


def test_what_the_commands_measure_is_there() -> None:
    for parts in figures.PARTS.values():
        for part in parts:
            assert (figures.ROOT / part).exists(), part


def git(folder: Path, *words: str) -> str:
    options = ("-c", "user.name=t", "-c", "user.email=t@localhost", "-c", "commit.gpgsign=false")
    return subprocess.run(
        ["git", *options, *words], cwd=folder, check=True, capture_output=True, text=True
    ).stdout.strip()


def committed(folder: Path, file: str) -> str:
    path = folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{path.exists()} {len(file)}")
    git(folder, "add", "-A")
    git(folder, "commit", "-m", f"changes {file}")
    return git(folder, "rev-parse", "--short", "HEAD")


@pytest.mark.skipif(shutil.which("git") is None, reason="did not run: git is not installed")
def test_a_figure_is_older_once_what_it_measures_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "-q")
    commit = committed(tmp_path, "txt1/sim/vehicle.py")
    for page in figures.PAGES:
        (tmp_path / page).parent.mkdir(parents=True, exist_ok=True)
        row = f"| speed | 1000 | `python -m benchmarks robots`, {commit}, 2026-11-29 |"
        (tmp_path / page).write_text(f"| figure | txt1 | measured |\n|---|---|---|\n{row}\n")
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    committed(tmp_path, "docs/other.md")
    assert figures.main() == 0
    committed(tmp_path, "txt1/kernel/clock.py")
    assert figures.main() == 1
    out = capsys.readouterr().out
    assert "README.md: speed" in out and "changes txt1/kernel/clock.py" in out


def test_a_row_that_does_not_say_how_it_was_measured_is_a_mistake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "README.md").write_text("| figure | txt1 | measured |\n|---|---|---|\n| speed | 1000 | yesterday |\n")
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    with pytest.raises(ValueError, match=r"README\.md: speed: 'yesterday' is no"):
        figures.figures("README.md")
