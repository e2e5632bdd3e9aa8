"""A robot of txt1, whose event loop runs in a thread beside LeRobot's own loop.

Every action is a command of txt1's source ``lerobot``, and passes the safety gate as all others do: it is limited,
and the robot is neutral 0.25 s after the last one, or when LeRobot ends, stands still or fails.
"""

from __future__ import annotations

import asyncio
import io
import threading
from typing import Any, Final

import numpy as np
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from PIL import Image

import txt1
from lerobot_robot_txt1.config_txt1 import Txt1Config
from txt1.commands import say
from txt1.errors import HalError, NotArmed

STATE: Final = {"x.pos": "x", "y.pos": "y", "theta.pos": "theta", "x.vel": "v", "theta.vel": "omega"}
"""Features of the odometry, in m, rad and s, and what they are called in txt1.

LeRobot gives a policy those that end in .pos and .vel. `txt1 log export --lerobot` names them so, too.
"""
ACTION: Final = ("x.vel", "theta.vel")
"""The velocities asked for."""
SOURCE: Final = "lerobot"
PATIENCE: Final = 20.0  # s to open the robot, and for its first picture


class Txt1(Robot):
    """See `Txt1Config`."""

    config_class = Txt1Config
    name = "txt1"

    def __init__(self, config: Txt1Config) -> None:
        super().__init__(config)
        self.config = config
        self._thread: threading.Thread | None = None
        self._opened = threading.Event()
        self._error: BaseException | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._robot: Any = None
        # number of actions, and whether one of them was not 0
        self._actions, self._moved = 0, False

    @property
    def observation_features(self) -> dict[str, Any]:
        """Odometry, and the picture where there is a camera."""
        features: dict[str, Any] = dict.fromkeys(STATE, float)
        if self.config.camera:
            features[self.config.camera] = (self.config.height, self.config.width, 3)
        return features

    @property
    def action_features(self) -> dict[str, Any]:
        """The two velocities."""
        return dict.fromkeys(ACTION, float)

    @property
    def cameras(self) -> dict[str, Any]:
        """By name; LeRobot counts them, to choose how many threads write pictures."""
        return {self.config.camera: self.config} if self.config.camera else {}

    @property
    def is_connected(self) -> bool:
        """Whether txt1's loop runs."""
        return self._robot is not None

    @property
    def is_calibrated(self) -> bool:
        """Yes: txt1 has its own calibration."""
        return True

    def calibrate(self) -> None:
        """Nothing: `txt1 calibrate` does it."""

    def configure(self) -> None:
        """Nothing: the settings were given."""

    def connect(self, calibrate: bool = True) -> None:
        """Open the robot and wait until it is armed; raises what txt1 raises."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected already")
        self._opened.clear()
        self._error = None
        self._thread = threading.Thread(target=self._run, name="txt1", daemon=True)
        self._thread.start()
        self._opened.wait()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        """Run txt1's loop until the robot is disconnected."""
        try:
            # by txt1's own loop, in which a simulation waits for a busy computer
            txt1.run(self._serve())
        except BaseException as error:
            self._error = error
        finally:
            self._robot = self._loop = None
            self._opened.set()

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        given = [*self.config.settings]
        if self.config.camera and self.config.hal == "sim":
            given.append(f"sensors.{self.config.camera}.driver=sim_camera")
        arm = self.config.arm or None
        async with txt1.Robot.open(self.config.hal, settings=given, seed=self.config.seed, arm=arm) as robot:
            if not robot.armed:
                raise NotArmed("the robot is not armed, and nothing moves it: --robot.arm=true arms it")
            if not await robot.load_gains():
                raise HalError("the board did not accept the gains, or did not answer")
            self._source = robot.source(SOURCE)
            if self.config.camera:
                async with asyncio.timeout(PATIENCE):
                    while robot.sensor(self.config.camera) is None:
                        await asyncio.sleep(0.05)
            self._robot = robot
            self._opened.set()
            await self._end.wait()

    def _connected(self) -> Any:
        if self._error is not None:
            raise self._error
        if self._robot is None:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")
        return self._robot

    def get_observation(self) -> dict[str, Any]:
        """The odometry of the last cycle, and the newest picture."""
        robot = self._connected()
        odometry = robot.odometry
        told: dict[str, Any] = {name: float(getattr(odometry, field)) for name, field in STATE.items()}
        if self.config.camera:
            picture = Image.open(io.BytesIO(robot.sensor(self.config.camera).value.data)).convert("RGB")
            told[self.config.camera] = np.asarray(picture.resize((self.config.width, self.config.height)))
        return told

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Ask for velocities; returns those that the gate may let through at most.

        Places that LeRobot asks for, as it does to bring an arm back, move nothing: the car stands.
        """
        robot = self._connected()
        v, omega = (float(action.get(each, 0.0)) for each in ACTION)
        limit = robot.config.safety.v_max
        told = max(-limit, min(limit, v)), omega
        self._actions, self._moved = self._actions + 1, self._moved or any(told)
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._command, *told)
        return dict(zip(ACTION, told, strict=True))

    def _command(self, v: float, omega: float) -> None:
        try:
            self._source.command(v, omega)
        except txt1.Txt1Error as error:  # what is no number moves nothing, and is told
            self._robot.tell(f"lerobot: {error}")

    def disconnect(self) -> None:
        """Stop the robot safely, and close it."""
        if not self.is_connected or self._loop is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        if self._actions and not self._moved:
            say(
                f"all {self._actions} actions were 0, so what was recorded is a robot that stands; "
                "see that the teleoperator drives"
            )
        self._actions, self._moved = 0, False
        self._loop.call_soon_threadsafe(self._end.set)
        assert self._thread is not None
        self._thread.join()
        if self._error is not None:
            raise self._error
