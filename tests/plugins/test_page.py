"""The page on plug-ins leads to every example of these tests."""

import re

from tests.unit.test_pages import ROOT

SITE = "tests/plugins/site"


def test_the_page_on_plug_ins_leads_to_each_example() -> None:
    linked = re.findall(rf"\]\(\.\./{SITE}/(\w+\.py)\)", (ROOT / "docs" / "plugins.md").read_text("utf-8"))
    assert sorted(set(linked)) == sorted(file.name for file in (ROOT / SITE).glob("*.py"))
