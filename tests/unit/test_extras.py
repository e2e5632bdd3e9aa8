"""The extras: at most twelve, and each that the program, a page or an image names is one of them."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
EXTRAS = set(PROJECT["project"]["optional-dependencies"])
INSTALLED = re.compile(r"""['"](?:txt1|\./[\w./-]+\.whl|\.)\[([\w,-]+)\]""")
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "Containerfile", ROOT / "Makefile"]
PAGES = [each for each in PAGES if each.name != "CHANGELOG.md"]


def named_by_the_program() -> Iterator[str]:
    """Each extra that these functions are given; a third argument of `MissingExtra` names a plug-in."""
    place_of = {"need": 1, "MissingExtra": 1, "needs_extra": 0, "installs": 0}
    for file in (ROOT / "txt1").rglob("*.py"):
        text = file.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if any(f"{kind}(" in text for kind in place_of) else ():
            kind = getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
            if isinstance(node, ast.Call) and kind in place_of and (kind == "need" or len(node.args) < 3):
                extra = node.args[place_of[kind]]
                if isinstance(extra, ast.Constant):
                    yield from extra.value.split(",")


def test_there_are_at_most_twelve_and_one_of_them_is_all() -> None:
    assert len(EXTRAS) <= 12
    (every,) = map(Requirement, PROJECT["project"]["optional-dependencies"]["all"])
    assert every.name == "txt1" and every.extras == EXTRAS - {"all"}


def test_each_extra_that_the_program_names_is_one() -> None:
    named = set(named_by_the_program())
    assert {"record", "devices"} <= named <= EXTRAS


def test_each_extra_that_a_page_names_is_one() -> None:
    for page in PAGES:
        text = page.read_text("utf-8")
        named = {extra for found in INSTALLED.findall(text) for extra in found.split(",")}
        named |= set(re.findall(r"\bextra `([\w-]+)`", text))
        assert named <= EXTRAS, page


def test_what_only_the_work_on_it_needs_is_no_extra() -> None:
    assert set(PROJECT["dependency-groups"]) == {"bench", "browser", "coverage", "dev", "docs", "fuzz", "sbom"}
