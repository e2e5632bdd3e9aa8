"""A recording as a bag of ROS 1."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from txt1.cli import execute
from txt1.record.cdr import MessageBuffer
from txt1.record.reader import OWN
from txt1.ros.definitions import own
from txt1.telemetry.messages import DEFINITIONS, schema_name, schema_text
from txt1_ros1.rosbag1 import Converter


def test_a_bag_of_ros_1_has_every_message_for_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, bag = tmp_path / "run.mcap", tmp_path / "run.bag"
    words = "run --headless --speed max --duration 2 --seed 1 --drive 0.5,0.3 --log"
    sensors = ["--set", "sensors.imu.driver=sim_imu", "--set", "sensors.laser.driver=sim_laser"]
    assert execute([*words.split(), str(file), *sensors]) == 0
    assert execute(["log", "export", "--rosbag1", str(file)]) == 0
    with AnyReader([bag]) as reader, AnyReader([file]) as recorded:
        told = {c.topic: c.msgcount for c in reader.connections}
        assert told == {c.topic: c.msgcount for c in recorded.connections if c.topic not in OWN}
        odometry = [c for c in reader.connections if c.topic == "/odom"]
        read = [reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages(odometry)]
        assert read[-1].twist.twist.linear.x == pytest.approx(0.5, abs=0.1)  # type: ignore[attr-defined]
    assert execute(["log", "export", "--rosbag1", str(file)]) == 2, "what is there is not overwritten"
    assert f"{bag}: is there already; choose another name with -o" in capsys.readouterr().err


def test_every_message_is_one_of_ros_1_too() -> None:
    own()
    converter = Converter()
    for message in sorted(DEFINITIONS):
        kind = schema_name(message)
        converter.add(kind, schema_text(message))
        converter.store.deserialize_ros1(converter.convert(kind, bytes(MessageBuffer(message))), kind)
