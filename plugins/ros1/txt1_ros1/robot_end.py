"""The robot's end of the original's node (thesis 3.4.3): sends odometry 20 times a second, batteries once, and answers.

Sensors' readings are sent with them, as trees (`txt1_ros1.tree`), and the event log for /rosout.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from contextlib import suppress
from math import inf
from typing import Any, Final

from txt1 import Robot, Switch
from txt1.bridges.registry import RobotEnd
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet
from txt1.errors import CommandRefused, NotArmed
from txt1.kernel.clock import NS_PER_S, seconds, wall_ns
from txt1.kernel.loop import VirtualTimeLoop
from txt1.record.settings import RecordConfig
from txt1.ros.calls import Calls
from txt1.tasks.fields import LOG, Event
from txt1.telemetry.topics import Topic
from txt1_ros1.tree import SensorFeed

# s between two odometry messages
ODOMETRY: Final = 0.05
# s between two battery messages
BATTERY: Final = 1.0
# numbers in a set of angular gains: v_max, kp, ki, kd
SETS: Final = 4
# numbers in all sets
NUMBERS_MAX: Final = 56


# s of silence or zeros, and of standing, before the robot arms by itself
CALM: Final = 1.0
# events that wait for the node; the oldest are dropped
EVENTS_MAX: Final = 100


class FirstArming:
    """Arms the robot once, as the original's node needed no arming.

    Before that, nobody has commanded anything but zero for `CALM` s, and the robot was seen to stand for as long. After
    a stop, or after board or node were away, it is left to a person.
    """

    def __init__(self, robot: Robot, place: str = "/", over: bool = False) -> None:
        self._robot, self._place = robot, place
        self.over = over
        """Whether it arms the robot no more, if it ever did."""
        self._linked = False
        self._calm_since = inf

    def disturb(self) -> None:
        """Wait for `CALM` s from now on: a command came that is not zero."""
        self._calm_since = inf

    def end(self, why: str) -> None:
        """Arm it no more; `why` is told if the robot was not armed."""
        if not self.over and not self._robot.armed:
            self._robot.tell(f"the robot does not arm by itself any more: {why}; call {self._place}arm")
        self.over = True

    def tick(self, now: float) -> None:
        """Arm it if it is time."""
        robot = self._robot
        if self.over:
            return
        linked = robot.runtime.linked
        if robot.armed or robot.touched:
            self.end("somebody has stopped or disarmed it")
        elif self._linked and not linked:
            self.end("the board was away")
        elif not linked or not robot.runtime.stands(now):
            self._calm_since = inf
        else:
            self._calm_since = min(self._calm_since, now)
            if now - self._calm_since >= CALM:
                # or a second later
                self._calm_since = inf
                with suppress(NotArmed):
                    robot.arm()
                    self.over = True
                    robot.tell(f"armed by itself: programs of ROS may move it from now on; {self._place}stop stops it")
        self._linked = linked


class Ros1Desk(RobotEnd):
    """Sends odometry and batteries, and carries out requests under the name "ros1"."""

    def __init__(self, robot: Robot, auto_arm: bool = False, namespace: str = "") -> None:
        self._place = f"/{namespace}/" if namespace else "/"
        self._arming = FirstArming(robot, self._place, over=not auto_arm)
        self._calls = Calls(
            {
                "pid_load": self._pid_load,
                "pwm_change": self._pwm_change,
                "switched_pwr": self._switched_pwr,
                "shutdown_computer": robot.shutdown_host,
                "arm": robot.arm,
                "disarm": lambda: robot.disarm("disarmed by ROS"),
                "stop": robot.stop,
                "manual": robot.set_manual,
            }
        )
        super().__init__(
            robot,
            "ros1",
            {
                "call": self._calls.call,
                "drive": self._drive,
                "combined": robot.combined_odometry,
                "servos": robot.servos,
                "begin": self._begin,
            },
        )
        self._readings = SensorFeed(robot.runtime)
        # whether the node serves now, and whether it ever did
        self._serving = self._served = False
        # from the start on: a command may be ignored before the node serves
        self._log: deque[Any] = deque(maxlen=EVENTS_MAX)
        robot.runtime.bus.subscribe(self._note, [LOG])
        self._virtual = isinstance(asyncio.get_running_loop(), VirtualTimeLoop)
        self._odometry_due = self._battery_due = 0.0

    def parameters(self) -> dict[str, Any]:
        """The node's private parameters, if the parameter server has no others."""
        config = self.robot.config
        loops = config.loops()
        return {
            "port": config.serial.port or "",
            "linear_pid": list(loops.linear.gains()),
            "angular_pid": [number for s in loops.angular for number in (s.v_max, s.kp, s.ki, s.kd)],
            "pwr_auto": False,
            "batt1": True,
            "batt2": False,
        }

    def telemetry(self) -> bytes | None:
        """Return a line with the values that are due, and answers; None if there are none."""
        robot, now = self.robot, self.robot.now
        told: dict[str, object] = {}
        if self._serving:
            self._arming.tick(now)
        epoch = seconds(wall_ns()) - now
        if self._virtual:
            epoch = robot.config.section(RecordConfig).epoch or 0.0
        if self._serving and (places := self._readings.places()):
            told["frames"] = places
        if readings := self._readings.take(epoch):
            told["readings"] = readings
        if now >= self._odometry_due:
            self._odometry_due = max(self._odometry_due + ODOMETRY, now)
            told["odom"] = tuple(robot.odometry)
        battery = robot.battery
        if now >= self._battery_due and battery.battery1 is not None:
            self._battery_due = max(self._battery_due + BATTERY, now)
            told["battery"] = battery.battery1, battery.battery2 or 0.0
        if self._calls.answers:
            told["answers"] = self._calls.take()
        if self._log:
            told["log"] = list(self._log)
            self._log.clear()
        if not told:
            return None
        told["now"] = round((epoch + now) * NS_PER_S)
        return f"{json.dumps(told)}\n".encode("ascii")

    def lost(self) -> None:
        """Note that the node has gone, and release the wheel."""
        self._calls.clear()
        self._readings.end()
        self._serving = False
        self.let_go()

    def _begin(self) -> None:
        self._readings.begin()
        self._odometry_due = self._battery_due = 0.0
        if self._served:
            self._arming.end("its node was away")
        self._serving = self._served = True

    def _note(self, topic: Topic[Any], event: Event, time: float) -> None:
        self._log.append(topic.make(event))

    def _drive(self, v: float, omega: float) -> None:
        if v or omega:
            self._arming.disturb()
        self.drive(v, omega)

    def how_to_arm(self) -> str:
        """Return the call of the node's service."""
        patience = "" if self._arming.over else f"send zeros, or nothing, for {CALM:g} s, or "
        return f"{patience}call its service: rosservice call {self._place}arm"

    async def _pid_load(self, linear: list[float], angular: list[float]) -> None:
        if len(linear) != 3 or len(angular) % SETS or len(angular) > NUMBERS_MAX:
            raise CommandRefused(f"linear_pid takes 3 numbers, angular_pid 4 of each set and at most {NUMBERS_MAX}")
        sets = [GainSet(angular[k], Gains(*angular[k + 1 : k + SETS])) for k in range(0, len(angular), SETS)]
        if not await self.robot.load_gains(Gains(*linear), sets):
            raise CommandRefused("the board did not accept the gains, or did not answer")

    def _pwm_change(self, esc: int, front: int, rear: int, pwm4: int, pwm5: int) -> None:
        self.robot.pwm_test(esc, front, rear, pwm4, pwm5)

    def _switched_pwr(self, source: int, on: bool) -> None:
        self.robot.switch_power(Switch(source), on)
