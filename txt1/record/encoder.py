"""What the recorder saw, as MCAP message records.

The robot's state is sampled as references to immutable values, which costs next to nothing; here, off the control
path, a batch of samples becomes bytes in a few calls of numpy. With one call per message, as the mcap library writes
them, a recorded simulation would be half as fast.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from math import cos, sin
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.control.pid import Gains
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.model.light import SENSORS, Readings
from txt1.model.odometry import Odometry
from txt1.record import topics
from txt1.record.layout import Layout, encode, record_type
from txt1.record.topics import CHANNELS
from txt1.tasks.battery import FITTED_V
from txt1.tasks.fields import Battery, BatteryState, Control, Encoders, Link, Panel, Power, Snapshot
from txt1.ui import frames

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
BEHIND_LENGTH: Final = RECORD.size - 9

INFO: Final = 20
WARN: Final = 30
"""Levels of ROS's log."""

POWER_SUPPLY_DISCHARGING: Final = 2
HEALTH: Final = {BatteryState.GOOD: 1, BatteryState.WARNING: 1, BatteryState.BAD: 3}
TECHNOLOGY_LIPO: Final = 3


class Sample(NamedTuple):
    """The state behind one controller cycle at `now` s of the run; everything in it is immutable."""

    now: float
    odometry: Odometry
    control: Control
    linear: Gains
    encoders: Encoders
    pose: tuple[float, float, float] | None
    battery: Battery
    armed: bool
    stopped: bool
    reason: str
    link: Link
    power: Power
    panel: Panel


class Extra(NamedTuple):
    """A message between the samples.

    Attributes:
        position: how many samples of its batch come before it.
        now: its time, s of the run.
        topic: of the topics that are not sampled.
        content: what that topic's function in `Encoder` takes.

    """

    position: int
    now: float
    topic: str
    content: Any


Tick = tuple[int, float, int]
"""A cycle of one of the robot's tasks: the task's number, when, s of the run, and cycles missed just before."""


