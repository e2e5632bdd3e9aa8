"""A page's connections for stops: they may stop the robot, and nothing else; a stop that comes on all is one."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from tests.unit.web.test_web_budgets import opened  # noqa: E402
from tests.unit.web.test_web_requests import STOP, Socket, frozen, join, pages_of  # noqa: E402, F401
from tests.unit.web.test_web_requests import Robot as Asked  # noqa: E402
from tests.unit.web.test_web_routes import Site, served  # noqa: E402
from txt1.bridges.registry import RobotEnd  # noqa: E402
from txt1.control.limits import Fault  # noqa: E402
from txt1.kernel.clock import seconds  # noqa: E402
from txt1.kernel.loop import clock_of, run  # noqa: E402
from txt1.robot import Robot  # noqa: E402
from txt1.sidecar import Request  # noqa: E402
from txt1.tasks.fields import EVENTS  # noqa: E402
from txt1.web import pages as pages_module  # noqa: E402
from txt1.web import requests, routes  # noqa: E402
from txt1.web.budgets import Account, Address, Budget, Budgets  # noqa: E402
from txt1.web.pages import Page, Pages  # noqa: E402
from txt1.web.requests import REQUESTS, take  # noqa: E402
from txt1.web.routes import listen  # noqa: E402


class Line:
    """To the robot's end of the page's bridge, in its process."""

    def __init__(self, robot: Robot) -> None:
        self._end = RobotEnd(robot, "web", {})

    def fileno(self) -> int:
        return -1

    def newest(self) -> bytes | None:
        return None

    def request(self, name: str, /, **fields: object) -> None:
        self._end.request(Request(name, json.loads(json.dumps(fields)), 0.0))


def channel_of(pages: Pages, units: float = 160.0) -> Page:
    account = Account(Budgets(), Address(Budget(0.0, 0.0)), Budget(80.0, units))
    return pages.join_stop_channel("127.0.0.1", Socket(), account)  # type: ignore[arg-type]


@pytest.mark.parametrize("by", [("channel",), ("page", "channel"), ("channel", "page"), ("page",)])
def test_a_stop_by_either_connection_or_by_both_stops_once(
    by: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        clock = clock_of(asyncio.get_running_loop())
        for module in (pages_module, requests):
            monkeypatch.setattr(module, "now", lambda: seconds(clock.now_ns()))
        async with Robot.open(hal="sim", seed=1) as car:
            car.arm()
            drive = asyncio.ensure_future(car.drive(0.5, 0.0, 5.0))
            await asyncio.sleep(1.0)
            pages = Pages(Line(car), Path("/nowhere"), 0.5, {}, [], invites=False)
            connections = {"page": join(pages), "channel": channel_of(pages)}
            pressed = car.now
            # as static/link.js does
            for _ in range(3):
                for each in by:
                    take(pages, connections[each], '{"do": "stop", "stop": 1}')
                assert car.runtime.gate.stopped and car.now - pressed < 0.1
                await asyncio.sleep(0.03)
            assert car.runtime.faults()[Fault.STOP] == 1
            assert ['{"stop":1}' in connections[each].outbox for each in by] == [True] * len(by)
            drive.cancel()
            await asyncio.sleep(2.0)
            assert not car.armed and car.runtime.state.control.outputs.motor == 0
            stops = [event for event in car.runtime.bus.read(EVENTS) or () if "emergency stop" in str(event)]
            assert len(stops) == 1

    run(main(), speed="max")


@pytest.mark.usefixtures("frozen")
async def test_a_flood_on_a_stop_channel_pays_for_itself_and_delays_no_page() -> None:
    robot = Asked()
    pages, address = pages_of(robot), Address(Budget(0.0, 0.0))
    budgets = Budgets()
    flood, operator = Socket(*['{"do": "drive"}'] * 1000, STOP), Socket(STOP)
    channel = pages.join_stop_channel("127.0.0.1", flood, Account(budgets, address))  # type: ignore[arg-type]
    page = pages.join("operator", "127.0.0.1", operator, Account(budgets, address))  # type: ignore[arg-type]
    flooding = asyncio.ensure_future(listen(pages, channel, flood))  # type: ignore[arg-type]
    stopping = asyncio.ensure_future(listen(pages, page, operator))  # type: ignore[arg-type]
    await stopping
    assert robot.times("stop") == 1 and flood.read <= 3
    await flooding
    assert channel.account.exceeded and robot.times("stop") == 2, "its own stop is obeyed, too"
    assert not page.account.exceeded and robot.times("drive") == 0


@pytest.fixture
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    async with served(tmp_path) as site:
        yield site


async def test_a_stop_channel_is_no_page_and_hears_nothing_but_confirmations(site: Site) -> None:
    async with site.client.ws_connect("/stop", headers=site.headers("visitor")) as channel:
        await site.until(lambda: site.pages.stop_channels)
        assert not site.pages.connected
        assert [each.address for each in site.pages.stop_channels] == ["127.0.0.1"]
        for do in sorted(set(REQUESTS) - {"stop"}):
            await channel.send_str(json.dumps({"do": do, "n": 1, "t": 0.0}))
            assert "for stops alone" in (await channel.receive_json())["told"]
        site.robot.asked.clear()
        await channel.send_str('{"do": "stop", "stop": 7}')
        assert await channel.receive_json() == {"stop": 7}
        assert site.robot.asked == [("stop", {})]
    await site.until(lambda: not site.pages.stop_channels)


@pytest.mark.parametrize("origin", [None, "http://elsewhere"])
async def test_strangers_and_other_sites_get_no_stop_channel(origin: str | None, site: Site) -> None:
    role = "" if origin is None else "operator"
    with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
        await site.client.ws_connect("/stop", headers=site.headers(role, origin))


async def test_stop_channels_are_as_many_as_pages_and_take_no_page_s_room(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes, "PAGES_MAX", 2)
    monkeypatch.setattr(routes, "OPERATORS", 1)
    await opened(site, "visitor", "/stop")
    with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
        await site.client.ws_connect("/stop", headers=site.headers("visitor"))
    await opened(site, "operator", "/stop")
    async with site.socket("visitor"), site.socket():
        assert len(site.pages.connected) == len(site.pages.stop_channels) == 2
