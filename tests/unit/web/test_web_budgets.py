"""What a connection may cost the server: its own share, its address's, the total, and the operators' reserve."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from benchmarks.web_stop import frame  # noqa: E402
from tests.patience import LIMIT  # noqa: E402
from tests.unit.web.test_web_routes import Site, served  # noqa: E402
from txt1.web import budgets, connections  # noqa: E402
from txt1.web.budgets import ADDRESS, CONNECTS, OWN, RESERVE, TOTAL, Account, Budget, Budgets  # noqa: E402
from txt1.web.connections import FAREWELL, READ_BYTES  # noqa: E402

STOP: Final = frame(1, b'{"do": "stop"}')


# -- accounts ----------------------------------------------------------------------------------------------------------


def spent(account: Account, now: float = 0.0, cost: float = 1.0) -> int:
    """How often an account pays a cost until it is exceeded."""
    times = 0
    while account.spend(now, cost):
        times += 1
    return times


def test_a_connection_spends_its_own_its_address_s_and_an_operator_the_reserve() -> None:
    for operator, more in ((False, 0.0), (True, RESERVE[1])):
        account = Budgets().account("a")
        account.operator = operator
        assert spent(account) == OWN[1] + ADDRESS[1] + more and account.exceeded
        assert not account.spend(1000.0, 0.0), "it gets nothing any more"


def test_a_flood_takes_nothing_from_the_own_share_of_its_neighbours() -> None:
    there = Budgets()
    for name in ("a", *"bcdefg"):
        spent(there.account(name))
    for name in ("a", "z"):
        assert spent(there.account(name)) == OWN[1]
    operator = there.account("a")
    operator.operator = True
    assert spent(operator) == OWN[1] + RESERVE[1], "the reserve was nobody else's"


def test_all_addresses_together_spend_no_more_than_the_total() -> None:
    there = Budgets()
    assert sum(spent(there.account(str(k))) - int(OWN[1]) for k in range(100)) == TOTAL[1]


def test_connections_are_limited_by_address_and_an_excess_makes_the_next_dearer() -> None:
    there = Budgets()
    assert [there.admits("a", 0.0) for _ in range(int(CONNECTS[1]) + 1)] == [True] * int(CONNECTS[1]) + [False]
    assert there.admits("b", 0.0)
    there.address("a").operator = True
    assert there.admits("a", 0.0), "operators have a reserve"
    spent(there.account("b"))
    before = sum(there.admits("b", 0.0) for _ in range(200))
    assert before == CONNECTS[1] - 1 - budgets.PENALTY


def test_many_addresses_together_make_only_so_many_connections_and_take_no_memory() -> None:
    there = Budgets()
    assert sum(there.admits(str(k), 0.0) for k in range(5000)) == budgets.CONNECTS_TOTAL[1]
    first = there.address("again")
    for k in range(budgets.ADDRESSES_MAX):
        there.address(f"x{k}")
    assert there.address("again") is not first, "the oldest are forgotten"


def test_an_address_that_comes_again_is_kept_and_only_the_oldest_is_forgotten() -> None:
    there = Budgets()
    first, second = there.address("first"), there.address("second")
    for k in range(budgets.ADDRESSES_MAX - 2):
        there.address(f"x{k}")
    assert there.address("first") is first, "so many are kept"
    there.address("one more")
    assert there.address("first") is first
    assert there.address("second") is not second


def test_nobody_is_an_operator_without_having_signed_in() -> None:
    there = Budgets()
    assert not there.address("a").operator
    assert not there.account("a").operator


@given(st.lists(st.tuples(st.floats(0.0, 0.5), st.sampled_from([0.25, 1.0, 10.0])), max_size=300))
def test_no_account_is_overdrawn(steps: list[tuple[float, float]]) -> None:
    account, now, paid = Budgets().account("a"), 0.0, 0.0
    for pause, cost in steps:
        now += pause
        if account.spend(now, cost):
            paid += cost
        assert paid <= OWN[1] + ADDRESS[1] + (OWN[0] + ADDRESS[0]) * now + 1e-6


# -- at the socket -----------------------------------------------------------------------------------------------------


@pytest.fixture
async def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Site]:
    """A page's server whose connections have little and get no more: time brings no budget, however slow all is."""
    monkeypatch.setattr(budgets, "OWN", (0.0, 40.0))
    for name in ("ADDRESS", "TOTAL", "RESERVE"):
        monkeypatch.setattr(budgets, name, (0.0, 0.0))
    async with served(tmp_path) as site:
        yield site


