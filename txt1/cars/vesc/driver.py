"""VESC motor controllers over USB or UART as a HAL, firmware 5 and 6: speed in electrical turns, a servo that steers.

A packet is 2, the payload's length in one byte (or 3, and in two), the payload, its CRC16 (XMODEM), and 3. A payload is
a command and its numbers, big-endian. The controller closes the speed loop. It stops by itself when no command has come
for the time set in VESC Tool (App Settings, General, Timeout). The driver reads this time and reports it.
"""

from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite
from struct import Struct, pack, unpack_from
from typing import Final, NamedTuple

from txt1.config import Config, checked
from txt1.errors import ConfigError, HalError
from txt1.hal.base import Capabilities, Inputs, Outputs
from txt1.hal.line import Line
from txt1.hal.plain_hal import PlainHal
from txt1.hal.registry import faults_of, is_simulated, port_of
from txt1.link.base import End, Port
from txt1.model.odometry import Odometry, rolled
from txt1.model.vehicle import Geometry
from txt1.units import NotNegative, Positive, PositiveInt, Share

# counts of the tachometer in an electrical turn
TACHOMETER_STEPS: Final = 6
# longest payload, bytes
LENGTH_MAX: Final = 512
# s: a longer time-out of the controller is reported
TIMEOUT_MAX: Final = 1.0
# s after which firmware and settings are requested again, until they are known
ASK_AGAIN: Final = 1.0
# m between two reports that no motion explains
RESTARTED: Final = 2.0


class PacketId(IntEnum):
    """The first byte of a payload."""

    FW_VERSION = 0
    GET_VALUES = 4
    SET_DUTY = 5
    SET_CURRENT = 6
    SET_CURRENT_BRAKE = 7
    SET_RPM = 8
    SET_SERVO_POS = 12
    GET_APPCONF = 17
    ALIVE = 30
    GET_IMU_DATA = 65


FAULTS: Final = {
    1: "over-voltage", 2: "under-voltage", 3: "gate driver", 4: "over-current", 5: "transistors too hot",
    6: "motor too hot", 7: "gate driver over-voltage", 8: "gate driver under-voltage", 9: "processor under-voltage",
    10: "restarted by its watchdog", 11: "encoder", 12: "encoder signal too weak", 13: "encoder signal too strong",
    14: "flash memory", 15: "current sensor 1", 16: "current sensor 2", 17: "current sensor 3",
    18: "unbalanced currents", 19: "brake", 20: "resolver", 21: "resolver", 22: "resolver",
    23: "settings of the app lost", 24: "settings of the motor lost", 25: "encoder without magnet",
    26: "encoder's magnet too strong", 27: "phase filter", 28: "encoder", 29: "output of low voltage",
    30: "encoder slips", 31: "too fast", 32: "too slow", 33: "too fast in either direction",
}  # fmt: skip
"""Fault codes of the firmware, in words."""


def packet(payload: bytes) -> bytes:
    """Frame a payload."""
    size = len(payload)
    head = bytes((2, size)) if size < 256 else pack(">BH", 3, size)
    return head + payload + pack(">HB", crc_hqx(payload, 0), 3)


# What commands ask for, and in how many parts of its unit: electrical turns a minute; a duty cycle from -1 to 1, of
# which 0 brakes with the motor's own current; a motor current in A, of which 0 lets it roll; braking with one; and the
# servo's position from 0 to 1, in two bytes.
SCALES: Final = {
    PacketId.SET_RPM: 1.0,
    PacketId.SET_DUTY: 1e5,
    PacketId.SET_CURRENT: 1e3,
    PacketId.SET_CURRENT_BRAKE: 1e3,
    PacketId.SET_SERVO_POS: 1e3,
}


def order(command: PacketId, value: float) -> bytes:
    """Return the packet that commands a value, for one of SCALES."""
    form = ">Bh" if command is PacketId.SET_SERVO_POS else ">Bi"
    return packet(pack(form, command, round(SCALES[command] * value)))


def ask(command: PacketId) -> bytes:
    """Return the packet that requests a report; ALIVE has no answer."""
    return packet(bytes((command,)))


