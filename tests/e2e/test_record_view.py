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
from contextlib import contextmanager
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from foxglove import layouts
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.patience import LIMIT, TXT1, S
from txt1.cli import execute
from txt1.config import Config
from txt1.control.hand import DEFAULT_HAND
from txt1.errors import ConfigError
from txt1.kernel.clock import RealClock, seconds
from txt1.kernel.loop import run
from txt1.record import live_view, options
from txt1.record.live_view import LiveView, velocity
from txt1.record.session import open_view, recording
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import TOPICS

ROOT = Path(__file__).parents[2]
MESSAGE_DATA = 1


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
    """Log time in s since the first message, and content of every message on the subscription."""
    first = None
    while True:
        data = client.recv(timeout=LIMIT)
        if isinstance(data, bytes) and data[0] == MESSAGE_DATA:
            subscription, stamp = struct.unpack_from("<IQ", data, 1)
            assert subscription == 7
            if first is None:
                first = stamp
                # a time of day
                assert abs(stamp / 1e9 - time.time()) < LIMIT
            yield (stamp - first) / 1e9, decode(data[13:])


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


@pytest.mark.long
def test_a_turn_alone_is_driven_on_the_smallest_circle_one_at_a_time() -> None:
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


def test_a_command_that_waited_for_the_loop_is_as_old_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    # the server's times, the first of which is when the command came
    read: list[int] = []

    class Clock(RealClock):
        def now_ns(self) -> int:
            read.append(super().now_ns())
            return read[-1]

    clock = RealClock()
    monkeypatch.setattr(live_view, "_CLOCK", Clock())

    async def body() -> float:
        loop = asyncio.get_running_loop()
        age: asyncio.Future[float] = loop.create_future()
        view = await asyncio.to_thread(LiveView, "127.0.0.1", 0, control=True)

        def command() -> None:
            with client_at(view.address) as client:
                advertise(client)
                drive(client, 0.5)

        try:
            view.drive(lambda v, omega, since: age.set_result(since), DEFAULT_HAND)
            commanding, ends = loop.run_in_executor(None, command), loop.time() + LIMIT
            while loop.time() < ends and not (read and seconds(clock.now_ns() - read[0]) >= 0.3):
                pass  # the loop is busy
            await commanding
            return await asyncio.wait_for(age, LIMIT)
        finally:
            await asyncio.to_thread(view.close, 0)

    assert run(body()) >= 0.3


# -- the address -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "robot.example", "::"])
def test_other_addresses_than_loopback_are_refused(host: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--view", f"[{host}]:8765"]) == 2
    err = capsys.readouterr().err
    assert f"--view {host}: not a loopback address" in err and "ssh -L 8765:127.0.0.1:8765" in err and "--web" in err


@pytest.mark.parametrize("command", ["run", "board"])
def test_the_option_for_a_token_is_refused_with_what_takes_its_place(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute([command, "--view", "--view-token", "FILE"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--view-token" in line and "ssh -L" in line and "--web" in line


def test_the_view_listens_at_the_address_that_was_named_and_at_no_other() -> None:
    view = LiveView("127.0.0.2", 0, control=False)
    try:
        port = int(view.address.rpartition(":")[2])
        with client_at(view.address) as client:
            assert text(client, "serverInfo")["name"] == "txt1"
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port))
    finally:
        view.close(0)


def test_a_view_is_closed_when_its_recording_cannot_be_made(tmp_path: Path) -> None:
    taken = tmp_path / "run.mcap"
    taken.touch()
    view = open_view("127.0.0.1", 0, control=False)

    async def record() -> None:
        async with recording(taken, Config(), None, {}, print, view):
            pass

    with client_at(view.address) as viewer:
        with pytest.raises(ConfigError, match="such a file already"):
            asyncio.run(record())
        with pytest.raises(ConnectionClosed):
            while True:
                viewer.recv(LIMIT)


def test_who_connects_and_says_nothing_does_not_keep_a_run_from_its_end() -> None:
    with running("--view", "127.0.0.1:0") as address:
        silent = socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])))
    silent.close()


def test_an_address_that_is_taken_is_said_to_be(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        assert execute(["run", "--headless", "--duration", "1", "--view", address]) == 2
        assert f"--view {address}: cannot listen there" in capsys.readouterr().err


def test_control_of_a_view_without_a_view_is_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--view-control"]) == 2
    assert "--view-control: there is no live view; add --view" in capsys.readouterr().err


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
    # declares the topics of maps
    import_module("txt1.mapping.topics")
    messages = {topic.name: topic.message for topic in TOPICS.values()}
    named = set(re.findall(r'"(/[^"]+)"', json.dumps(LAYOUT)))
    assert {path.partition(".")[0] for path in named} == {
        "/odom",
        "/pose",
        "/markers",
        "/map",
        "/particles",
        "/setpoint",
        "/pwm",
        "/diagnostics",
        "/rosout",
        "/cmd_vel",
    }
    for path in named:
        topic, *names = path.split(".")
        kind = messages[topic]
        for name in names:
            (kind,) = (field.type for field in fields(kind) if field.name == name)
        assert not names or kind in ("float64", "int32"), path
