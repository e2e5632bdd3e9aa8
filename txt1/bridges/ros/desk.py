"""The robot's end of a bridge to ROS: its topics as ready CDR bytes, and answers to what ROS asks for."""

from __future__ import annotations

import asyncio
import json
from base64 import b64encode
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict
from math import hypot
from pathlib import Path
from typing import Any, Final, Protocol

from txt1.beside import PERIOD, Beside, Request
from txt1.bridges.registry import RESTART, SILENCE, Desk
from txt1.bridges.ros.calls import Calls
from txt1.bridges.ros.topics import (
    JOINT_STATES,
    NOT_TOLD,
    Joints,
    Publication,
    fixed,
    of_the_table,
    parent,
    sensor,
    turned,
)
from txt1.bridges.ros.urdf import links_of, robot_description
from txt1.config.sources import with_values
from txt1.control.limits import clip
from txt1.errors import ConfigError, RecordingError, Txt1Error
from txt1.estimation.task import FILTERED
from txt1.kernel.clock import NS_PER_S, seconds, wall_ns
from txt1.kernel.loop import VirtualTimeLoop
from txt1.navigation import PoseSource, fused_pose, go_to, true_pose, wheel_pose
from txt1.protocol.messages import Switch
from txt1.record.encoder import Encoder, Event
from txt1.robot import Robot
from txt1.sim.room import Room
from txt1.tasks.controller import SETPOINT
from txt1.tasks.encoder import ODOMETRY, POSE, origin
from txt1.telemetry.topics import Rule, Topic

START: Final = Path(__file__).with_name("start.py")
PRIORITY: Final = -110  # behind the telemetry's task, so that what a cycle tells is sent in the same one
EVENTS_MAX: Final = 3000  # messages that wait for the bridge; the oldest go first
FEEDBACK: Final = 0.2  # s between two reports on the way to a goal
SPEED: Final = 0.4  # m/s to a goal that says none
STEPPED: Final = 0.05  # s by which the time of day may drift before stamps follow it
DESCRIPTION: Final = Topic("/robot_description", str, "", "std_msgs/String", Rule.CHANGE, "the robot as URDF")
_SWITCHES: Final = {"atx": Switch.ATX, "esc": Switch.ESC}


class NodeDesk(Protocol):
    """The robot's end of a node."""

    def telemetry(self) -> bytes | None:
        """What is to be sent now."""

    def request(self, request: Request) -> None:
        """Do what is asked for."""

    def say(self, text: str) -> None:
        """Add a line about the node to the event log."""

    def lost(self) -> None:
        """The node has gone."""


@asynccontextmanager
async def node_beside(
    robot: Robot,
    desk: NodeDesk,
    target: str,
    python: Sequence[str],
    environment: Mapping[str, str],
    options: Mapping[str, object],
) -> AsyncIterator[Beside]:
    """A node at work beside a robot, under another Python, until the block is left.

    `target` is its function, ``module:function``; `options` are keyword arguments for it.
    """
    beside = Beside(
        target, desk.telemetry, desk.request, options=options, restart=RESTART, silence=SILENCE,
        tell=lambda text: desk.say(f" {text}"), lost=desk.lost, program=(*python, str(START)), environment=environment,
        niceness=0, prompt=True,
    )  # fmt: skip
    try:
        async with beside:
            robot.add_task(f"bridge {target.rpartition(':')[0].rpartition('.')[2]}", PERIOD, beside.serve, PRIORITY)
            yield beside
    finally:
        desk.lost()


