"""What the pages tell to type: every command is one, and those of the first hour run as they stand, page by page."""

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from txt1.cli import parsed

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEMPLATE = re.compile(r"\.\.\.|^\[|^[A-Z][A-Z0-9_]+([:=,].*)?$")  # a word that stands for others
FILE = re.compile(r'```\w+ title="([\w.]+)"\n(.*?)```', re.DOTALL)  # one that the reader is to write
TUTORIALS = ("task", "light", "tune", "car", "sensor", "fleet")
PATIENCE = 2.0  # s that a command gets before Ctrl-C, as an operator ends what runs for ever


def commands(page: Path) -> Iterator[list[str]]:
    """The words of each command in a page's blocks of code, without environment and comment."""
    for line in re.findall(r"(?m)^(?: {4,}|)((?:TXT1_\w+=\S+ )?(?:txt1|python) .*)$", page.read_text("utf-8")):
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # a sentence with an apostrophe
            continue
        yield words[1:] if "=" in words[0] else words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_that_a_page_names_is_one(
    page: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    for words in commands(page):
        if words[0] != "txt1" or any(TEMPLATE.search(word) for word in words):
            continue
        try:
            parsed(words[1 : words.index(">") if ">" in words else None])
        except SystemExit as ended:
            told = capsys.readouterr().err
            assert ended.code == 0 or "there is no file" in told, f"{shlex.join(words)}: {told}"


def run_page(page: Path, folder: Path, without: tuple[str, ...] = ()) -> None:
    """Write the page's files, then run its commands there, one after the other, as a reader without a terminal does."""
    for name, text in FILE.findall(page.read_text("utf-8")):
        (folder / name).write_text(text)
    clean = {name: value for name, value in os.environ.items() if not name.startswith("TXT1_")}
    clean["PYTHONPATH"] = str(ROOT)
    for words in (each for each in commands(page) if each[1] not in without):
        program = [sys.executable, "-m", "txt1"] if words[0] == "txt1" else [sys.executable]
        output = None
        if ">" in words:
            words, output = words[: words.index(">")], folder / words[-1]
        with subprocess.Popen(
            [*program, *words[1:]], cwd=folder, env=clean, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True,
        ) as process:  # fmt: skip
            endless = words[:2] == ["txt1", "run"] and "--duration" not in words
            try:
                out, err = process.communicate(timeout=PATIENCE if endless else 600.0)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGINT)
                out, err = process.communicate(timeout=30.0)
        assert process.returncode == (130 if endless else 0), f"{shlex.join(words)}: {process.returncode}\n{out}\n{err}"
        if output is not None:
            output.write_text(out)


def test_the_start_page_runs_word_by_word(tmp_path: Path) -> None:
    run_page(ROOT / "docs" / "start.md", tmp_path, without=("demo", "replay"))
    assert (tmp_path / "first.html").stat().st_size > 10_000


@pytest.mark.long
def test_the_demo_and_a_replay_of_the_start_page_run_too(tmp_path: Path) -> None:
    run_page(ROOT / "docs" / "start.md", tmp_path)
    assert (tmp_path / "out" / "demo" / "light.html").exists()


@pytest.mark.long
@pytest.mark.parametrize("name", [f"tutorials/{name}" for name in TUTORIALS] + ["completion"])
def test_a_tutorial_runs_as_it_stands(name: str, tmp_path: Path) -> None:
    run_page(ROOT / "docs" / f"{name}.md", tmp_path)
