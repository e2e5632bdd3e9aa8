"""Every exception the package raises on purpose.

A fault the robot is expected to survive (a missed cycle, a stale command, a clipped set-point) is no exception:
it is counted in the state and shown.
"""

from __future__ import annotations

from typing import Any


class Txt1Error(Exception):
    """The root: catch this to catch everything txt1 raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        """How it travels from one process to another, whatever its own `__init__` takes."""
        return _remade, (type(self), self.args, self.__dict__)


def _remade(kind: type[Txt1Error], args: tuple[Any, ...], attributes: dict[str, Any]) -> Txt1Error:
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error


class ConfigError(Txt1Error):
    """A setting is unknown, has a value of the wrong type or is out of its range."""


class MissingExtra(Txt1Error):
    """A feature was asked for whose optional dependency is not installed."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs the extra '{extra}': pip install 'txt1[{extra}]'")


class HalError(Txt1Error):
    """The hardware layer cannot be found, opened or used."""


class LinkLost(HalError):
    """Bytes were given to a link that is down; nothing was sent. `reason` is a sentence that names the link.

    >>> raise LinkLost("/dev/ttyUSB0 was unplugged")
    Traceback (most recent call last):
    txt1.errors.LinkLost: nothing was sent: /dev/ttyUSB0 was unplugged
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"nothing was sent: {reason}")
        self.reason = reason


class NotCapable(HalError):
    """The HAL in use has no such capability; a single argument is a message of your own.

    >>> raise NotCapable("serial", "pwm")
    Traceback (most recent call last):
    txt1.errors.NotCapable: the HAL 'serial' cannot do this: it has no capability 'pwm'
    """

    def __init__(self, hal: str, capability: str = "") -> None:
        super().__init__(f"the HAL '{hal}' cannot do this: it has no capability '{capability}'" if capability else hal)
        self.hal = hal
        self.capability = capability


class EncodeError(Txt1Error, ValueError):
    """A message cannot be put on the wire; nothing was sent.

    >>> raise EncodeError("Velocity", "v", 40.0, "a number from -32.768 to 32.767")
    Traceback (most recent call last):
    txt1.errors.EncodeError: Velocity.v is 40.0, its field on the wire takes a number from -32.768 to 32.767
    """

    def __init__(self, message: str, field: str, value: object, takes: str) -> None:
        super().__init__(f"{message}.{field} is {value!r}, its field on the wire takes {takes}")
        self.message = message
        self.field = field


class CaptureError(Txt1Error):
    """A capture given as text holds something else than hexadecimal digits."""

    def __init__(self, line: int, column: int, what: str) -> None:
        super().__init__(f"line {line}, column {column}: {what}")
        self.line = line
        self.column = column


class LightFault(Txt1Error):
    """A light sensor cannot be believed, so there is no direction to go by."""

    def __init__(self, sensor: str, what: str) -> None:
        super().__init__(f"light sensor {sensor} {what}")
        self.sensor = sensor


class NoDirection(LightFault):
    """The four sensors read the same: no light, or one too far away, and nothing says where."""

    def __init__(self, reading: float) -> None:
        Txt1Error.__init__(self, f"light sensors FL, FR, RL and RR all read {reading:g} lux: they tell no direction")
        self.sensor = "all"


class QTableError(Txt1Error):
    """A Q-table cannot be read from or written to a file."""

    def __init__(self, file: str, problem: str, remedy: str) -> None:
        super().__init__(f"{file}: {problem}; {remedy}")
        self.problem = problem
        self.remedy = remedy


class RecordingError(Txt1Error):
    """A recording cannot be written or read any further; the message names the file, the problem and the remedy."""


class CommandRefused(Txt1Error):
    """A command was not carried out; the message says which value or rule is the reason."""


class NotArmed(CommandRefused):
    """The safety gate is closed, so nothing moves.

    >>> raise NotArmed("emergency stop")
    Traceback (most recent call last):
    txt1.errors.NotArmed: the robot is not armed (emergency stop): call Robot.arm() or press m
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"the robot is not armed ({reason}): call Robot.arm() or press m")
        self.reason = reason


class Overruled(CommandRefused):
    """Another source of commands has the wheel, or had it and nobody has asked anew since.

    >>> raise Overruled("program", "keys")
    Traceback (most recent call last):
    txt1.errors.Overruled: 'program' does not drive: 'keys' has taken the wheel; ask anew when it has let go
    """

    def __init__(self, source: str, driver: str) -> None:
        super().__init__(f"'{source}' does not drive: '{driver}' has taken the wheel; ask anew when it has let go")
        self.source = source
        self.driver = driver


class TaskFault(Txt1Error):
    """A task raised an exception nobody expected; the robot was stopped first. The cause is chained."""

    def __init__(self, task: str, cause: BaseException) -> None:
        super().__init__(f"task '{task}' failed: {type(cause).__name__}: {cause}")
        self.task = task


class TerminalLost(Txt1Error):
    """The process that draws the terminal ended without being asked to."""
