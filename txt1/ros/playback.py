"""Plays a recording's messages as topics of ROS 2, with their times as ``/clock``."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from txt1.commands import say
from txt1.config.sources import checked
from txt1.errors import HalError
from txt1.kernel.clock import NS_PER_S, RealClock, nanoseconds, seconds
from txt1.kernel.loop import run
from txt1.model.vehicle import Geometry
from txt1.record.mcap_records import Encoder
from txt1.record.reader import Decoding, FilePass, Item, metadata_of, robot_in
from txt1.ros.definitions import OWNERS
from txt1.ros.node import started
from txt1.ros.publisher import DESCRIBED, JOINTS, PLACES, WheelJoints, line_of
from txt1.ros.python import RosPython
from txt1.ros.robot_node import ros2_python
from txt1.ros.topics import Publication, Quality, recorded
from txt1.ros.urdf import robot_description
from txt1.sensors.mounts import ORIGINAL, TF_STATIC
from txt1.sidecar import Request, Sidecar
from txt1.tasks.controller import PWM
from txt1.tasks.encoder import ODOMETRY
from txt1.telemetry.topics import Topic

NODE: Final = "txt1.ros.ros2:main"
# s between two checks for messages that are due
DUE_PERIOD: Final = 0.01
# messages after which a line is full
BYTES_MAX: Final = 1 << 19
# s that the last messages have to arrive
ARRIVAL_TIME: Final = 1.0


class Playback:
    """Sends the messages of a recording at `speed` times its pace, from `start` s of the run on.

    In addition it sends the robot's description, its wheels, and the places of the original's sensors, until the
    recording's own follow: a recording by version 0.2.0 has none. `say` is called for messages without a type in ROS.
    Raises RecordingError: there is no such robot in the file.
    """

    def __init__(
        self, file: Path, robot: str | None, speed: float, start: float | None, loop: bool, say: Callable[[str], None]
    ) -> None:
        # by the topics' qualities of service
        for module in OWNERS:
            import_module(module)
        self.over = asyncio.Event()
        """Set when the end was sent."""
        self._file, self._robot = file, robot_in(file, robot)
        self._speed, self._start, self._loop, self._say = speed, start, loop, say
        config = json.loads(metadata_of(file, "txt1").get("config", "{}"))
        self._geometry = checked(Geometry, config.get("geometry", {}), "geometry")
        self._name = config.get("name", "")
        self._clock = RealClock()
        # ns of the clock; None while there is no node
        self._began: int | None = None
        # of the clock: time of the next line
        self._due_ns = 0

    def request(self, request: Request) -> None:
        """Start when the node is there; tell which types it lacks."""
        if request.name == "begin":
            self._places: dict[int, tuple[str, Quality] | None] = {}
            self._numbers: dict[int | str, int] = {}
            self._rewind()
        elif request.name == "missing":
            self._say(f"ROS has no type {request.fields['message']} here, so {request.fields['name']} is not told")

    def _rewind(self) -> None:
        self._decoding, self._encoder, self._wheels = Decoding(), Encoder(0.0), WheelJoints(self._geometry)
        self._pwm = 0, 0
        self._items = self._due()
        self._next = next(self._items, None)
        self._described = False
        self._began = self._clock.now_ns()

    def _due(self) -> Iterator[Item]:
        """Yield the messages from the start on, and before them the last of each kind that is kept for late
        subscribers.
        """
        reading = FilePass(self._file, self._robot)
        kept: dict[int, Item] = {}
        # time of the recording at the start, ns
        self._first: int | None = None
        for item in reading:
            if self._start is not None and (run := reading.run_time(item)) < self._start:
                place = self._place(item)
                if place is not None and place[1] == "latched":
                    kept[item.channel.id] = item
                self._first = item.message.log_time + nanoseconds(self._start - run)
                continue
            if self._first is None:
                self._first = item.message.log_time
            yield from kept.values()
            kept.clear()
            yield item

    def _place(self, item: Item) -> tuple[str, Quality] | None:
        if item.channel.id not in self._places:
            taken = {place[0] for place in self._places.values() if place is not None}
            self._places[item.channel.id] = recorded(item.name, item.schema.name.replace("/msg/", "/"), taken)
        return self._places[item.channel.id]

    def telemetry(self) -> bytes | None:
        """Return a line with the messages that are due now; None if there are none."""
        if self._began is None or self._clock.now_ns() < self._due_ns:
            return None
        self._due_ns = self._clock.now_ns() + nanoseconds(DUE_PERIOD)
        now = (self._first or 0) + round((self._clock.now_ns() - self._began) * self._speed)
        new: list[tuple[int, str, str, str]] = []
        messages: list[tuple[int, int, bytes]] = []

        def number(key: int | str, name: str, message: str, quality: Quality) -> int:
            if key not in self._numbers:
                self._numbers[key] = len(self._numbers)
                new.append((self._numbers[key], name, message, quality))
            return self._numbers[key]

        def tell(publication: Publication, value: Any, time: int) -> None:
            topic: Topic[Any] = publication.topic
            key = number(topic.name, publication.name, topic.message, publication.quality)
            for _, stamp, data in self._encoder.block([(seconds(time), topic, value)]).messages():
                messages.append((key, stamp, data))

        if not self._described:
            self._described = True
            tell(DESCRIBED, robot_description(self._name, self._geometry), now)
            tell(PLACES, ORIGINAL, now)
        size = 0
        while self._next is not None and self._next.message.log_time <= now and size < BYTES_MAX:
            item, self._next = self._next, next(self._items, None)
            time, place = item.message.log_time, self._place(item)
            if place is not None:
                message = item.schema.name.replace("/msg/", "/")
                key = item.name if item.name == TF_STATIC.name else item.channel.id
                messages.append((number(key, place[0], message, place[1]), time, item.message.data))
                size += len(item.message.data)
            if item.name == PWM.name:
                pwm = self._decoding.message(item)
                self._pwm = pwm.front, pwm.rear
            elif item.name == ODOMETRY.name:
                v = self._decoding.message(item).twist.twist.linear.x
                tell(JOINTS, self._wheels.joints(v, *self._pwm, time / NS_PER_S), time)
        if self._next is None:
            if self._loop:
                self._rewind()
            else:
                self.over.set()
        return line_of(now, new, messages)


async def publish(playback: Playback, python: RosPython, namespace: str) -> None:
    """Publish a recording until its end.

    Raises HalError when the node fails, RecordingError for a damaged file.
    """
    async with Sidecar(
        NODE,
        playback.telemetry,
        playback.request,
        options={"namespace": namespace, "virtual": True},
        beat=DUE_PERIOD,
        niceness=0,
        program=started(python, NODE),
        environment=python.environment,
    ) as beside:
        ended = asyncio.ensure_future(beside.ended())
        over = asyncio.ensure_future(playback.over.wait())
        await asyncio.wait([ended, over], return_when=asyncio.FIRST_COMPLETED)
        over.cancel()
        if ended.done():
            raise HalError(f"the node of ROS 2 ended: {ended.result()} (exit code {beside.returncode})")
        await asyncio.sleep(ARRIVAL_TIME)
        ended.cancel()


def play(file: Path, robot: str | None, speed: float, start: float | None, loop: bool, namespace: str) -> None:
    """Publish a recording as topics of ROS 2 until its end; raises as `Playback` and `publish`, ConfigError without
    ROS 2.
    """
    python = ros2_python()

    async def whole() -> None:
        await publish(Playback(file, robot, speed, start, loop, say), python, namespace)

    run(whole())
