"""The robot's end of its node of ROS 2: sends telemetry, and carries out requests."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from dataclasses import asdict
from math import hypot
from typing import Any, Final

from txt1.bridges.registry import RobotEnd
from txt1.config.sources import with_values
from txt1.control.limits import clip
from txt1.driver import finite
from txt1.errors import ConfigError, Txt1Error
from txt1.navigation import PoseSource, fused_pose, go_to, map_floor, map_pose, true_pose, wheel_pose
from txt1.protocol.messages import Switch
from txt1.robot import Robot
from txt1.ros.calls import Calls
from txt1.ros.publisher import PLAIN, Publisher, Told
from txt1.tasks.on_map import MapInUse

# s between two reports on the way to a goal
FEEDBACK_PERIOD: Final = 0.2
# m/s for a goal without a speed
GOAL_SPEED: Final = 0.4
_SWITCHES: Final = {"atx": Switch.ATX, "esc": Switch.ESC}


class Ros2RobotEnd(RobotEnd):
    """Sends messages, and carries out requests under the name "ros"."""

    offers = (
        "drive",
        "drive_to",
        "arm",
        "disarm",
        "stop",
        "load_gains",
        "manual",
        "power_atx",
        "power_esc",
        "place",
    )
    """Subscriptions and services of the node."""

    def __init__(self, robot: Robot, told: Told = PLAIN) -> None:
        self._config = config = robot.config
        self._feed, self._prefix = Publisher(robot.runtime, self.say, told), told.prefix
        self._place = f"/{told.owner}/" if told.owner else "/"
        self._calls = Calls(
            {
                "arm": robot.arm,
                "disarm": lambda: robot.disarm("disarmed by ROS"),
                "stop": robot.stop,
                "load_gains": self._load_gains,
                "drive_to": self._drive_to,
                "goal_pose": self._goal_pose,
                "initial_pose": self._initial_pose,
                "manual": robot.set_manual,
                "place": robot.place,
                "set": self._set,
                "power": lambda switch, on: robot.switch_power(_SWITCHES[switch], on),
            }
        )
        super().__init__(
            robot,
            "ros",
            {
                "begin": self._feed.begin,
                "missing": self._feed.missing,
                "parent": self._feed.parent,
                "call": self._calls.call,
                "cancel": self._calls.cancel,
                "drive": self._drive,
                "steer": self._steer,
                "combined": robot.combined_odometry,
                "servos": robot.servos,
            },
        )
        self.stale = config.commander.timeouts.get("ros", config.safety.command_timeout)
        """Age at which a command is stale, s."""
        self._v_max = config.safety.v_max
        self._goal: asyncio.Task[Any] | None = None
        self._aim: tuple[PoseSource, float, float] | None = None
        self._feedback_due = 0.0

    def telemetry(self) -> bytes | None:
        """Return all messages since the last call, and answers; None if there are none."""
        return self._feed.line({"answers": self._calls.take(), "feedback": self._feedback()})

    # -- requests ----------------------------------------------------------------------------------------------

    def how_to_arm(self) -> str:
        """Return the call of the node's service."""
        return f"call its service: ros2 service call {self._place}arm std_srvs/srv/Trigger"

    def lost(self) -> None:
        """Note that the node has gone: release the wheel, and collect nothing."""
        self._feed.end()
        self._calls.clear()
        self.let_go()

    def _drive(self, v: float, omega: float, age: float = 0.0) -> None:
        if self._goal is not None and (v or omega):
            # a person who steers has the wheel
            self._goal.cancel()
        limited = clip(v, self._v_max) if v == v else v
        self.drive(limited, omega * limited / v if v and limited != v else omega, age)

    def _steer(self, speed: float, angle: float, age: float = 0.0) -> None:
        """Command a speed, m/s, and the angle of the front wheels, rad, left positive: (2.13)."""
        speed, angle = finite("drive", speed=speed, steering_angle=angle)
        geometry = self._config.geometry
        self._drive(speed, speed * geometry.curvature(clip(angle / geometry.steering_max, 1.0)), age)

    async def _drive_to(self, frame: str, x: float, y: float, theta: float, speed: float) -> str:
        """Drive to a pose (m, rad) in odom, room or map; return the result as JSON. A new goal replaces the last."""
        robot, config, frame = self.robot, self._config, frame.removeprefix(self._prefix)
        on_map = robot.runtime.part(MapInUse) is not None
        sources = {"odom": wheel_pose, "room": true_pose, "map": map_pose if on_map else fused_pose}
        if frame not in sources:
            raise ConfigError(
                f"frame_id '{frame}': give odom, room (where the true pose is known) or map (--in, or estimation)"
            )
        room = config.sim.room.built() if frame == "room" else map_floor(robot) if frame == "map" else None
        if self._goal is not None:
            self._goal.cancel()
        source = sources[frame](robot)
        self._goal, self._aim = goal, _ = asyncio.current_task(), (source, x, y)
        try:
            arrival = await go_to(
                robot,
                (x, y, theta),
                pose_source=source,
                room=room,
                source=self.source,
                speed=min(speed or GOAL_SPEED, self._v_max),
            )
        finally:
            if self._goal is goal:
                self._goal = self._aim = None
            self.let_go()
        told = f"{arrival.distance:.3f} m and {arrival.turn:.3f} rad from the goal, {arrival.plans} paths planned"
        return json.dumps({"arrived": arrival.arrived, "reached": arrival.pose, "told": told})

    async def _goal_pose(self, frame: str, x: float, y: float, theta: float) -> None:
        """Drive to a pose as `_drive_to`, for a caller without an answer: the result is an event."""
        try:
            x, y, theta = finite("pose", x=x, y=y, theta=theta)
            told = json.loads(await self._drive_to(frame, x, y, theta, 0.0))["told"]
        except Txt1Error as error:
            told = str(error)
        self.robot.tell(f"/goal_pose: {told}")

    def _initial_pose(self, frame: str, x: float, y: float, theta: float) -> None:
        """Set the robot's pose on its map, m and rad; a refusal is an event."""
        there, frame = self.robot.runtime.part(MapInUse), frame.removeprefix(self._prefix)
        try:
            if there is None:
                raise ConfigError("there is no map: give --in MAP")
            if frame != "map":
                raise ConfigError(f"frame_id '{frame}': give map")
            there.place(*finite("/initialpose", x=x, y=y, theta=theta))
        except Txt1Error as error:
            self.robot.tell(f"/initialpose: {error}")

    def _feedback(self) -> tuple[float, ...] | None:
        """Return the distance (m) from the goal and the pose (m, rad), five times a second during a drive; else
        None.
        """
        now = self.robot.now
        if self._aim is None or now < self._feedback_due:
            return None
        self._feedback_due = now + FEEDBACK_PERIOD
        source, x, y = self._aim
        pose = source.read()
        return None if pose is None else (hypot(x - pose[0], y - pose[1]), *pose)

    async def _load_gains(self) -> None:
        if not await self.robot.load_gains(*self._gains()):
            raise ConfigError("the board did not accept the gains, or did not answer")

    # -- parameters --------------------------------------------------------------------------------------------

    def parameters(self) -> dict[str, tuple[Any, bool]]:
        """Return the parameters by name: values, and whether they may be set."""
        loops, config = self._config.loops(), self._config
        linear = {f"control.linear.{name}": (value, True) for name, value in loops.linear.gains()._asdict().items()}
        angular = [number for s in loops.angular for number in (s.v_max, s.kp, s.ki, s.kd)]
        limits = {f"safety.{name}": value for name, value in asdict(config.safety).items()}
        return {
            **linear,
            "control.angular": (angular, True),
            "v_max": (self._v_max, True),
            **{name: (float(value), False) for name, value in limits.items() if isinstance(value, int | float)},
        }

    async def _set(self, values: Mapping[str, Any]) -> None:
        """Set all parameters or none; raises ConfigError."""
        changed = dict(values)
        v_max = changed.pop("v_max", self._v_max)
        highest = self.robot.config.safety.v_max
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
