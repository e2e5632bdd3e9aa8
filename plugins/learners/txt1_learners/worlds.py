"""The worlds of worlds.yaml: those that change in mid-trial, and the hostile ones."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from txt1.learning.world_presets import in_file, ours

Worlds = Mapping[str, Mapping[str, Any]]


@cache
def groups() -> Mapping[str, Worlds]:
    """Return the worlds in the groups that a study takes: the usual ones, txt1's own among them, and the hostile."""
    here = in_file(Path(__file__).with_name("worlds.yaml"))
    return {"usual": {**ours(), **here["changing"]}, "hostile": here["hostile"]}


def every() -> Worlds:
    """Return all worlds by name."""
    return {name: one for group in groups().values() for name, one in group.items()}
