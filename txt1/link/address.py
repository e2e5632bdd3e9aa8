"""Open a link by its address."""

from __future__ import annotations

from typing import Final

from txt1.link.base import End, Link
from txt1.link.device import open_device
from txt1.link.tcp import open_socket

STANDARD_BAUDS: Final = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
"""Baud rates that every adapter knows."""


async def open_link(address: str, end: End, baud: int = 57600) -> Link:
    """The link to a serial device (8N1, ours alone) or to `socket://host:port`; `end` is connected when this returns.

    Raises:
        HalError: it cannot be opened; the message names the address, the cause and what to do.

    """
    return await (open_socket(address, end) if "://" in address else open_device(address, end, baud))


def baud_warning(baud: int) -> str | None:
    """One line for people when many adapters do not know this baud rate; None for those of STANDARD_BAUDS."""
    if baud in STANDARD_BAUDS:
        return None
    nearest = min(STANDARD_BAUDS, key=lambda standard: abs(standard - baud))
    return (
        f"{baud} baud is unusual (the nearest usual rate is {nearest}, the board's 57600): the adapter may not know it"
    )
