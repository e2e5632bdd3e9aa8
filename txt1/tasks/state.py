"""The shared state of the tasks: typed fields, each with exactly one writer.

Every value is immutable and replaced whole, so a reader never sees half of an update and nothing needs a lock; this
is what the critical sections of the RTOS were for.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from txt1.hal.base import BoardLink
from txt1.model.odometry import Odometry
from txt1.tasks.fields import (
    Battery,
    CombinedSample,
    Command,
    Control,
    Encoders,
    Event,
    GainTable,
    LinkState,
    ManualPwm,
    Panel,
    Power,
)
from txt1.telemetry.bus import Bus
from txt1.telemetry.topics import Rule, Topic, declare

WRITERS: Final = {
    "serial": (
        "command", "manual_pwm", "combined", "gains", "power", "servos", "received", "velocity_count", "combined_count",
    ),
    "encoder": ("encoders", "odometry", "odometry_time", "pose", "board"),
    "mode": ("link",),
    "controller": ("control",),
    "battery": ("battery",),
    "button": ("panel", "backlight"),
    "odometry": ("transmitted",),
}  # fmt: skip
"""The fields that each task writes, and no other task."""

_INFO: Final = 20
_WARN: Final = 30
"""Levels of ROS's log."""


def _log_message(event: Event) -> dict[str, object]:
    warns = event.text.startswith(("disarmed", "link lost", "batteries"))
    return {"level": _WARN if warns else _INFO, "name": "txt1", "msg": event.text}


LOG: Final = declare(Topic("/rosout", Event, "", "rcl_interfaces/Log", Rule.EVENT, "the event log", make=_log_message))


class State:
    """The shared state. `WRITERS` names the one task that may assign to each field."""

    def __init__(self, bus: Bus | None = None) -> None:
        self.bus = Bus() if bus is None else bus
        self.command: Command | None = None
        self.manual_pwm: ManualPwm | None = None
        self.combined: CombinedSample | None = None
        self.gains = GainTable()
        self.power = Power()
        self.servos: tuple[int, int] = (0, 0)
        self.received = 0
        self.velocity_count = 0
        self.combined_count = 0
        self.encoders = Encoders()
        self.odometry = Odometry()
        self.odometry_time = 0.0
        self.pose: tuple[float, float, float] | None = None
        self.board: BoardLink | None = None
        self.link = LinkState()
        self.control = Control()
        self.battery = Battery()
        self.panel = Panel()
        self.backlight: float | None = None
        self.transmitted = 0
        self.events: deque[Event] = deque(maxlen=20)
        """The latest events, oldest first: a log that everybody may append to."""
        self.line_faults: dict[str, int] = {}
        """What went wrong on the line to the host, by name; kept by whoever reads it."""

    def tell(self, time: float, text: str) -> None:
        """Log an event."""
        event = Event(time, text)
        self.events.append(event)
        self.bus.publish(LOG, event, time)

    def count_on_line(self, reason: str) -> None:
        """Count a fault of the line to the host."""
        name = f"line_{reason}"
        self.line_faults[name] = self.line_faults.get(name, 0) + 1
