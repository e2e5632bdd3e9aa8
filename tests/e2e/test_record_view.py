"""The live view, as a client of the Foxglove protocol sees it: bare websockets and JSON."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import re
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from foxglove import layouts
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.patience import LIMIT, TXT1, S
from txt1.cli import execute
from txt1.config import Config
from txt1.errors import ConfigError
from txt1.kernel.loop import run
from txt1.record import options
from txt1.record.live import LiveView, velocity
from txt1.record.session import open_view, recording
from txt1.record.view_proxy import CLIENTS_MAX, STRANGERS_ALIKE_MAX, ViewProxy, token_in
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import TOPICS

ROOT = Path(__file__).parents[2]
MESSAGE_DATA = 1
TOKEN = "a-word-that-nobody-guesses"


@contextmanager
def running(*words: str, start: tuple[str, ...] = ("run", "--headless")) -> Iterator[str]:
    """The address of the live view of a robot that runs in real time."""
    command = [*TXT1, *start, "--duration", "3600", *words]
    process = subprocess.Popen(
        command, cwd=ROOT, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    try:
        assert process.stderr is not None
        found = re.search(r"the live view is at (ws://[0-9.]+:[0-9]+)", process.stderr.readline())
        assert found is not None
        yield found[1]
    finally:
        process.terminate()
        assert process.wait(LIMIT) == 143
        assert process.stderr is not None
        process.stderr.close()


def client_at(address: str, **options: Any) -> ClientConnection:
    return connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None, open_timeout=LIMIT, **options)


@contextmanager
def served(*words: str) -> Iterator[ClientConnection]:
    """A client of a robot that runs in real time."""
    with running("--view", "0", *words) as address, client_at(address) as client:
        yield client


def text(client: ClientConnection, operation: str) -> dict[str, Any]:
    """The next text message of a kind."""
    while True:
        message = client.recv(timeout=LIMIT)
        if isinstance(message, str) and json.loads(message)["op"] == operation:
            parsed: dict[str, Any] = json.loads(message)
            return parsed


def advertised(client: ClientConnection) -> Iterator[list[dict[str, Any]]]:
    """The channels as they come: a topic is advertised with its first message."""
    while True:
        yield text(client, "advertise")["channels"]


def subscribed(client: ClientConnection, topic: str) -> Any:
    """What decodes the messages of a topic, now that it is subscribed to."""
    channel = next(c for channels in advertised(client) for c in channels if c["topic"] == topic)
    assert channel["encoding"] == "cdr" and channel["schemaEncoding"] == "ros2msg"
    time.sleep(0.2 * S)  # the server may not know a channel yet in the instant in which it advertises it
    client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}))
    schema = Schema(id=1, data=channel["schema"].encode(), encoding="ros2msg", name=channel["schemaName"])
    return DecoderFactory().decoder_for("cdr", schema)


def messages(client: ClientConnection, decode: Any) -> Iterator[tuple[float, Any]]:
    """Log time in s and content of every message on the subscription."""
    while True:
        data = client.recv(timeout=LIMIT)
        if isinstance(data, bytes) and data[0] == MESSAGE_DATA:
            subscription, stamp = struct.unpack_from("<IQ", data, 1)
            assert subscription == 7
            yield stamp / 1e9, decode(data[13:])


def drive(client: ClientConnection, v: float, omega: float = 0.0) -> None:
    twist = {"linear": {"x": v, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": omega}}
    client.send(b"\x01" + struct.pack("<I", 3) + json.dumps(twist).encode())


def advertise(client: ClientConnection) -> None:
    channel = {"id": 3, "topic": "/cmd_vel", "encoding": "json", "schemaName": "geometry_msgs/msg/Twist"}
    client.send(json.dumps({"op": "advertise", "channels": [channel]}))


def test_a_client_receives_live_odometry() -> None:
    with served("--drive", "0.3,0.3") as client:
        info = text(client, "serverInfo")
        assert info["name"] == "txt1" and "clientPublish" not in info["capabilities"]
        stream = messages(client, subscribed(client, "/odom"))
        times = []
        for at, odometry in stream:
            times.append(at)
            if len(times) > 20 and odometry.twist.twist.linear.x > 0.2:
                break
        assert odometry.header.frame_id == "odom"
        steps = [later - earlier for earlier, later in pairwise(times)]
        assert min(steps) > 0.0 and median(steps) > 0.015  # once a cycle; a busy computer misses some


def test_a_virtual_board_is_seen_live() -> None:
    with running("--view", "0", start=("board", "--tcp", "0")) as address, client_at(address) as client:
        _, snapshot = next(messages(client, subscribed(client, "/snapshot")))
        assert json.loads(snapshot.data)["name"] == "board"


def assert_it_drives(client: ClientConnection) -> None:
    """The robot obeys this client."""
    stream = messages(client, subscribed(client, "/odom"))
    advertise(client)
    for at, odometry in stream:
        drive(client, 0.5)
        if odometry.twist.twist.linear.x > 0.2:
            break
        assert at < LIMIT


def test_a_command_is_refused_without_view_control() -> None:
    with served() as client:
        stream = messages(client, subscribed(client, "/odom"))
        advertise(client)
        drive(client, 0.5)
        for at, odometry in stream:
            drive(client, 0.5)
            assert odometry.twist.twist.linear.x == 0.0
            if at > 2.0:
                break


def test_a_command_drives_with_view_control() -> None:
    with served("--view-control") as client:
        assert_it_drives(client)


def test_a_turn_alone_is_driven_on_the_smallest_circle_as_the_teleop_panel_says_one_at_a_time() -> None:
    with served("--view-control") as client:
        stream = messages(client, subscribed(client, "/odom"))
        advertise(client)
        for at, odometry in stream:
            drive(client, 0.0, 0.5)
            twist = odometry.twist.twist
            if twist.angular.z > 0.4:
                break
            assert at < LIMIT
        assert twist.linear.x / twist.angular.z == pytest.approx(0.56, abs=0.15)


def test_a_command_that_waited_for_the_loop_is_as_old_as_it_is() -> None:
    async def body() -> float:
        loop = asyncio.get_running_loop()
        age: asyncio.Future[float] = loop.create_future()
        view = await asyncio.to_thread(LiveView, "127.0.0.1", 0, control=True)
        sent: list[float] = []

        def command() -> None:
            with client_at(view.address) as client:
                advertise(client)
                drive(client, 0.5)
                sent.append(loop.time())

        try:
            view.drive(lambda v, omega, since: age.set_result(since), 0.56)
            commanding = loop.run_in_executor(None, command)
            while not sent or loop.time() < sent[0] + 0.3:
                pass  # the loop is busy
            await commanding
            return await asyncio.wait_for(age, LIMIT)
        finally:
            await asyncio.to_thread(view.close, 0)

    assert run(body()) > 0.2


# -- the token ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "robot.example", "::"])
def test_other_addresses_than_loopback_are_refused_without_a_token(
    host: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--view", f"[{host}]:8765"]) == 2
    err = capsys.readouterr().err
    assert f"--view {host}: not a loopback address" in err and "add --view-token FILE" in err


def test_only_who_presents_the_token_looks_and_drives(tmp_path: Path) -> None:
    file = tmp_path / "token"
    with running("--view", "0.0.0.0:0", "--view-control", "--view-token", str(file)) as address:
        token = file.read_text().strip()
        assert len(token) >= 40 and file.stat().st_mode & 0o777 == 0o600
        local = address.replace("0.0.0.0", "127.0.0.1")
        for stranger in ("", "?token=", "?token=wrong", f"?token={token[:-1]}", f"?token={token}x", f"?tok={token}"):
            with pytest.raises(InvalidStatus) as refused:
                client_at(f"{local}/{stranger}")
            assert refused.value.response.status_code == 401
        with pytest.raises(InvalidStatus):
            client_at(local, additional_headers={"Authorization": f"Basic {token}"})
        with client_at(local, additional_headers={"Authorization": f"Bearer {token}"}) as client:
            assert text(client, "serverInfo")["name"] == "txt1"
        with client_at(f"{local}/?token={token}") as client:
            assert_it_drives(client)


def test_who_talks_something_else_at_the_door_costs_nothing(tmp_path: Path) -> None:
    with running("--view", "0", "--view-token", str(tmp_path / "token")) as address:
        port = int(address.rpartition(":")[2])
        for said in (b"", b"\xff" * 100 + b"\r\n\r\n", b"GET /?token=%zz HTTP/1.1\r\n\r\n", b"x" * 100_000):
            # it may hang up before all is said
            with socket.create_connection(("127.0.0.1", port), timeout=LIMIT) as stranger, suppress(OSError):
                stranger.sendall(said)
                stranger.shutdown(socket.SHUT_WR)
                heard = stranger.recv(100)
                assert not heard or heard.startswith(b"HTTP/1.1 401 ")
        token = (tmp_path / "token").read_text().strip()
        with client_at(f"{address}/?token={token}") as client:
            assert text(client, "serverInfo")["name"] == "txt1"


def test_the_token_is_not_among_the_words_of_the_process(tmp_path: Path) -> None:
    (tmp_path / "token").write_text(f"{TOKEN}\n")
    (tmp_path / "token").chmod(0o600)
    with running("--view", "0", "--view-token", str(tmp_path / "token")) as address:
        words = b"".join(path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if readable(path))
        assert str(tmp_path).encode() in words and b"nobody-guesses" not in words
        with client_at(f"{address}/?token={TOKEN}") as client:
            assert text(client, "serverInfo")["name"] == "txt1"


def readable(path: Path) -> bool:
    try:
        path.read_bytes()
    except OSError:  # that process has ended
        return False
    return True


@pytest.mark.parametrize(
    ("content", "mode", "problem"),
    [
        ("a-word-that-nobody-guesses", 0o644, "others may read it; chmod 600"),
        ("short", 0o600, "a word of at least 16 characters"),
        ("", 0o600, "a word of at least 16 characters"),
        ("two words that nobody guesses", 0o600, "a word of at least 16 characters"),
        ("ein-Wort-das-niemand-errät", 0o600, "a word of at least 16 characters"),
        *((f"a-word-that{mark}nobody-guesses", 0o600, "a digit or one of . _ ~ -") for mark in "+%&#/"),
    ],
)
def test_a_token_that_is_none_or_no_secret_is_refused(
    content: str, mode: int, problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "token"
    file.write_text(content, encoding="utf-8")
    file.chmod(mode)
    assert execute(["run", "--headless", "--duration", "1", "--view", "0.0.0.0:0", "--view-token", str(file)]) == 2
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize("name", ["/dev/null", "."])
def test_a_token_is_kept_in_a_regular_file(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / name)
    assert execute(["run", "--headless", "--duration", "1", "--view", "0.0.0.0:0", "--view-token", file]) == 2
    err = capsys.readouterr().err
    assert f"--view-token {Path(file)}: not a regular file" in err and "chmod" not in err


def test_who_make_a_token_at_once_have_the_same(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        for place in range(50):
            file = tmp_path / str(place)
            assert len(set(pool.map(token_in, [file] * 8))) == 1
    assert {path.name for path in tmp_path.iterdir()} == {str(place) for place in range(50)}


def test_a_token_that_somebody_makes_meanwhile_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "token"
    file.write_text(TOKEN)
    file.chmod(0o600)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "exists", lambda _: False)
        assert token_in(file) == TOKEN
    assert list(tmp_path.iterdir()) == [file]


@contextmanager
def door(token: str | None = TOKEN) -> Iterator[tuple[int, socket.socket]]:
    """The port at which the token is asked for, if there is one, and what listens for those who are let through."""
    with socket.create_server(("127.0.0.1", 0)) as inner:
        inner.settimeout(LIMIT)
        front = ViewProxy("127.0.0.1", 0, inner.getsockname()[1], token)
        try:
            yield front.port, inner
        finally:
            front.close()


def timers(port: int) -> list[str]:
    """The kinds of timers that run on the connections to a port, as Linux numbers them."""
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sorted(words[5][:2] for words in lines if words[1].endswith(f":{port:04X}") and words[3] == "01")


def test_who_is_connected_at_the_end_is_let_go_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    with ExitStack() as clients:
        with door() as (port, inner):
            silent, client = (
                clients.enter_context(socket.create_connection(("127.0.0.1", port), timeout=LIMIT)) for _ in range(2)
            )
            client.sendall(f"GET /?token={TOKEN} HTTP/1.1\r\n\r\n".encode())
            passed_on = clients.enter_context(inner.accept()[0])
            assert passed_on.recv(100) == b"GET / HTTP/1.1\r\n\r\n"
            assert timers(port) == ["00", "02"]  # keepalive for the one with the token
        assert silent.recv(1) == client.recv(1) == passed_on.recv(1) == b""
    assert not caplog.records


@pytest.mark.parametrize("target", ["//[", "//[?token=wrong", "?", "", "/?token=%ff", "/#?token"])
def test_any_address_without_the_token_gets_a_401(target: str, caplog: pytest.LogCaptureFixture) -> None:
    with door() as (port, _), socket.create_connection(("127.0.0.1", port), timeout=LIMIT) as stranger:
        stranger.sendall(f"GET {target} HTTP/1.1\r\n\r\n".encode())
        assert stranger.recv(100).startswith(b"HTTP/1.1 401 ")
    assert not caplog.records


def test_who_is_silent_keeps_out_only_those_at_its_own_address() -> None:
    request = f"GET /?token={TOKEN} HTTP/1.1\r\n\r\n".encode()
    with door() as (port, inner), ExitStack() as silent:
        for _ in range(STRANGERS_ALIKE_MAX):
            silent.enter_context(socket.create_connection(("127.0.0.1", port)))
        with socket.create_connection(("127.0.0.1", port), timeout=LIMIT) as client, suppress(ConnectionError):
            client.sendall(request)
            assert client.recv(1) == b""
        with socket.create_connection(("127.0.0.1", port), source_address=("127.0.0.2", 0)) as client:
            client.sendall(request)
            inner.accept()[0].close()
        inner.setblocking(False)
        with pytest.raises(BlockingIOError):  # nobody else was let through
            inner.accept()


@pytest.mark.parametrize("token", [None, TOKEN])
def test_no_more_clients_are_let_through_than_the_robot_has_room_for(token: str | None) -> None:
    request = f"GET /?token={token} HTTP/1.1\r\n\r\n".encode()
    with door(token) as (port, inner), ExitStack() as clients:
        for _ in range(CLIENTS_MAX):
            client = clients.enter_context(socket.create_connection(("127.0.0.1", port), timeout=LIMIT))
            client.sendall(request)
            passed_on = clients.enter_context(inner.accept()[0])
        with socket.create_connection(("127.0.0.1", port), timeout=LIMIT) as one_more:
            one_more.sendall(request)
            assert one_more.recv(1000).startswith(b"HTTP/1.1 503 ")
        client.close()
        assert passed_on.recv(1000).startswith(b"GET / HTTP/1.1")
        assert passed_on.recv(1) == b""
        passed_on.close()
        with socket.create_connection(("127.0.0.1", port), timeout=LIMIT) as next_one:
            next_one.sendall(request)
            inner.accept()[0].close()  # there is room again


def test_a_name_that_no_host_can_have_is_said_to_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    view = ["--view", f"{'a' * 70}:0", "--view-token", str(tmp_path / "token")]
    assert execute(["run", "--headless", "--duration", "1", *view]) == 2
    assert "a:0: cannot listen there" in capsys.readouterr().err


@pytest.mark.parametrize("asks", [False, True])
def test_a_view_is_closed_when_its_recording_cannot_be_made(asks: bool, tmp_path: Path) -> None:
    token, taken = tmp_path / "token", tmp_path / "run.mcap"
    taken.touch()
    view = open_view("127.0.0.1", 0, control=False, token=token if asks else None)
    port = int(view.address.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)):
        pass

    async def record() -> None:
        async with recording(taken, Config(), None, {}, print, view):
            pass

    with pytest.raises(ConfigError, match="such a file already"):
        asyncio.run(record())
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port))


def test_an_address_that_is_taken_is_said_to_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        for token in ([], ["--view-token", str(tmp_path / "token")]):
            assert execute(["run", "--headless", "--duration", "1", "--view", address, *token]) == 2
            assert f"--view {address}: cannot listen there" in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--view-control"], ["--view-token", "FILE"]])
def test_what_is_about_the_view_without_a_view_is_a_mistake(
    option: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["run", "--headless", "--duration", "1", *option]) == 2
    assert f"{option[0]}: there is no live view; add --view" in capsys.readouterr().err


def test_what_is_no_twist_is_no_command() -> None:
    assert velocity(b'{"linear": {"x": 0.5}, "angular": {"z": 0.1}}') == (0.5, 0.1)
    assert velocity(b'{"twist": {"linear": {"x": 0.5}, "angular": {"z": 0.1}}}') == (0.5, 0.1)
    for data in (
        b"[" * 100_000,
        b'{"linear": {"x": 1' + b"0" * 400 + b'}, "angular": {"z": 0}}',
        b"",
        b"[]",
        b"3",
        b'{"linear": 3}',
        b'{"linear": {"x": "fast"}, "angular": {"z": 0}}',
        b"\xff",
    ):
        assert velocity(data) is None


# -- the layout --------------------------------------------------------------------------------------------------

LAYOUT = json.loads(options.LAYOUT.read_text())  # the file that `--view` names
PANELS: dict[str, type] = {
    "3D": layouts.ThreeDeeConfig,
    "Plot": layouts.PlotConfig,
    "DiagnosticSummary": layouts.DiagnosticsSummaryConfig,
    "RosOut": layouts.LogConfig,
    "Teleop": layouts.TeleopConfig,
}
"""The kinds of panels by the names that they have in an exported layout, and what Foxglove's library says of them."""


