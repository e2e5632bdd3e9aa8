"""Every exception that the package raises on purpose.

A fault that the robot is expected to survive (a missed cycle, a stale command, a clipped set-point) is no exception: it
is counted in the state and shown.
"""

from typing import Any, Final


class Txt1Error(Exception):
    """The base class: catch it to catch everything that txt1 raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Make it picklable between processes, whatever the arguments of its own `__init__`."""
        return Exception.__new__, (type(self), *self.args), self.__dict__


class ConfigError(Txt1Error):
    """A setting is unknown, has a value of the wrong type or is out of its range."""


class MissingExtra(Txt1Error):
    """The user asked for a feature whose optional dependency is not installed; the extra may be a plug-in's."""

    def __init__(self, feature: str, extra: str, plugin: str = "") -> None:
        from txt1.installing import needs_extra

        super().__init__(f"{feature} {needs_extra(extra, plugin)}")


class MissingPlugin(ConfigError):
    """The user asked for a part of a plug-in of this repository that is not installed; `command` installs it."""

    def __init__(self, part: str, plugin: str) -> None:
        from txt1.installing import distribution_of, installs_plugin

        self.command = installs_plugin(plugin)
        super().__init__(f"{part} is in the plug-in {distribution_of(plugin)}, which is not installed: {self.command}")


class HalError(Txt1Error):
    """The hardware layer cannot be found, opened or used."""


class LinkLost(HalError):
    """Bytes were to be sent over a link that is down; nothing was sent."""


class NotCapable(HalError):
    """The HAL in use lacks a capability; a single argument is a complete message."""

    def __init__(self, hal: str, capability: str = "") -> None:
        super().__init__(f"the HAL '{hal}' cannot do this: it has no capability '{capability}'" if capability else hal)
        self.hal = hal
        self.capability = capability


class EncodeError(Txt1Error, ValueError):
    """A message cannot be put on the wire; nothing was sent."""

    def __init__(self, message: str, field: str, value: object, takes: str) -> None:
        super().__init__(f"{message}.{field} is {value!r}, its field on the wire takes {takes}")


class CaptureError(Txt1Error):
    """A capture given as text has other characters than hexadecimal digits; the message names line and column."""


class LightFault(Txt1Error):
    """A light sensor cannot be believed, so there is no direction."""


class NoDirection(LightFault):
    """The four sensors read the same, so they show no direction: there is no light, or it is too far away."""

    def __init__(self, reading: float) -> None:
        super().__init__(f"light sensors FL, FR, RL and RR all read {reading:g} lux: they tell no direction")


class QTableError(Txt1Error):
    """A Q-table cannot be read from or written to a file."""

    def __init__(self, file: str, problem: str, remedy: str) -> None:
        super().__init__(f"{file}: {problem}; {remedy}")
        self.problem = problem


class RecordingError(Txt1Error):
    """A recording cannot be written or read any further; the message names the file, the problem and the remedy."""


class CommandRefused(Txt1Error):
    """A command was refused; the message names the value or rule that is the reason."""


class NotArmed(CommandRefused):
    """The safety gate is closed, so nothing moves. The message gives the remedy, then the reason."""

    def __init__(self, reason: str, remedy: str = "call Robot.arm() or press m") -> None:
        # a gate that was never opened gives "not armed yet" as its reason
        told = reason if reason.startswith("not armed") else f"not armed: {reason}"
        super().__init__(f"{remedy}: {told}" if remedy else told)
        self.reason = reason


A_STOP: Final = "a stop"
"""Stands for the source that overruled, where a source was stopped without its asking."""


class Overruled(CommandRefused):
    """Another source of commands has the wheel, or had it, and this source has not asked again since.

    `driver` is the other source; `A_STOP` if the robot was stopped for more than half a second without this source's
    asking.
    """

    def __init__(self, source: str, driver: str) -> None:
        why = f"'{driver}' has taken the wheel; ask again when it has let go"
        if driver == A_STOP:
            why = "the robot was stopped without its asking; ask again"
        super().__init__(f"'{source}' does not drive: {why}")
        self.driver = driver


class StopNotVerified(Txt1Error):
    """A stop of the run was not obeyed, or the robot was not seen to stand; raised when the run has ended."""


class TaskFault(Txt1Error):
    """A task raised an unexpected exception; the robot was stopped first. The cause is chained."""

    def __init__(self, task: str, cause: BaseException) -> None:
        super().__init__(f"task '{task}' failed: {type(cause).__name__}: {cause}")
        self.task = task


class AdditionFault(Txt1Error):
    """An addition raised an unexpected exception, or cannot be imported; the cause is chained."""

    def __init__(self, addition: str, function: str, cause: BaseException) -> None:
        told = " ".join(f"{type(cause).__name__}: {cause}".split())
        super().__init__(f"the addition '{addition}' ({function}) failed: {told}")
        self.addition = addition


class TerminalLost(Txt1Error):
    """The process that draws the terminal ended unexpectedly."""
