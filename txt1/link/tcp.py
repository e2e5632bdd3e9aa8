"""A byte link over TCP: to a board elsewhere, or from a virtual board to one host at a time."""

from __future__ import annotations

import asyncio
import errno
import hmac
import socket
from contextlib import ExitStack
from typing import Any, Final
from urllib.parse import urlsplit

from txt1.errors import HalError
from txt1.link.base import BYTES_WAITING_MAX, End, Link, Listener, StreamLink

# s: a host that has sent nothing for this time makes room for another
HOST_SILENCE: Final = 1.0
# ms: a peer that has acknowledged no byte for this time is gone
VANISHED_MS: Final = 3000
# s without bytes after which the kernel asks a peer whether it is there, s between two such questions, and their number
KEEP_ALIVE: Final = {"TCP_KEEPIDLE": 1, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 3}
CHALLENGE_MAX: Final = 80  # bytes
# s within which a peer has to accept a connection
ANSWER: Final = 3.0
# the command that serves a board's address
BOARD: Final = "txt1 board"

_NO_PORT: Final = {
    errno.EADDRINUSE: "it is in use, perhaps by another board; choose another port, or 0 for any free port",
    errno.EACCES: "ports below 1024 are reserved; choose a higher port, or 0 for any free port",
    errno.EADDRNOTAVAIL: "this computer does not have this address; 127.0.0.1 is the computer itself",
}


async def open_socket(address: str, end: End, secret: bytes | None = None, behind: str = BOARD) -> Link:
    """Open a link to `socket://host:port`, and prove the secret to it, if there is one.

    Raises HalError: the address is malformed, nothing accepts the connection, or no proof is asked for.
    """
    host, port = _host_and_port(address)
    link = StreamLink(address, end, broken_off)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(ANSWER):
            sock = await _connected_socket(host, port)
            if secret is not None:
                with ExitStack() as opened:
                    await _prove(opened.enter_context(sock), secret, address)
                    opened.pop_all()
        await loop.create_connection(lambda: link, sock=sock)
    except asyncio.CancelledError:
        link.shut()
        raise
    except socket.gaierror as error:
        raise HalError(f"{address}: no computer is known by the name {host!r}: check the spelling") from error
    except TimeoutError as error:
        raise HalError(f"{address} does not answer: is the computer on, and no firewall in between?") from error
    except ConnectionRefusedError as error:
        # if two commands may serve it, the last is txt1's own
        remedy = f"is {'' if '`' in behind else '`'}{behind} --tcp {address.removeprefix('socket://')}` running there?"
        raise HalError(f"{address} refuses the connection: {remedy}") from error
    except OSError as error:
        raise HalError(f"{address} cannot be reached: {error.strerror or error}") from error
    return link


async def _connected_socket(host: str, port: int) -> socket.socket:
    """Return a socket connected to the first of the host's addresses that accepts."""
    loop = asyncio.get_running_loop()
    refusal = OSError(errno.EHOSTUNREACH, "it has no address")
    for family, kind, protocol, _, where in await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        with ExitStack() as opened:
            try:
                sock = opened.enter_context(socket.socket(family, kind, protocol))
                sock.setblocking(False)
                tune(sock)
                await loop.sock_connect(sock, where)
            except OSError as error:
                # for example IPv6 on a computer without it
                refusal = error
            else:
                opened.pop_all()
                return sock
    raise refusal


async def _prove(sock: socket.socket, secret: bytes, address: str) -> None:
    """Answer the board's challenge, ``txt1 NUMBER``, with the number's HMAC-SHA256 under the secret, in hexadecimal."""
    loop, line, byte = asyncio.get_running_loop(), b"", b"?"
    while byte not in (b"", b"\n") and len(line) < CHALLENGE_MAX:
        byte = await loop.sock_recv(sock, 1)
        line += byte
    greeting, _, number = line.strip().partition(b" ")
    if greeting != b"txt1" or not number:
        raise HalError(f"{address} does not ask for a secret; leave serial.secret_file away, or check the port")
    await loop.sock_sendall(sock, hmac.digest(secret, number, "sha256").hex().encode() + b"\n")


