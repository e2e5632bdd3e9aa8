"""How long tests wait in real time, in one unit, so that none fails because the machine is slow.

Whatever waits for something to come true has `LIMIT`, and ends as soon as it is true: patience costs nothing. Pauses in
which nothing may happen are so many `S`. A machine that is too slow even so is given more time by `TXT_PATIENCE=5`.

A robot in real time takes a stall of the machine for a fault, as it should. The fixture `patient` (tests/conftest.py)
lets the robots of a test live through stalls, and `TXT1` starts such a robot as a process of its own. Tests of the
rules on stalls are in virtual time.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from math import inf
from types import ModuleType
from typing import Any, Final

S: Final = float(os.environ.get("TXT_PATIENCE", "1"))
"""A second of the tests' patience."""
LIMIT: Final = 120.0 * S
"""s for something to come true."""
LOOK: Final = 0.005
"""s between two looks at whether it has."""

MISSED: Final = ("TXT1_SAFETY__MISSED_TICKS_MAX", "1000000")
"""The setting of a robot that goes on after the machine let its controller miss cycles, for it and its children."""
PATIENT: Final = ("safety.missed_ticks_max=1000000",)
"""The same for a configuration that is made without the environment."""
TXT1: Final = (sys.executable, "-P", __file__)
"""The command `txt1` with a robot that lives through stalls of the machine."""

STALLED: Final = (
    ("txt1.tasks.controller", "ODOMETRY_TIMEOUT", inf),
    ("txt1.tasks.mode", "VELOCITY_MIN", -1),
    ("txt1.hal.serial", "BOARD_LOST", LIMIT),
    ("txt1.hal.line", "ANSWER_SILENCE", LIMIT),
    ("txt1.cars.pi.driver", "GUARD_SILENCE", LIMIT),
    ("txt1.cars.pi.driver", "HANGS", LIMIT),
    ("txt1.hal.restarts", "PAUSE", LIMIT),
    ("txt1.sidecar", "START", LIMIT),
    ("txt1.fleet.network", "STOP_FOR", LIMIT),
    ("txt1.ui.terminal", "KEY_AGE_MAX", LIMIT),
)
"""The numbers by which, after a stall, odometry, host, board, guard or bridge seem lost, and a key is too old."""
LEAVING: Final = ("txt1.sidecar", "END_PATIENCE", 10.0 * S)
"""What the command gives a process beside its robot to end, such as a node that leaves its master."""


async def until(condition: Callable[[], object], limit: float = LIMIT, look: float = LOOK) -> None:
    """Wait for something to come true, in the event loop's time; TimeoutError when it does not."""
    async with asyncio.timeout(limit):
        while not condition():
            await asyncio.sleep(look)


def wait_until(condition: Callable[[], object], limit: float = LIMIT, look: float = LOOK) -> None:
    """Wait for something to come true, in real time, without an event loop; TimeoutError when it does not."""
    ends = time.monotonic() + limit
    while not condition():
        if time.monotonic() > ends:
            raise TimeoutError(f"not within {limit:g} s")
        time.sleep(look)


@contextmanager
def lateness() -> Iterator[Callable[[], float]]:
    """How much too late a thread of this process woke up at worst meanwhile, s: so late may all else be."""
    done, worst = threading.Event(), 0.0

    def look() -> None:
        nonlocal worst
        before = time.monotonic()
        while not done.wait(LOOK):
            worst, before = max(worst, time.monotonic() - before - LOOK), time.monotonic()

    threading.Thread(target=look, daemon=True).start()
    try:
        yield lambda: worst
    finally:
        # it ends at its next look; an event loop must not wait for it
        done.set()


@contextmanager
def surviving() -> Iterator[None]:
    """Let robots live through stalls of the machine, here and in processes that are started meanwhile."""
    import pytest  # not when it is the command

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(*MISSED)
        for module, name, value in STALLED:
            patch.setattr(import_module(module), name, value)
        yield


class Patient(PathFinder):
    """Finds modules whose numbers are set as soon as they are imported: a command imports few of them."""

    @classmethod
    def find_spec(cls, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        numbers = {name: value for module, name, value in (*STALLED, LEAVING) if module == fullname}
        spec = super().find_spec(fullname, path, target) if numbers else None
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_set(module: ModuleType) -> None:
                load(module)
                if strange := numbers.keys() - vars(module).keys():
                    raise AttributeError(f"{fullname} has no {', '.join(strange)}")
                vars(module).update(numbers)

            spec.loader.exec_module = load_and_set  # type: ignore[method-assign]
        return spec


def main() -> None:
    """Do what the command `txt1` does, with a robot that lives through stalls of the machine."""
    sys.meta_path.insert(0, Patient)
    from txt1 import __main__ as command

    for each in command.SIGNALS:
        signal.signal(each, command.leave)  # before the imports, as the command does
    os.environ.setdefault(*MISSED)
    command.main()


if __name__ == "__main__":
    main()
