"""The line to a radio control receiver: kept open, its bytes decoded with the time of their arrival."""

import asyncio
from collections.abc import Callable
from typing import Final

from txt1.errors import ConfigError, LinkLost
from txt1.link.base import Link, Port
from txt1.link.device import DevicePort
from txt1.link.silence import Watched
from txt1.rc.frames import RcFrame
from txt1.rc.settings import PROTOCOLS

# s of silence after which the port is opened again: a transmitter may be off for long
SILENCE_PATIENCE: Final = 10.0


class ReceiverLine:
    """An end of a link to a receiver; `take` gets what each frame told, and the loop's time of its arrival."""

    def __init__(
        self, protocol: str, address: str, take: Callable[[RcFrame, float], None], port: Port | None = None
    ) -> None:
        if protocol not in PROTOCOLS:
            raise ConfigError(f"rc.protocol: {protocol} is for a receiver at a board (--rc board); choose sbus or crsf")
        chosen = PROTOCOLS[protocol]
        self._decoder = chosen.decoder
        self._decoding = chosen.decoder()
        self._take = take
        self._link: Link | None = None
        self.problem = ""
        """Why the port is not open; "" while it is."""
        line = port or DevicePort(address, chosen.baud, behind="a receiver", framing=chosen.framing)
        self._watched = Watched(line, self, SILENCE_PATIENCE, None, self._tell, self._fail)
        self._mistake: Exception | None = None

    async def open(self) -> None:
        """Open the port; raises HalError."""
        await self._watched.open()

    async def close(self) -> None:
        """Close the port."""
        self._watched.close()
        if self._link is not None:
            self._link.close()
            self._link = None
        await self._watched.port.close()

    def send(self, data: bytes) -> None:
        """Send bytes, if the port is open; raises the error by which opening it again failed."""
        if self._mistake is not None:
            raise self._mistake
        if self._link is not None and self._link.up:
            try:
                self._link.write(data)
            except LinkLost:
                # `lost` comes next
                self._link = None

    # -- the link's end ----------------------------------------------------------------------------------------

    def connected(self, link: Link) -> None:
        """Begin with the next frame."""
        self._link, self._decoding, self.problem = link, self._decoder(), ""

    def received(self, data: bytes) -> None:
        """Decode bytes."""
        now = asyncio.get_running_loop().time()
        for heard in self._decoding.feed(data):
            self._watched.heard()
            self._take(heard, now)

    def lost(self, reason: str) -> None:
        """Note why nothing comes."""
        self._link, self.problem = None, reason

    def _tell(self, reason: str) -> None:
        self.problem = reason

    def _fail(self, error: Exception) -> None:
        self._mistake = error
