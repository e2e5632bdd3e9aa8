"""The cameras' pictures for pages: who may look, and that pictures are dropped and never queued."""

from __future__ import annotations

import asyncio
import json
from base64 import b64encode
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from aiohttp import web  # noqa: E402

from rigs.ports import free_port  # noqa: E402
from tests.patience import LIMIT, PATIENT, until  # noqa: E402
from tests.unit.web.test_web_server import Far  # noqa: E402
from txt1.bridges.registry import RobotEnd  # noqa: E402
from txt1.kernel.loop import run  # noqa: E402
from txt1.robot import Robot  # noqa: E402
from txt1.sensors.readings import Image  # noqa: E402
from txt1.sidecar import Request  # noqa: E402
from txt1.web import admission, camera_server  # noqa: E402
from txt1.web.admission import at_port  # noqa: E402
from txt1.web.auth import Auth, visitors_token  # noqa: E402
from txt1.web.camera_server import HEAD, ROUTES, SEEN, VIEWERS, VISITORS, CameraRoutes, CameraViewers  # noqa: E402
from txt1.web.connections import Connections  # noqa: E402
from txt1.web.options import PageAsked, WebPage  # noqa: E402
from txt1.web.pages import Pages, now  # noqa: E402
from txt1.web.robot_end import beside  # noqa: E402
from txt1.web.routes import Routes  # noqa: E402

TOKEN: Final = "t0ken-of-the-robot-long-enough"
WORDS: Final = {"operator": TOKEN, "visitor": visitors_token(TOKEN)}
# of the page, which another server has
PAGE: Final = 8080


class Desk:
    """The server of a robot with the cameras front and rear, and a browser."""

    client: aiohttp.ClientSession

    def __init__(self) -> None:
        self.robot, self.door = Far(), Auth(TOKEN, "http", PAGE)
        self.viewers = CameraViewers(self.robot, ["front", "rear"])
        self.runner = web.AppRunner(CameraRoutes(self.door, PAGE, self.viewers).application(ROUTES))
        self.number = 0

    async def open(self) -> None:
        await self.runner.setup()
        assert self.runner.server is not None
        self.connections = Connections(self.runner.server, None, now)
        await self.connections.listen("127.0.0.1", 0)
        self.client = aiohttp.ClientSession(
            f"http://127.0.0.1:{self.connections.port}", cookie_jar=aiohttp.DummyCookieJar()
        )
        asyncio.get_running_loop().add_reader(self.robot.fileno(), self.viewers.hear)

    async def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self.robot.fileno())
        await self.client.close()
        self.connections.close()
        await self.runner.cleanup()
        self.robot.close()

    def headers(self, role: str = "operator", origin: str = f"http://127.0.0.1:{PAGE}") -> dict[str, str]:
        signed = self.door.sign_in(WORDS.get(role, ""), admission.wall())
        cookie = {} if signed is None else {"Cookie": f"{self.door.cookie}={signed[1]}"}
        return {"Origin": origin, **cookie}

    def look(self, camera: str = "front", role: str = "operator", **given: str) -> Any:
        return self.client.ws_connect(f"/camera/{camera}", headers=self.headers(role, **given))

    async def refused(self, camera: str = "front", role: str = "operator", **given: str) -> int:
        """The status with which a viewer is sent away."""
        with pytest.raises(aiohttp.WSServerHandshakeError) as answer:
            await self.look(camera, role, **given)
        return int(answer.value.status)

    def show(self, *cameras: str) -> None:
        """The robot sends a picture of each camera, numbered, in one line of telemetry."""
        self.number += 1
        value = {"data": b64encode(b"JPEG %d" % self.number).decode()}
        events = [
            {"topic": f"/sensors/{each}", "time": 1.0, "exposed": now() - 0.08, "value": value} for each in cameras
        ]
        self.robot.send(json.dumps({"time": 1.1, "topics": {}, "events": events}).encode() + b"\n")

    def subscribed(self) -> list[Any]:
        """The topics that the robot is asked for, one after the other."""
        return [fields["topics"] for name, fields in self.robot.asked if name == "subscribe"]