def keys(config: type) -> set[str]:
    """The names of a configuration's values, as they stand in a file."""
    words = (field.name.split("_") for field in dataclasses.fields(config))
    return {first + "".join(map(str.capitalize, rest)) for first, *rest in words}


def leaves(node: Any) -> Iterator[str]:
    """The panels of a tree of panels."""
    if isinstance(node, str):
        yield node
    else:
        assert node["direction"] in ("row", "column")
        yield from leaves(node["first"])
        yield from leaves(node["second"])


def test_the_layout_arranges_the_panels_that_it_configures() -> None:
    assert set(LAYOUT) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    assert sorted(leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


@pytest.mark.parametrize("panel", LAYOUT["configById"])
def test_a_panel_of_the_layout_is_configured_as_foxglove_does(panel: str) -> None:
    config = LAYOUT["configById"][panel]
    assert set(config) - {"foxglovePanelTitle"} <= keys(PANELS[panel.partition("!")[0]])
    for series in config.get("paths", []):
        assert set(series) <= keys(layouts.PlotSeries)
    for name, button in config.items():
        assert not name.endswith("Button") or set(button) == keys(layouts.TeleopButton)
    for grid in config.get("layers", {}).values():
        assert set(grid) <= keys(layouts.BaseRendererGridLayerSettings) | {"frameLocked"}
    assert set(config.get("cameraState", {})) <= keys(layouts.ThreeDeeCameraState)


def test_the_layout_shows_values_that_there_are() -> None:
    messages = {topic.name: topic.message for topic in TOPICS.values()}
    named = set(re.findall(r'"(/[^"]+)"', json.dumps(LAYOUT)))
    assert {path.partition(".")[0] for path in named} == {
        "/odom", "/pose", "/markers", "/setpoint", "/pwm", "/diagnostics", "/rosout", "/cmd_vel",
    }  # fmt: skip
    for path in named:
        topic, *names = path.split(".")
        kind = messages[topic]
        for name in names:
            (kind,) = (field.type for field in fields(kind) if field.name == name)
        assert not names or kind in ("float64", "int32"), path