async def opened(
    site: Site, role: str = "visitor", path: str = "/socket"
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """A page's socket."""
    reader, writer = await site.connect()
    asked = {
        **site.headers(role),
        "Host": site.host,
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    lines = "".join(f"{name}: {value}\r\n" for name, value in asked.items())
    writer.write(f"GET {path} HTTP/1.1\r\n{lines}\r\n".encode())
    assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 101")
    return reader, writer


async def ended(reader: asyncio.StreamReader) -> bytes:
    """All that comes until the connection is closed."""
    come = b""
    async with asyncio.timeout(LIMIT):
        try:
            while piece := await reader.read(1 << 16):
                come += piece
        except ConnectionError:
            pass
    return come


FRAMES: Final[dict[str, bytes]] = {
    "messages": frame(1, b"{}") * 100,
    "stops": STOP * 100,
    "pings": frame(9, b"") * 1000,
    "long pings": frame(9, b"x" * 125) * 100,
    "pongs": frame(10, b"") * 1000,
    "empty fragments": frame(1, b'{"do": "st', last=False) + frame(0, b"", last=False) * 2500 + frame(0, b'op"}'),
    "fragments of a byte": b"".join(frame(0 if k else 1, b"x", last=False) for k in range(2500)) + frame(0, b"x"),
    "long messages": frame(1, b'"stop"' + b"x" * 8000) * 3,
}


@pytest.mark.parametrize("path", ["/socket", "/stop"])
@pytest.mark.parametrize("role", ["visitor", "operator"])
@pytest.mark.parametrize("kind", FRAMES)
async def test_a_stop_behind_a_flood_of_any_frames_is_obeyed_and_then_its_page_is_closed(
    kind: str, role: str, path: str, site: Site
) -> None:
    reader, writer = await opened(site, role, path)
    writer.write(FRAMES[kind] + frame(1, b'{"do": "disarm"}') + STOP)
    await ended(reader)
    await site.until(lambda: not site.pages.connected and not site.pages.stop_channels)
    assert site.robot.times("stop") >= 1 and site.robot.times("disarm") == 0


async def test_a_server_that_was_held_up_looks_for_a_stop_before_it_closes(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    # as late as its loop may be, what has come is read
    monkeypatch.setattr(connections, "ABORT_AFTER", 0.0)
    reader, writer = await opened(site)
    # more than its budget, and no more than waits in the system at once
    writer.write(frame(1, b'"stop"' + b"x" * 6000) * 2 + STOP)
    await ended(reader)
    await site.until(lambda: not site.pages.connected)
    assert site.robot.times("stop") >= 1


async def test_a_flood_without_an_end_is_read_for_a_while_only(site: Site) -> None:
    _, writer = await opened(site)
    with pytest.raises(ConnectionError):
        for _ in range(1000):
            writer.write(frame(9, b"") * 1000)
            await writer.drain()
    await site.until(lambda: not site.pages.connected)
    assert FAREWELL >= 4 * READ_BYTES


async def test_pings_are_answered_as_long_as_they_are_paid(site: Site) -> None:
    reader, writer = await opened(site)
    writer.write(frame(9, b"hallo") * 1000)
    come = await ended(reader)
    assert 0 < come.count(b"\x8a\x05hallo") < 40


@pytest.mark.parametrize(("path", "answered"), [("/style.css", 3), ("/socket", 3), ("/recordings/run.mcap", 3)])
async def test_requests_that_come_at_once_are_answered_as_long_as_they_are_paid(
    path: str, answered: int, site: Site
) -> None:
    reader, writer = await site.connect()
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {site.host}\r\n\r\n".encode() * 20)
    come = await ended(reader)
    assert come.count(b"HTTP/1.1 ") - come.count(b"HTTP/1.1 408") == answered


async def test_wrong_tokens_cost_more_than_other_requests(site: Site) -> None:
    reader, writer = await site.connect()
    head = f"POST /sign-in HTTP/1.1\r\nHost: {site.host}\r\nOrigin: http://{site.host}\r\nContent-Length: 7\r\n\r\n"
    writer.write(f"{head}token=x".encode() * 20)
    assert (await ended(reader)).count(b"HTTP/1.1 403") == 1


async def test_too_many_connections_are_closed_before_anything_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(budgets, "CONNECTS", (0.0, 2.0))
    monkeypatch.setattr(budgets, "CONNECTS_RESERVE", (0.0, 1.0))
    async with served(tmp_path) as site:
        for _ in range(2):
            await opened(site, "visitor")
        reader, _ = await site.connect()
        assert await ended(reader) == b""
        site.connections.budgets.address("127.0.0.1").operator = True
        await opened(site, "operator")
        reader, _ = await site.connect()
        assert await ended(reader) == b"", "the reserve has an end, too"


async def test_an_operator_s_address_is_known_by_a_cookie_and_a_visitor_s_is_none(site: Site) -> None:
    address = site.connections.budgets.address("127.0.0.1")
    await opened(site, "visitor")
    assert not address.operator
    await opened(site, "operator")
    assert address.operator


async def test_descriptors_that_run_out_close_nothing_and_later_connections_come(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "EXHAUSTED", 0.0)
    await opened(site)
    failed: list[int] = []
    accept: Callable[..., Any] = socket.socket.accept

    def none_left(listening: socket.socket) -> Any:
        if len(failed) < 3:
            failed.append(1)
            raise OSError(24, "Too many open files")
        return accept(listening)

    monkeypatch.setattr(socket.socket, "accept", none_left)
    await opened(site)
    assert len(failed) == 3 and len(site.pages.connected) == 2


def test_a_fine_takes_what_is_there() -> None:
    budget = Budget(1.0, 5.0)
    budget.fine(0.0, 3.0)
    assert budget.has(0.0, 2.0) and not budget.has(0.0, 2.1)
    budget.fine(0.0, 3.0)
    assert not budget.has(0.0, 0.1) and budget.has(1.0, 1.0)


def test_a_fine_is_taken_of_what_has_come_meanwhile() -> None:
    budget = Budget(1.0, 5.0)
    assert budget.spend(0.0, 5.0)
    budget.fine(2.0, 1.0)
    assert budget.has(2.0, 1.0) and not budget.has(2.0, 1.1)