class Ros2Desk:
    """Hands out messages, and does what is asked for under the name "ros"."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._config = robot, robot.config
        self._calls = Calls({
            "arm": robot.arm, "disarm": lambda: robot.disarm("disarmed by ROS"), "stop": robot.stop,
            "load_gains": self._load_gains, "drive_to": self._drive_to, "manual": robot.set_manual,
            "place": robot.place, "set": self._set,
            "power": lambda switch, on: robot.switch_power(_SWITCHES[switch], on),
        })  # fmt: skip
        self._desk = Desk(robot, "ros", {
            "begin": self._begin, "missing": self._missing, "call": self._calls.call, "cancel": self._calls.cancel,
            "drive": self._drive,
            "combined": robot.combined_odometry, "servos": robot.servos,
        })  # fmt: skip
        config = robot.config
        self.stale = config.commander.timeouts.get("ros", config.safety.command_timeout)
        """Age at which a command is stale, s."""
        self._virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        self._leave: Callable[[], None] = lambda: None
        self._events: deque[Event] = deque(maxlen=EVENTS_MAX)
        self._lacking: dict[str, list[str]] = {}  # messages that the node has no type for, and their topics' names
        self._v_max = robot.config.safety.v_max
        self._wheel_angle, self._read_at = 0.0, 0.0
        self._told = 0  # channels that the node was told of
        self._goal: asyncio.Task[Any] | None = None
        self._aim: tuple[PoseSource, float, float] | None = None
        self._feedback_due = 0.0
        self._forget()

    # -- telemetry ---------------------------------------------------------------------------------------------

    def telemetry(self) -> bytes | None:
        """All messages since the last time, channels that are new, and answers; None when there is nothing."""
        if not (self._events or self._calls.answers):
            return None
        if not self._virtual and abs(self._offset() - self._epoch) > STEPPED:
            self._forget()  # the time of day was set
        events, self._events = self._events, deque(maxlen=EVENTS_MAX)
        messages = []
        for (_, topic), time, data in self._encoded(events):
            number = self._numbers.setdefault(topic, len(self._numbers))
            messages.append((number, time, b64encode(data).decode("ascii")))
        known = list(self._numbers)
        new = [
            (number, publication.name, publication.topic.message, publication.quality)
            for number, publication in ((n, self._publication[known[n]]) for n in range(self._told, len(known)))
        ]
        self._told = len(known)
        line: dict[str, object] = {"now": round((self._robot.now + self._epoch) * NS_PER_S)}
        line |= {
            name: told
            for name, told in (
                ("new", new),
                ("messages", messages),
                ("answers", self._calls.take()),
                ("feedback", self._feedback()),
            )
            if told
        }
        return f"{json.dumps(line)}\n".encode("ascii")

    def _encoded(self, events: Iterable[Event]) -> Iterable[Any]:
        try:
            return self._encoder.block([], list(events)).messages()
        except RecordingError as error:
            self.say(f": {error}")
            return ()

    def _offset(self) -> float:
        """Time of day at the run's start; in virtual time that of recordings."""
        return self._config.record.epoch if self._virtual else seconds(wall_ns()) - self._robot.now

    def _forget(self) -> None:
        """Begin anew: nobody knows any channel."""
        self._epoch = self._offset()
        self._encoder = Encoder(self._epoch)
        self._numbers: dict[Topic[Any], int] = {}
        self._told = 0
        self._publications: dict[Topic[Any], tuple[Publication, ...]] = {}
        self._publication: dict[Topic[Any], Publication] = {}
        self._kinds: dict[type, Topic[Any]] = {}  # the first sensor's topic of each type

    def _publications_of(self, topic: Topic[Any]) -> tuple[Publication, ...]:
        found = self._publications.get(topic)
        if found is None:
            if topic.rule is Rule.SNAPSHOT or topic.name in NOT_TOLD:
                every: Sequence[Publication] = ()
            elif topic.name.startswith("/sensors/"):
                every = sensor(topic, self._kinds.setdefault(topic.type, topic) is topic)
            else:
                every = (of_the_table(topic),)
            found = self._publications[topic] = tuple(each for each in every if each.topic.message not in self._lacking)
            self._publication |= {each.topic: each for each in found}
        return found

    def _take(self, topic: Topic[Any], value: Any, time: float) -> None:
        for publication in self._publications_of(topic):
            self._events.append((0, time, publication.topic, value))

    def _tell(self, publication: Publication, value: Any, time: float) -> None:
        if publication.topic.message not in self._lacking:
            self._publication[publication.topic] = publication
            self._events.append((0, time, publication.topic, value))

    def _take_cycle(self, topics: tuple[Topic[Any], ...], values: list[Any], now: float) -> None:
        told = dict(zip(topics, values, strict=True))
        for topic, value in told.items():
            if value is not None:
                self._take(topic, value, now)
        odometry = told[ODOMETRY]
        estimate, pose = told.get(FILTERED), told.get(POSE)
        if estimate is not None:
            self._tell(self._map, origin(estimate[:3], odometry), now)
        elif pose is not None:
            self._tell(self._room, origin(pose, odometry), now)
        outputs = told[SETPOINT].outputs
        geometry = self._config.geometry
        rate = odometry.v * 6.283185307179586 / geometry.circumference
        self._wheel_angle += rate * max(0.0, now - self._read_at)
        self._read_at = now
        front, rear = turned(outputs.front, outputs.rear, geometry)
        joints = Joints((self._wheel_angle,) * 4 + (front, front, rear, rear), (rate,) * 4 + (0.0,) * 4)
        self._tell(self._joints, joints, now)

    # -- requests ----------------------------------------------------------------------------------------------

    def request(self, request: Request) -> None:
        """Do what is asked for."""
        self._desk.request(request)

    def say(self, text: str) -> None:
        """Add a line about the node to the event log."""
        self._desk.say(text)

    def lost(self) -> None:
        """The node has gone: let go of the wheel, and collect nothing."""
        self._leave()
        self._calls.clear()
        self._events.clear()
        self._desk.let_go()

    def _begin(self) -> None:
        """A node has started, which knows nothing."""
        self._leave()
        self._events.clear()
        self._lacking.clear()
        self._forget()
        self._map, self._room = (Publication("tf", "default", parent(frame)) for frame in ("map", "room"))
        self._joints = Publication("joint_states", "default", JOINT_STATES)
        now, config = self._robot.now, self._config
        for polled in self._robot.sensors.values():
            self._kinds.setdefault(polled.sensor.topic.type, polled.sensor.topic)
        links = links_of(self._kinds)
        self._tell(Publication("tf_static", "latched", fixed(links)), None, now)
        description = robot_description(self._robot.runtime.name, config.geometry, links)
        self._tell(Publication("robot_description", "latched", DESCRIPTION), description, now)
        self._leave = self._robot.runtime.bus.subscribe(self._take, cycle=self._take_cycle)

    def _missing(self, message: str, name: str) -> None:
        """The node has no type for a message."""
        first = message not in self._lacking
        self._lacking.setdefault(message, []).append(name)
        self._publications.clear()
        if first:
            self.say(f": ROS has no type {message} here, so {name} is not told; 'txt1 ros2 install' makes it")

    def _drive(self, v: float, omega: float, age: float = 0.0) -> None:
        if self._goal is not None and (v or omega):
            self._goal.cancel()  # whoever steers by hand has the wheel
        limited = clip(v, self._v_max) if v == v else v
        self._desk.drive(limited, omega * limited / v if v and limited != v else omega, age)

    async def _drive_to(self, frame: str, x: float, y: float, theta: float, speed: float) -> str:
        """Drive to a pose (m, rad) in odom, room or map; how it ended, as JSON. One goal at a time: the newest."""
        robot, config = self._robot, self._config
        sources = {"odom": wheel_pose, "room": true_pose, "map": fused_pose}
        if frame not in sources:
            raise ConfigError(f"frame_id '{frame}': give odom, room (where the true pose is known) or map (estimation)")
        room = Room(config.sim.room.length, config.sim.room.width) if frame == "room" else None
        if self._goal is not None:
            self._goal.cancel()
        source = sources[frame](robot)
        self._goal, self._aim = goal, _ = asyncio.current_task(), (source, x, y)
        try:
            arrival = await go_to(
                robot, (x, y, theta), pose_source=source, room=room, source=self._desk.source,
                speed=min(speed or SPEED, self._v_max),
            )  # fmt: skip
        finally:
            if self._goal is goal:
                self._goal = self._aim = None
            self._desk.let_go()
        told = f"{arrival.distance:.3f} m and {arrival.turn:.3f} rad from the goal, {arrival.plans} paths planned"
        return json.dumps({"arrived": arrival.arrived, "reached": arrival.pose, "told": told})

    def _feedback(self) -> tuple[float, ...] | None:
        """The distance (m) from the goal and the pose (m, rad), five times a second while there is one."""
        now = self._robot.now
        if self._aim is None or now < self._feedback_due:
            return None
        self._feedback_due = now + FEEDBACK
        source, x, y = self._aim
        pose = source.read()
        return None if pose is None else (hypot(x - pose[0], y - pose[1]), *pose)

    async def _load_gains(self) -> None:
        if not await self._robot.load_gains(*self._gains()):
            raise ConfigError("the board did not accept the gains, or did not answer")

    # -- parameters --------------------------------------------------------------------------------------------

    def parameters(self) -> dict[str, tuple[Any, bool]]:
        """The parameters by their names: values, and whether they may be set."""
        loops, config = self._config.loops(), self._config
        linear = {f"control.linear.{name}": (value, True) for name, value in loops.linear.gains()._asdict().items()}
        angular = [number for s in loops.angular for number in (s.v_max, s.kp, s.ki, s.kd)]
        limits = {f"safety.{name}": value for name, value in asdict(config.safety).items()}
        return {
            **linear, "control.angular": (angular, True), "v_max": (self._v_max, True),
            **{name: (float(value), False) for name, value in limits.items() if isinstance(value, int | float)},
        }  # fmt: skip

    async def _set(self, values: Mapping[str, Any]) -> None:
        """Set parameters, all or none; raises ConfigError."""
        changed = dict(values)
        v_max = changed.pop("v_max", self._v_max)
        highest = self._robot.config.safety.v_max
        if not 0.0 < v_max <= highest:
            raise ConfigError(f"v_max: {v_max!r}: more than 0, and at most safety.v_max, {highest:g} m/s")
        if changed:
            where = "control" if self._config.loops() is self._config.control else "serial.host"
            if (flat := changed.pop("control.angular", None)) is not None:
                if len(flat) % 4:
                    raise ConfigError(f"control.angular: {len(flat)} numbers; give v_max, kp, ki, kd of each set")
                names = ("v_max", "kp", "ki", "kd")
                sets = [dict(zip(names, flat[k : k + 4], strict=True)) for k in range(0, len(flat), 4)]
                changed["control.angular"] = sets
            keys = {key.replace("control", where, 1): value for key, value in changed.items()}
            before, self._config = self._config, with_values(self._config, keys)
            try:
                await self._load_gains()
            except Txt1Error:
                self._config = before
                raise
        self._v_max = v_max

    def _gains(self) -> tuple[Any, Any]:
        loops = self._config.loops()
        return loops.linear.gains(), loops.schedule().sets
