"""Connections before aiohttp sees them: how many there may be, who goes first, that nobody keeps it busy."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest

from tests.patience import LIMIT
from txt1.web import budgets, connections
from txt1.web.connections import PACE, REFUSALS, STRANGER, WAITING, Connections, Metered

TURNS = 50
"""Turns of the event loop in which whatever is due has happened, on however slow a computer."""


class Server:
    """A server on loopback, and its clients: bare sockets."""

    def __init__(self, context: ssl.SSLContext | None = None) -> None:
        self.connections = Connections(asyncio.Protocol, context, lambda: 100.0)
        self.clients: list[socket.socket] = []
        self._stopped = False

    async def open(self) -> None:
        await self.connections.listen("127.0.0.1", 0)

    def connect(self) -> socket.socket:
        """A client; the system answers for the server, which need not have accepted it."""
        client = socket.create_connection(("127.0.0.1", self.connections.port))
        client.setblocking(False)
        self.clients.append(client)
        return client

    def closed(self) -> list[socket.socket]:
        """The clients that the server has closed."""
        return [each for each in self.clients if _ended(each)]

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(LIMIT):
            while not condition():
                await asyncio.sleep(0)
        for _ in range(TURNS):
            await asyncio.sleep(0)

    def stop(self) -> None:
        if not self._stopped:
            self._stopped = True
            self.connections.close()

    def close(self) -> None:
        self.stop()
        for each in self.clients:
            each.close()


def _ended(client: socket.socket) -> bool:
    try:
        return client.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


@pytest.fixture
async def server() -> AsyncIterator[Server]:
    made = Server()
    await made.open()
    yield made
    made.close()


@pytest.fixture
async def secure(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Server]:
    """A server that waits for handshakes without an end, which its clients do not begin."""
    monkeypatch.setattr(connections, "STRANGER", 1e6)
    made = Server(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER))
    await made.open()
    yield made
    made.close()


async def test_of_a_flood_of_connections_a_few_are_refused_and_then_none_for_a_while(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "REFUSED", 1e6)
    monkeypatch.setattr(budgets.Budgets, "admits", lambda *_: False)
    for _ in range(REFUSALS + 5):
        server.connect()
    await server.until(lambda: len(server.closed()) >= REFUSALS)
    assert len(server.closed()) == REFUSALS


async def test_without_descriptors_it_is_not_tried_again_for_a_while(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[int] = []
    failed: list[Any] = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: failed.append(context))

    def none_left(listening: socket.socket) -> Any:
        tried.append(1)
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(connections, "EXHAUSTED", 1e6)
    monkeypatch.setattr(connections, "REFUSED", 0.0)
    monkeypatch.setattr(socket.socket, "accept", none_left)
    server.connect()
    await server.until(lambda: tried)
    assert len(tried) == 1
    assert failed == []


async def test_no_connection_holds_the_server_up_or_has_more_waiting_than_is_paid_for(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[bool, int]] = []
    loop = asyncio.get_running_loop()

    async def accepted(protocol: object, sock: socket.socket, **_: object) -> None:
        seen.append((sock.getblocking(), sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)))
        sock.close()

    monkeypatch.setattr(loop, "connect_accepted_socket", accepted)
    server.connect()
    await server.until(lambda: seen)
    blocks, waiting = seen[0]
    assert not blocks
    assert waiting <= 2 * WAITING, "the system doubles it"


async def test_the_oldest_handshake_makes_room_for_a_new_one(secure: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 2)
    first, second = secure.connect(), secure.connect()
    for _ in range(TURNS):
        await asyncio.sleep(0)
    assert secure.closed() == []
    third = secure.connect()
    await secure.until(secure.closed)
    assert secure.closed() == [first]
    assert second in secure.clients
    assert third in secure.clients


async def test_a_handshake_that_has_ended_takes_no_room(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 2)
    for number in (1, 2):
        server.connect()
        await server.until(lambda number=number: len(server.connections.open) == number or server.closed())
    assert server.closed() == []


async def test_handshakes_and_connections_take_room_together(secure: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 2)
    page = Metered(secure.connections, "127.0.0.1")
    page.page = True
    page.connection_made(asyncio.Transport())
    first = secure.connect()
    for _ in range(TURNS):
        await asyncio.sleep(0)
    assert secure.closed() == []
    secure.connect()
    await secure.until(secure.closed)
    assert secure.closed() == [first]
    page.connection_lost(None)


async def test_pages_make_no_room_for_others(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 1)
    server.connect()
    await server.until(lambda: server.connections.open)
    next(iter(server.connections.open)).page = True
    refused = server.connect()
    await server.until(server.closed)
    assert server.closed() == [refused]


async def test_a_server_that_closes_closes_its_connections(server: Server) -> None:
    client = server.connect()
    await server.until(lambda: server.connections.open)
    server.stop()
    await server.until(server.closed)
    assert server.closed() == [client]


async def test_a_server_that_closes_waits_for_no_handshake(secure: Server) -> None:
    client = secure.connect()
    for _ in range(TURNS):
        await asyncio.sleep(0)
    secure.stop()
    await secure.until(secure.closed)
    assert secure.closed() == [client]


async def test_of_connections_over_their_budget_one_piece_is_read_at_a_time(server: Server) -> None:
    pace = server.connections.pace
    assert [pace(), pace(), pace()] == pytest.approx([PACE, 2.0 * PACE, 3.0 * PACE])


async def test_it_listens_at_the_address_that_it_is_asked_for_and_no_other(server: Server) -> None:
    server.connect()
    with pytest.raises(ConnectionRefusedError):
        # another address of loopback stands for all others
        socket.create_connection(("127.0.0.2", server.connections.port))


async def test_a_server_that_is_started_again_gets_its_port_at_once(server: Server) -> None:
    client = server.connect()
    await server.until(lambda: server.connections.open)
    port = server.connections.port
    server.stop()
    await server.until(server.closed)
    # the system remembers the connection for a minute
    client.close()
    again = Connections(asyncio.Protocol, None, lambda: 100.0)
    await again.listen("127.0.0.1", port)
    assert again.port == port
    again.close()


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this computer has no IPv6")
async def test_the_same_port_of_the_other_family_is_free() -> None:
    made = Connections(asyncio.Protocol, None, lambda: 100.0)
    await made.listen("::", 0)
    try:
        with socket.socket(socket.AF_INET) as other:
            other.bind(("0.0.0.0", made.port))
    finally:
        made.close()


async def test_a_connection_that_asks_for_nothing_is_closed_after_a_while() -> None:
    clock = 100.0
    made = Connections(asyncio.Protocol, None, lambda: clock)
    silent, asked = Metered(made, "127.0.0.1"), Metered(made, "127.0.0.1")
    closed: list[Metered] = []
    for each in (silent, asked):
        each.connection_made(_Transport(lambda each=each: closed.append(each)))  # type: ignore[misc]
    asked.asked = True
    clock += STRANGER
    made.hang_up()
    assert closed == []
    clock += 0.1
    made.hang_up()
    assert closed == [silent]


class _Transport(asyncio.Transport):
    """Tells when it is closed, and remembers what it was told."""

    def __init__(self, aborted: Callable[[], object] = lambda: None) -> None:
        super().__init__()
        self._aborted, self.told = aborted, list[str]()

    def abort(self) -> None:
        self.told.append("abort")
        self._aborted()

    def is_closing(self) -> bool:
        return "abort" in self.told

    def pause_reading(self) -> None:
        self.told.append("pause")

    def resume_reading(self) -> None:
        self.told.append("resume")


class _Heard(asyncio.Protocol):
    """Counts the bytes that pass, and remembers whether it may write."""

    def __init__(self) -> None:
        self.bytes, self.told = 0, list[str]()

    def data_received(self, data: bytes) -> None:
        self.bytes += len(data)

    def pause_writing(self) -> None:
        self.told.append("pause")

    def resume_writing(self) -> None:
        self.told.append("resume")


@pytest.mark.parametrize(
    ("page", "farewell", "heard"), [(True, 2000, 1000), (True, 2001, 2000), (True, 2999, 2000), (False, 3000, 0)]
)
async def test_a_page_over_its_budget_is_searched_for_a_stop_and_anything_else_is_closed(
    page: bool, farewell: int, heard: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "FAREWELL", farewell)
    inner, closed = _Heard(), list[int]()
    made = Connections(lambda: inner, None, lambda: 100.0)
    metered = Metered(made, "127.0.0.1")
    metered.connection_made(_Transport(lambda: closed.append(inner.bytes)))
    metered.page, metered.account.exceeded = page, True
    for _ in range(5):
        if not closed:
            metered.get_buffer(-1)[:1000] = bytes(1000)
            metered.buffer_updated(1000)
    assert closed == [heard]
    metered.connection_lost(None)


@pytest.mark.parametrize("page", [True, False])
@pytest.mark.parametrize("lost", [False, True])
async def test_whoever_exceeds_the_budget_is_closed_a_page_after_it_was_read_on(
    page: bool, lost: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "PACE", 0.0)
    monkeypatch.setattr(connections, "ABORT_AFTER", 0.0)
    metered = Metered(Connections(asyncio.Protocol, None, lambda: 100.0), "127.0.0.1")
    transport = _Transport()
    metered.connection_made(transport)
    metered.page = page
    assert not metered.account.spend(100.0, 1e9)
    assert transport.told == ["pause"] * page, "not from within a call of the transport"
    if lost:
        metered.connection_lost(None)
    async with asyncio.timeout(LIMIT):
        while "abort" not in transport.told and not (lost and page):
            await asyncio.sleep(0)
    for _ in range(TURNS):
        await asyncio.sleep(0)
    of_a_page = ["pause"] if lost else ["pause", "resume", "abort"]
    assert transport.told == (of_a_page if page else ["abort"])


async def test_a_client_that_does_not_read_holds_the_server_s_answers_back() -> None:
    inner = _Heard()
    metered = Metered(Connections(lambda: inner, None, lambda: 100.0), "127.0.0.1")
    metered.connection_made(_Transport())
    metered.pause_writing()
    metered.resume_writing()
    assert inner.told == ["pause", "resume"]


async def test_the_oldest_connection_that_is_no_page_makes_room(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 1)
    first = server.connect()
    await server.until(lambda: server.connections.open)
    server.connect()
    await server.until(server.closed)
    assert server.closed() == [first]


async def test_budgets_are_of_the_address_and_not_of_the_port(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def admits(self: object, address: str, now: float) -> bool:
        asked.append(address)
        return False

    monkeypatch.setattr(budgets.Budgets, "admits", admits)
    server.connect()
    await server.until(lambda: asked)
    assert set(asked) == {"127.0.0.1"}
