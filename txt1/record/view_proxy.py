"""A proxy before the live view that lets through a bounded number of clients, and where there is a token who has it.

The server of the Foxglove library takes any number and cannot ask. So it listens on the loopback interface, at a port
of its own, and this one where the user wants it. Where there is a token a client presents it in the address,
``ws://HOST:PORT/?token=TOKEN``, or in the header ``Authorization: Bearer TOKEN``; then its bytes are passed on as they
come.
"""

import asyncio
import re
import secrets
import socket
import stat
import threading
from contextlib import suppress
from hmac import compare_digest
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Final
from urllib.parse import parse_qs

from txt1.errors import ConfigError

HEAD_MAX: Final = 16_384  # bytes of a request's head
HEAD_TIME: Final = 5.0  # real s in which it has to come
STRANGERS_MAX: Final = 32  # connections that have not said yet, with the token if need be, what they want
STRANGERS_ALIKE_MAX: Final = 8  # of those, from one address
CLIENTS_MAX: Final = 16  # connections that are let through at a time
PIECE: Final = 1 << 16
TOKEN_MIN: Final = 16  # characters of a token; fewer could be guessed
TOKEN: Final = re.compile(rf"[A-Za-z0-9._~-]{{{TOKEN_MIN},}}")  # stands in an address as it is

REFUSED: Final = (
    b"HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Bearer\r\nContent-Type: text/plain\r\n"
    b"Content-Length: 51\r\nConnection: close\r\n\r\n"
    b"the live view asks for its token: add ?token=TOKEN\n"
)
FULL: Final = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain\r\nContent-Length: 37\r\nConnection: close\r\n\r\n"
    b"the live view has 16 clients already\n"
)


class ViewProxy:
    """A server in a thread of its own; `port` is 0 for any that is free, `inner` the one on the loopback interface.

    Without a token everybody is let through, as long as there is room.

    Raises ConfigError: the address cannot be listened on.
    """

    def __init__(self, host: str, port: int, inner: int, token: str | None) -> None:
        self._inner = inner
        self._token = None if token is None else token.encode()
        self._clients = 0
        self._strangers: list[str] = []  # the addresses that they come from
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, name="txt1 live view", daemon=True)
        self._thread.start()
        served = asyncio.start_server(self._meet, host, port, limit=HEAD_MAX)
        try:
            self._server = asyncio.run_coroutine_threadsafe(served, self._loop).result()
        except (OSError, UnicodeError) as error:  # the latter for what cannot be a host's name
            self._end()
            why = error.strerror if isinstance(error, OSError) and error.strerror else error
            raise ConfigError(f"--view {host}:{port}: cannot listen there: {why}; choose another address") from None
        self.port: int = self._server.sockets[0].getsockname()[1]

    def close(self) -> None:
        """Let go of the clients."""
        self._loop.call_soon_threadsafe(self._server.close)
        self._end()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _serve(self) -> None:
        self._loop.run_forever()
        self._loop.run_until_complete(self._part())
        self._loop.close()

    async def _part(self) -> None:
        clients = asyncio.all_tasks() - {asyncio.current_task()}
        for client in clients:
            client.cancel()
        await asyncio.gather(*clients, return_exceptions=True)

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """See a client in, or send it away."""
        try:
            address = writer.get_extra_info("peername")[0]
            if len(self._strangers) < STRANGERS_MAX and self._strangers.count(address) < STRANGERS_ALIKE_MAX:
                self._strangers.append(address)
                try:
                    async with asyncio.timeout(HEAD_TIME):
                        head = await reader.readuntil(b"\r\n\r\n")
                finally:
                    self._strangers.remove(address)
                welcome = self._token is None or compare_digest(presented(head), self._token)
                if welcome and self._clients < CLIENTS_MAX:
                    self._clients += 1
                    try:
                        await self._let_through(head, reader, writer)
                    finally:
                        self._clients -= 1
                else:
                    writer.write(FULL if welcome else REFUSED)
                    await writer.drain()
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.CancelledError):
            pass  # it has gone, or is no client; only `_part` cancels, and asyncio's streams would print that
        finally:
            writer.close()

    async def _let_through(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", self._inner)
        try:
            inner_writer.write(b"GET / HTTP/1.1" + head[head.index(b"\r\n") :])
            await asyncio.gather(_pass_on(reader, inner_writer), _pass_on(inner_reader, writer))
        finally:
            inner_writer.close()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Bytes from one end to the other, until one has gone; then the other goes, too."""
    with suppress(OSError):
        while data := await reader.read(PIECE):
            writer.write(data)
            await writer.drain()
    writer.close()


def presented(head: bytes) -> bytes:
    """The token in the head of a request; empty when there is none."""
    request, *fields = head.decode("latin-1").split("\r\n")
    target = request.partition(" ")[2].partition(" ")[0]
    if tokens := parse_qs(target.partition("?")[2]).get("token"):
        return tokens[0].encode()
    for field in fields:
        name, _, value = field.partition(":")
        scheme, _, token = value.strip().partition(" ")
        if name.lower() == "authorization" and scheme.lower() == "bearer":
            return token.strip().encode()
    return b""


def token_in(file: Path, option: str = "--view-token") -> str:
    """The token that is in a file; when there is no file it is made, with a new one, for its owner's eyes only.

    Raises ConfigError, which names the `option`: it is no regular file, others may read it, its token is no good, or it
    cannot be read or made.
    """
    try:
        if not file.exists():
            _make(file)
        mode = file.stat().st_mode
        if not stat.S_ISREG(mode):
            raise ConfigError(f"{option} {file}: not a regular file; name one, or one that is to be made")
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise ConfigError(f"{option} {file}: others may read it; chmod 600 {file}")
        token = file.read_text(encoding="latin-1").strip()
    except OSError as error:
        raise ConfigError(f"{option} {file}: {error.strerror}; give a file that can be read or made") from None
    if not TOKEN.fullmatch(token):
        raise ConfigError(
            f"{option} {file}: its token has to be a word of at least {TOKEN_MIN} characters, each a letter from A "
            "to Z or a to z, a digit or one of . _ ~ -; delete the file, and a good one is made"
        )
    return token


def _make(file: Path) -> None:
    """Put a file with a new token there, whole from the first; one that has come there meanwhile stays."""
    with NamedTemporaryFile("w", encoding="ascii", dir=file.parent, prefix=".token-") as made:  # has mode 0600
        made.write(secrets.token_urlsafe(32) + "\n")
        made.flush()
        with suppress(FileExistsError):
            file.hardlink_to(made.name)
