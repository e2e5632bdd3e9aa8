"""A Waveshare rover's virtual board, with a simulated rover behind it.

It behaves like the firmware of the UGV rovers. It drops lines that are not JSON. Its own loops hold the speeds of the
sides. It sends paths in whole centimetres and voltages in hundredths of a volt. When its heartbeat time passes without
a set-point, it stops both sides.
"""

import json
from math import inf, pi
from typing import Any, Final

from txt1.board.line_faults import far_end
from txt1.cars.waveshare.driver import (
    ECHO,
    FEEDBACK,
    HEARTBEAT,
    INTERVAL,
    LINE_MAX,
    PWM,
    PWM_FULL,
    REPORT,
    SPEED,
    WaveshareOptions,
    number,
)
from txt1.config import Config, checked
from txt1.hal.simulated_controller import Controller, ControllerPort
from txt1.model.vehicle import PWM_MAX

# ms of its heartbeat at power-up
HEARTBEAT_MS: Final = 3000.0
GYRO: Final = 16.4 * 180.0 / pi  # counts for 1 rad/s
# counts, bias of the simulated gyroscope
BIAS: Final = 12.0
# request for a report
ASK: Final = 130
ROS: Final = 13  # X in m/s and Z in rad/s


class Waveshare(Controller):
    """The board's end of the line."""

    def __init__(self, config: Config) -> None:
        options = checked(WaveshareOptions, config.hal_options if config.hal == "waveshare" else {}, "hal_options")
        super().__init__(config)
        self.line = far_end(self, config)
        self.heartbeat = HEARTBEAT_MS
        """Time without a set-point after which it stops, ms."""
        self._track, self._encoders = config.geometry.track_width, options.closed
        self._rest = b""
        # right and left: m/s, or PWM
        self._sides = 0.0, 0.0
        self._by_pwm = False
        # s since power-up
        self._heard = -inf
        self._reports, self._interval, self._echoes = False, 0.0, False
        self._reported = -inf

    @property
    def drives(self) -> bool:
        """Whether a motor is under power."""
        return self._sides != (0.0, 0.0)

    def step(self, now: float) -> None:
        """Hold the sides' commands, until the heartbeat is over, and report."""
        self.car.move(now)
        if now - self._heard > self.heartbeat / 1000.0:
            self._sides, self._by_pwm = (0.0, 0.0), False
        right, left = self._sides
        if self._by_pwm:
            self.car.skid(now, *(PWM_MAX * side / PWM_FULL for side in (right, left)))
        else:
            self.car.skid(now, *self.car.counts(now, right, left))
        if self._reports and now - self._reported >= self._interval / 1000.0 - 1e-9:
            self._reported = now
            self._report()

    def _report(self) -> None:
        right, left = self.car.speeds
        path_right, path_left = self.car.paths
        told: dict[str, Any] = {"T": REPORT}
        if self._encoders:
            told |= {"L": round(left, 4), "R": round(right, 4)}
        yaw = (right - left) / self._track
        told |= {
            "ax": 0,
            "ay": 0,
            "az": 8192,
            "gx": 0,
            "gy": 0,
            "gz": round(GYRO * yaw + BIAS),
            "mx": 0,
            "my": 0,
            "mz": 0,
        }
        if self._encoders:
            told |= {"odl": int(100.0 * path_left), "odr": int(100.0 * path_right)}
        self._say(told | {"v": round(100.0 * self.car.voltage)})

    # -- the link's end --------------------------------------------------------------------------------------------

    def received(self, data: bytes) -> None:
        """Carry out the host's lines."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-LINE_MAX:]
        for text in lines:
            try:
                told = json.loads(text)
            except (ValueError, RecursionError):
                continue
            if self._echoes:
                self.send(text + b"\n")
            if isinstance(told, dict):
                self._obey(told)

    def _obey(self, told: dict[str, Any]) -> None:
        left, right = number(told.get("L")), number(told.get("R"))
        x, z, value = number(told.get("X")), number(told.get("Z")), number(told.get("cmd"))
        command = told.get("T")
        if command in (SPEED, PWM) and left is not None and right is not None:
            self._set(right, left, by_pwm=command == PWM)
        elif command == ROS and x is not None and z is not None:
            self._set(x + 0.5 * self._track * z, x - 0.5 * self._track * z, by_pwm=False)
        elif command == ASK:
            self._report()
        elif value is None:
            return
        elif command == FEEDBACK:
            self._reports = bool(value)
        elif command == HEARTBEAT:
            self.heartbeat = value
        elif command == INTERVAL:
            self._interval = abs(value)
        elif command == ECHO:
            self._echoes = bool(value)

    def _set(self, right: float, left: float, by_pwm: bool) -> None:
        self._heard, self._sides, self._by_pwm = self.now, (right, left), by_pwm

    def _say(self, told: dict[str, Any]) -> None:
        self.send(json.dumps(told, separators=(",", ":")).encode() + b"\r\n")


def port(config: Config) -> ControllerPort[Waveshare]:
    """Return a port with such a board behind it: `serial.port: waveshare`."""
    return ControllerPort("waveshare", lambda: Waveshare(config))
