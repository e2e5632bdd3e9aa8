"""The Q-table: what is learned, how it is updated (thesis 5.2.1), and the file it is kept in.

The file, qtable.json, is text:

    format      "txt1 Q-table"
    version     1
    values      one list for each state, one number in it for each action
    about       whatever the agent wants to remember with it: its name, seed, episodes
    sha256      checksum of all the above

so that a table that was cut off, altered or written by something else is refused instead of driven by.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.errors import QTableError

Table = NDArray[np.float64]
"""Q(s, a), shape (states, actions)."""

STATES: Final = 8
"""The sectors of `txt1.learning.light`."""
ACTIONS: Final = ("right", "straight", "left")
"""By index (table 5.2)."""

TABLE_5_3: Final = (
    (0.9494, -0.6495, -0.5848),
    (0.7950, -0.0449, -0.2863),
    (0.7120, 0.1365, -0.3091),
    (0.4466, 0.1255, -0.0286),
    (0.8803, 1.4476, 1.1834),
    (0.3014, 0.3008, 0.8993),
    (-0.5585, -0.0546, 1.1205),
    (-0.3775, 0.0077, 0.8443),
)
"""The table of the thesis's robot after 30 episodes (table 5.3); rows by state, columns by action."""

FORMAT: Final = "txt1 Q-table"
VERSION: Final = 1

LARGEST: Final = sys.float_info.max

RELEARN: Final = "take a sound copy, or learn it again with 'txt1 learn'"


def initial(rng: np.random.Generator, states: int = STATES, actions: int = len(ACTIONS), spread: float = 0.1) -> Table:
    """A table that knows nothing: uniform random values in [-spread, spread] (5.4), shape (states, actions)."""
    return rng.uniform(-spread, spread, (states, actions))


def update(q: Table, s: int, a: int, reward: float, s_next: int, alpha: float = 0.3, gamma: float = 0.5) -> float:
    """The temporal difference by which Q(s, a) was wrong; the table is updated in place, (5.1).

    Q(s, a) <- Q(s, a) + alpha [r + gamma max Q(s', .) - Q(s, a)]

    Args:
        q: the table.
        s: state before.
        a: action taken.
        reward: r, received for it.
        s_next: s', state after.
        alpha: learning rate, 0 to 1.
        gamma: discount factor, 0 to 1.

    Raises:
        IndexError: no such state or action.
        ValueError: the result would not be finite; the table is as before.

    """
    states, actions = q.shape
    if not (0 <= s < states and 0 <= a < actions and 0 <= s_next < states):
        raise IndexError(
            f"state {s}, action {a}, next state {s_next}: the table has {states} states, {actions} actions"
        )
    difference = float(reward + gamma * q[s_next].max() - q[s, a])
    value = float(q[s, a]) + alpha * difference
    if not np.isfinite(value):
        raise ValueError(f"Q({s}, {a}) would become {value:g}, with reward {reward:g}")
    q[s, a] = value
    return difference


# -- the file ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StoredTable:
    """A Q-table as a file holds it."""

    values: Table  # Q(s, a), shape (states, actions)
    about: Mapping[str, Any] = field(default_factory=dict)  # what its agent keeps with it: JSON values only

    def shaped(self, states: int, actions: int) -> Table:
        """Return the values, shape (states, actions).

        Raises:
            ValueError: they have another shape.

        """
        for needed, has, what in zip((states, actions), self.values.shape, ("states", "actions"), strict=True):
            if needed != has:
                raise ValueError(f"has {has} {what} where {needed} are needed")
        return self.values


