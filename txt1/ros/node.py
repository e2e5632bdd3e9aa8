"""A node of ROS beside a robot or a board, under the Python of ROS."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Final, Protocol

from txt1.bridges.registry import HEARTBEAT_SILENCE, RESTART, warning
from txt1.ros.python import RosPython
from txt1.runtime import Runtime
from txt1.sidecar import TELEMETRY_PERIOD, Request, Sidecar

START: Final = Path(__file__).with_name("start.py")
# after the telemetry's task, so that a cycle's values are sent in the same cycle
NODE_PRIORITY: Final = -110


class NodeDesk(Protocol):
    """The near end of a node."""

    def telemetry(self) -> bytes | None:
        """Return a line for the node; None if there is none."""

    def request(self, request: Request) -> None:
        """Carry out a request."""

    def say(self, text: str) -> None:
        """Add a line about the node to the event log."""

    def lost(self) -> None:
        """Note that the node has gone."""


def started(python: RosPython, target: str) -> tuple[str, ...]:
    """Return the words that start a node, ``module:function``, under a Python of ROS."""
    spec = find_spec(target.partition(".")[0])
    assert spec is not None and spec.origin is not None
    return (*python.program, str(START), str(Path(spec.origin).parents[1]))


@asynccontextmanager
async def node_beside(
    runtime: Runtime,
    desk: NodeDesk,
    target: str,
    python: RosPython,
    options: Mapping[str, object],
) -> AsyncIterator[Sidecar]:
    """Run a node until the block is left.

    `target` is its function, as ``module:function``; `options` are keyword arguments for it.
    """
    beside = Sidecar(
        target,
        desk.telemetry,
        desk.request,
        options=options,
        restart=RESTART,
        silence=HEARTBEAT_SILENCE,
        tell=lambda text: desk.say(f" {text}"),
        lost=desk.lost,
        program=started(python, target),
        environment=python.environment,
        niceness=0,
        prompt=True,
    )
    try:
        node = target.rpartition(":")[0].rpartition(".")[2]
        with warning(runtime, f"bridge '{node}'", beside):
            async with beside:
                # an IMU sends 100 readings a second
                runtime.add_task(f"bridge {node}", NODE_PRIORITY, 0.5 * TELEMETRY_PERIOD, beside.serve)
                yield beside
    finally:
        desk.lost()
