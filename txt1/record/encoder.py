"""What the recorder saw, as MCAP message records.

The robot's state is sampled as references to immutable values, which costs next to nothing; here, off the control
path, all messages of a sample become bytes in one call of struct. With one call per message, as the mcap library
writes them, a recorded simulation would be half as fast.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from txt1.record.layout import HEADER, LENGTH, Layout, add_length, add_text, encode, packer
from txt1.record.topics import CHANNELS
from txt1.tasks.battery import FITTED_V
from txt1.tasks.fields import Battery, BatteryState, Control, Encoders, LinkState, Panel, Power, Snapshot
from txt1.ui import frames

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
BEHIND_LENGTH: Final = RECORD.size - 9

KIND: Final = struct.Struct("<BQH")
"""The part of it that tells what the record is: opcode, length, channel."""
WHEN: Final = struct.Struct("<IQQ4siI")
"""What tells its place in time: sequence, log time, publish time, then of the message CDR's mark and the stamp."""
STAMP: Final = struct.calcsize("<iI")

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
    link: LinkState
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
        makers: dict[str, Callable[[Any], bytes]] = {
            topics.BATTERIES[0]: _battery,
            topics.BATTERIES[1]: _battery,
            topics.MODE: _mode,
            topics.DIAGNOSTICS: _diagnostics,
            topics.FAULTS: _faults,
            topics.LOG: _log,
            topics.LINK: _link,
            topics.LIGHT: _light,
            topics.LEARNING: _learning,
            topics.TICKS: _ticks,
        }
        self._makers: dict[str, Callable[[bytes, Any], bytes]] = {
            topics.COMMAND: _twist_maker(),
            topics.INPUT: _input,
            topics.SNAPSHOT: _snapshot,
            **{topic: _stamping(CHANNELS[topic], make) for topic, make in makers.items()},
        }

    def skip(self, samples: int) -> None:
        """Leave a gap in the sequence numbers where samples were lost."""
        self._row.sequence += samples

    @property
    def sampled(self) -> int:
        """How many messages one sample makes."""
        return len(self._row.offsets)

    def block(self, samples: Sequence[Sample], extras: Sequence[Extra]) -> Block:
        """The records of a batch; `extras` by rising position."""
        changes = list(self._changes(samples))
        made = sorted([*changes, *extras], key=lambda extra: extra.position) if changes else extras
        row, count = self._row, len(samples)
        width = row.size
        times = [round(sample.now * NS_PER_S) + self._epoch_ns for sample in samples]
        rows = row.fill(samples, times)
        pieces: list[bytes] = []
        shifts: list[int] = []
        stamps = [times[0], times[-1]] if times else []
        entries: dict[int, list[int]] = {}
        done = before = time = sec = nanosec = 0
        known = float("nan")
        sequences, makers, when = self._sequences, self._makers, WHEN.pack
        for position, now, topic, content in made:
            if now != known:
                known = now
                time = round(now * NS_PER_S) + self._epoch_ns
                sec, nanosec = divmod(time, NS_PER_S)
                stamps.append(time)
            if position != done:
                pieces += rows[done:position]
                shifts += [before] * (position - done)
                done = position
            channel = CHANNELS[topic]
            sequence = sequences[channel]
            sequences[channel] = sequence + 1
            record = makers[topic](when(sequence, time, time, HEADER, sec, nanosec), content)
            pieces.append(record)
            if channel not in entries:
                entries[channel] = []
            entries[channel] += time, done * width + before
            before += len(record)
        pieces += rows[done:]
        shifts += [before] * (count - done)
        index = {channel: _numbers(each).reshape(-1, 2) for channel, each in entries.items()}
        if count:
            starts = np.arange(count, dtype=np.uint64) * np.uint64(width) + _numbers(shifts)
            sampled = np.empty((len(row.offsets), count, 2), np.uint64)
            sampled[:, :, 0] = _numbers(times)
            sampled[:, :, 1] = starts + _numbers(list(row.offsets.values()))[:, None]
            index.update(zip(row.offsets, sampled, strict=True))
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


def _numbers(values: Sequence[int]) -> NDArray[np.uint64]:
    """As numpy's array makes them, in a fifth of its time."""
    return np.frombuffer(struct.pack(f"={len(values)}Q", *values), np.uint64)


