"""A serial device over serialx, which takes the place of pyserial-asyncio by `serial.transport: serialx`."""

import asyncio
import struct
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any

from txt1.errors import ConfigError
from txt1.installing import installs_package
from txt1.link.base import End, StreamLink


class SerialxLink(StreamLink):
    """A link over serialx's transport.

    The transport raises the error of a device that is gone in each write until it has reported the loss.
    """

    def _send(self, data: bytes) -> None:
        with suppress(OSError):
            super()._send(data)


def library() -> Any:
    """Return serialx; raises ConfigError if it is not installed."""
    try:
        return import_module("serialx")
    except ModuleNotFoundError:
        remedy = installs_package("serialx")
        raise ConfigError(f"serial.transport: serialx is not installed: {remedy}") from None


async def open_serialx(
    address: str, end: End, baud: int, explain: Callable[[str, Exception | None], str]
) -> SerialxLink:
    """Open a serial device, 8N1 and exclusive; `end` is connected on return.

    Raises ConfigError: serialx is not installed; ValueError: there is no such baud rate; OSError.
    """
    serialx = await asyncio.to_thread(library)
    link = SerialxLink(address, end, explain)
    try:
        # many boards restart when DTR rises, so a closed port leaves it as it is
        left = {"dtr_on_close": serialx.PinState.UNDEFINED, "rts_on_close": serialx.PinState.UNDEFINED}
        # opens in a thread, and closes what it has opened if this is cancelled
        await serialx.create_serial_connection(asyncio.get_running_loop(), lambda: link, address, baud, **left)
    except (serialx.UnsupportedSetting, OverflowError, struct.error) as error:
        raise ValueError(baud) from error
    return link
