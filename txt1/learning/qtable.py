"""The Q-table: what is learned, how it is updated (thesis 5.2.1), and the file it is kept in.

The file, qtable.json, holds format, version, `values` (a list for each state, with a number for each action), `about`
(the agent's notes: its name, seed, episodes) and sha256, the checksum of all these. A table that was cut off, altered
or written by another program is refused, and no robot drives by it.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.errors import QTableError
from txt1.file_limits import JSON_MAX, read_text

# Q(s, a), shape (states, actions)
Table = NDArray[np.float64]

# the sectors of `txt1.learning.light_direction`
STATES: Final = 8
# by index (table 5.2)
ACTIONS: Final = ("right", "straight", "left")

FORMAT: Final = "txt1 Q-table"
VERSION: Final = 1
RELEARN: Final = "take a sound copy, or learn it again with 'txt1 learn'"


def initial(rng: np.random.Generator, states: int = STATES, actions: int = len(ACTIONS), spread: float = 0.1) -> Table:
    """Make a table without knowledge: uniform random values in [-spread, spread] (5.4), shape (states, actions)."""
    return rng.uniform(-spread, spread, (states, actions))


def update(q: Table, s: int, a: int, reward: float, s_next: int, alpha: float = 0.3, gamma: float = 0.5) -> float:
    """Update the table in place, and return the temporal difference by which Q(s, a) was wrong, (5.1).

    Q(s, a) <- Q(s, a) + alpha [r + gamma max Q(s', .) - Q(s, a)]
    """
    difference = float(reward + gamma * q[s_next].max() - q[s, a])
    q[s, a] += alpha * difference
    return difference


@dataclass(frozen=True)
class StoredTable:
    """A Q-table as a file holds it."""

    # Q(s, a), shape (states, actions)
    values: Table
    # the agent's notes: JSON values only
    about: Mapping[str, Any] = field(default_factory=dict)

    def shaped(self, states: int, actions: int) -> Table:
        """Return the values; ValueError: their shape is not (states, actions)."""
        for needed, has, what in zip((states, actions), self.values.shape, ("states", "actions"), strict=True):
            if needed != has:
                raise ValueError(f"has {has} {what} where {needed} are needed")
        return self.values

    def kept(self, name: str, shape: tuple[int, ...]) -> Table:
        """Return an array that the agent keeps with the table; ValueError: it has another shape."""
        array = np.array(self.about[name], float)
        if array.shape != shape:
            raise ValueError(f"keeps '{name}' of the shape {array.shape} where {shape} is needed")
        return array


def replace_file(path: Path, text: str) -> None:
    """Write a text to a file; the file is replaced as a whole, or left as it was if this fails."""
    part = path.with_name(path.name + ".part")
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def save(path: Path, table: StoredTable) -> None:
    """Write the table to a file, as `replace_file`.

    Raises QTableError: it cannot be written; ValueError: the values are not finite, no table, or `about` is no JSON.
    """
    values = np.asarray(table.values, float)
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():
        raise ValueError(f"a Q-table is one row of finite numbers for each state; this has the shape {values.shape}")
    try:
        # as it will be read: keys are strings
        about = json.loads(json.dumps(dict(table.about), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"the notes of a Q-table are no JSON: {error}") from error
    content = {"format": FORMAT, "version": VERSION, "values": values.tolist(), "about": about}
    content["sha256"] = _checksum(content)
    lines = ",\n".join(f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items())
    try:
        replace_file(path, f"{{\n{lines}\n}}\n")
    except OSError as error:
        remedy = "give a directory that exists, is yours and has room"
        raise QTableError(str(path), f"cannot be written: {error.strerror}", remedy) from error


def load(path: Path) -> StoredTable:
    """Return the table in a file; raises QTableError: there is no file, or it is not a whole, unaltered Q-table."""
    ours = "give the qtable.json that 'txt1 learn' wrote"
    try:
        content = json.loads(read_text(path, JSON_MAX), parse_float=_finite, parse_constant=_finite)
    except OSError as error:
        raise QTableError(str(path), f"cannot be read: {error.strerror}", ours) from error
    except (ValueError, RecursionError) as error:
        raise QTableError(str(path), f"is cut off, or no Q-table: {error}", RELEARN) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise QTableError(str(path), "is JSON, but no Q-table", ours)
    if (version := content.get("version")) != VERSION:
        problem = f"has the version {version!r}, this program reads {VERSION}"
        raise QTableError(str(path), problem, "use the txt1 that wrote it")
    if content.pop("sha256", None) != _checksum(content):
        raise QTableError(str(path), "was altered after it was written: its checksum does not match", RELEARN)
    # the checksum only shows that the file was not altered by chance; the table may still be wrong
    try:
        values, about = np.array(content["values"], float), content["about"]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise QTableError(str(path), f"holds no table of numbers: {type(error).__name__}: {error}", RELEARN) from error
    if values.ndim != 2 or not values.size or not np.isfinite(values).all() or not isinstance(about, dict):
        raise QTableError(str(path), "holds no table of one row of finite numbers for each state", RELEARN)
    return StoredTable(values, about)


def _finite(text: str) -> float:
    """Return a number of JSON; ValueError: it is infinite or not a number, and no robot may drive by it."""
    if not isfinite(value := float(text)):
        raise ValueError(f"{text} is no finite number")
    return value


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of the content, whatever the file's white space."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
