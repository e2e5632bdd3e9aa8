"""Pages, examples and skeletons import public modules only; so do plug-ins, but for those that are listed here."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
API: Final = (ROOT / "docs/reference/api.md").read_text("utf-8")
PUBLIC: Final = {
    name for row in re.findall(r"^\| (`txt1.*?) \|", API, re.MULTILINE) for name in re.findall(r"`([\w.]+)`", row)
}
IMPORT: Final = re.compile(r"^ *(?:from txt1[\w.]* import .*|import txt1.*)$", re.MULTILINE)
PAGES: Final = sorted(
    each
    for each in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "txt1/hal/skeleton").glob("*.txt"))
    if IMPORT.search(each.read_text("utf-8"))
)
EXAMPLES: Final = sorted((ROOT / "examples").rglob("*.py"))
NOT_PUBLIC: Final[dict[str, tuple[str, set[str]]]] = {
    "learners": (
        "trials of many robots in lockstep compute with the same task, physics and control as the running robot",
        {
            "txt1.cli",
            "txt1.commands",
            "txt1.config.schema",
            "txt1.config.sources",
            "txt1.control.car",
            "txt1.control.pid",
            "txt1.kit.options",
            "txt1.learning.batch",
            "txt1.learning.experiment",
            "txt1.learning.light_direction",
            "txt1.learning.modelled_settings",
            "txt1.learning.qtable",
            "txt1.learning.registry",
            "txt1.learning.settings",
            "txt1.learning.solvability",
            "txt1.learning.task",
            "txt1.learning.world_presets",
            "txt1.model.kinematics",
            "txt1.model.light_sensors",
            "txt1.sensors.sim_laser",
            "txt1.sensors.sim_vicon",
            "txt1.sim.batch",
            "txt1.sim.dynamics",
            "txt1.sim.lamp",
            "txt1.sim.machine_code",
            "txt1.sim.obstacles",
            "txt1.sim.parameters",
            "txt1.sim.rays",
            "txt1.sim.room",
            "txt1.sim.shadow",
            "txt1.trials.provenance",
            "txt1.trials.run",
            "txt1.trials.workers",
        },
    ),
    "browser": (
        "it is the robot's end and the page's server in one process, on an event loop of its own",
        {
            "txt1.bridges.registry",
            "txt1.bridges.services",
            "txt1.cli",
            "txt1.commands",
            "txt1.hal.serial",
            "txt1.kernel.clock",
            "txt1.kernel.loop",
            "txt1.kernel.ticks",
            "txt1.learning.live_learner",
            "txt1.learning.options",
            "txt1.learning.registry",
            "txt1.link.base",
            "txt1.protocol.layout",
            "txt1.protocol.messages",
            "txt1.record.session",
            "txt1.resources",
            "txt1.web.budgets",
            "txt1.web.pages",
            "txt1.web.player",
            "txt1.web.requests",
        },
    ),
    "lerobot": (
        "an exporter reads recordings",
        {
            "txt1.commands",
            "txt1.control.hand",
            "txt1.model.vehicle",
            "txt1.record.reader",
        },
    ),
    "physics": (
        "it takes the place of the dynamics in the simulation",
        {
            "txt1.model.kinematics",
            "txt1.model.vehicle",
            "txt1.sim.batch",
            "txt1.sim.dynamics",
            "txt1.sim.machine_code",
        },
    ),
    "ros1": (
        "a node of ROS shares the calls, times and messages of ROS 2's",
        {
            "txt1.bridges.registry",
            "txt1.commands",
            "txt1.control.pid",
            "txt1.control.schedule",
            "txt1.kernel.clock",
            "txt1.kernel.loop",
            "txt1.model.battery",
            "txt1.record.reader",
            "txt1.record.settings",
            "txt1.ros.calls",
            "txt1.ros.node",
            "txt1.ros.python",
            "txt1.ros.topics",
            "txt1.sensors.mounts",
            "txt1.tasks.fields",
        },
    ),
}
"""By plug-in: why it looks inside, and where."""


def imports(code: str) -> Iterator[tuple[str, str]]:
    """Each module of txt1 that is imported, with the name that is taken from it; "" for the module itself."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            yield from ((each.name, "") for each in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            for each in node.names:
                inside = f"{node.module}.{each.name}"
                path = ROOT.joinpath(*inside.split("."))
                there = path.is_dir() or path.with_suffix(".py").exists()
                yield (inside, "") if there else (str(node.module), each.name)


def ours(code: str) -> list[tuple[str, str]]:
    return [each for each in imports(code) if each[0].partition(".")[0] == "txt1"]


def offered(module: str) -> set[str] | None:
    """Its `__all__`; None if it has none."""
    path = ROOT.joinpath(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    for node in ast.parse(file.read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return set(ast.literal_eval(node.value))
    return None


def not_public(found: list[tuple[str, str]]) -> list[str]:
    told = []
    for module, name in found:
        names = offered(module) if module in PUBLIC else set()
        if module not in PUBLIC or (name and names is not None and name not in names):
            told.append(f"{module}: {name}")
    return told


def test_each_public_module_is_there() -> None:
    assert len(PUBLIC) > 20
    assert "Robot" in (offered("txt1") or ())
    for name in PUBLIC:
        offered(name)


@pytest.mark.parametrize("page", PAGES, ids=[each.name for each in PAGES])
def test_a_page_or_a_skeleton_imports_public_names_only(page: Path) -> None:
    code = "\n".join(dedent(each) for each in IMPORT.findall(page.read_text("utf-8")))
    assert not_public(ours(code)) == []


@pytest.mark.parametrize("file", EXAMPLES, ids=[each.name for each in EXAMPLES])
def test_an_example_imports_public_names_only(file: Path) -> None:
    assert not_public(ours(file.read_text("utf-8"))) == []


@pytest.mark.parametrize("plugin", NOT_PUBLIC)
def test_a_plugin_looks_inside_where_it_is_listed_and_nowhere_else(plugin: str) -> None:
    files = [each for each in (ROOT / "plugins" / plugin).rglob("*.py") if "tests" not in each.parts]
    assert files
    used = {module for each in files for module, _ in ours(each.read_text("utf-8"))}
    assert used - PUBLIC == NOT_PUBLIC[plugin][1]
