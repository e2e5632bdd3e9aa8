"""What a newcomer sees in the root, and the changes that wait for a release."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRAGMENT = re.compile(r"[a-z0-9-]+\.(added|changed|fixed|removed|security)\.md")


def test_each_entry_of_the_root_has_a_line_in_contributing(tracked: list[str]) -> None:
    entries = {each.partition("/")[0] for each in tracked}
    page = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    (section,) = re.findall(r"(?ms)^## What lies in the root\n(.*?)^## ", page)
    rows = re.findall(r"(?m)^\| (`.*?) \|", section)
    told = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert sorted(told) == sorted(entries)


def test_each_file_of_changes_has_a_name_that_a_release_takes() -> None:
    there = {file.name: file.read_text("utf-8").strip() for file in (ROOT / "changes").iterdir()}
    assert there.pop("README.md")
    assert [name for name, text in there.items() if not FRAGMENT.fullmatch(name) or not text] == []


def test_what_waits_for_a_release_is_read_in_one_sitting() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    for section in re.findall(r"(?ms)^## Unreleased\n.*?(?=^## )", changelog):
        assert len(section.splitlines()) <= 120
        assert [line for line in section.splitlines() if len(line) > 120] == []


def test_the_files_of_changes_are_shown_together() -> None:
    pytest.importorskip("towncrier")
    words = [sys.executable, "-m", "towncrier", "build", "--draft", "--version", "9.9.9"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "## 9.9.9 (" in done.stdout
    for file in (ROOT / "changes").glob("*.*.md"):
        assert " ".join(file.read_text("utf-8").split()[:5]) in " ".join(done.stdout.split())
