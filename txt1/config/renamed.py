"""Renamed settings: translated in a recording, refused in a file by an error that gives the new name."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, Final

from txt1 import additions

RENAMED: Final[Mapping[str, str]] = {}
"""New name of a renamed setting or section of the spine, by its former name; additions have their own."""


def names_now() -> dict[str, str]:
    """Return the new names of all renamed settings, by their former names."""
    return {**RENAMED, **{old: now for each in additions.known().values() for old, now in each.renamed.items()}}


def name_now(key: str, renamed: Mapping[str, str] | None = None) -> str | None:
    """Return the new name of a dotted key that was renamed, or whose section was; None for any other key."""
    renamed = names_now() if renamed is None else renamed
    parts = key.split(".")
    for end in range(len(parts), 0, -1):
        now = renamed.get(".".join(parts[:end]))
        if now is not None:
            return ".".join((now, *parts[end:]))
    return None


def translated(tree: Mapping[str, Any], renamed: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return a recording's configuration with the new names: a nested mapping, or values by dotted key."""
    renamed = names_now() if renamed is None else renamed
    found = deepcopy(dict(tree))
    for key in [key for key in found if "." in key]:
        found[name_now(key, renamed) or key] = found.pop(key)
    for old, now in renamed.items():
        *sections, last = old.split(".")
        holder: Any = found
        for name in sections:
            holder = holder.get(name) if isinstance(holder, dict) else None
        if isinstance(holder, dict) and last in holder:
            value = holder.pop(last)
            *sections, last = now.split(".")
            holder = found
            for name in sections:
                holder = holder.setdefault(name, {})
            holder[last] = value
    return found
