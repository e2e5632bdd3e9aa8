"""A snapshot survives the way to the drawing process exactly."""

from __future__ import annotations

import json
import timeit

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ui_snapshots import blind, full

from txt1.hal.base import Capabilities
from txt1.tasks.fields import BatteryState, Event, Source
from txt1.tasks.frames import decode, encode


@pytest.mark.parametrize("snapshot", [full(), blind(), full()._replace(events=(), tasks=(), faults={})])
def test_a_snapshot_comes_back_as_it_was(snapshot: object) -> None:
    line = encode(snapshot)  # type: ignore[arg-type]
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    assert decode(line) == snapshot


def test_types_come_back_too() -> None:
    snapshot = decode(encode(full()))
    assert type(snapshot.capabilities) is Capabilities
    assert snapshot.battery.state is BatteryState.GOOD
    assert snapshot.control.source is Source.ENCODER
    assert type(snapshot.servos) is tuple
    assert snapshot.gains.angular.at(0.5) == full().gains.angular.at(0.5)
    assert snapshot.tasks[0].lateness.p999 == full().tasks[0].lateness.p999


@settings(max_examples=40)
@given(
    st.tuples(*[st.floats(allow_nan=False)] * 5),
    st.none() | st.tuples(*[st.floats(allow_nan=False)] * 3),
    st.text(),
    st.dictionaries(st.text(max_size=20), st.integers(0), max_size=5),
)
def test_all_values_are_exact(
    odometry: tuple[float, ...], pose: tuple[float, float, float] | None, text: str, faults: dict[str, int]
) -> None:
    sent = full()._replace(pose=pose, reason=text, faults=faults, events=(Event(1.0, text),))
    sent = sent._replace(odometry=type(sent.odometry)(*odometry))
    assert decode(encode(sent)) == sent


@pytest.mark.parametrize("line", [b"", b"{}\n", b"[1, 2]\n", b"null\n", b"\xff\n", encode(full())[:-10]])
def test_anything_else_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError):
        decode(line)


def test_a_value_of_unknown_type_is_an_error_and_no_guess() -> None:
    with pytest.raises(TypeError, match="complex"):
        encode(full()._replace(time=1j))  # type: ignore[arg-type]


def test_encoding_does_not_hold_up_the_robot() -> None:
    snapshot = full()
    fastest = min(timeit.repeat(lambda: encode(snapshot), number=10, repeat=20)) / 10
    assert fastest < 1e-3, "design: 0.3 ms; the rest is for a busy machine"
    assert len(json.loads(encode(snapshot))) == len(snapshot)
