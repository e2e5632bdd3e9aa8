"""SECURITY.md names a test for each promise; each is one."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMED = re.findall(r"`(tests/\S+\.py)::(\w+)`", (ROOT / "SECURITY.md").read_text("utf-8"))


@pytest.mark.parametrize(("file", "name"), NAMED, ids=[name for _, name in NAMED])
def test_a_promise_names_a_test_that_there_is(file: str, name: str) -> None:
    assert re.search(rf"(?m)^(async )?def {name}\(", (ROOT / file).read_text("utf-8"))


def test_each_promise_names_a_test() -> None:
    promises = (ROOT / "SECURITY.md").read_text("utf-8").split("## What is promised", 1)[1].split("\n## ", 1)[0]
    items = promises.split("\n- ")[1:]
    assert len(items) > 10
    assert not [item for item in items if "::test_" not in item]
