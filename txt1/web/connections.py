"""Accepts connections, and gives the server no more of their bytes than their budgets pay for.

How it works
------------

`Connections` accepts one connection in each turn of the event loop, before any handshake, if the budgets of its address
allow it. It reads a connection in small pieces (`Metered`), one in each turn, and each piece is paid for before aiohttp
sees it. So in each turn every connection costs little, and a stop waits for few turns.

A connection that has exceeded its budget is closed. A page may have sent a stop behind its flood: it is read on until
nothing more comes, or `FAREWELL` bytes have come. Meanwhile nothing but stops is obeyed (`requests.take`), and only one
piece of all such connections is read in `PACE` s.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from txt1.web.budgets import BYTE, TURN_COST, Account, Budgets

CONNECTIONS_MAX: Final = 256
# s within which a connection has to send its first request, and to finish its handshake
STRANGER: Final = 5.0
# connections that wait to be accepted
LISTEN_BACKLOG: Final = 128
# connections refused at once, and s until the next are accepted: a flood of them takes a tenth of the time
REFUSALS: Final = 16
REFUSED: Final = 0.002
# s without descriptors until the next connection is accepted
EXHAUSTED: Final = 0.5
# bytes read in one turn
READ_BYTES: Final = 2048
# bytes that wait in the system for each connection
WAITING: Final = 1 << 14
# bytes of a page that are searched for a stop after it has exceeded its budget: all that waited then
FAREWELL: Final = 1 << 15
# s between two pieces of connections that have exceeded their budgets
PACE: Final = 0.01
# s without a piece after which such a connection is closed
ABORT_AFTER: Final = 0.05


class Connections:
    """All connections to the server.

    Args:
        protocol: makes aiohttp's protocol for a connection.
        context: of TLS; None for none.
        now: the clock, s.

    """

    def __init__(
        self, protocol: Callable[[], asyncio.Protocol], context: ssl.SSLContext | None, now: Callable[[], float]
    ) -> None:
        self.protocol, self._context, self.now = protocol, context, now
        self.budgets = Budgets()
        # the oldest first
        self.open: dict[Metered, None] = {}
        self._listening: list[socket.socket] = []
        # handshakes, the oldest first
        self._beginning: dict[asyncio.Task[None], None] = {}
        # time at which the next piece of a connection may be read that has exceeded its budget
        self._paced = 0.0

    async def listen(self, host: str, port: int) -> None:
        """Begin to accept connections; raises OSError."""
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, _, _, _, address in dict.fromkeys(found):
            listening = socket.socket(family, socket.SOCK_STREAM)
            self._listening.append(listening)
            listening.setblocking(False)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            # inherited by the connections
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WAITING)
            if family == socket.AF_INET6:
                listening.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            listening.bind(address)
            listening.listen(LISTEN_BACKLOG)
            loop.add_reader(listening, self._accept, listening)

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self._listening[0].getsockname()[1])

    def close(self) -> None:
        """Accept no more connections, and close those that are open."""
        loop = asyncio.get_running_loop()
        for listening in self._listening:
            loop.remove_reader(listening)
            listening.close()
        for task in self._beginning:
            task.cancel()
        for each in tuple(self.open):
            each.abort()

    def hang_up(self) -> None:
        """Close the connections that have been silent for too long."""
        for each in tuple(self.open):
            if not each.asked and self.now() - each.since > STRANGER:
                each.abort()

    def pace(self) -> float:
        """Return after how many s a connection may be read on that has exceeded its budget."""
        self._paced = max(self._paced, self.now()) + PACE
        return self._paced - self.now()

    def _accept(self, listening: socket.socket) -> None:
        """Accept one connection; of those that are refused, a few."""
        pause = REFUSED
        for _ in range(REFUSALS):
            try:
                connection, address = listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                break
            except OSError:
                # no descriptors are left
                pause = EXHAUSTED
                break
            if self.budgets.admits(str(address[0]), self.now()) and self._has_room():
                connection.setblocking(False)
                task = asyncio.get_running_loop().create_task(self._begin(connection, str(address[0])))
                self._beginning[task] = None
                task.add_done_callback(lambda done: self._beginning.pop(done, None))
                return
            connection.close()
        self._rest(listening, pause)

    def _rest(self, listening: socket.socket, pause: float) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(listening)
        loop.call_later(pause, self._go_on, listening)

    def _go_on(self, listening: socket.socket) -> None:
        if listening.fileno() >= 0:
            asyncio.get_running_loop().add_reader(listening, self._accept, listening)

    def _has_room(self) -> bool:
        """Return whether there is room for a connection; the oldest handshake or connection, but no page, goes."""
        if len(self.open) + len(self._beginning) < CONNECTIONS_MAX:
            return True
        for task in self._beginning:
            return task.cancel()
        for each in self.open:
            if not each.page:
                each.abort()
                return True
        return False

    async def _begin(self, connection: socket.socket, address: str) -> None:
        patience = None if self._context is None else STRANGER
        loop = asyncio.get_running_loop()
        try:
            # the far end goes away, or does not speak TLS
            with suppress(OSError):
                await loop.connect_accepted_socket(
                    lambda: Metered(self, address), connection, ssl=self._context, ssl_handshake_timeout=patience
                )
        except BaseException:
            connection.close()
            raise


class Metered(asyncio.BufferedProtocol):
    """One connection: stands between its transport and aiohttp's protocol, and pays for what passes."""

    def __init__(self, connections: Connections, address: str) -> None:
        self._connections = connections
        self.account: Account = connections.budgets.account(address)
        self.account.close = self._exceeded
        self.since = connections.now()
        # whether it has sent a request
        self.asked = False
        # whether it is a page's socket
        self.page = False
        self._inner = connections.protocol()
        # asyncio's TLS writes to slices of it, and slices of a bytearray are copies
        self._piece = memoryview(bytearray(READ_BYTES))
        self._farewell = FAREWELL
        # reading on, or closing, of a connection that has exceeded its budget
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._connections.open[self] = None
        self._inner.connection_made(transport)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return room for a piece."""
        return self._piece

    def buffer_updated(self, nbytes: int) -> None:
        """Pay for a piece, and pass it on."""
        if self.account.exceeded:
            self._farewell -= nbytes
        else:
            self.account.spend(self._connections.now(), TURN_COST + BYTE * nbytes)
        if not self.account.exceeded:
            self._inner.data_received(bytes(self._piece[:nbytes]))
        elif self.page and self._farewell > 0:
            self._inner.data_received(bytes(self._piece[:nbytes]))
            self._pause()
        else:
            self._transport.abort()

    def eof_received(self) -> bool | None:
        """Pass on the end."""
        return self._inner.eof_received()

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._connections.open.pop(self, None)
        if self._timer is not None:
            self._timer.cancel()
        self._inner.connection_lost(exc)

    def pause_writing(self) -> None:
        """Pass it on."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Pass it on."""
        self._inner.resume_writing()

    def abort(self) -> None:
        """Close the connection at once."""
        self._transport.abort()

    def _exceeded(self) -> None:
        """Close the connection: a page's as soon as it was searched for a stop."""
        if self.page:
            self._pause()
        else:
            # not from within a call of the transport
            asyncio.get_running_loop().call_soon(self._transport.abort)

    def _pause(self) -> None:
        """Read on later, and close the connection if nothing comes then. What has come is obeyed after that, too."""
        if self._transport.is_closing():
            return
        self._transport.pause_reading()
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(self._connections.pace(), self._read_on)

    def _read_on(self) -> None:
        """Read a piece, and close the connection if nothing comes.

        The time until then begins only now. Else a loop that was held up would close it before it has looked for bytes.
        """
        self._transport.resume_reading()
        self._timer = asyncio.get_running_loop().call_later(ABORT_AFTER, self._transport.abort)