class Unpacker:
    """Finds the packets in a stream; `faults` counts the stretches of other bytes."""

    def __init__(self) -> None:
        self.faults = 0
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes; return the payloads that they complete."""
        self._buffer += data
        payloads = []
        while (found := self._first()) is not None:
            start, end, payload = found
            self.faults += start > 0
            self._buffer = self._buffer[end:]
            payloads.append(payload)
        keep = next((at for at in range(len(self._buffer)) if self._at(at) is not None), len(self._buffer))
        self.faults += keep > 0
        self._buffer = self._buffer[keep:]
        return payloads

    def _first(self) -> tuple[int, int, bytes] | None:
        """Return begin and end of the first complete packet, and its payload; an unfinished packet before it is
        damaged.
        """
        for start in range(len(self._buffer)):
            payload = self._at(start)
            if payload:
                return start, start + len(packet(payload)), payload
        return None

    def _at(self, start: int) -> bytes | None:
        """Return the payload of the packet at `start`; empty: it is incomplete; None: no packet begins there."""
        buffer, kind = self._buffer, self._buffer[start]
        if kind not in (2, 3):
            return None
        begin = start + kind
        size = int.from_bytes(buffer[start + 1 : begin])
        if len(buffer) < begin:
            return b""
        if not 0 < size <= LENGTH_MAX or (kind == 3 and size < 256):
            return None
        end = begin + size
        if len(buffer) < end + 3:
            return b""
        payload = buffer[begin:end]
        return payload if buffer[end : end + 3] == pack(">HB", crc_hqx(payload, 0), 3) else None


class Values(NamedTuple):
    """The controller's report, from its answer to GET_VALUES."""

    # temperature of its transistors, degrees Celsius
    transistors: float
    # temperature of the motor, degrees Celsius
    motor: float
    motor_current: float  # A
    input_current: float  # A
    # -1 to 1
    duty: float
    # speed, electrical turns a minute
    erpm: int
    # battery's voltage, V
    voltage: float
    # sixths of an electrical turn, forward positive
    tachometer: int
    # the same without sign: it always rises
    distance: int
    # 0: none
    fault: int
    # whether it has stopped for lack of commands; None: older firmware does not report it
    timed_out: bool | None
    # whether its kill switch is on; None likewise
    killed: bool | None = None


_VALUES: Final = Struct(">hhiiiihihiiiiiiB")
# bytes after the command; newer firmware has more, and reports a time-out in the first bit, the kill switch in the
# second
_STATUS_AT: Final = 73


def values_of(payload: bytes) -> Values | None:
    """Return the values in an answer to GET_VALUES; None if it is too short."""
    body = payload[1:]
    if len(body) < _VALUES.size:
        return None
    hot, motor, amps, amps_in, _, _, duty, erpm, volts, *_, tachometer, distance, fault = _VALUES.unpack_from(body)
    status = body[_STATUS_AT - 1] if len(body) >= _STATUS_AT else None
    return Values(
        hot / 10.0,
        motor / 10.0,
        amps / 100.0,
        amps_in / 100.0,
        duty / 1000.0,
        erpm,
        volts / 10.0,
        tachometer,
        distance,
        fault,
        None if status is None else bool(status & 1),
        None if status is None else bool(status & 2),
    )


class ImuValues(NamedTuple):
    """The report of the controller's IMU."""

    # g
    acceleration: tuple[float, float, float]
    # degrees/s
    rates: tuple[float, float, float]


# the bits of an IMU's values in a question and its answer: accelerations and rates
ACCELERATION: Final = (3, 4, 5)
RATES: Final = (6, 7, 8)
IMU_QUESTION: Final = packet(pack(">BH", PacketId.GET_IMU_DATA, sum(1 << each for each in (*ACCELERATION, *RATES))))


def imu_of(payload: bytes) -> ImuValues | None:
    """Return the IMU's values in an answer to GET_IMU_DATA; None if any is missing.

    After the command come sixteen bits for the values that follow, and these, float32.
    """
    mask = int.from_bytes(payload[1:3])
    there = [each for each in range(16) if mask >> each & 1]
    if len(payload) != 3 + 4 * len(there):
        return None
    numbers = dict(zip(there, unpack_from(f">{len(there)}f", payload, 3), strict=True))
    if not all(isfinite(numbers.get(each, inf)) for each in (*ACCELERATION, *RATES)):
        return None
    (ax, ay, az), (p, q, r) = ([numbers[each] for each in bits] for bits in (ACCELERATION, RATES))
    return ImuValues((ax, ay, az), (p, q, r))


