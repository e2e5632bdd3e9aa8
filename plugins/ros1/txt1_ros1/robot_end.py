"""The robot's end of the original's node (thesis 3.4.3): sends odometry 20 times a second, batteries once, and answers.

Sensors' readings are sent with them, as trees (`txt1_ros1.tree`).
"""

from __future__ import annotations

import asyncio
import json
from typing import Any, Final

from txt1 import Robot, Switch
from txt1.bridges.registry import RobotEnd
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet
from txt1.errors import CommandRefused
from txt1.kernel.clock import NS_PER_S, seconds, wall_ns
from txt1.kernel.loop import VirtualTimeLoop
from txt1.record.settings import RecordConfig
from txt1.ros.calls import Calls
from txt1_ros1.tree import SensorFeed

# s between two odometry messages
ODOMETRY: Final = 0.05
# s between two battery messages
BATTERY: Final = 1.0
# numbers in a set of angular gains: v_max, kp, ki, kd
SETS: Final = 4
# numbers in all sets
NUMBERS_MAX: Final = 56


class Ros1Desk(RobotEnd):
    """Sends odometry and batteries, and carries out requests under the name "ros1"."""

    def __init__(self, robot: Robot) -> None:
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
                "combined": robot.combined_odometry,
                "servos": robot.servos,
                "begin": self._begin,
            },
        )
        self._readings = SensorFeed(robot.runtime)
        # places of the sensors, for a node that has started
        self._frames: list[dict[str, Any]] = []
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
        epoch = seconds(wall_ns()) - now
        if self._virtual:
            epoch = robot.config.section(RecordConfig).epoch or 0.0
        if self._frames:
            told["frames"], self._frames = self._frames, []
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
        if not told:
            return None
        told["now"] = round((epoch + now) * NS_PER_S)
        return f"{json.dumps(told)}\n".encode("ascii")

    def lost(self) -> None:
        """Note that the node has gone, and release the wheel."""
        self._calls.clear()
        self._readings.end()
        self.let_go()

    def _begin(self) -> None:
        self._frames = self._readings.begin()
        self._odometry_due = self._battery_due = 0.0

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
