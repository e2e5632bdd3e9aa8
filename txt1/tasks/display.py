"""The display task: the picture of the robot that the screens draw. Priority 2, 10 Hz, soft (thesis 3.3.3).

Drawing takes longer than a controller period, so it is done elsewhere; this task only publishes a snapshot.
"""

from __future__ import annotations

from collections.abc import Callable

from txt1.control.limits import Gate
from txt1.hal.base import Hal, Indicators
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import BatteryState, Snapshot, TaskReport
from txt1.tasks.state import State

PRIORITY = 2
PERIOD = 0.1


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
            time=now,
            hal=name,
            capabilities=hal.capabilities,
            armed=gate.armed,
            stopped=gate.stopped,
            reason=gate.reason,
            faults=faults(gate, state),
            command=state.command,
            gains=state.gains,
            power=state.power,
            servos=state.servos,
            received=state.received,
            transmitted=state.transmitted,
            encoders=state.encoders,
            odometry=state.odometry,
            pose=state.pose,
            board=state.board,
            odometry_age=now - state.odometry_time,
            link=state.link,
            control=state.control,
            battery=state.battery,
            panel=state.panel,
            backlight=state.backlight,
            buzzer=sounds,
            room=room,
            light=light,
            tasks=reports(),
            events=tuple(state.events),
        )


def buzzer(state: State) -> bool:
    """Whether the buzzer sounds: the link is lost or a battery is low (thesis 3.6.2)."""
    return not state.link.alive or state.battery.state in (BatteryState.WARNING, BatteryState.BAD)


def faults(gate: Gate, state: State) -> dict[str, int]:
    """What was counted so far by the safety gate, the tasks and on the line, by name; no zeros."""
    counted = {str(fault): count for fault, count in gate.counts.items() if count} | state.line_faults
    if state.board is not None:
        counted.update((name, count) for name, count in state.board.faults.items() if count)
    return counted