class Input(NamedTuple):
    """Something given to the tasks from outside.

    Attributes:
        cycle: cycles of the recorder before it: they tell its place among the ticks of the same instant.
        tick: recorded ticks before it, which tell its place on the real clock.
        received: messages that the serial task had taken before it, which tells its place among those.
        source: the task of the user's or the driver's that gave it, empty for none.
        kind: the message's or the action's name.
        text: of a disarming, the reason.
        given: when its author gave it, s of the run.
        values: its numbers.

    """

    cycle: int
    tick: int
    received: int
    source: str
    kind: str
    text: str
    given: float
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """Message records in the order of their happening.

    Attributes:
        data: the records.
        index: for each channel the log times (ns) and offsets of its records.
        first: the smallest log time, ns.
        last: the largest.

    """

    data: bytes
    index: dict[int, NDArray[np.uint64]]
    first: int
    last: int

    @property
    def count(self) -> int:
        """How many messages it holds."""
        return sum(len(entries) for entries in self.index.values())

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Channel, log time in ns, and CDR bytes of every message."""
        data, start = self.data, 0
        while start < len(data):
            _, length, channel, _, time, _ = RECORD.unpack_from(data, start)
            end = start + 9 + length
            yield channel, time, data[start + RECORD.size : end]
            start = end


class Encoder:
    """Makes blocks of batches; remembers sequence numbers, and what it said last of what is told when it changes.

    Args:
        epoch: added to the run's time, s.
        ticks: whether the HAL has encoders.
        pose: whether it knows the true pose.

    """

    def __init__(self, epoch: float, *, ticks: bool, pose: bool) -> None:
        self._epoch_ns = nanoseconds(epoch)
        self._sequences = dict.fromkeys(CHANNELS.values(), 0)
        self._battery: Battery | None = None
        self._mode: tuple[Any, ...] = ()
        self._row = _Row(ticks, pose)
        self._makers: dict[str, Callable[[int, int, Any], bytes]] = {
            topics.COMMAND: _twist,
            topics.BATTERIES[0]: _battery,
            topics.BATTERIES[1]: _battery,
            topics.MODE: _mode,
            topics.DIAGNOSTICS: _diagnostics,
            topics.FAULTS: _faults,
            topics.LOG: _log,
            topics.LINK: _link,
            topics.INPUT: _input,
            topics.LIGHT: _light,
            topics.LEARNING: _learning,
            topics.TICKS: _ticks,
            topics.SNAPSHOT: _snapshot,
        }

    def skip(self, samples: int) -> None:
        """Leave a gap in the sequence numbers where samples were lost."""
        for channel in self._row.offsets:
            self._sequences[channel] += samples

    @property
    def sampled(self) -> int:
        """How many messages one sample makes."""
        return len(self._row.offsets)

    def block(self, samples: Sequence[Sample], extras: Sequence[Extra]) -> Block:
        """The records of a batch; `extras` by rising position."""
        made = sorted([*self._changes(samples), *extras], key=lambda extra: extra.position)
        row, count = self._row, len(samples)
        width, rows = row.size, b""
        times = np.empty(0, np.uint64)
        if count:
            instants = np.array([sample.now for sample in samples])
            times = np.rint(instants * NS_PER_S).astype(np.uint64) + np.uint64(self._epoch_ns)
            rows = row.fill(samples, times, self._sequences)
        pieces: list[bytes] = []
        shift = [0] * (count + 1)
        entries: dict[int, list[tuple[int, int]]] = {}
        done = before = 0
        sequences, makers, epoch_ns, pack, head = (
            self._sequences,
            self._makers,
            self._epoch_ns,
            RECORD.pack,
            RECORD.size,
        )
        for position, now, topic, content in made:
            channel = CHANNELS[topic]
            time = round(now * NS_PER_S) + epoch_ns
            payload = makers[topic](*divmod(time, NS_PER_S), content)
            sequence = sequences[channel]
            sequences[channel] = sequence + 1
            if position != done:
                pieces.append(rows[done * width : position * width])
                done = position
            if channel not in entries:
                entries[channel] = []
            entries[channel].append((time, done * width + before))
            length = len(payload)
            pieces.append(pack(MESSAGE, BEHIND_LENGTH + length, channel, sequence, time, time))
            pieces.append(payload)
            before += head + length
            shift[done] += head + length
        pieces.append(rows[done * width :])
        index = {channel: np.array(each, np.uint64) for channel, each in entries.items()}
        if count:
            starts = np.arange(count, dtype=np.uint64) * np.uint64(width) + np.cumsum(
                np.array(shift[:count], np.uint64), dtype=np.uint64
            )
            for channel, offset in row.offsets.items():
                index[channel] = np.column_stack((times, starts + np.uint64(offset)))
        stamps = [time for each in entries.values() for time, _ in each]
        if count:
            stamps += [int(times[0]), int(times[-1])]
        return Block(b"".join(pieces), index, min(stamps, default=0), max(stamps, default=0))

    def _changes(self, samples: Sequence[Sample]) -> Iterator[Extra]:
        """Battery and mode, where they differ from those before."""
        for position, sample in enumerate(samples, start=1):
            if sample.battery is not self._battery:
                self._battery = battery = sample.battery
                if battery.state is not None:
                    for topic, voltage in zip(topics.BATTERIES, battery[:2], strict=True):
                        yield Extra(position, sample.now, topic, (voltage, battery.state, topic))
            if sample[7:] != self._mode:
                self._mode = sample[7:]
                yield Extra(position, sample.now, topics.MODE, sample)


# -- what is sampled -------------------------------------------------------------------------------------------


class _Row:
    """The records of one cycle behind one another, as one numpy record."""

    def __init__(self, ticks: bool, pose: bool) -> None:
        base = {"header": {"frame_id": "odom"}, "child_frame_id": "base_footprint"}
        on_robot = {"header": {"frame_id": "base_footprint"}}
        layouts = {  # causes before effects, as a verification names the first that differs
            topics.ODOMETRY: Layout("nav_msgs/Odometry", base),
            topics.SETPOINT: Layout("geometry_msgs/TwistStamped", on_robot),
            topics.GAINS: Layout("txt1_msgs/Gains", on_robot),
            topics.PWM: Layout("txt1_msgs/Pwm", on_robot),
            topics.TRANSFORM: Layout("tf2_msgs/TFMessage", {"transforms": [base]}),
        }
        if ticks:
            layouts[topics.ENCODERS] = Layout("txt1_msgs/Encoders", on_robot)
        if pose:
            layouts[topics.POSE] = Layout("geometry_msgs/PoseStamped", {"header": {"frame_id": "room"}})
        self.offsets: dict[int, int] = {}
        parts, heads, template = [], {}, b""
        for topic, layout in layouts.items():
            channel, start = CHANNELS[topic], len(template)
            self.offsets[channel] = start
            template += RECORD.pack(MESSAGE, BEHIND_LENGTH + len(layout.template), channel, 0, 0, 0) + layout.template
            parts.append((topic, layout, start + RECORD.size))
            heads[topic] = start
        self.size = len(template)
        self._type = record_type(parts, self.size)
        self._template = template
        self._heads = {
            topic: np.dtype(
                {
                    "names": ["sequence", "log", "publish"],
                    "formats": ["<u4", "<u8", "<u8"],
                    "offsets": [start + 11, start + 15, start + 23],
                    "itemsize": self.size,
                }
            )
            for topic, start in heads.items()
        }

    def fill(self, samples: Sequence[Sample], times: NDArray[np.uint64], sequences: dict[int, int]) -> bytes:
        """The records of these samples; counts them in `sequences`."""
        count = len(samples)
        filled = bytearray(self._template * count)  # and not numpy's repeat, which leaves out what is no field
        rows = np.frombuffer(filled, self._type)
        seconds, rest = np.divmod(times, np.uint64(NS_PER_S))
        for topic, head_type in self._heads.items():
            head, channel = np.frombuffer(filled, head_type), CHANNELS[topic]
            head["sequence"] = np.arange(sequences[channel], sequences[channel] + count, dtype=np.uint32)
            head["log"] = head["publish"] = times
            sequences[channel] += count
            stamp = f"{topic}transforms.0.header.stamp" if topic == topics.TRANSFORM else f"{topic}header.stamp"
            rows[f"{stamp}.sec"], rows[f"{stamp}.nanosec"] = seconds, rest
        x, y, _, v, omega = np.array([sample.odometry for sample in samples]).T
        half = [0.5 * sample.odometry.theta for sample in samples]
        # math's sine and not numpy's, whose last bit may depend on where in the batch a value stands
        z, w = [sin(angle) for angle in half], [cos(angle) for angle in half]
        odometry, transform = topics.ODOMETRY, f"{topics.TRANSFORM}transforms.0.transform."
        rows[f"{odometry}pose.pose.position.x"] = rows[f"{transform}translation.x"] = x
        rows[f"{odometry}pose.pose.position.y"] = rows[f"{transform}translation.y"] = y
        rows[f"{odometry}pose.pose.orientation.z"] = rows[f"{transform}rotation.z"] = z
        rows[f"{odometry}pose.pose.orientation.w"] = rows[f"{transform}rotation.w"] = w
        rows[f"{odometry}twist.twist.linear.x"] = v
        rows[f"{odometry}twist.twist.angular.z"] = omega
        rows[f"{topics.SETPOINT}twist.linear.x"] = [sample.control.v for sample in samples]
        rows[f"{topics.SETPOINT}twist.angular.z"] = [sample.control.omega for sample in samples]
        counts = np.array([sample.control.outputs[:5] for sample in samples], np.int32).T
        for name, column in zip(("motor", "front", "rear", "pwm4", "pwm5"), counts, strict=True):
            rows[f"{topics.PWM}{name}"] = column
        gains = np.array([(*sample.linear, *sample.control.gains) for sample in samples], float).T
        for name, column in zip(_GAINS, gains, strict=True):
            rows[f"{topics.GAINS}{name}"] = column
        if topics.ENCODERS in self._heads:
            right, left = zip(*(sample.encoders for sample in samples), strict=True)
            rows[f"{topics.ENCODERS}right"] = [each or 0 for each in right]
            rows[f"{topics.ENCODERS}left"] = [each or 0 for each in left]
            rows[f"{topics.ENCODERS}valid"] = [each is not None for each in right]
        if topics.POSE in self._heads:
            poses = [sample.pose or (0.0, 0.0, 0.0) for sample in samples]
            rows[f"{topics.POSE}pose.position.x"] = [pose[0] for pose in poses]
            rows[f"{topics.POSE}pose.position.y"] = [pose[1] for pose in poses]
            rows[f"{topics.POSE}pose.orientation.z"] = [sin(0.5 * pose[2]) for pose in poses]
            rows[f"{topics.POSE}pose.orientation.w"] = [cos(0.5 * pose[2]) for pose in poses]
        return bytes(filled)


_GAINS: Final = ("linear_kp", "linear_ki", "linear_kd", "angular_kp", "angular_ki", "angular_kd")


# -- what comes in between -------------------------------------------------------------------------------------

_STAMP: Final = ("header.stamp.sec", "header.stamp.nanosec")


@cache
def _twist_filler() -> Callable[..., bytes]:
    layout = Layout("geometry_msgs/TwistStamped", {"header": {"frame_id": "base_footprint"}})
    return layout.filler(*_STAMP, "twist.linear.x", "twist.angular.z")


def _twist(sec: int, nanosec: int, velocity: tuple[float, float]) -> bytes:
    return _twist_filler()(sec, nanosec, *velocity)


@lru_cache(256)
def _input_filler(source: str, kind: str, text: str, length: int) -> Callable[..., bytes]:
    layout = Layout("txt1_msgs/Input", {"source": source, "kind": kind, "text": text, "values": [0.0] * length})
    return layout.filler(*_STAMP, "cycle", "tick", "received", "given", *_elements("values", length))


def _input(sec: int, nanosec: int, given: Input) -> bytes:
    fill = _input_filler(given.source, given.kind, given.text, len(given.values))
    return fill(sec, nanosec, given.cycle, given.tick, given.received, given.given, *given.values)


def _elements(field: str, length: int) -> Iterator[str]:
    return (f"{field}.{index}" for index in range(length))


def _ticks(sec: int, nanosec: int, ticks: Sequence[Tick]) -> bytes:
    tasks, times, missed = zip(*ticks, strict=True)
    return encode(
        "txt1_msgs/Ticks",
        {
            "header": _stamped(sec, nanosec),
            "task": bytes(tasks), "time": np.array(times), "missed": np.array(missed, np.uint32),
        },
    )  # fmt: skip


def _stamped(sec: int, nanosec: int, frame: str = "") -> dict[str, Any]:
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


@cache
def _battery_filler(topic: str) -> Callable[..., bytes]:
    unknown = float("nan")  # what ROS says of what is not measured
    layout = Layout(
        "sensor_msgs/BatteryState",
        {
            "temperature": unknown, "current": unknown, "charge": unknown, "capacity": unknown,
            "design_capacity": 6.5, "percentage": unknown,
            "power_supply_status": POWER_SUPPLY_DISCHARGING,
            "power_supply_technology": TECHNOLOGY_LIPO,
            "location": topic.removeprefix("/"),
        },
    )  # fmt: skip
    return layout.filler(*_STAMP, "voltage", "power_supply_health", "present")


def _battery(sec: int, nanosec: int, pack: tuple[float, BatteryState, str]) -> bytes:
    voltage, state, topic = pack
    return _battery_filler(topic)(sec, nanosec, voltage, HEALTH.get(state, 0), voltage >= FITTED_V)


def _mode(sec: int, nanosec: int, sample: Sample) -> bytes:
    return encode(
        "txt1_msgs/Mode",
        {
            "header": _stamped(sec, nanosec),
            "armed": sample.armed, "stopped": sample.stopped, "manual": sample.panel.manual,
            "link_alive": sample.link.alive, "combined": sample.link.combined,
            "atx": sample.power.atx, "esc": sample.power.esc,
            "screen": sample.panel.screen, "reason": sample.reason,
        },
    )  # fmt: skip


def _diagnostics(sec: int, nanosec: int, tasks: dict[str, dict[str, object]]) -> bytes:
    return encode(
        "diagnostic_msgs/DiagnosticArray",
        {
            "header": _stamped(sec, nanosec),
            "status": [
                {
                    "level": 1 if values["misses"] else 0,
                    "name": f"task {name}",
                    "message": f"{values['misses']} cycles missed" if values["misses"] else "punctual",
                    "hardware_id": "txt1",
                    "values": [{"key": key, "value": str(value)} for key, value in values.items()],
                }
                for name, values in tasks.items()
            ],
        },
    )


def _faults(sec: int, nanosec: int, counts: dict[str, int]) -> bytes:
    status = {
        "level": 1 if counts else 0,
        "name": "faults",
        "hardware_id": "txt1",
        "values": [{"key": name, "value": str(count)} for name, count in counts.items()],
    }
    return encode("diagnostic_msgs/DiagnosticArray", {"header": _stamped(sec, nanosec), "status": [status]})


def _log(sec: int, nanosec: int, line: tuple[int, str]) -> bytes:
    level, text = line
    return encode(
        "rcl_interfaces/Log",
        {"stamp": {"sec": sec, "nanosec": nanosec}, "level": level, "name": "txt1", "msg": text},
    )


def _link(sec: int, nanosec: int, piece: tuple[str, bytes]) -> bytes:
    direction, data = piece
    return encode("txt1_msgs/LinkBytes", {"header": _stamped(sec, nanosec), "direction": direction, "data": data})


@cache
def _light_filler() -> Callable[..., bytes]:
    layout = Layout("txt1_msgs/Light", {"header": {"frame_id": "base_footprint"}})
    return layout.filler(*_STAMP, *_elements("lux", len(SENSORS)))


def _light(sec: int, nanosec: int, lux: Readings) -> bytes:
    return _light_filler()(sec, nanosec, *lux)


@lru_cache(256)
def _learning_filler(actions: int) -> Callable[..., bytes]:
    layout = Layout("txt1_msgs/LearningStep", {"values": [0.0] * actions})
    return layout.filler(*_STAMP, "repetition", "state", "action", "reward", *_elements("values", actions))


def _learning(sec: int, nanosec: int, step: tuple[int, int, int, float, tuple[float, ...]]) -> bytes:
    *numbers, values = step
    return _learning_filler(len(values))(sec, nanosec, *numbers, *values)


def _snapshot(sec: int, nanosec: int, snapshot: Snapshot) -> bytes:
    del sec, nanosec  # a snapshot has its time in it
    return encode("std_msgs/String", {"data": frames.encode(snapshot).decode("ascii").rstrip("\n")})
