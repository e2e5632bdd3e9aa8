"""What a page may ask for: nothing raises, in a flood only a stop is heard, and another page's stop does not wait."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.any_json import JSON
from tests.examples import examples

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from tests.patience import LIMIT  # noqa: E402
from txt1.web import pages as pages_module  # noqa: E402
from txt1.web import requests, routes  # noqa: E402
from txt1.web.auth import Role  # noqa: E402
from txt1.web.budgets import FRAME_COST, PING_COST, Account, Address, Budget, Budgets  # noqa: E402
from txt1.web.pages import STOPS_PERIOD, Page, Pages  # noqa: E402
from txt1.web.requests import REQUESTS, STOP_MAX, take  # noqa: E402
from txt1.web.routes import SEARCHED, listen  # noqa: E402

STOP = '{"do": "stop"}'
ALIKE = '{"a": "stop", "do": "wind"}'
BURST = 160


class Robot:
    """Writes down what it is asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, dict[str, object]]] = []

    def fileno(self) -> int:
        return -1

    def newest(self) -> bytes | None:
        return None

    def request(self, name: str, /, **fields: object) -> None:
        json.dumps(fields)
        self.asked.append((name, fields))

    def times(self, name: str) -> int:
        return [each for each, _ in self.asked].count(name)


class Socket:
    """Of a browser that has sent everything already: reading it never waits."""

    def __init__(self, *texts: object) -> None:
        self.texts = texts
        self.read = self.pongs = 0

    async def __aiter__(self) -> AsyncIterator[aiohttp.WSMessage]:
        for text in self.texts:
            self.read += 1
            if isinstance(text, str):
                yield aiohttp.WSMessage(aiohttp.WSMsgType.TEXT, text, None)
            else:
                yield aiohttp.WSMessage(text, b"", None)

    async def pong(self, _: bytes) -> None:
        self.pongs += 1


@pytest.fixture
def robot() -> Robot:
    return Robot()


def pages_of(robot: Robot) -> Pages:
    return Pages(robot, Path("/nowhere"), 0.5, {}, [], invites=False)


def join(pages: Pages, socket: object = None, role: Role = "operator") -> Page:
    """A page that may spend `BURST` units at once, and nothing of what others have."""
    account = Account(Budgets(), Address(Budget(0.0, 0.0)), Budget(80.0, BURST))
    page = pages.join(role, "127.0.0.1", socket or Socket(), account)  # type: ignore[arg-type]
    page.clock.answered(0.0, 0.0, 0.0)
    return page


@pytest.fixture
def frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time stands still, so no page's budget grows, however slow the computer is."""
    for module in (requests, routes):
        monkeypatch.setattr(module, "now", lambda: 0.0)
    monkeypatch.setattr(pages_module, "STOPS_PERIOD", 0.0)


@pytest.mark.usefixtures("frozen")
async def test_in_a_flood_nothing_but_a_stop_is_heard(robot: Robot) -> None:
    pages = pages_of(robot)
    page = join(pages)
    for _ in range(1000):
        take(pages, page, ALIKE)
    assert page.counts["dropped"] == 1000 - BURST and page.account.exceeded
    for no_stop in (
        '{"do": "drive", "stop": "stop"}',
        '["stop"]',
        '"stop"',
        '{"stop"',
        '{"do": ["stop"]}',
        '{"do": "stop", "x": "%s"}' % (STOP_MAX * "x"),
    ):
        take(pages, page, no_stop)
    assert robot.times("stop") == 0 and page.counts["malformed"] == 0, "only counted as dropped"
    for stop in (STOP, '{"n": 7, "t": 1.5, "do": "stop"}', '{ "do" : "stop" }', STOP.ljust(STOP_MAX)):
        take(pages, page, stop)
    assert robot.times("stop") == 4