@pytest.fixture
async def desk() -> AsyncIterator[Desk]:
    desk = Desk()
    await desk.open()
    try:
        yield desk
    finally:
        await desk.close()


async def picture(socket: Any) -> tuple[bytes, tuple[float, float, float]]:
    """The next picture, and its head."""
    data = await socket.receive_bytes(timeout=LIMIT)
    return data[HEAD.size :], HEAD.unpack(data[: HEAD.size])


async def test_a_viewer_gets_the_newest_picture_after_it_has_seen_the_one_before(desk: Desk) -> None:
    async with desk.look() as socket:
        desk.show("front")
        assert (await picture(socket))[0] == b"JPEG 1"
        for _ in range(5):
            desk.show("front")
            await until(lambda: desk.robot.times("") == desk.number)
        # one is under way at most: it has not said that it has seen the first
        with pytest.raises(TimeoutError):
            await socket.receive(timeout=0.05)
        await socket.send_str(SEEN)
        data, (exposed, sent, trip) = await picture(socket)
        assert data == b"JPEG 6"
        assert sent - exposed >= 0.08
        assert 0.05 < trip < now()
        await socket.send_str(SEEN)
        with pytest.raises(TimeoutError):
            await socket.receive(timeout=0.05)


async def test_a_viewer_that_reads_nothing_costs_the_others_nothing(desk: Desk) -> None:
    async with desk.look(), desk.look() as other:
        for number in range(1, 20):
            desk.show("front")
            assert (await picture(other))[0] == b"JPEG %d" % number
            await other.send_str(SEEN)


async def test_a_viewer_that_does_not_answer_is_sent_away(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_server, "VIEWER_TIME_OUT", 0.1)
    async with desk.look() as socket:
        desk.show("front")
        await picture(socket)
        message = await socket.receive(timeout=LIMIT)
        assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
    await until(lambda: not desk.viewers.looking)


@pytest.mark.parametrize("said", ["stop", "x" * 100, b"seen"])
async def test_a_viewer_that_says_anything_else_is_sent_away(desk: Desk, said: str | bytes) -> None:
    async with desk.look() as socket:
        await (socket.send_str(said) if isinstance(said, str) else socket.send_bytes(said))
        message = await socket.receive(timeout=LIMIT)
        assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR)


async def test_a_flood_of_answers_exceeds_the_budget_and_ends_its_viewer_alone(desk: Desk) -> None:
    async with desk.look("rear") as other, desk.look() as socket:
        with suppress(ConnectionError):
            for _ in range(2000):
                await socket.send_str(SEEN)
        await until(lambda: len(desk.viewers.looking) == 1)
        desk.show("rear")
        assert (await picture(other))[0] == b"JPEG 1"


async def test_the_robot_sends_pictures_only_while_somebody_looks(desk: Desk) -> None:
    desk.viewers.begin()
    async with desk.look("rear") as socket:
        async with desk.look(), desk.look():
            await until(lambda: len(desk.viewers.looking) == 3)
            desk.show("front", "rear")
            assert (await picture(socket))[0] == b"JPEG 1"
        await until(lambda: len(desk.viewers.looking) == 1)
    await until(lambda: not desk.viewers.looking)
    rear, both = ["/sensors/rear"], ["/sensors/front", "/sensors/rear"]
    assert desk.subscribed() == [[], rear, both, rear, []]


async def test_who_may_look_is_asked_at_the_door_of_the_page(desk: Desk) -> None:
    assert await desk.refused(role="stranger") == 403
    for origin in ("http://elsewhere", f"http://127.0.0.1:{desk.connections.port}", "null"):
        assert await desk.refused(origin=origin) == 403
    assert await desk.refused("side") == 404
    for role in ("operator", "visitor"):
        async with desk.look(role=role):
            assert [each.role for each in desk.viewers.looking] == [role]
        await until(lambda: not desk.viewers.looking)
    async with desk.client.get("/") as answer:
        assert (answer.status, "go back to its page" in await answer.text()) == (200, True)