def save(path: Path, table: StoredTable) -> None:
    """Write the table to a file; one that was there is replaced as a whole or, should this fail, left as it was.

    Raises:
        QTableError: the file cannot be written.
        ValueError: the values are not finite or not a table, or `about` is no JSON.

    """
    values = np.asarray(table.values, float)
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():
        raise ValueError(f"a Q-table is one row of finite numbers for each state; this has the shape {values.shape}")
    try:
        about = json.loads(json.dumps(dict(table.about), allow_nan=False))  # as it will be read: keys are strings
    except (TypeError, ValueError) as error:
        raise ValueError(f"what is to be kept with a Q-table is no JSON: {error}") from error
    content = {"format": FORMAT, "version": VERSION, "values": values.tolist(), "about": about}
    content["sha256"] = _checksum(content)
    text = _text(content)
    part = path.with_name(path.name + ".part")
    try:
        with part.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        raise QTableError(
            str(path), f"cannot be written: {error.strerror}", "give a directory that exists, is yours and has room"
        ) from error


def load(path: Path) -> StoredTable:
    """Return the table in a file, checked.

    Raises:
        QTableError: there is no such file, or it is not a whole, unaltered Q-table.

    """
    content = _parse(path)
    if content.get("format") != FORMAT:
        raise QTableError(str(path), "is JSON, but no Q-table", "give the qtable.json that 'txt1 learn' wrote")
    version = content.get("version")
    if version != VERSION:
        raise QTableError(
            str(path), f"has the version {version!r}, this program reads {VERSION}", "use the txt1 that wrote it"
        )
    values = _values(path, content.get("values"))
    about = content.get("about")
    if not isinstance(about, dict):
        raise QTableError(str(path), "says nothing about where it comes from", RELEARN)
    said = content.pop("sha256", None)
    if said != _checksum(content):
        raise QTableError(str(path), "was altered after it was written: its checksum does not match", RELEARN)
    return StoredTable(values, about)


def _parse(path: Path) -> dict[str, Any]:
    """The JSON object in the file."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise QTableError(
            str(path), f"cannot be read: {error.strerror}", "give the qtable.json that 'txt1 learn' wrote"
        ) from error
    except UnicodeDecodeError as error:
        raise QTableError(str(path), "is no text", RELEARN) from error
    try:
        content = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        ends_early = error.pos >= len(text.rstrip()) or (text[0] == "{" and not text.rstrip().endswith("}"))
        problem = "ends in the middle" if text.strip() else "is empty"
        if not ends_early:
            problem = f"is no JSON: {error.msg}, line {error.lineno}, column {error.colno}"
        raise QTableError(str(path), problem, RELEARN) from error
    except (ValueError, RecursionError) as error:
        raise QTableError(str(path), f"holds what no Q-table does: {error}", RELEARN) from error
    if not isinstance(content, dict):
        raise QTableError(str(path), "is JSON, but no Q-table", "give the qtable.json that 'txt1 learn' wrote")
    return content


def _refuse_constant(name: str) -> float:
    """Refuse NaN and the infinities, which Python's JSON would let pass."""
    raise ValueError(f"the value {name}")


def _values(path: Path, values: Any) -> Table:
    """The numbers as an array, each of them seen to be one."""
    if not (isinstance(values, list) and values and all(isinstance(row, list) and row for row in values)):
        raise QTableError(str(path), "has no rows of values", RELEARN)
    for state, row in enumerate(values):
        if len(row) != len(values[0]):
            raise QTableError(
                str(path), f"has {len(row)} actions in state {state} and {len(values[0])} in state 0", RELEARN
            )
        for action, value in enumerate(row):
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
                raise QTableError(str(path), f"has no finite number for state {state}, action {action}", RELEARN)
    return np.array(values, float)


def _text(content: Mapping[str, Any]) -> str:
    """The content as JSON with a line for each key and for each row of values.

    json's own indentation takes three times as long, and gives every number of a path a line.
    """
    texts = {key: json.dumps(value, allow_nan=False) for key, value in content.items()}
    texts["values"] = texts["values"].replace("], ", "],\n  ")
    lines = [f" {json.dumps(key)}: {text}" for key, text in texts.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of the content, whatever the file's white space."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
