"""The page on plug-ins has every example of these tests, word by word."""

from pathlib import Path

from tests.unit.test_pages import FILE, ROOT

SITE = Path(__file__).parent / "site"


def test_the_page_on_plug_ins_has_each_example_as_it_runs_in_the_tests() -> None:
    shown = dict(FILE.findall((ROOT / "docs" / "plugins.md").read_text("utf-8")))
    assert shown == {file.name: file.read_text("utf-8") for file in SITE.glob("*.py")}
