"""Damaged files of other kinds for `torture.fuzz`: tables, policies, maps, and recordings that are driven again.

A checksum would turn nearly all of them away, so tables are signed again after they were damaged. What is read
nevertheless may drive: for a moment it does, in simulation, and nothing that is not finite may come of it.
"""

import contextlib
import io
import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.cli import execute
from txt1.errors import Txt1Error
from txt1.learning import qtable
from txt1.maps import files as maps

RUN: Final = ("run", "--headless", "--speed", "max", "--seed", "1", "--json", "--duration")
CODES: Final = (0, 1, 2)
"""All that a command may end with that a file has not stopped in motion."""


def said(*words: str) -> tuple[int, str]:
    """The exit code of a command, and what it printed; AssertionError for a traceback."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = execute(words)
    assert "Traceback" not in err.getvalue(), err.getvalue()[-300:]
    return code, out.getvalue()


def drives(*words: str) -> None:
    """Let a robot drive for a moment; AssertionError where anything that it tells is not finite."""
    code, told = said(*RUN, "0.6", *words)
    assert code in (*CODES, 3, 4), f"exit code {code}"

    def number(text: str) -> float:
        value = float(text)
        assert isfinite(value), text
        return value

    for line in told.splitlines():
        json.loads(line, parse_float=number, parse_constant=number)


def table(data: bytes) -> None:
    """Read a learner's table, signed again, and drive by it."""
    try:
        content = json.loads(data)
        if isinstance(content, dict) and "sha256" in content:
            del content["sha256"]
            content["sha256"] = qtable._checksum(content)  # noqa: SLF001 - as a forger would
            data = json.dumps(content).encode()
    except (ValueError, RecursionError):
        pass
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "qtable.json")
        file.write_bytes(data)
        drives("--policy", str(file))


def policy(data: bytes) -> None:
    """Read a taught policy, and ask it."""
    from txt1.teaching.policy import loaded

    with contextlib.suppress(Txt1Error):
        read = loaded(data)
        read.judge([np.zeros(sight.size, np.float32) for sight in read.card.sees])


def room(data: bytes) -> None:
    """Read a map: the text up to the first empty line, and its picture after it."""
    text, _, picture = data.partition(b"\n\n")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "a.yaml").write_bytes(text)
        for kind in ("png", "pgm"):
            Path(folder, f"a.{kind}").write_bytes(picture)
        with contextlib.suppress(Txt1Error):
            maps.read(str(Path(folder, "a.yaml")))


def replay(data: bytes) -> None:
    """Give a recording's inputs to the robot again, and draw its report."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "x.mcap")
        file.write_bytes(data)
        for words in (("replay", "--verify"), ("report",)):
            code, _ = said(*words, str(file))
            assert code in CODES, f"{words}: exit code {code}"


def seeds(target: str) -> list[bytes]:
    """Sound files to begin with."""
    if target == "policy":
        return [_policy()]
    with tempfile.TemporaryDirectory() as folder:
        if target == "map":
            maps.write(maps.read("flat").grid, Path(folder, "a.yaml"))
            text, picture = (Path(folder, f"a.{kind}").read_bytes() for kind in ("yaml", "png"))
            plain = text.replace(b"a.png", b"a.pgm") + b"\nP5\n40 30\n255\n" + bytes(range(240)) * 5
            return [text + b"\n" + picture, plain]
        kinds = ("thesis", "pilot", "neural", "taxis")
        for agent in kinds:
            out = str(Path(folder, agent))
            words = ("learn", "--agent", agent, "--trials", "1", "--episodes", "2", "--no-pictures", "--jobs", "1")
            code, _ = said(*words, "--seed", "1", "--out", out)
            assert code == 0, agent
        return [file.read_bytes() for agent in kinds for file in sorted(Path(folder, agent).rglob("qtable*.json"))]


def _policy() -> bytes:
    from txt1.teaching.features import Sight, shape_of
    from txt1.teaching.network import PolicyNetwork
    from txt1.teaching.policy import Card, Policy, digest

    sights = (Sight("light", "light", (1, 1, 5), (), (0.2,) * 5, (0.1,) * 5),)
    networks = [PolicyNetwork(shape_of(sights, (6,)), np.random.default_rng(number)) for number in range(2)]
    card = Card(1, "0", "2026-01-01", sights, 2, (6,), 1.0, 0.5, 0.1, 0.3)
    return Policy(replace(card, weights=digest(networks)), networks).data


TARGETS: Final[dict[str, Callable[[bytes], Any]]] = {"table": table, "policy": policy, "map": room, "replay": replay}