class _Row:
    """The records of one cycle behind one another.

    Attributes:
        sequence: the number of the next cycle's messages, which is the same in all of them.
        offsets: of the records by their channels.
        size: of all of them in bytes.

    """

    def __init__(self, ticks: bool, pose: bool) -> None:
        base = {"header": {"frame_id": "odom"}, "child_frame_id": "base_footprint"}
        on_robot = {"header": {"frame_id": "base_footprint"}}
        place = ("position.x", "position.y", "orientation.z", "orientation.w")
        # causes before effects, as a verification names the first that differs
        records: dict[str, tuple[Layout, Sequence[str]]] = {
            topics.ODOMETRY: (
                Layout("nav_msgs/Odometry", base),
                (*(f"pose.pose.{name}" for name in place), "twist.twist.linear.x", "twist.twist.angular.z"),
            ),
            topics.SETPOINT: (Layout("geometry_msgs/TwistStamped", on_robot), ("twist.linear.x", "twist.angular.z")),
            topics.GAINS: (
                Layout("txt1_msgs/Gains", on_robot),
                [f"{controller}_{gain}" for controller in ("linear", "angular") for gain in ("kp", "ki", "kd")],
            ),
            topics.PWM: (Layout("txt1_msgs/Pwm", on_robot), ("motor", "front", "rear", "pwm4", "pwm5")),
            topics.TRANSFORM: (
                Layout("tf2_msgs/TFMessage", {"transforms": [base]}),
                [
                    f"transforms.0.transform.{name}"
                    for name in ("translation.x", "translation.y", "rotation.z", "rotation.w")
                ],
            ),
        }
        if ticks:
            records[topics.ENCODERS] = Layout("txt1_msgs/Encoders", on_robot), ("right", "left", "valid")
        if pose:
            room = {"header": {"frame_id": "room"}}
            records[topics.POSE] = Layout("geometry_msgs/PoseStamped", room), [f"pose.{name}" for name in place]
        self.sequence = 0
        self.offsets: dict[int, int] = {}
        template, places = b"", []
        for topic, (layout, names) in records.items():
            channel, start = CHANNELS[topic], len(template)
            self.offsets[channel] = start
            template += RECORD.pack(MESSAGE, BEHIND_LENGTH + len(layout.template), channel, 0, 0, 0) + layout.template
            if topic == topics.TRANSFORM:  # the number of transforms stands before the stamp
                stamp, _ = layout.places["transforms.0.header.stamp.sec"]
                places += [(start + KIND.size, f"{WHEN.size - STAMP}s"), (start + RECORD.size + stamp, f"{STAMP}s")]
            else:
                places.append((start + KIND.size, f"{WHEN.size}s"))
            places += [(start + RECORD.size + layout.places[name][0], layout.places[name][1]) for name in names]
        self.size = len(template)
        self._pack, self._constants = packer(template, places)
        self._has_ticks, self._has_pose = ticks, pose

    def fill(self, samples: Sequence[Sample], times: Sequence[int]) -> list[bytes]:
        """For each of these samples the records; counts them."""
        pack, when, has_ticks, has_pose = self._pack, WHEN.pack, self._has_ticks, self._has_pose
        a, b, c, d, e, f, g, h, i, j, k, *rest = self._constants  # what stands ahead of the numbers, in their order
        rows: list[bytes] = []
        for sequence, (sample, time) in enumerate(zip(samples, times, strict=True), self.sequence):
            _, odometry, control, linear, (right, left), pose = sample[:6]
            outputs, v_set, omega_set, _, angular = control
            (x, y, theta, v, omega), (motor, front, rear, pwm4, pwm5, _, _) = odometry, outputs
            (kp, ki, kd), (turn_kp, turn_ki, turn_kd) = linear, angular
            sec, nanosec = divmod(time, NS_PER_S)
            head = when(sequence, time, time, HEADER, sec, nanosec)
            z, w = sin(0.5 * theta), cos(0.5 * theta)
            more: tuple[Any, ...] = ()
            if has_ticks:
                more = rest[0], head, rest[1], right or 0, left or 0, right is not None
            if has_pose:
                room_x, room_y, angle = pose or (0.0, 0.0, 0.0)
                more += rest[-2], head, rest[-1], room_x, room_y, sin(0.5 * angle), cos(0.5 * angle)
            rows.append(
                pack(
                    a, head, b, x, y, z, w, v, omega,
                    c, head, d, v_set, omega_set,
                    e, head, f, kp, ki, kd, turn_kp, turn_ki, turn_kd,
                    g, head, h, motor, front, rear, pwm4, pwm5,
                    i, head[:-STAMP], j, head[-STAMP:], k, x, y, z, w,
                    *more,
                )
            )  # fmt: skip
        self.sequence += len(samples)
        return rows


# -- what comes in between -------------------------------------------------------------------------------------


def _record(channel: int, when: bytes, message: bytes) -> bytes:
    """A record of a message that begins with its stamp, whatever that is; `when` has the right one."""
    return KIND.pack(MESSAGE, BEHIND_LENGTH + len(message), channel) + when + message[len(HEADER) + STAMP :]


def _record_packer(topic: str, layout: Layout, *paths: str) -> tuple[Callable[..., bytes], list[bytes]]:
    """`packer` for whole records of these messages, given when and then these numbers."""
    template = _record(CHANNELS[topic], bytes(WHEN.size), layout.template)
    places = [(RECORD.size + offset, code) for offset, code in map(layout.places.__getitem__, paths)]
    return packer(template, [(KIND.size, f"{WHEN.size}s"), *places])


def _twist_maker() -> Callable[[bytes, tuple[float, float]], bytes]:
    layout = Layout("geometry_msgs/TwistStamped", {"header": {"frame_id": "base_footprint"}})
    pack, (kind, frame) = _record_packer(topics.COMMAND, layout, "twist.linear.x", "twist.angular.z")

    def twist(when: bytes, velocity: tuple[float, float]) -> bytes:
        v, omega = velocity
        return pack(kind, when, frame, v, omega)

    return twist


