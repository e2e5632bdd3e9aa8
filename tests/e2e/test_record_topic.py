"""A topic that some other module declares is recorded, listed, exported and seen live, and nothing of ours knows it."""

from __future__ import annotations

import asyncio
import csv
import json
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from websockets.sync.client import connect

from tests.patience import LIMIT, PATIENT
from txt1.cli import execute
from txt1.config import Config, load
from txt1.kernel.loop import Speed, run
from txt1.kit.app import report
from txt1.record.session import open_view, recording
from txt1.robot import Robot
from txt1.telemetry.messages import define
from txt1.telemetry.topics import TOPICS, Rule, Topic, declare


class Compass(NamedTuple):
    """Where the needle points, rad, and how sure it is."""

    heading: float
    sure: bool


MESSAGE = define("txt1_msgs/TestCompass", "std_msgs/Header header\nfloat64 heading\nbool sure")


def compass(name: str, rule: Rule) -> Topic[Compass]:
    return Topic(
        name,
        Compass,
        "rad",
        MESSAGE,
        rule,
        "where the needle points",
        {"header": {"frame_id": "needle"}},
        ("heading", "sure"),
        lambda value: value,
    )


@pytest.fixture
def topics() -> Iterator[dict[Rule, Topic[Compass]]]:
    """A topic of each rule, forgotten afterwards."""
    known = dict(TOPICS)
    yield {rule: declare(compass(f"/test/{rule.name.lower()}", rule)) for rule in RULES}
    TOPICS.clear()
    TOPICS.update(known)


RULES = (Rule.CYCLE, Rule.CHANGE, Rule.SECOND, Rule.EVENT)


async def needle(robot: Robot, topics: dict[Rule, Topic[Compass]], seconds: int) -> None:
    """Drive for so many seconds, the needle turning once in each; it is not known before it turns first."""
    bus, value = robot.runtime.bus, None
    for rule in RULES[:-1]:
        bus.offer(topics[rule], lambda: value)
    await robot.drive(0.3, 0.3, 1.0)
    for turn in range(seconds):
        value = Compass(float(turn), turn > 0)
        bus.publish(topics[Rule.EVENT], value, robot.now)
        await robot.drive(0.3, 0.3, 1.0)


def recorded(path: Path, topics: dict[Rule, Topic[Compass]], config: Config, speed: Speed = "max") -> None:
    async def main() -> None:
        async with (
            recording(path, config, speed, {}, print) as attach,
            Robot.open(config=config, attach=attach) as robot,
        ):
            await robot.load_gains()
            await needle(robot, topics, 3)

    run(main(), speed=speed)


def test_it_is_recorded_by_its_rule(topics: dict[Rule, Topic[Compass]], tmp_path: Path) -> None:
    recorded(tmp_path / "run.mcap", topics, Config())
    found: dict[str, list[Any]] = {}
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(topics=[each.name for each in topics.values()]):
            found.setdefault(channel.topic, []).append(message)
        file.seek(0)
        summary = make_reader(file).get_summary()
    assert summary is not None
    (channel,) = [each for each in summary.channels.values() if each.topic == "/test/cycle"]
    assert channel.metadata["about"] == "where the needle points" and channel.metadata["units"] == "rad"
    assert len(found["/test/cycle"]) == pytest.approx(150, abs=3), "none before there is a value"
    for name in ("/test/change", "/test/second", "/test/event"):
        assert [(each.heading, each.sure) for each in found[name]] == [(0.0, False), (1.0, True), (2.0, True)], name
    assert found["/test/event"][0].header.frame_id == "needle"


def test_arrays_of_numbers_and_numbers_that_are_published_are_recorded(tmp_path: Path) -> None:
    offered, published = (
        replace(compass(f"/test/{name}", Rule.CYCLE), make=lambda value: value.tolist())
        for name in ("offered", "published")
    )
    path, value = tmp_path / "run.mcap", np.array([1.0, 0.0])

    async def main() -> None:
        async with recording(path, Config(), "max", {}, print) as attach, Robot.open(attach=attach) as robot:
            robot.runtime.bus.offer(offered, lambda: value)
            await asyncio.sleep(0.1)
            robot.runtime.bus.publish(published, 2.0 * value, robot.now)

    run(main(), speed="max")
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = {
            channel.topic: message.heading
            for _, channel, _, message in reader.iter_decoded_messages(topics=[offered.name, published.name])
        }
    assert found == {"/test/offered": 1.0, "/test/published": 2.0}


