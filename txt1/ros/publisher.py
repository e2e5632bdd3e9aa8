"""Telemetry of a robot or a board, as lines of CDR bytes for the node of ROS 2."""

from __future__ import annotations

import asyncio
import json
from base64 import b64encode
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import tau
from typing import Any, Final, Literal, NamedTuple

from txt1.errors import RecordingError
from txt1.estimation.task import FILTERED
from txt1.kernel.clock import NS_PER_S, seconds, wall_ns
from txt1.kernel.loop import VirtualTimeLoop
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.record.mcap_records import Encoder, Message
from txt1.record.settings import RecordConfig
from txt1.ros.topics import (
    JOINT_STATES,
    NOT_TOLD,
    STEERED_DRIVE,
    Joints,
    Publication,
    in_namespace,
    of_the_table,
    parent,
    sensor,
    steered,
    turned,
)
from txt1.ros.urdf import robot_description
from txt1.runtime import Runtime
from txt1.sensors.mounts import TF_STATIC, SensorFrames
from txt1.tasks.controller import SETPOINT
from txt1.tasks.encoder import ODOMETRY, POSE, TRANSFORM, origin
from txt1.tasks.on_map import MapInUse
from txt1.telemetry.topics import Rule, Topic

# messages that wait for the node; the oldest are dropped
EVENTS_MAX: Final = 3000
# s by which the time of day may drift before stamps follow it
STEPPED: Final = 0.05
DESCRIPTION: Final = Topic("/robot_description", str, "", "std_msgs/String", Rule.CHANGE, "the robot as URDF")


def line_of(
    now: int, new: Sequence[tuple[int, str, str, str]], messages: Iterable[tuple[int, int, bytes]], **more: object
) -> bytes:
    """Return a line for the node: time in ns, new channels, messages, and further fields.

    A channel consists of number, name, message and quality of service; a message of channel, time in ns and bytes.
    """
    told = [(number, time, b64encode(data).decode("ascii")) for number, time, data in messages]
    rest = {name: value for name, value in {"new": new, "messages": told, **more}.items() if value}
    return f"{json.dumps({'now': now, **rest})}\n".encode("ascii")


class WheelJoints:
    """The joints of the wheels, moved by the odometry's speed and the steering's PWM counts."""

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        self._angle, self._read_at = 0.0, 0.0

    def joints(self, v: float, front: int, rear: int, now: float) -> Joints:
        """Return the joints at `now` s, for `v` in m/s."""
        rate = v * tau / self._geometry.circumference
        self._angle += rate * max(0.0, now - self._read_at)
        self._read_at = now
        left, right = turned(front, rear, self._geometry)
        return Joints((self._angle,) * 4 + (left, left, right, right), (rate,) * 4 + (0.0,) * 4)


PLACES: Final = Publication("tf_static", "latched", TF_STATIC)
DESCRIBED: Final = Publication("robot_description", "latched", DESCRIPTION)


JOINTS: Final = Publication("joint_states", "default", JOINT_STATES)
STEERED: Final = Publication("~/drive", "default", STEERED_DRIVE)


Transforms = Literal["auto", "map", "room", "odom", "none"]
"""The moving transforms that a node publishes.

- auto: odom -> base_footprint, and a frame above odom until another program publishes a frame there. The frame is map
  if the robot is located on a map or has an estimate; in a simulation it is else room. While the robot is lost on its
  map, there is no frame above odom.
- map, room: this frame above odom, even if another program publishes a different frame there.
- odom: no frame above odom.
- none: no moving transform.
"""


class Told(NamedTuple):
    """Settings of a node's messages."""

    transforms: Transforms = "auto"
    prefix: str = ""
    """Prefix of the names of frames."""
    owner: str = ""
    """Robot of the diagnostics, if several robots publish theirs."""
    ackermann: bool = False
    """Whether speed and steering angle are published, too."""


PLAIN: Final = Told()