@pytest.mark.usefixtures("frozen")
async def test_a_stop_is_confirmed_to_the_page_that_sent_it_unless_the_robot_is_gone(robot: Robot) -> None:
    pages = pages_of(robot)
    page, other = join(pages), join(pages)
    for each in (page, other):
        each.outbox.clear()
    take(pages, page, '{"do": "stop", "stop": 3}')
    assert [json.loads(text) for text in page.outbox] == [{"stop": 3}] and not other.outbox

    def gone(name: str, /, **fields: object) -> None:
        raise BrokenPipeError

    robot.request = gone  # type: ignore[method-assign]
    take(pages, page, '{"do": "stop", "stop": 4}')
    assert len(page.outbox) == 1


async def test_of_many_stops_at_once_the_first_and_the_last_are_passed_on(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flood of stops does not fill the line. None is lost, because an order to arm may come before it."""
    present = 5.0
    monkeypatch.setattr(pages_module, "now", lambda: present)
    pages = pages_of(robot)
    page = join(pages)
    page.outbox.clear()
    for _ in range(100):
        take(pages, page, STOP)
    pages.ask(page, "arm")
    take(pages, page, STOP)
    assert [name for name, _ in robot.asked if name in ("stop", "arm")] == ["stop", "arm"]
    assert len(page.outbox) == 1, "what was not passed on is not confirmed"
    async with asyncio.timeout(LIMIT):
        while robot.times("stop") == 1:
            await asyncio.sleep(STOPS_PERIOD)
    assert robot.asked[-1] == ("stop", {}) and robot.times("stop") == 2 and len(page.outbox) == 2
    present += STOPS_PERIOD
    take(pages, page, STOP)
    assert robot.times("stop") == 3


@pytest.mark.usefixtures("frozen")
async def test_a_stop_waits_for_one_message_of_another_page_at_a_time(robot: Robot) -> None:
    pages = pages_of(robot)
    flood, operator = Socket(*[ALIKE] * 1000), Socket(STOP)
    flooding = asyncio.ensure_future(listen(pages, join(pages, flood), flood))  # type: ignore[arg-type]
    stopping = asyncio.ensure_future(listen(pages, join(pages, operator), operator))  # type: ignore[arg-type]
    await stopping
    assert robot.times("stop") == 1 and flood.read <= 3
    await flooding
    assert flood.read == 1000, "what has come is searched for a stop"


@pytest.mark.usefixtures("frozen")
@pytest.mark.parametrize(("exceeded", "at_once"), [(False, 1), (True, SEARCHED)])
async def test_a_page_lets_others_go_on_after_each_message_or_a_piece_of_a_flood(
    exceeded: bool, at_once: int, robot: Robot
) -> None:
    pages, socket = pages_of(robot), Socket(*["{}"] * 3 * SEARCHED)
    page = join(pages, socket)
    page.account.exceeded = exceeded
    listening = asyncio.ensure_future(listen(pages, page, socket))  # type: ignore[arg-type]
    for turn in range(3):
        await asyncio.sleep(0)
        assert socket.read == at_once * (turn + 1)
    listening.cancel()


@pytest.mark.usefixtures("frozen")
async def test_pings_and_pongs_cost_a_page_its_budget_and_are_not_answered_beyond_it(robot: Robot) -> None:
    pages, socket = pages_of(robot), Socket(*[aiohttp.WSMsgType.PING, aiohttp.WSMsgType.PONG] * BURST, STOP)
    page = join(pages, socket)
    await listen(pages, page, socket)  # type: ignore[arg-type]
    assert socket.pongs == BURST // (PING_COST + FRAME_COST) and page.account.exceeded
    assert robot.times("stop") == 1, "it is obeyed behind them"


@pytest.mark.usefixtures("frozen")
async def test_a_dear_request_is_paid_as_a_whole(robot: Robot) -> None:
    pages = pages_of(robot)
    page = join(pages)
    cost = REQUESTS["files"].cost
    assert BURST % cost == 0
    # so that what is left at the end pays for a message, but not for what it asks
    take(pages, page, ALIKE)
    for _ in range(int(BURST // cost) - 1):
        take(pages, page, '{"do": "files"}')
    assert not page.account.exceeded and page.counts["dropped"] == 0
    take(pages, page, '{"do": "files"}')
    assert page.account.exceeded and page.counts["dropped"] == 1


@pytest.mark.usefixtures("frozen")
@pytest.mark.parametrize("do", REQUESTS)
async def test_a_request_costs_what_its_row_says_and_no_more(do: str, robot: Robot) -> None:
    pages = pages_of(robot)
    page = join(pages)
    page.account.own = Budget(0.0, REQUESTS[do].cost)
    take(pages, page, json.dumps({"do": do}))
    assert page.counts["dropped"] == 0 and not page.account.exceeded
    assert not page.account.own.has(0.0, 1e-9)


@pytest.mark.parametrize("late", [0.0, 0.1, 0.24])
async def test_a_command_is_handed_on_with_its_age(late: float, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests, "now", lambda: 50.0)
    pages = pages_of(robot)
    page = join(pages)
    page.clock.answered(49.9, 10.0, 49.9)  # its clock is 39.9 s behind
    for number, message in enumerate(({"do": "drive", "v": 0.5, "omega": 0.1}, {"do": "hold"})):
        take(pages, page, json.dumps({**message, "n": number, "t": 10.1 - late}))
        assert robot.asked[-1][0] == message["do"]
        assert robot.asked[-1][1]["age"] == pytest.approx(late)


async def test_a_visitor_who_is_too_fast_drives_the_same_curve_slowly(robot: Robot) -> None:
    pages = pages_of(robot)
    page = join(pages, role="visitor")
    page.clock.answered(requests.now(), requests.now(), requests.now())
    take(pages, page, json.dumps({"do": "drive", "v": -2.0, "omega": 1.0, "n": 1, "t": requests.now()}))
    assert robot.asked[-1][1] | {"age": 0.0} == {"v": -0.5, "omega": 0.25, "age": 0.0, "held": True}


NAMES = (
    "n", "t", "v", "omega", "ping", "points", "speed", "linear", "angular", "on", "name", "topics", "to", "hold",
)  # fmt: skip
ASKED = st.dictionaries(st.sampled_from(NAMES), JSON | st.floats(-1.0, 1.0) | st.integers(0, 99))


@settings(max_examples=examples(120), deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted(REQUESTS)) | JSON, ASKED) | JSON, max_size=20))
def test_nothing_that_a_page_sends_raises_and_what_is_right_is_done_after_it(messages: list[Any]) -> None:
    async def main() -> None:
        robot = Robot()
        pages = pages_of(robot)
        page, other = join(pages), join(pages)
        # no stop waits for another
        patch.setattr(pages_module, "STOPS_PERIOD", 0.0)
        for message in messages:
            asked = {**message[1], "do": message[0]} if isinstance(message, tuple) else message
            take(pages, page, json.dumps(asked))
        take(pages, page, json.dumps({"do": "give"}))
        other.clock.answered(0.0, 0.0, requests.now())
        before = robot.times("drive")
        take(pages, other, json.dumps({"do": "drive", "v": 0.5, "omega": 0.0, "n": 1, "t": requests.now()}))
        assert robot.times("drive") == before + 1
        take(pages, page, STOP)
        assert robot.asked[-1] == ("stop", {})

    with pytest.MonkeyPatch.context() as patch:
        asyncio.run(main())


async def test_a_mistake_of_ours_costs_one_message(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("of ours")

    monkeypatch.setattr(requests, "REQUESTS", {**REQUESTS, "broken": REQUESTS["wind"]._replace(do=broken)})
    pages = pages_of(robot)
    page = join(pages)
    take(pages, page, '{"do": "broken"}')
    assert json.loads(page.outbox[-1]) == {"told": "that failed: ZeroDivisionError: of ours"}
    assert page.counts == {"malformed": 1}
    take(pages, page, STOP)
    assert robot.times("stop") == 1