@lru_cache(256)
def _input_packer(source: str, kind: str, text: str, length: int) -> tuple[Any, ...]:
    """What packs an input, and the constants: ahead of `when`, `cycle`, `given` and the values, if there are any."""
    layout = Layout("txt1_msgs/Input", {"source": source, "kind": kind, "text": text, "values": [0.0] * length})
    numbers = "cycle", "tick", "received", "given", *_elements("values", length)
    pack, (record, frame, texts, *count) = _record_packer(topics.INPUT, layout, *numbers)
    return pack, record, frame, texts, count


def _input(when: bytes, given: Input) -> bytes:
    cycle, tick, received, source, kind, text, moment, values = given
    pack, record, frame, texts, count = _input_packer(source, kind, text, len(values))
    made: bytes = pack(record, when, frame, cycle, tick, received, texts, moment, *count, *values)
    return made


def _snapshot(when: bytes, snapshot: Snapshot) -> bytes:
    text = frames.encode(snapshot)  # it has its time in it; the string's zero comes in the place of the line's end
    length = BEHIND_LENGTH + len(HEADER) + LENGTH.size + len(text)
    kind = KIND.pack(MESSAGE, length, CHANNELS[topics.SNAPSHOT])
    return b"".join((kind, when[:-STAMP], LENGTH.pack(len(text)), text[:-1], b"\0"))


def _stamping(channel: int, make: Callable[[Any], bytes]) -> Callable[[bytes, Any], bytes]:
    """What makes records of the messages that `make` makes without their stamps."""
    return lambda when, content: _record(channel, when, make(content))


def _elements(field: str, length: int) -> Iterator[str]:
    return (f"{field}.{index}" for index in range(length))


def _ticks(ticks: Sequence[Tick]) -> bytes:
    tasks, times, missed = zip(*ticks, strict=True)
    return encode(
        "txt1_msgs/Ticks",
        {"task": bytes(tasks), "time": np.array(times), "missed": np.array(missed, np.uint32)},
    )


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
    return layout.filler("voltage", "power_supply_health", "present")


def _battery(pack: tuple[float, BatteryState, str]) -> bytes:
    voltage, state, topic = pack
    return _battery_filler(topic)(voltage, HEALTH.get(state, 0), voltage >= FITTED_V)


def _mode(sample: Sample) -> bytes:
    return encode(
        "txt1_msgs/Mode",
        {
            "armed": sample.armed, "stopped": sample.stopped, "manual": sample.panel.manual,
            "link_alive": sample.link.alive, "combined": sample.link.combined,
            "atx": sample.power.atx, "esc": sample.power.esc,
            "screen": sample.panel.screen, "reason": sample.reason,
        },
    )  # fmt: skip


def _diagnostics(tasks: dict[str, dict[str, object]]) -> bytes:
    return _statuses(
        (
            1 if values["misses"] else 0,
            f"task {name}",
            f"{values['misses']} cycles missed" if values["misses"] else "punctual",
            values,
        )
        for name, values in tasks.items()
    )


def _faults(counts: dict[str, int]) -> bytes:
    return _statuses([(1 if counts else 0, "faults", "", counts)])


def _statuses(statuses: Iterable[tuple[int, str, str, Mapping[str, object]]]) -> bytes:
    """A DiagnosticArray of these levels, names, messages and values, in a fifth of the time of `encode`."""
    data, count = bytearray(NO_STATUS), 0
    for level, name, message, values in statuses:
        count += 1
        data.append(level)
        for text in (name, message, "txt1"):
            add_text(data, text)
        add_length(data, len(values))
        for key, value in values.items():
            add_text(data, key)
            add_text(data, str(value))
    data[len(NO_STATUS) - LENGTH.size : len(NO_STATUS)] = LENGTH.pack(count)
    return bytes(data)


NO_STATUS: Final = encode("diagnostic_msgs/DiagnosticArray", {})


def _log(line: tuple[int, str]) -> bytes:
    level, text = line
    return encode("rcl_interfaces/Log", {"level": level, "name": "txt1", "msg": text})


def _link(piece: tuple[str, bytes]) -> bytes:
    direction, data = piece
    return encode("txt1_msgs/LinkBytes", {"direction": direction, "data": data})


@cache
def _light_filler() -> Callable[..., bytes]:
    layout = Layout("txt1_msgs/Light", {"header": {"frame_id": "base_footprint"}})
    return layout.filler(*_elements("lux", len(SENSORS)))


def _light(lux: Readings) -> bytes:
    return _light_filler()(*lux)


@lru_cache(256)
def _learning_filler(actions: int) -> Callable[..., bytes]:
    layout = Layout("txt1_msgs/LearningStep", {"values": [0.0] * actions})
    return layout.filler("episode", "state", "action", "reward", *_elements("values", actions))


def _learning(step: tuple[int, int, int, float, tuple[float, ...]]) -> bytes:
    *numbers, values = step
    return _learning_filler(len(values))(*numbers, *values)