def _host_and_port(address: str) -> tuple[str, int]:
    form = "write a device's path or socket://host:port, such as socket://127.0.0.1:5000"
    try:
        url = urlsplit(address)
        host, port = url.hostname, url.port
    except ValueError as error:
        raise HalError(f"{address} is no address ({error}): {form}") from error
    if url.scheme != "socket":
        raise HalError(f"{address} is no address: there is no {url.scheme}://; {form}")
    if not host or not port or url.netloc.count("@") or url.path not in ("", "/") or url.query or url.fragment:
        raise HalError(f"{address} is no address: {form}")
    return host, port


def broken_off(address: str, exc: Exception | None) -> str:
    """Return the reason for the end of a connection, for people."""
    if exc is None:
        return f"{address} was closed by the other side"
    if isinstance(exc, TimeoutError):
        return f"{address} no longer answers"
    if isinstance(exc, ConnectionError):
        return f"{address} was broken off by the other side"
    return f"{address} failed: {exc}"


def tune(sock: socket.socket) -> None:
    """Make a TCP socket behave like a wire: no delay, small buffers, and a dead peer is noticed."""
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    # the kernel would keep minutes of frames in megabytes
    for direction in (socket.SO_SNDBUF, socket.SO_RCVBUF):
        sock.setsockopt(socket.SOL_SOCKET, direction, 4 * BYTES_WAITING_MAX)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, VANISHED_MS)
    # without these, who only listens never notices that the other computer is gone
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEP_ALIVE.items():
        if hasattr(socket, name):
            sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


class _HostLink(StreamLink):
    """The link to a host of a TCP port. It registers itself, or is turned away."""

    def __init__(self, listener: _TcpListener) -> None:
        super().__init__("", listener.end, broken_off)
        self._listener = listener
        self._loop = asyncio.get_running_loop()
        self.heard = self._loop.time()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.address = socket_address(transport.get_extra_info("peername"))
        before = self._listener.host
        if before is not None and before.up:
            if self._loop.time() - before.heard < HOST_SILENCE:
                self._down = "another host is connected"
                transport.close()
                return
            before.lose(f"{before.address} was silent, and another host took its place")
            before.transport.abort()
        tune(transport.get_extra_info("socket"))
        self._listener.host = self
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        self.heard = self._loop.time()
        super().data_received(data)


class _TcpListener:
    """A TCP port that serves one host at a time."""

    address: str
    server: asyncio.Server

    def __init__(self, end: End) -> None:
        self.end = end
        # the host that is or was connected last
        self.host: _HostLink | None = None

    def close(self) -> None:
        self.server.close()
        if self.host is not None:
            self.host.close()


async def listen_tcp(host: str, port: int, end: End) -> Listener:
    """Listen on a TCP port for one host at a time. Port 0 is any free port; `address` then names it.

    While a host is connected, a second host is turned away, unless the first has sent nothing for HOST_SILENCE seconds:
    then the second replaces it. Raises HalError, with the remedy, if the port is not available.
    """
    loop = asyncio.get_running_loop()
    listener = _TcpListener(end)
    where = f"{host}:{port}"
    if not 0 <= port <= 65535:
        raise HalError(f"cannot listen on {where}: a port is a number from 0 to 65535")
    try:
        # on one address only: a name with two addresses would get two different ports
        if port == 0:
            found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
            host = str(found[0][4][0])
        listener.server = await loop.create_server(lambda: _HostLink(listener), host, port)
    except socket.gaierror as error:
        raise HalError(f"cannot listen on {where}: {host!r} is no name or address of this computer") from error
    except OSError as error:
        # from Python 3.13 on, this error comes without its number
        number = error.errno or errno.EADDRNOTAVAIL
        raise HalError(f"cannot listen on {where}: {_NO_PORT.get(number, error)}") from error
    listener.address = socket_address(listener.server.sockets[0].getsockname())
    return listener


def socket_address(name: Any) -> str:
    """Return the address of a socket in the form of `open_link`."""
    # the peer was gone before its address could be read
    if not name:
        return "socket://?"
    host, port = name[:2]
    return f"socket://[{host}]:{port}" if ":" in host else f"socket://{host}:{port}"
