"""An I2C bus whose transfers can be cut off, for the conformance suite: outages are put on the bytes of the bus."""

import errno
import os
import threading
from collections.abc import Callable
from typing import Any, Final

from txt1.link.outages import Outage

# s after which Linux gives a transfer up on a bus that is held, on a Raspberry Pi
GIVES_UP: Final = 1.0
# what a transfer fails with; an opening of a bus that is not there fails with ENOENT
ERRORS: Final = {
    Outage.SILENT: errno.EREMOTEIO,
    Outage.POWER: errno.EREMOTEIO,
    Outage.UNPLUGGED: errno.ENODEV,
    Outage.HELD: errno.ETIMEDOUT,
}


class CutBus:
    """What opens a bus, and the outages of it.

    `make` makes the bus with its virtual chips, which are powered up then, in their first mode. It is called again
    when they were without power. Every method of the bus but `close` is a transfer.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self.transfers = 0
        """Number of transfers and openings until now."""
        self._make, self._bus = make, make()
        self._outage: Outage | None = None

    def open(self) -> Any:
        """Open the bus; raises OSError as smbus2 does if it is unplugged."""
        if self._outage is Outage.UNPLUGGED:
            self.transfers += 1
            raise failure(errno.ENOENT)
        return _Opened(self)

    def cut(self, outage: Outage) -> None:
        """Let every transfer fail: SILENT, UNPLUGGED, POWER or HELD."""
        self._outage = outage

    def restore(self) -> None:
        """Let the chips answer again; those without power are in their first mode."""
        if self._outage is Outage.POWER:
            self._bus = self._make()
        self._outage = None

    def transfer(self, name: str, *arguments: Any, **named: Any) -> Any:
        """Call a method of the bus, or fail."""
        self.transfers += 1
        if self._outage is None:
            return getattr(self._bus, name)(*arguments, **named)
        number = ERRORS[self._outage]
        if self._outage is Outage.HELD:
            threading.Event().wait(GIVES_UP)
        raise failure(number)


class _Opened:
    """The bus that the driver sees."""

    def __init__(self, cut: CutBus) -> None:
        self._cut = cut

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments, **named: self._cut.transfer(name, *arguments, **named)

    def close(self) -> None:
        """Do nothing: the chips go on."""


def failure(number: int) -> OSError:
    """Return the error of a system call."""
    return OSError(number, os.strerror(number))
