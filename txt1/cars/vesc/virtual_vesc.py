"""A virtual VESC, with a simulated car behind it, and a servo that steers on its servo output.

It behaves as the firmware does. It drops damaged frames and sends values on request. Below its least speed the motor
rolls. Without a command for the length of the time-out, the motor rolls and the servo keeps its angle. A request for
values or a servo command does not restart the time-out.
"""

from math import degrees, inf
from struct import Struct, pack, unpack_from
from typing import Final

from txt1.board.line_faults import far_end
from txt1.cars.vesc.driver import SCALES, TACHOMETER_STEPS, PacketId, Unpacker, VescOptions, packet
from txt1.config import Config, checked
from txt1.hal.simulated_controller import Controller, ControllerPort
from txt1.link.base import Link
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import PWM_MAX
from txt1.units import GRAVITY

# s; the firmware's default
VESC_TIMEOUT: Final = 1.0
# electrical turns a minute below which the speed loop lets the motor roll; the firmware's default
ERPM_MIN: Final = 900.0
# s, shortest time in which the simulated IMU measures a turn
TURN_TIME_MIN: Final = 1e-3
# length of its settings in bytes, about
APPCONF: Final = 470
# signature of the settings' layout; every firmware has another
SIGNATURE: Final = 0x0B5C8F1D
_VALUES: Final = Struct(">BhhiiiihihiiiiiiBiBhhhii")


class Vesc(Controller):
    """The controller's end of the line. `firmware` is (major, minor).

    `fault` is a code and may be set, and so may `killed`, its kill switch; `imu`: whether it has one, else it tells 0.
    """

    def __init__(self, config: Config, firmware: tuple[int, int] = (6, 5), timeout: float = VESC_TIMEOUT) -> None:
        options = checked(VescOptions, config.hal_options if config.hal == "vesc" else {}, "hal_options")
        super().__init__(config)
        self.line = far_end(self, config)
        self.firmware, self.timeout, self.fault, self.killed = firmware, timeout, 0, False
        self.imu = True
        # time, s, and heading, rad, of the last answer of the IMU
        self._turned = 0.0, 0.0
        self._options = options
        sign = -1.0 if options.backwards else 1.0
        turns = options.pole_pairs * options.gear / config.geometry.circumference
        self._erpm_per_speed, self._steps_per_m = 60.0 * sign * turns, TACHOMETER_STEPS * sign * turns
        self._unpacker = Unpacker()
        self._command, self._value = PacketId.SET_CURRENT, 0.0
        self._servo = options.servo_centre
        # loop time of the last command
        self._heard = -inf
        self._distance = self._last = self._duty = 0.0

    @property
    def drives(self) -> bool:
        """Whether the motor is under power."""
        return self._value != 0.0 and self._command is not PacketId.SET_CURRENT_BRAKE and not self.timed_out

    @property
    def timed_out(self) -> bool:
        """Whether it has stopped because no command came for its time-out."""
        return bool(self.timeout) and self.now - self._heard > self.timeout

    def step(self, now: float) -> None:
        """Hold the commanded speed, duty or current and the servo's position, until the time-out."""
        self.car.move(now)
        path = 0.5 * sum(self.car.paths)
        self._distance += abs(path - self._last)
        self._last = path
        value = 0.0 if self.timed_out or self.fault or self.killed else self._value
        motor = 0.0
        sign = 1.0 if self._erpm_per_speed > 0.0 else -1.0
        match self._command:
            case PacketId.SET_RPM:
                wanted = None if abs(value) < ERPM_MIN else value / self._erpm_per_speed
                motor = self.car.counts(now, wanted)[0]
            case PacketId.SET_DUTY:
                motor = sign * min(max(value, -1.0), 1.0) * PWM_MAX
            case PacketId.SET_CURRENT:
                # the simulated vehicle has no torque: 60 A are full throttle
                motor = sign * min(max(value / 60.0, -1.0), 1.0) * PWM_MAX
        self._duty = sign * motor / PWM_MAX
        share = (self._servo - self._options.servo_centre) / self._options.servo_range
        self.car.steer(now, motor, min(max(share, -1.0), 1.0))

    # -- the link's end --------------------------------------------------------------------------------------------

    def connected(self, link: Link) -> None:
        """Take the link."""
        self._unpacker = Unpacker()
        super().connected(link)

    def received(self, data: bytes) -> None:
        """Carry out the host's commands."""
        for payload in self._unpacker.feed(data):
            self._obey(payload)

    def _obey(self, payload: bytes) -> None:
        command, body = payload[0], payload[1:]
        if command == PacketId.SET_SERVO_POS:
            if len(body) >= 2:
                self._servo = min(max(unpack_from(">h", body)[0] / SCALES[PacketId(command)], 0.0), 1.0)
        elif command in SCALES and len(body) >= 4:
            self._heard = self.now
            self._command = PacketId(command)
            self._value = unpack_from(">i", body)[0] / SCALES[self._command]
        elif command == PacketId.ALIVE:
            self._heard = self.now
        elif command == PacketId.GET_VALUES:
            self.send(packet(self._values()))
        elif command == PacketId.GET_IMU_DATA and len(body) >= 2:
            self.send(packet(self._imu(int.from_bytes(body[:2]))))
        elif command == PacketId.FW_VERSION:
            self.send(packet(bytes((command, *self.firmware)) + b"410\0" + bytes(12) + bytes(3)))
        elif command == PacketId.GET_APPCONF:
            settings = pack(">IBI", SIGNATURE, 0, round(1000.0 * self.timeout))
            self.send(packet(bytes((command,)) + settings.ljust(APPCONF, b"\0")))

    def _imu(self, asked: int) -> bytes:
        """Return the values that are asked for; those that are not simulated are 0."""
        now, theta = self.now, self.car.vehicle.motion[2]
        before, old = self._turned
        rate = wrap_angle(theta - old) / max(now - before, TURN_TIME_MIN)
        self._turned = now, theta
        across = self.car.vehicle.motion[3] * rate / GRAVITY
        felt = {4: across, 5: 1.0, 8: degrees(rate)} if self.imu else {}
        there = [each for each in range(16) if asked >> each & 1]
        return pack(f">BH{len(there)}f", PacketId.GET_IMU_DATA, asked, *(felt.get(each, 0.0) for each in there))

    def _values(self) -> bytes:
        self.step(self.now)
        erpm = self.car.vehicle.motion[3] * self._erpm_per_speed
        values = _VALUES.pack(
            PacketId.GET_VALUES,
            250,
            250,
            0,
            0,
            0,
            0,
            round(1000.0 * self._duty),
            round(erpm),
            round(10.0 * self.car.voltage),
            0,
            0,
            0,
            0,
            int(self._last * self._steps_per_m),
            int(self._distance * abs(self._steps_per_m)),
            self.fault,
            0,
            0,
            250,
            250,
            250,
            0,
            0,
        )
        return values + (bytes((self.timed_out | self.killed << 1,)) if self.firmware >= (6, 0) else b"")


def port(config: Config) -> ControllerPort[Vesc]:
    """Return a port with a VESC behind it: `serial.port: vesc`."""
    return ControllerPort("vesc", lambda: Vesc(config))
