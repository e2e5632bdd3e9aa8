"""The two counters of the repository's structure: sizes in statements, and arrows between folders."""

import ast
import re
import tomllib

import pytest

from tests import arrows, size
from tests.arrows import Arrow
from tests.conftest import APART


@pytest.mark.long  # `make lint` asks the same
def test_every_text_that_names_a_module_resolves(capsys: pytest.CaptureFixture[str]) -> None:
    code = arrows.main(["--places"])
    out = capsys.readouterr().out
    assert code == 0, out.partition("texts that do not resolve")[2]
    assert "txt1.robot -> txt1.runtime" in out
    assert "txt1/hal/registry.py" in out


def test_imports_are_told_apart_by_when_they_happen() -> None:
    code = """
from typing import TYPE_CHECKING
from txt1.hal import registry, sim
import json
if TYPE_CHECKING:
    from txt1.robot import Robot
def late():
    import txt1.record.report
"""
    assert arrows.arrows_of("txt1/cli/made_up.py", code) == [
        Arrow("txt1/cli/made_up.py", 3, "import", "txt1.hal.registry"),
        Arrow("txt1/cli/made_up.py", 3, "import", "txt1.hal.sim"),
        Arrow("txt1/cli/made_up.py", 6, "typing", "txt1.robot"),
        Arrow("txt1/cli/made_up.py", 8, "lazy", "txt1.record.report"),
    ]


def test_a_text_is_an_arrow() -> None:
    texts = '"txt1.hal.serial:Port", "mypackage.x:y", f"txt1.cli.{name}", "txt1.hal"'
    assert [each.target for each in arrows.arrows_of("txt1/a.py", texts)] == ["txt1.hal.serial:Port", "txt1.cli"]
    called = f"import_module({texts})"
    assert [each.target for each in arrows.arrows_of("txt1/a.py", called)][-1] == "txt1.hal"


@pytest.mark.parametrize(("module", "name"), [("hall", "Port"), ("hal.serial", "Prot"), ("hal", "create")])
def test_a_text_that_names_nothing_does_not_resolve(module: str, name: str) -> None:
    assert not arrows.resolves(f"txt1.{module}:{name}")


def test_a_text_that_names_nothing_is_told_with_its_place(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrows, "arrows", lambda: [Arrow("txt1/cli/made_up.py", 7, "text", "txt1.gone")])
    assert arrows.main([]) == 1
    assert "txt1/cli/made_up.py:7: 'txt1.gone'" in capsys.readouterr().out


def test_a_text_that_names_a_module_or_a_function_resolves() -> None:
    assert arrows.resolves("txt1.hal.sim")
    assert arrows.resolves("txt1.cars.pi.virtual_pi:virtual_bus")


def test_no_import_is_exempt_from_a_contract() -> None:
    settings = tomllib.loads((size.ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    assert [each["name"] for each in settings["contracts"] if "ignore_imports" in each] == []


def test_all_additions_are_above_the_spine() -> None:
    layers = arrows.layers()
    lies_in = {each: ".".join(each.split(".")[:2]) for each in arrows.additions()}
    assert [each for each, layer in lies_in.items() if arrows.in_spine(layer, layers)] == []
    assert arrows.in_spine("txt1.hal", layers)


@pytest.mark.long
def test_an_opened_robot_is_a_part_of_the_whole(capsys: pytest.CaptureFixture[str]) -> None:
    size.main()
    whole, opened = (int(word) for word in capsys.readouterr().out.splitlines()[-1].split()[:2])
    assert 1000 < opened < whole


def test_no_class_name_stands_for_two_things() -> None:
    where: dict[str, list[str]] = {}
    for file in sorted((size.ROOT / "txt1").rglob("*.py")):
        for name in re.findall(r"^ *class (\w+)[(:\[]", file.read_text("utf-8"), re.MULTILINE):
            where.setdefault(name, []).append(str(file.relative_to(size.ROOT)))
    assert {name: files for name, files in where.items() if len(files) > 1} == {}


def test_the_page_on_the_architecture_has_the_layers_of_the_contract() -> None:
    page = (size.ROOT / "docs" / "architecture.md").read_text("utf-8")
    tree = page.partition("## The tree")[2].partition("\n## ")[0]
    stack = re.findall(r"^    ([a-z_]+(?: · [a-z_]+)*)   +\S", tree, re.MULTILINE)
    layers = arrows.layers()
    told = {f"txt1.{name}": height for height, line in enumerate(reversed(stack)) for name in line.split(" · ")}
    assert told == {name: height for name, height in layers.items() if name != "txt1.__main__"}
    assert len(tree.splitlines()) < 65


def test_code_that_the_formatter_leaves_alone_is_rare() -> None:
    lines = [file.read_text("utf-8").count("# fmt: skip") for file in (size.ROOT / "txt1").rglob("*.py")]
    assert sum(lines) < 40


def test_a_period_names_its_subject() -> None:
    vague = re.compile(r"^(PERIOD|PATIENCE)\b", re.MULTILINE)
    files = (file for top in ("txt1", "plugins/learners") for file in (size.ROOT / top).rglob("*.py"))
    assert [file for file in files if vague.search(file.read_text("utf-8"))] == []


def test_a_name_of_a_number_does_not_stand_for_many_things() -> None:
    where: dict[str, list[str]] = {}
    for file in sorted((size.ROOT / "txt1").rglob("*.py")):
        for name in re.findall(r"(?m)^([A-Z][A-Z0-9_]*)(?:: \w+)? = -?[\d.]", file.read_text("utf-8")):
            where.setdefault(name, []).append(str(file.relative_to(size.ROOT)))
    assert len(where) > 800
    # each format has a version
    assert {name: files for name, files in where.items() if len(files) > 3 and name != "VERSION"} == {}


def test_what_is_compiled_is_there() -> None:
    (named,) = re.findall(r"(?s)^MODULES = (\{.*?^\})", (size.ROOT / "setup.py").read_text("utf-8"), re.MULTILINE)
    modules = [f"txt1/{package}/{name}.py" for package, names in ast.literal_eval(named).items() for name in names]
    assert [each for each in modules if not (size.ROOT / each).is_file()] == []


@pytest.mark.parametrize(
    ("walk", "most"), [("Key to PWM", 15), ("Encoder to file", 10), ("Page to gate", 12), ("Scan to map", 11)]
)
def test_a_walk_through_the_code_is_short_and_names_files(walk: str, most: int) -> None:
    text = (size.ROOT / "docs" / "architecture.md").read_text("utf-8")
    _, told, rest = text.partition(f"**{walk}.**")
    files = re.findall(r"`([a-z_0-9/]+\.(?:py|js))`", rest.partition("\n\n")[0])
    assert told
    assert [file for file in files if not (size.ROOT / "txt1" / file).exists()] == []
    assert 5 <= len(set(files)) <= most


def test_the_names_of_tests_are_short_enough_to_be_read() -> None:
    files = [file for place in ("tests", "plugins") for file in (size.ROOT / place).rglob("test_*.py")]
    names = [name for file in files for name in re.findall(r"def (test_\w+)", file.read_text("utf-8"))]
    assert len(names) > 1000
    assert [name for name in names if len(name) > 80] == []


def test_folders_that_make_test_leaves_out_hold_no_test_that_it_would_run() -> None:
    files = [file for name in APART for file in (size.ROOT / "tests" / name).glob("test_*.py")]
    assert len(files) > 5
    marked = re.compile(r"(?m)^pytestmark = pytest\.mark\.(browser|long)$")
    assert [file.name for file in files if not marked.search(file.read_text("utf-8"))] == []
