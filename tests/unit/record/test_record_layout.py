"""What is written is what ROS 2's own tools read: every message, with any strings and numbers."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import txt1.learning.task
import txt1.robot
import txt1.sensors.light  # noqa: F401  # all of them declare topics
from txt1.errors import RecordingError
from txt1.estimation.task import FILTERED
from txt1.model.estimate import Estimate
from txt1.model.odometry import Odometry
from txt1.protocol.messages import Velocity
from txt1.record.cdr import MessageBuffer, encode
from txt1.record.mcap_records import Encoder, Told
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import Encoders
from txt1.tasks.inputs import COMMAND
from txt1.telemetry.messages import DEFINITIONS, schema_name, schema_text
from txt1.telemetry.topics import TOPICS

texts = st.text(st.characters(exclude_characters="\x00", exclude_categories=("Cs",)), max_size=20)
finite = st.floats(allow_nan=False)


@pytest.fixture(scope="module")
def ros() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    for message in DEFINITIONS:
        if message.startswith(("txt1_msgs/", "ackermann_msgs/")):
            store.register(get_types_from_msg(schema_text(message), schema_name(message)))
    return store


def test_the_standard_messages_are_defined_as_ros_defines_them(ros: Any) -> None:
    for message in DEFINITIONS:
        if message.startswith(("txt1_msgs/", "ackermann_msgs/")):
            continue
        theirs = [(name, kind) for name, kind in ros.get_msgdef(schema_name(message)).fields]
        ours = get_types_from_msg(schema_text(message), schema_name(message))[schema_name(message)][1]
        assert ours == theirs, message


PRIMITIVE = {
    "bool",
    "byte",
    "float32",
    "float64",
    "string",
    *(f"{u}int{bits}" for u in ("", "u") for bits in (8, 16, 32, 64)),
}


@pytest.mark.parametrize("message", DEFINITIONS)
def test_a_schema_defines_every_type_that_it_uses_as_rosbag2_does(message: str) -> None:
    own, *others = schema_text(message).split(f"{'=' * 80}\n")
    names = [text.partition("\n")[0] for text in others]
    assert all(name.startswith("MSG: ") for name in names) and len(set(names)) == len(names)
    lines = [line for text in (own, *(each.partition("\n")[2] for each in others)) for line in text.splitlines()]
    used = {line.split()[0].partition("[")[0] for line in lines}
    assert used - PRIMITIVE == {name.removeprefix("MSG: ") for name in names}


def test_every_message_can_be_read_by_ros_tools(ros: Any) -> None:
    for topic in TOPICS.values():
        layout = MessageBuffer(topic.message, topic.constants)
        assert set(topic.paths) <= set(layout.places)
        ros.deserialize_cdr(bytes(layout), schema_name(topic.message))


@given(frame=texts, child=texts, x=finite, omega=finite, sec=st.integers(0, 2**31 - 1), nanosec=st.integers(0, 10**9))
def test_numbers_and_strings_come_back(
    ros: Any, frame: str, child: str, x: float, omega: float, sec: int, nanosec: int
) -> None:
    message = MessageBuffer("nav_msgs/Odometry", {"header": {"frame_id": frame}, "child_frame_id": child})
    paths = "header.stamp.sec", "header.stamp.nanosec", "pose.pose.position.x", "twist.twist.angular.z"
    for path, number in zip(paths, (sec, nanosec, x, omega), strict=True):
        place, code = message.places[path]
        struct.pack_into(f"<{code}", message, place, number)
    read = ros.deserialize_cdr(bytes(message), "nav_msgs/msg/Odometry")
    assert (read.header.frame_id, read.child_frame_id) == (frame, child)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (sec, nanosec)
    assert (read.pose.pose.position.x, read.twist.twist.angular.z) == (x, omega)


@given(source=texts, kind=texts, text=texts, values=st.lists(finite, max_size=70))
def test_sequences_of_any_length_come_back(ros: Any, source: str, kind: str, text: str, values: list[float]) -> None:
    data = encode("txt1_msgs/Input", {"source": source, "kind": kind, "text": text, "values": values, "given": 1.5})
    read = ros.deserialize_cdr(bytes(data), "txt1_msgs/msg/Input")
    assert (read.source, read.kind, read.text, read.given) == (source, kind, text, 1.5)
    assert list(read.values) == values


@given(st.lists(st.tuples(texts, st.lists(st.tuples(texts, texts), max_size=3)), max_size=4), st.binary(max_size=50))
def test_nested_sequences_and_bytes_come_back(ros: Any, statuses: list[Any], data: bytes) -> None:
    status = [{"name": name, "values": [{"key": k, "value": v} for k, v in pairs]} for name, pairs in statuses]
    read = ros.deserialize_cdr(
        bytes(encode("diagnostic_msgs/DiagnosticArray", {"status": status})), "diagnostic_msgs/msg/DiagnosticArray"
    )
    assert [(s.name, [(v.key, v.value) for v in s.values]) for s in read.status] == statuses
    link = ros.deserialize_cdr(bytes(encode("txt1_msgs/LinkBytes", {"data": data})), "txt1_msgs/msg/LinkBytes")
    assert bytes(link.data) == data


def test_an_array_takes_as_many_values_as_it_has() -> None:
    with pytest.raises(ValueError, match=r"lux takes 4 values, not 3"):
        MessageBuffer("txt1_msgs/Light", {"lux": [1.0, 2.0, 3.0]})


def test_topics_of_a_cycle_are_recorded_together_as_each_by_itself() -> None:
    odometry, pose = Odometry(1.0, 2.0, 0.5, 0.3, 0.1), (3.0, 4.0, -0.5)
    wheels, asked = Encoders(7, -3), Velocity(0.3, 0.1)
    together: list[Told] = [
        (0.02, (ODOMETRY, POSE, ENCODERS), (odometry, pose, wheels)),
        (0.03, (COMMAND,), (asked,)),
        # no pose is known meanwhile
        (0.04, (ODOMETRY, ENCODERS), (odometry, wheels)),
        (0.06, (ODOMETRY, POSE, ENCODERS), (odometry, pose, wheels)),
    ]
    alone: list[Told] = [
        (time, (topic,), (value,))
        for time, topics, values in together
        for topic, value in zip(topics, values, strict=True)
    ]
    blocks = []
    for told in (together, alone):
        encoder = Encoder(1.0e9)
        encoder.take(told)
        blocks.append(encoder.block())
    assert blocks[0] == blocks[1]


def test_a_number_of_a_cycle_that_its_field_cannot_hold_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"^/encoders: no txt1_msgs/Encoders can be made of .*1099511627776"):
        Encoder(0.0).take([(0.02, (POSE, ENCODERS), ((0.0, 0.0, 0.0), Encoders(1 << 40, 0)))])


def test_numbers_in_a_template_are_the_message_written_field_by_field() -> None:
    estimate = Estimate(1.0, 2.0, 0.5, 0.3, 0.1, tuple(float(number) for number in range(25)), 0.0, 0.0, True)
    backwards = replace(FILTERED, paths=FILTERED.paths[::-1], make=lambda value: FILTERED.make(value)[::-1])
    for topic in (FILTERED, backwards):
        ((_, _, data),) = Encoder(0.0).block([(2.5, topic, estimate)]).messages()
        plain = MessageBuffer(topic.message, topic.constants)
        numbers = dict(zip(FILTERED.paths, FILTERED.make(estimate)[: len(FILTERED.paths)], strict=True))
        for path, number in {**numbers, "header.stamp.sec": 2, "header.stamp.nanosec": 500_000_000}.items():
            place, code = plain.places[path]
            struct.pack_into(f"<{code}", plain, place, number)
        assert data == plain