def test_it_is_listed_and_exported(
    topics: dict[Rule, Topic[Compass]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(tmp_path / "run.mcap", topics, Config())
    TOPICS.clear()  # as in a process that has never heard of it
    assert execute(["log", "info", str(tmp_path / "run.mcap")]) == 0
    rows = {words[0]: words[1:] for line in capsys.readouterr().out.splitlines() if (words := line.split())}
    assert rows["/test/event"] == ["3", "1.00", "1.000", "0", "txt1_msgs/msg/TestCompass"]
    assert execute(["log", "export", str(tmp_path / "run.mcap"), "--topic", "/test/event", "-o", str(tmp_path)]) == 0
    table = list(csv.DictReader((tmp_path / "test_event.csv").read_text().splitlines()))
    assert [(row["heading"], row["sure"]) for row in table] == [("0.0", "False"), ("1.0", "True"), ("2.0", "True")]
    assert execute(["replay", "--verify", str(tmp_path / "run.mcap")]) == 0


def test_it_is_in_the_runs_json(topics: dict[Rule, Topic[Compass]]) -> None:
    async def main() -> dict[str, Any]:
        async with Robot.open() as robot:
            await robot.load_gains()
            await needle(robot, topics, 1)
            return report(robot.runtime)

    told = run(main(), speed="max")["topics"]
    assert told["/test/cycle"] == {"heading": 0.0, "sure": False}
    assert {"/odom", "/mode", "/battery1", "/driver", "/test/change", "/test/second"} <= told.keys()


@pytest.mark.long
def test_with_a_name_the_robots_stands_before_its_topics(topics: dict[Rule, Topic[Compass]], tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, topics, Config(name="txt03"))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    names = {channel.topic for channel in summary.channels.values()}
    assert {"/txt03/odom", "/txt03/rosout", "/txt03/test/event"} <= names
    assert all(name.startswith("/txt03/") for name in names)
    assert execute(["replay", "--verify", str(path)]) == 0
    assert execute(["report", str(path)]) == 0


@pytest.mark.usefixtures("patient")
def test_who_joins_the_live_view_late_sees_what_was_told_last(topics: dict[Rule, Topic[Compass]]) -> None:
    config, view = load(overrides=PATIENT).config, open_view("127.0.0.1", 0, control=False)

    def look() -> dict[str, list[bytes]]:
        """The first messages on what is told seldom, after a second."""
        wanted = {"/test/change", "/test/event", "/mode", "/faults", "/rosout"}
        found: dict[str, list[bytes]] = {}
        subscribed: dict[int, str] = {}
        with connect(view.address, subprotocols=["foxglove.sdk.v1"], max_size=None, open_timeout=LIMIT) as client:  # type: ignore[list-item]
            while wanted - found.keys():
                data = client.recv(timeout=LIMIT)
                if isinstance(data, bytes):
                    number, _ = struct.unpack_from("<IQ", data, 1)
                    found.setdefault(subscribed[number], []).append(data[13:])
                elif json.loads(data)["op"] == "advertise":
                    channels = [each for each in json.loads(data)["channels"] if each["topic"] in wanted]
                    asked = [{"id": each["id"], "channelId": each["id"]} for each in channels]
                    subscribed |= {each["id"]: each["topic"] for each in channels}
                    client.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
        return found

    async def main() -> dict[str, list[bytes]]:
        async with (
            recording(None, config, None, {}, print, view) as attach,
            Robot.open(config=config, attach=attach) as robot,
        ):
            await robot.load_gains()
            await needle(robot, topics, 1)
            looking = asyncio.create_task(asyncio.to_thread(look))
            while not looking.done():
                await robot.drive(0.3, 0.3, 0.2)
            return await looking

    found = run(main())
    assert found["/test/event"] and found["/mode"] and found["/rosout"]
