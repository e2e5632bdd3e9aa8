"""Settings that have another name now: in recordings they are translated, in files they are refused by the new name."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, Final

from txt1 import additions

RENAMED: Final[Mapping[str, str]] = {}
"""The present name of a setting or a section of the spine, by the name that it had; additions have theirs."""


def names_now() -> dict[str, str]:
    """Return the present names of all settings that were renamed, by the names that they had."""
    return {**RENAMED, **{old: now for each in additions.known().values() for old, now in each.renamed.items()}}


def name_now(key: str, renamed: Mapping[str, str] | None = None) -> str | None:
    """The present name of a dotted key that was renamed, or that is in a section that was; None of any other."""
    renamed = names_now() if renamed is None else renamed
    parts = key.split(".")
    for end in range(len(parts), 0, -1):
        now = renamed.get(".".join(parts[:end]))
        if now is not None:
            return ".".join((now, *parts[end:]))
    return None


def translated(tree: Mapping[str, Any], renamed: Mapping[str, str] | None = None) -> dict[str, Any]:
    """A recording's configuration with the present names: a nested mapping, or one of values by dotted key."""
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