class Publisher:
    """Collects the telemetry of a runtime from `begin` to `end`, and returns it as lines; `say` informs the
    operator.
    """

    def __init__(self, runtime: Runtime, say: Callable[[str], None], told: Told = PLAIN) -> None:
        self._runtime, self._say, self._how = runtime, say, told
        # another program publishes the transform of odom
        self._yields = False
        self.virtual: Final = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        """Whether ROS gets the robot's time instead of the time of day."""
        self._leave: Callable[[], None] = lambda: None
        self._events: deque[Message] = deque(maxlen=EVENTS_MAX)
        # from the start on: readings tell where their sensors sit
        self._frames = SensorFrames()
        sensors = [polled.sensor.topic for polled in runtime.sensors.values()]
        for topic in sensors:
            self._frames.link(topic)
        self._begun = False
        runtime.bus.subscribe(self._see, sensors)
        # messages without a type in the node, and their topics' names
        self._lacking: dict[str, list[str]] = {}
        # topics with a value that could not become a message
        self._refused: set[Topic[Any]] = set()
        self._wheels = WheelJoints(runtime.config.geometry)
        # channels announced to the node
        self._told = 0
        self._forget()

    def begin(self) -> None:
        """Start: a new node knows nothing yet."""
        self.end()
        self._lacking.clear()
        self._forget()
        self._map, self._room, self._joints = (
            self._named(Publication(*each))
            for each in (
                ("tf", "default", parent("map")),
                ("tf", "default", parent("room")),
                JOINTS,
            )
        )
        self._steered, self._places, self._described = (self._named(each) for each in (STEERED, PLACES, DESCRIBED))
        runtime = self._runtime
        for polled in runtime.sensors.values():
            self._kinds.setdefault(polled.sensor.topic.type, polled.sensor.topic)
        self._begun = True
        self._describe()
        self._leave = runtime.bus.subscribe(self._take)

    def end(self) -> None:
        """Collect nothing more."""
        self._begun = False
        self._leave()
        self._events.clear()

    def parent(self, frame: str, nodes: str) -> None:
        """Give way to another program, which publishes the transform from `frame` to odom."""
        if not self._yields and self._how.transforms == "auto":
            self._yields = True
            self._say(
                f": {nodes or 'another program'} tells {frame} -> odom, so the robot tells no frame above odom now"
            )

    def missing(self, message: str, name: str) -> None:
        """Note that the node has no type for a message."""
        first = message not in self._lacking
        self._lacking.setdefault(message, []).append(name)
        self._publications.clear()
        if first:
            self._say(f": ROS has no type {message} here, so {name} is not told; 'txt1 ros2 install' makes it")

    def line(self, more: Mapping[str, object]) -> bytes | None:
        """Return all messages since the last call, new channels, and `more`; None if there is nothing."""
        if not self._events and not any(more.values()):
            return None
        if not self.virtual and abs(self._offset() - self._epoch) > STEPPED:
            # the time of day was set; the messages that wait are of the channels that were known
            self._announce_anew()
        events, self._events = self._events, deque(maxlen=EVENTS_MAX)
        messages = [
            (self._numbers.setdefault(topic, len(self._numbers)), time, data)
            for (_, topic), time, data in self._encoded(list(events))
        ]
        known = list(self._numbers)
        new = [
            (number, publication.name, publication.topic.message, publication.quality)
            for number, publication in ((n, self._publication[known[n]]) for n in range(self._told, len(known)))
        ]
        self._told = len(known)
        return line_of(round((self._runtime.now + self._epoch) * NS_PER_S), new, messages, **more)

    # -- inside ------------------------------------------------------------------------------------------------

    def _encoded(self, events: list[Message]) -> Iterable[Any]:
        try:
            return self._encoder.block(events).messages()
        except RecordingError as error:
            # what was made before it
            self._encoder.block()
            # a single value is no message; the others are
            if len(events) > 1:
                return (each for event in events for each in self._encoded([event]))
            if events[0][1] not in self._refused:
                self._refused.add(events[0][1])
                self._say(f": {error}")
            return ()

    def _offset(self) -> float:
        """Return the time of day at the run's start; in virtual time that of recordings."""
        return (
            self._runtime.config.section(RecordConfig).epoch or 0.0
            if self.virtual
            else seconds(wall_ns()) - self._runtime.now
        )

    def _forget(self) -> None:
        """Start again: no channel is known."""
        self._announce_anew()
        self._publications: dict[Topic[Any], tuple[Publication, ...]] = {}
        self._publication: dict[Topic[Any], Publication] = {}
        # the first sensor's topic of each type
        self._kinds: dict[type, Topic[Any]] = {}

    def _announce_anew(self) -> None:
        """Announce every channel again, with stamps of the present time of day."""
        self._epoch = self._offset()
        self._encoder = Encoder(self._epoch)
        self._numbers: dict[Topic[Any], int] = {}
        self._told = 0

    def _publications_of(self, topic: Topic[Any]) -> tuple[Publication, ...]:
        found = self._publications.get(topic)
        if found is None:
            if topic.rule is Rule.SNAPSHOT or topic.name in NOT_TOLD or self._left_out(topic):
                every: Sequence[Publication] = ()
            elif topic.name.startswith("/sensors/"):
                every = [
                    each._replace(topic=self._frames.framed(each.topic, topic))
                    for each in sensor(topic, self._kinds.setdefault(topic.type, topic) is topic)
                ]
            else:
                every = (of_the_table(topic),)
            found = self._publications[topic] = tuple(
                self._named(each) for each in every if each.topic.message not in self._lacking
            )
            self._publication |= {each.topic: each for each in found}
        return found

    def _left_out(self, topic: Topic[Any]) -> bool:
        return topic is TRANSFORM and self._how.transforms == "none"

    def _named(self, publication: Publication) -> Publication:
        return publication._replace(topic=in_namespace(publication.topic, self._how.prefix, self._how.owner))

    def _take(self, topic: Topic[Any], value: Any, time: float) -> None:
        for publication in self._publications_of(topic):
            self._events.append((time, publication.topic, value))
        if topic is ODOMETRY:
            self._tell_frames(value, time)

    def _see(self, topic: Topic[Any], value: Any, _time: float) -> None:
        """Describe the robot anew if a sensor sits elsewhere than known before."""
        if self._frames.see(topic, value) and self._begun:
            self._describe()

    def _describe(self) -> None:
        runtime, mounts = self._runtime, self._frames.mounts
        self._tell(self._places, mounts, runtime.now)
        self._tell(self._described, robot_description(runtime.name, runtime.config.geometry, mounts), runtime.now)

    def _tell(self, publication: Publication, value: Any, time: float) -> None:
        if publication.topic.message not in self._lacking:
            self._publication[publication.topic] = publication
            self._events.append((time, publication.topic, value))

    def _tell_frames(self, odometry: Odometry, now: float) -> None:
        """Publish the odometry's origin on the map or in the room, and the positions of the wheels."""
        bus, frame = self._runtime.bus, "" if self._yields else self._how.transforms
        estimate, pose, control = bus.read(FILTERED), bus.read(POSE), bus.read(SETPOINT)
        on_map = self._runtime.part(MapInUse)
        if on_map is not None and frame in ("auto", "map"):
            there = on_map.pose()
            if there is not None and not there.lost:
                self._tell(self._map, origin(there[:3], odometry), now)
        elif estimate is not None and frame in ("auto", "map"):
            self._tell(self._map, origin(estimate[:3], odometry), now)
        elif pose is not None and frame in ("auto", "room"):
            self._tell(self._room, origin(pose, odometry), now)
        if control is not None:
            outputs = control.outputs
            self._tell(self._joints, self._wheels.joints(odometry.v, outputs.front, outputs.rear, now), now)
            if self._how.ackermann:
                self._tell(self._steered, steered(control.v, control.omega, self._runtime.config.geometry), now)
