"""Each field of the shared state has exactly one writer."""

import ast
from pathlib import Path

import txt1.tasks
from txt1.tasks.fields import WRITERS, State

TASKS = Path(txt1.tasks.__file__).parent
PACKAGE = TASKS.parent


def assignments(file: Path) -> set[str]:
    """The fields that a module assigns to, as ``state.<field> = ...`` or in place."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in [t for each in targets for t in (each.elts if isinstance(each, ast.Tuple) else [each])]:
            if isinstance(target, ast.Attribute) and ast.unparse(target.value) in ("state", "self.state"):
                found.add(target.attr)
    return found


def test_every_field_is_written_by_its_one_writer_and_nobody_else() -> None:
    written = {file.stem: assignments(file) for file in TASKS.glob("*.py") if file.stem != "fields"}
    assert {task: fields for task, fields in written.items() if fields} == {
        task: set(fields) for task, fields in WRITERS.items()
    }


def test_nothing_outside_the_tasks_writes_to_the_state() -> None:
    for file in PACKAGE.rglob("*.py"):
        if file.parent != TASKS and "sim" not in file.parts:  # the simulated vehicle has a state of its own
            assert assignments(file) == set(), file


def test_every_field_is_set_from_the_start() -> None:
    state = State()
    assert all(hasattr(state, field) for fields in WRITERS.values() for field in fields)
