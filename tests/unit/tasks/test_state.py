"""Each field of the shared state has exactly one writer."""

import ast
from pathlib import Path

import txt1.tasks
from txt1.tasks.state import State

TASKS = Path(txt1.tasks.__file__).parent
PACKAGE = TASKS.parent


def assignments(tree: ast.AST) -> set[str]:
    """The fields that a piece of source assigns to, as ``state.<field> = ...`` or in place."""
    found: set[str] = set()
    for node in ast.walk(tree):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in [t for each in targets for t in (each.elts if isinstance(each, ast.Tuple) else [each])]:
            if isinstance(target, ast.Attribute) and ast.unparse(target.value) in ("state", "self.state"):
                found.add(target.attr)
    return found


def test_every_field_is_written_by_a_single_task() -> None:
    modules = [ast.parse(file.read_text()) for file in TASKS.glob("*.py")]
    written = [field for module in modules for function in module.body for field in assignments(function)]
    assert sorted(written) == sorted(
        set(vars(State())) - {"bus", "events", "line_faults", "warnings", "_told", "_times"}
    )


def test_nothing_outside_the_tasks_writes_to_the_state() -> None:
    for file in PACKAGE.rglob("*.py"):
        # the simulated vehicle has a state of its own, and a board of 2011 has tasks of its own
        if file.parent != TASKS and "sim" not in file.parts and file.name != "original.py":
            text = file.read_text()
            assert "state." not in text or assignments(ast.parse(text)) == set(), file
