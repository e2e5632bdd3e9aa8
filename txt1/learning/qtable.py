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

from txt1.errors import QTableError
from txt1.file_limits import JSON_MAX, read_text
from txt1.sim.pcg64 import Draws

# Q(s, a): a row for each state, with a number for each action
Table = list[list[float]]

# the sectors of `txt1.learning.light_direction`
STATES: Final = 8
# by index (table 5.2)
ACTIONS: Final = ("right", "straight", "left")

FORMAT: Final = "txt1 Q-table"
VERSION: Final = 1
RELEARN: Final = "take a sound copy, or learn it again with 'txt1 learn'"


def initial(rng: Draws, states: int = STATES, actions: int = len(ACTIONS), spread: float = 0.1) -> Table:
    """Make a table without knowledge: uniform random values in [-spread, spread] (5.4)."""
    values = [float(value) for value in rng.uniform(-spread, spread, states * actions)]
    return [values[s * actions : (s + 1) * actions] for s in range(states)]


def update(q: Table, s: int, a: int, reward: float, s_next: int, alpha: float = 0.3, gamma: float = 0.5) -> float:
    """Update the table in place, and return the temporal difference by which Q(s, a) was wrong, (5.1).

    Q(s, a) <- Q(s, a) + alpha [r + gamma max Q(s', .) - Q(s, a)]
    """
    difference = reward + gamma * max(q[s_next]) - q[s][a]
    q[s][a] += alpha * difference
    return difference


@dataclass(frozen=True)
class StoredTable:
    """A Q-table as a file holds it."""

    # Q(s, a), shape (states, actions): lists, or an array of numpy
    values: Any
    # the agent's notes: JSON values only
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of states and of actions."""
        return len(self.values), len(self.values[0])

    def as_array(self) -> "StoredTable":
        """Return it with an array of numpy as its values."""
        import numpy as np

        return StoredTable(np.array(self.values, float), self.about)

    def shaped(self, states: int, actions: int) -> Any:
        """Return the values; ValueError: their shape is not (states, actions)."""
        for needed, has, what in zip((states, actions), self.shape, ("states", "actions"), strict=True):
            if needed != has:
                raise ValueError(f"has {has} {what} where {needed} are needed")
        return self.values


def table_of(rows: Any) -> Table:
    """Return rows of numbers as lists; ValueError, TypeError: they are no table of finite numbers."""
    if isinstance(rows, str) or any(isinstance(row, str) for row in rows):
        raise ValueError("text in place of numbers")
    table = [[float(number) for number in row] for row in rows]
    if not table or not table[0] or len({len(row) for row in table}) > 1:
        raise ValueError(f"its rows have {', '.join(str(len(row)) for row in table[:9]) or 'no'} numbers")
    if not all(isfinite(number) for row in table for number in row):
        raise ValueError("a number is not finite")
    return table


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
    try:
        values = table_of(table.values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"a Q-table is one row of finite numbers for each state: {error}") from None
    try:
        # as it will be read: keys are strings
        about = json.loads(json.dumps(dict(table.about), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"the notes of a Q-table are no JSON: {error}") from error
    content = {"format": FORMAT, "version": VERSION, "values": values, "about": about}
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
        values, about = table_of(content["values"]), content["about"]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise QTableError(str(path), f"holds no table of numbers: {type(error).__name__}: {error}", RELEARN) from error
    if not isinstance(about, dict):
        raise QTableError(str(path), "holds no table of numbers: its notes are missing", RELEARN)
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
