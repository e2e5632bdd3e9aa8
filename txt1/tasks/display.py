"""The display task: the picture of the robot that the screens draw. Priority 2, 10 Hz, soft (thesis 3.3.3).

Drawing takes longer than a controller period, so it is done elsewhere; this task only publishes a snapshot.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from txt1.control.limits import Gate
from txt1.hal.base import Hal, Indicators
from txt1.kernel.ticks import Ticks
from txt1.tasks import frames
from txt1.tasks.fields import BatteryState, Snapshot, TaskReport
from txt1.tasks.state import State
from txt1.telemetry.topics import Rule, Topic, declare

PRIORITY: Final = 2
PERIOD: Final = 0.1

SNAPSHOT: Final = declare(Topic(
    "/snapshot", Snapshot, "", "std_msgs/String", Rule.SECOND, "all that the screens show, as one line of JSON",
    make=lambda snapshot: {"data": frames.encode(snapshot)[:-1].decode("ascii")},
))  # fmt: skip

WARNING: Final = BatteryState.WARNING  # an attribute of an Enum is not found quickly
BAD: Final = BatteryState.BAD


async def display(
    ticks: Ticks,
    state: State,
    hal: Hal,
    name: str,
    gate: Gate,
    room: tuple[float, float] | None,
    light: tuple[float, float] | None,
    reports: Callable[[], tuple[TaskReport, ...]],
) -> None:
    """Publish a snapshot, once per tick, and set buzzer and LEDs."""
    async for now in ticks:
        sounds = buzzer(state)
        hal.indicate(Indicators(sounds, state.received % 2 == 1, state.transmitted % 2 == 1))
        state.snapshot = Snapshot(
            now,
            name,
            hal.capabilities,
            gate.armed,
            gate.stopped,
            gate.reason,
            faults(gate, state),
            state.command,
            state.gains,
            state.power,
            state.servos,
            state.received,
            state.transmitted,
            state.encoders,
            state.odometry,
            state.pose,
            state.board,
            now - state.odometry_time,
            state.link,
            state.control,
            state.battery,
            state.panel,
            state.backlight,
            sounds,
            room,
            light,
            reports(),
            tuple(state.events),
        )


def buzzer(state: State) -> bool:
    """Whether the buzzer sounds: the link is lost or a battery is low (thesis 3.6.2)."""
    return not state.link.alive or state.battery.state is WARNING or state.battery.state is BAD


def faults(gate: Gate, state: State) -> dict[str, int]:
    """What was counted so far by the safety gate, the tasks and on the line, by name; no zeros."""
    counted = {str(fault): count for fault, count in gate.counts.items() if count} | state.line_faults
    if state.board is not None:
        counted.update((name, count) for name, count in state.board.faults.items() if count)
    return counted
