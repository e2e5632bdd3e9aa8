"""The live view, as a client of the Foxglove protocol sees it: bare websockets and JSON."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.sync.client import ClientConnection, connect

from txt1.cli import execute
from txt1.record.live import velocity
from txt1.record.topics import TOPICS

ROOT = Path(__file__).parents[2]
MESSAGE_DATA = 1


@contextmanager
def served(*words: str) -> Iterator[ClientConnection]:
    """A client of a robot that runs in real time."""
    command = [sys.executable, "-m", "txt1", "run", "--headless", "--duration", "60", "--view", "0", *words]
    process = subprocess.Popen(
        command, cwd=ROOT, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    try:
        assert process.stderr is not None
        address = process.stderr.readline().rpartition(" ")[2].strip()
        assert address.startswith("ws://127.0.0.1:")
        with connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None) as client:
            yield client
    finally:
        process.terminate()
        assert process.wait(20.0) == 143
        assert process.stderr is not None
        process.stderr.close()


def text(client: ClientConnection, operation: str) -> dict[str, Any]:
    """The next text message of a kind."""
    while True:
        message = client.recv(timeout=20.0)
        if isinstance(message, str) and json.loads(message)["op"] == operation:
            parsed: dict[str, Any] = json.loads(message)
            return parsed


def subscribed(client: ClientConnection, topic: str) -> Any:
    """What decodes the messages of a topic, now that it is subscribed to."""
    (channel,) = [c for c in text(client, "advertise")["channels"] if c["topic"] == topic]
    assert channel["encoding"] == "cdr" and channel["schemaEncoding"] == "ros2msg"
    client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}))
    schema = Schema(id=1, data=channel["schema"].encode(), encoding="ros2msg", name=channel["schemaName"])
    return DecoderFactory().decoder_for("cdr", schema)


def messages(client: ClientConnection, decode: Any) -> Iterator[tuple[float, Any]]:
    """Log time in s and content of every message on the subscription."""
    while True:
        data = client.recv(timeout=20.0)
        if isinstance(data, bytes) and data[0] == MESSAGE_DATA:
            subscription, time = struct.unpack_from("<IQ", data, 1)
            assert subscription == 7
            yield time / 1e9, decode(data[13:])


def drive(client: ClientConnection, v: float) -> None:
    twist = {"linear": {"x": v, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
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
        for time, odometry in stream:
            times.append(time)
            if odometry.twist.twist.linear.x > 0.2:
                break
        assert odometry.header.frame_id == "odom"
        steps = [later - earlier for earlier, later in pairwise(times)]
        assert min(steps) > 0.0 and median(steps) == pytest.approx(0.02, abs=0.005)


def test_a_command_is_refused_without_view_control() -> None:
    with served() as client:
        stream = messages(client, subscribed(client, "/odom"))
        advertise(client)
        drive(client, 0.5)
        for time, odometry in stream:
            drive(client, 0.5)
            assert odometry.twist.twist.linear.x == 0.0
            if time > 3.0:
                break


def test_a_command_drives_with_view_control() -> None:
    with served("--view-control") as client:
        stream = messages(client, subscribed(client, "/odom"))
        advertise(client)
        for time, odometry in stream:
            drive(client, 0.5)
            if odometry.twist.twist.linear.x > 0.2:
                break
            assert time < 15.0


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "robot.example"])
def test_other_addresses_than_loopback_are_refused(host: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--view", f"{host}:8765"]) == 2
    assert f"--view {host}: not a loopback address" in capsys.readouterr().err


def test_control_without_a_view_is_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--headless", "--duration", "1", "--view-control"]) == 2
    assert "--view-control: there is no live view to drive from; add --view" in capsys.readouterr().err


def test_what_is_no_twist_is_no_command() -> None:
    assert velocity(b'{"linear": {"x": 0.5}, "angular": {"z": 0.1}}') == (0.5, 0.1)
    assert velocity(b'{"twist": {"linear": {"x": 0.5}, "angular": {"z": 0.1}}}') == (0.5, 0.1)
    for data in (b"", b"[]", b"3", b'{"linear": 3}', b'{"linear": {"x": "fast"}, "angular": {"z": 0}}', b"\xff"):
        assert velocity(data) is None


def test_the_layout_shows_topics_that_there_are() -> None:
    layout = json.loads((ROOT / "docs" / "txt1.foxglove-layout.json").read_text())
    shown = json.dumps(layout["configById"])
    named = set(re.findall(r'"(/[a-z_]+)', shown))
    assert named and named <= {topic.name for topic in TOPICS}
    assert set(re.findall(r'"([A-Za-z0-9]+![a-z]+)"', json.dumps(layout["layout"]))) == set(layout["configById"])