def trouble_of(values: Values) -> str:
    """Return why the controller does not obey, in words; empty if it does."""
    if values.fault:
        return f"the VESC reports a fault: {FAULTS.get(values.fault, f'code {values.fault}')}"
    return "the VESC's kill switch is on" if values.killed else ""


def timeout_of(payload: bytes) -> float | None:
    """Return the controller's own time-out, s, 0 for none, from an answer to GET_APPCONF; None if it is unknown.

    After the command come a signature of the settings' layout, the controller's number, and milliseconds.
    """
    if len(payload) < 10:
        return None
    milliseconds = int.from_bytes(payload[6:10])
    return milliseconds / 1000.0 if milliseconds <= 600_000 else None


@dataclass(frozen=True, slots=True)
class VescOptions:
    """Settings of the HAL, under `hal_options`; the port is `serial.port`."""

    baud: PositiveInt = 115200
    """Bits a second over UART; USB takes any."""
    pole_pairs: PositiveInt = 2
    """Pole pairs of the motor: electrical turns in a turn of its shaft."""
    gear: Positive = 11.82
    """Turns of the motor in a turn of the wheels; default: a Traxxas Slash 4x4."""
    backwards: bool = False
    """Whether the motor drives the car backwards for positive speeds."""
    servo_centre: Share = 0.5
    """The servo's position for straight wheels."""
    servo_range: float = 0.4
    """From there to full lock on the left; negative if smaller positions steer left."""
    brake: NotNegative = 5.0
    """Motor current that brakes the car to a stand, A; 0 lets it roll."""