async def test_four_look_and_three_of_them_may_be_visitors(desk: Desk) -> None:
    looking = [await desk.look(role="visitor") for _ in range(VISITORS)]
    assert await desk.refused(role="visitor") == 503
    looking += [await desk.look() for _ in range(VIEWERS - VISITORS)]
    assert await desk.refused() == 503
    await looking.pop().close()
    await until(lambda: len(desk.viewers.looking) < VIEWERS)
    looking.append(await desk.look())
    for each in looking:
        await each.close()


async def test_the_page_may_connect_to_its_cameras_and_nowhere_else(desk: Desk) -> None:
    pages = Pages(desk.robot, None, 0.5, {}, [], invites=False, camera=8081)  # type: ignore[arg-type]
    answer = web.Response()
    request: Any = type("Request", (), {"host": "[::1]:8080", "secure": False, "scheme": "http"})()
    Routes(desk.door, pages).limit(request, answer)
    assert "connect-src 'self' ws://[::1]:8080 ws://[::1]:8081;" in answer.headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    ("host", "port", "scheme", "expected"),
    [
        ("robot.local:8081", 8080, "https", "robot.local:8080"),
        ("robot.local:8081", 443, "https", "robot.local"),
        ("[::1]:81", 80, "http", "[::1]"),
        ("[::1]", 8080, "http", "[::1]:8080"),
    ],
)
def test_the_origin_of_the_page_is_at_its_own_port(host: str, port: int, scheme: str, expected: str) -> None:
    assert at_port(host, port, scheme) == expected


def test_of_pictures_only_the_newest_waits_for_a_bridge() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", settings=["sensors.front.driver=sim_camera"]) as robot:
            end = RobotEnd(robot, "web_camera", {})
            topic = robot.sensors["front"].sensor.topic
            end.request(Request("subscribe", {"topics": [topic.name], "rate": 50.0}, 0.0))
            await asyncio.sleep(1.0)
            for number in range(3):
                robot.runtime.bus.publish(topic, Image(1, 1, b"%d" % number), robot.now - 0.2)
            before = now()
            line = end.telemetry()
            assert line is not None
            (event,) = json.loads(line)["events"]
            assert event["value"]["data"] == b64encode(b"2").decode()
            # on the clock that both processes share
            assert before - 0.2 <= event["exposed"] + 1e-6 <= now() - 0.2 + 1e-6
            end.leave()

    run(main(), speed="max")


@pytest.mark.waits
def test_a_robot_with_a_camera_serves_its_pictures_beside_its_page(tmp_path: Path) -> None:
    page = WebPage("127.0.0.1", free_port(), None, None, None, tmp_path, 0.5, {}, ("here",))
    url = f"http://127.0.0.1:{page.port}"

    async def main() -> None:
        settings = ["sensors.front.driver=sim_camera", *PATIENT]
        async with (
            Robot.open(hal="sim", settings=settings) as robot,
            beside(robot, PageAsked(page, None)),
            aiohttp.ClientSession(headers={"Origin": url}) as client,
        ):
            async with asyncio.timeout(LIMIT):
                told: Any = {}
                async with await connected(client, f"{url}/socket") as socket:
                    while "page" not in told:
                        told = await socket.receive_json()
                camera = f"http://127.0.0.1:{told['page']['camera']}/camera/front"
                async with await connected(client, camera) as look:
                    data, (exposed, *_) = await picture(look)
            assert data.startswith(b"\xff\xd8")
            assert exposed < now()

    run(main())


async def connected(client: aiohttp.ClientSession, url: str) -> Any:
    """A socket, as soon as its server listens."""
    while True:
        try:
            return await client.ws_connect(url)
        except aiohttp.ClientConnectorError:
            await asyncio.sleep(0.1)


def test_the_camera_s_server_gets_names_of_files_and_no_token(tmp_path: Path) -> None:
    token = tmp_path / "token"
    page = WebPage("0.0.0.0", 8443, token, tmp_path / "cert", None, tmp_path, 0.5, {})
    files = {"token": str(token), "certificate": str(tmp_path / "cert")}
    given = {"host": "0.0.0.0", "port": 8444, "page": 8443, "cameras": ["front"], **files}
    assert page.camera_bridge(8444, ["front"]) == ("web_camera", given)
