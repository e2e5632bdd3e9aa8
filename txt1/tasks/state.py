"""The shared state of the tasks: typed fields, each with exactly one writer."""

from collections import deque
from collections.abc import Callable
from typing import Final

from txt1.hal.base import BoardLink, Capabilities
from txt1.model.odometry import Odometry
from txt1.tasks.fields import (
    LOG,
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

_EVERYTHING: Final = Capabilities(pwm=True, power=True, power_known=True)


class State:
    """The shared state; each field is written by one task alone."""

    def __init__(self, bus: Bus | None = None, can: Capabilities = _EVERYTHING) -> None:
        self.bus = Bus() if bus is None else bus
        # by the serial task
        self.command: Command | None = None
        self.manual_pwm: ManualPwm | None = None
        self.combined: CombinedSample | None = None
        self.gains = GainTable()
        self.power = Power(True, True, True) if can.power_known else Power()
        # time when the ATX supply was last switched on, s of the run
        self.atx_time = 0.0
        self.servos: tuple[int, int] = (0, 0)
        self.received = 0
        self.velocity_count = 0
        self.combined_count = 0
        # by the encoder task
        self.encoders = Encoders()
        self.odometry = Odometry()
        self.odometry_time = 0.0
        # time of the last motion, or when it was last impossible to see one, s of the run
        self.moved_time = 0.0
        # time when the speed fell faster than brakes allow, if no motion was seen since, s of the run
        self.fell_time = 0.0
        self.pose: tuple[float, float, float] | None = None
        self.board: BoardLink | None = None
        # whether the motors do not follow the outputs: no fault, and nothing to wind up for
        self.held = False
        # by the mode, controller and battery tasks
        self.link = LinkState()
        self.control = Control()
        self.battery = Battery()
        # by the button task
        self.panel = Panel(manual=False if can.pwm else None)
        self.backlight: float | None = None
        # by the odometry task
        self.transmitted = 0
        # the latest events, oldest first; every part may append
        self.events: deque[Event] = deque(maxlen=20)
        # counts of faults of the line to the host; written by the reader of the line
        self.line_faults: dict[str, int] = {}

        # the text of the last event, and how often it came in a row
        self._told = "", 0

        # the 29th attribute: CPython finds those of an object with more of them slowly
        self.warnings: list[Callable[[], str]] = []
        """Functions that return a warning, such as a silent bridge, or ""."""

    def warned(self) -> tuple[str, ...]:
        """Return all present warnings."""
        return tuple(text for each in self.warnings if (text := each()))

    def tell(self, time: float, text: str) -> None:
        """Log an event; one that repeats the event before it is one line with a count."""
        event = Event(time, text)
        times = self._told[1] + 1 if text == self._told[0] else 1
        self._told = text, times
        if times > 1:
            self.events.pop()
        self.events.append(event if times == 1 else Event(time, f"{text} ({times} times)"))
        self.bus.publish(LOG, event, time)

    def count_on_line(self, reason: str) -> None:
        """Count a fault of the line to the host."""
        name = f"line_{reason}"
        self.line_faults[name] = self.line_faults.get(name, 0) + 1