class VescHal(PlainHal):
    """A car with a VESC, whose servo output steers."""

    name = "vesc"

    def __init__(
        self, port: Port, options: VescOptions, geometry: Geometry, wrap: Callable[[End], End], simulated: bool = False
    ) -> None:
        self.capabilities = Capabilities(odometry=True, battery=True, halt=True, simulated=simulated)
        self.line = Line(port, wrap, "answers of the VESC", self._greet, self._take, hal=self.name)
        self.own_channels = options
        """Its settings, with the directions of motor and servo."""
        self._options, self._geometry = options, geometry
        sign = -1.0 if options.backwards else 1.0
        self._erpm_per_speed = sign * 60.0 * options.pole_pairs * options.gear / geometry.circumference
        self._count_length = sign * geometry.circumference / (TACHOMETER_STEPS * options.pole_pairs * options.gear)
        self.imu: tuple[float, ImuValues] | None = None
        """The last answer of its IMU, and the loop's time when it came; None: there was none."""
        self._unpacker = Unpacker()
        # faults of earlier streams
        self._skipped = 0
        self._forget()

    def _forget(self) -> None:
        self._odometry: Odometry | None = None
        self._values: Values | None = None
        # loop time of the last values
        self._taken = 0.0
        self._firmware: tuple[int, int] | None = None
        self._timeout: float | None = None
        # loop time
        self._asked = -ASK_AGAIN
        # share of the steering's range, left positive
        self._share = 0.0
        self._halted = self._driven = False

    async def open(self) -> None:
        """Open the port."""
        self._forget()
        await self.line.open()

    async def close(self) -> None:
        """Brake, release the motor, and close the port."""
        await self.line.close(self._at_rest() + self._steered())

    def _greet(self) -> None:
        """Discard everything from an earlier line but the car's pose."""
        self._skipped += self._unpacker.faults
        self._unpacker = Unpacker()
        self._values = self._firmware = self._timeout = self.imu = None
        self._asked = self.line.time() - ASK_AGAIN

    def read(self, now: float) -> Inputs:
        """Return odometry from the tachometer and the commanded steering, and the battery's voltage."""
        link = self.line.report(now, {"line_damaged": self._skipped + self._unpacker.faults})
        if self._odometry is None or self._values is None:
            return Inputs(odometry=self._odometry, odometry_time=self.line.run_time(self._taken), link=link)
        time = self.line.run_time(self._taken)
        return Inputs(
            odometry=self._odometry,
            odometry_time=time,
            batteries=(max(0.0, self._values.voltage), 0.0),
            battery_time=time,
            link=link,
        )

    def write(self, outputs: Outputs, now: float) -> None:
        """Send speed and steering, and request the values; this also tells the controller that the host lives."""
        time = self.line.time()
        v = outputs.v if self.line.ready else 0.0
        if v:
            self._halted, self._driven = False, True
            self._share = self._geometry.steering_share(outputs.omega / v)
            drive = order(PacketId.SET_RPM, min(max(v * self._erpm_per_speed, -1e6), 1e6))
        else:
            self._share = 0.0
            drive = self._at_rest()
        questions = ask(PacketId.GET_VALUES)
        if time >= self._asked + ASK_AGAIN - 1e-9 and (self._firmware is None or self._timeout is None):
            self._asked = time
            questions += ask(PacketId.FW_VERSION) + ask(PacketId.GET_APPCONF)
        self.line.send(drive + self._steered() + questions)

    def halt(self, outputs: Outputs, now: float) -> None:
        """Brake with full motor current, until a speed is commanded."""
        self._halted = True
        self.line.send(self._at_rest())

    def ask_imu(self) -> None:
        """Ask for the values of its IMU; no command, which the controller's time-out would count."""
        self.line.send(IMU_QUESTION)

    def _at_rest(self) -> bytes:
        if self._halted:
            return order(PacketId.SET_DUTY, 0.0)
        return (
            order(PacketId.SET_CURRENT_BRAKE, self._options.brake)
            if self._options.brake
            else order(PacketId.SET_CURRENT, 0.0)
        )

    def _steered(self) -> bytes:
        position = self._options.servo_centre + self._options.servo_range * self._share
        return order(PacketId.SET_SERVO_POS, min(max(position, 0.0), 1.0))

    # -- what comes ------------------------------------------------------------------------------------------------

    def _take(self, data: bytes) -> None:
        for payload in self._unpacker.feed(data):
            match payload[0]:
                case PacketId.GET_VALUES:
                    values = values_of(payload)
                    if values is not None:
                        self._take_values(values)
                case PacketId.GET_IMU_DATA:
                    imu = imu_of(payload)
                    if imu is not None:
                        self.imu = self.line.time(), imu
                case PacketId.FW_VERSION if len(payload) >= 3:
                    self._take_firmware(payload[1], payload[2])
                case PacketId.GET_APPCONF:
                    self._timeout = timeout_of(payload)
                    self._tell()

    def _take_firmware(self, major: int, minor: int) -> None:
        if major >= 5:
            self._firmware = major, minor
            self._tell()
        elif self._firmware is None and not self._driven:
            remedy = "update it with VESC Tool: 5 and 6 are spoken here"
            self.line.fail(HalError(f"the VESC has firmware {major}.{minor:02d}: {remedy}"))
        else:
            # a car that drove is not let go of for a single answer
            self.line.tell(f"an answer about firmware {major}.{minor:02d} was ignored: 5 and 6 are spoken here")

    def _tell(self) -> None:
        if self._firmware is None:
            return
        text = f"VESC with firmware {self._firmware[0]}.{self._firmware[1]:02d}"
        advice = "set 0.5 s in VESC Tool, App Settings, General"
        if self._timeout is not None:
            text += f", stops by itself after {self._timeout:g} s" if self._timeout else ", never stops by itself"
            text += "" if 0.0 < self._timeout <= TIMEOUT_MAX else f": {advice}"
        self.line.tell(text)

    def _take_values(self, values: Values) -> None:
        before, self._values = self._values, values
        self._taken = self.line.time()
        troubled = values.fault or values.killed
        if troubled:
            # it answers all the same
            self.line.watched.heard()
            trouble = trouble_of(values)
            if before is None or trouble_of(before) != trouble:
                self.line.down(trouble)
        v = values.erpm / self._erpm_per_speed
        distance = 0.0
        if before is not None:
            distance = self._count_length * wrapped(values.tachometer - before.tachometer)
            if wrapped(values.distance - before.distance) < 0 or abs(distance) > RESTARTED:
                distance = 0.0
                self.line.down("the VESC restarted: its tachometer started again at 0")
        if not troubled:
            self.line.heard()
        old = self._odometry or Odometry()
        self._odometry = rolled(old, distance, self._geometry.curvature(self._share), v)


def wrapped(count: int) -> int:
    """Return the difference of two counters of 32 bits."""
    return (count + 2**31) % 2**32 - 2**31


def create(config: Config) -> VescHal:
    """Make the VESC behind the configured line."""
    options = checked(VescOptions, config.hal_options, "hal_options")
    if config.geometry.steering == "skid":
        raise ConfigError("geometry.steering: a VESC drives one motor and steers with a servo; choose both or front")
    port = port_of(config, options.baud, "txt1 device vesc")
    return VescHal(port, options, config.geometry, faults_of(config), is_simulated(config))
