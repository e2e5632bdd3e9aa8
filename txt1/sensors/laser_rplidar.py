"""Slamtec RPLIDAR laser scanners (A1, A2, A3, C1, S1, S2, S3): the decoder, and the driver.

How it works
------------

The host stops whatever an earlier host has started, and waits until the line is quiet. Then it asks, one question at
a time: who are you, are you well, how long does a sample take, which mode is your typical one, and in which form do
you answer in it. A scanner whose health is 2 ("protection stop") is reset once. The model says how its motor is
started: an A1 by the line DTR, which the port holds down; an A2 or A3 by SET_MOTOR_PWM; an S-series by
MOTOR_SPEED_CTRL; a C1 by the scan itself.

Answers come in four forms. A standard answer is a sample. The others are packets with the angle of their first sample;
the angles between are known when the next packet tells its own. Angles grow clockwise, as seen from above.

The scanner sends no times. So the time of a turn is that of its arrival, and its length is the number of its samples.
"""

import struct
from collections.abc import Callable, Generator
from dataclasses import dataclass
from math import inf, pi
from typing import Annotated, Final, NamedTuple

import numpy as np
from annotated_types import MinLen
from numpy.typing import NDArray

from txt1.config.sources import checked
from txt1.errors import HalError
from txt1.link.device import DevicePort
from txt1.sensors.base import Setup
from txt1.sensors.laser_turns import Numbers, beams_for, scan_of_turn
from txt1.sensors.readings import LASER_MOUNT, Mount, Scan, scan_topic
from txt1.sensors.stream import Codec, Measured, Streamed
from txt1.units import NotNegative, PositiveInt

Whole = NDArray[np.int64]

# commands
STOP: Final = 0x25
RESET: Final = 0x40
SCAN: Final = 0x20
EXPRESS: Final = 0x82
INFO: Final = 0x50
HEALTH: Final = 0x52
SAMPLE_TIMES: Final = 0x59
SETTING: Final = 0x84
MOTOR_PWM: Final = 0xF0
MOTOR_SPEED: Final = 0xA8
# settings of a mode
SAMPLE_TIME: Final = 0x71
DISTANCE: Final = 0x74
FORM: Final = 0x75
TYPICAL: Final = 0x7C
# types of answers
INFO_TOLD: Final = 0x04
HEALTH_TOLD: Final = 0x06
SAMPLE_TIMES_TOLD: Final = 0x15
SETTING_TOLD: Final = 0x20
STANDARD: Final = 0x81
CAPSULE: Final = 0x82
ULTRA: Final = 0x84
DENSE: Final = 0x85
# bytes of a sample or packet
LENGTHS: Final = {STANDARD: 5, CAPSULE: 84, ULTRA: 132, DENSE: 84}
HEAD: Final = b"\xa5\x5a"
# bytes of what announces an answer
ANNOUNCED: Final = 7
FAULTY: Final = 2
# the first firmware that knows its modes
MODES_SINCE: Final = (1, 24)
# rates of the models, bits a second
RATES: Final = (115200, 256000, 460800, 1000000)
# duty cycle of an A2's motor, of 1023, and turns a minute of an S-series: about 10 turns a second
PWM: Final = 660
MOTOR_TURNS: Final = 600
# s until a stopped scanner is quiet, until an answer is missed, and until a scanner is there again after a reset
QUIET: Final = 0.1
MISSED: Final = 0.5
RESTART: Final = 2.0
# s without a turn after which it is greeted again: a reset and the motor take their time
SCAN_PATIENCE: Final = 5.0
# us of a sample of a scanner that does not tell
SAMPLE_DEFAULT: Final = 500.0
RANGE_MIN: Final = 0.05  # m
RANGE_MAX: Final = 12.0  # m, unless it tells another
# s that a turn takes at most
TURN_MAX: Final = 1.0
# sound samples in a row after which a standard answer is in step again
RUN: Final = 8
# a head that turns so much faster between two packets than between the two before has lost packets
LOST_PACKETS_FACTOR: Final = 1.5
# a sample of an ultra answer that hit nothing
NO_HIT: Final = (-512, 511)
# the scale of distances in an ultra answer: from this number on, the distance of that number, mm, and the bits left out
SCALES: Final = ((0, 0, 0), (512, 512, 1), (1280, 2048, 2), (1792, 4096, 3), (3328, 16384, 4))


class Question(NamedTuple):
    """Bytes to send, the type of the answer, and the s after which it is missed; no type: a pause."""

    data: bytes
    answer: int | None
    lasts: float = inf


def command(name: int, payload: bytes = b"") -> bytes:
    """Return a command; with a payload it has its length and a checksum."""
    if not payload:
        return bytes((0xA5, name))
    data = bytes((0xA5, name, len(payload))) + payload
    return data + bytes((xor(data),))


def xor(data: bytes) -> int:
    """Return the checksum of bytes: their exclusive or."""
    return int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))


def announce(kind: int, length: int, many: bool = False) -> bytes:
    """Return what announces an answer, or answers until STOP."""
    return HEAD + struct.pack("<IB", length | many << 30, kind)


def packet(kind: int, start: float, samples: bytes, first: bool = False) -> bytes:
    """Return a packet of samples whose first has this angle, degrees; `first`: the first after a start."""
    body = struct.pack("<H", round(start * 64.0) % 23040 | first << 15) + samples
    assert len(body) + 2 == LENGTHS[kind]
    check = xor(body)
    return bytes((0xA0 | check & 0xF, 0x50 | check >> 4)) + body


def setting(number: int, mode: int | None = None) -> Question:
    """Return the question for a setting, or for one of a mode."""
    payload = struct.pack("<I", number) if mode is None else struct.pack("<IH", number, mode)
    return Question(command(SETTING, payload), SETTING_TOLD, MISSED)


def unscaled(scaled: Whole) -> tuple[Whole, Whole]:
    """Return distances in an ultra answer, mm, and their scales: the number of bits left out of each."""
    mm, scale = scaled.copy(), np.zeros_like(scaled)
    for begins, distance, bits in SCALES:
        there = scaled >= begins
        mm[there] = distance + ((scaled[there] - begins) << bits)
        scale[there] = bits
    return mm, scale


def distances(kind: int, data: bytes, after: bytes) -> tuple[Numbers, Numbers]:
    """Return the samples of a packet: mm (0 or less: no hit), and degrees by which each was seen earlier than its
    turn of the head.
    """
    if kind == DENSE:
        return np.frombuffer(data, "<u2", 40, 4).astype(float), np.zeros(40)
    if kind == CAPSULE:
        cabins = np.frombuffer(data, [("near", "<u2", 2), ("early", "u1")], 16, 4)
        early = np.stack((cabins["early"] & 0xF, cabins["early"] >> 4), 1) | (cabins["near"] & 3) << 4
        return (cabins["near"] >> 2).astype(float).ravel(), early.ravel() / 8.0
    words = np.frombuffer(data[4:] + after[4:8], "<u4").astype(np.int64)
    (mm, scale), middle, last = unscaled(words & 0xFFF), signed(words >> 12)[:-1], signed(words >> 22)[:-1]
    # the sample before is the base of the middle one, or the sample after it if there was no hit
    based = np.where(mm[:-1] > 0, mm[:-1], mm[1:])
    scaled = np.where((mm[:-1] > 0) | (mm[1:] == 0), scale[:-1], scale[1:])
    seen = np.stack(
        (
            mm[:-1],
            np.where(np.isin(middle, NO_HIT), 0, (middle << scaled) + based),
            np.where(np.isin(last, NO_HIT), 0, (last << scale[1:]) + mm[1:]),
        ),
        1,
    ).ravel()
    return seen.astype(float), parallax(seen)


def signed(numbers: Whole) -> Whole:
    """Return the lower ten bits of numbers, with their sign."""
    numbers = numbers & 0x3FF
    return np.where(numbers >= 512, numbers - 1024, numbers)


def parallax(mm: Whole) -> Numbers:
    """Return the angles between head and ray of an ultra answer, degrees: laser and camera sit beside each other, so
    near things are seen earlier.
    """
    near = 98361 // np.maximum(4 * mm, 1)
    far = 8.0 - (64.0 * near + near**3 / 98304.0) * 180.0 / pi / 65536.0
    return np.where(mm >= 50, far, 7.5)


class RplidarDecoder(Codec[Scan]):
    """Talks with a scanner, and decodes its answers into turns, clockwise from straight ahead.

    `known` is called when the scanner has told its name.
    """

    def __init__(self, mount: Mount = LASER_MOUNT, known: Callable[[], None] = lambda: None) -> None:
        super().__init__(command(STOP), command(STOP))
        self.model = 0
        """Its number: the series in the upper half, the model in the lower; 0: not known yet."""
        self._mount, self._known = mount, known
        # us, m
        self._sample, self._range_max = SAMPLE_DEFAULT, RANGE_MAX
        # the type of the answers of a running scan
        self._kind: int | None = None
        self._skipping = False
        # the packet whose angles are not known yet
        self._before: bytes | None = None
        # degrees between the last two packets
        self._span = inf
        # degrees of the last sample's head
        self._last = 0.0
        # samples of this turn, degrees and mm; None until a turn begins
        self._samples: list[tuple[Numbers, Numbers]] | None = None
        # number of samples of this turn, and of beams once a turn is known
        self._count = self._beams = 0
        self._talk = self._conversation()
        self._asked = Question(b"", None)
        self._go_on(next(self._talk))

    # -- the conversation --------------------------------------------------------------------------------------

    def resume(self) -> None:
        """Go on after a pause, or without the answer that was missed."""
        self._hear(None)

    def _hear(self, answer: bytes | None) -> None:
        try:
            self._go_on(self._talk.send(answer))
        except StopIteration:
            self._asked, self.pause = Question(b"", None), inf

    def _go_on(self, question: Question) -> None:
        self._asked, self._out, self.pause = question, question.data, question.lasts

    def _conversation(self) -> Generator[Question, bytes | None, None]:
        """Ask questions until the scanner sends; an answer is None if it is missed."""
        yield Question(command(STOP), None, QUIET)
        firmware = 0, 0
        for last in (False, True):
            told = yield Question(command(INFO), INFO_TOLD)
            assert told is not None
            self.model, firmware = told[0], (told[2], told[1])
            self._known()
            told = yield Question(command(HEALTH), HEALTH_TOLD, MISSED)
            if told is None or told[0] != FAULTY:
                break
            code = int.from_bytes(told[1:3], "little")
            if last:
                raise HalError(
                    f"the laser scanner is not well (health 2, error {code}), not even after a reset: "
                    "switch it off and on; does its head turn freely?"
                )
            self.trouble = f"it is not well (health 2, error {code}), and was reset"
            yield Question(command(RESET), None, RESTART)
        series = self.model >> 4
        # 2, 3: A2, A3; from 6 on: S-series
        if series in (2, 3):
            self.farewell = command(MOTOR_PWM, struct.pack("<H", 0)) + self.farewell
            yield Question(command(MOTOR_PWM, struct.pack("<H", PWM)), None, QUIET)
        elif series >= 6:
            self.farewell = command(MOTOR_SPEED, struct.pack("<H", 0)) + self.farewell
            yield Question(command(MOTOR_SPEED, struct.pack("<H", MOTOR_TURNS)), None, QUIET)
        told = yield Question(command(SAMPLE_TIMES), SAMPLE_TIMES_TOLD, MISSED)
        if told is not None:
            self._sample = float(int.from_bytes(told[:2], "little")) or SAMPLE_DEFAULT
        if firmware >= MODES_SINCE:
            yield from self._choose()
        if self._kind is None:
            yield Question(command(SCAN), STANDARD)
            self._kind = STANDARD

    def _choose(self) -> Generator[Question, bytes | None, None]:
        """Start the scanner's typical mode, if its answers can be read."""
        mode = number(TYPICAL, (yield setting(TYPICAL)))
        if mode is None:
            return
        kind = number(FORM, (yield setting(FORM, mode)))
        sample = number(SAMPLE_TIME, (yield setting(SAMPLE_TIME, mode)))
        reach = number(DISTANCE, (yield setting(DISTANCE, mode)))
        self._range_max = reach / 256.0 if reach else RANGE_MAX
        if kind in LENGTHS and sample:
            self._sample = sample / 256.0
            if kind != STANDARD:
                yield Question(command(EXPRESS, struct.pack("<BHH", mode, 0, 0)), kind)
                self._kind = kind

    # -- the answers -------------------------------------------------------------------------------------------

    def feed(self, data: bytes) -> list[Measured[Scan]]:
        """Take bytes; return the turns that they complete. Raises HalError if the scanner stays faulty."""
        found: list[Measured[Scan]] = []
        data, self._rest = self._rest + data, b""
        while self._kind is None:
            # whatever comes in a pause is from before
            if self._asked.answer is None:
                return found
            at = data.find(HEAD)
            if at < 0:
                self._rest = data[-1:]
                return found
            data = data[at:]
            if len(data) < ANNOUNCED:
                self._rest = data
                return found
            length, kind = struct.unpack("<IB", data[2:ANNOUNCED])
            many, length = length >> 30, length & 0x3FFFFFFF
            ends = ANNOUNCED if many else ANNOUNCED + length
            if kind != self._asked.answer or length > 255 or (many and length != LENGTHS.get(kind)):
                data = data[1:]
                self.faults += 1
            elif len(data) < ends:
                self._rest = data
                return found
            else:
                answer, data = data[ANNOUNCED:ends], data[ends:]
                self._hear(answer.ljust(4, b"\0"))
        at = 0
        take = self._take_sample if self._kind == STANDARD else self._take_packet
        while (length := take(data, at, found)) is not None:
            self.faults += not (length or self._skipping)
            self._skipping = not length
            at += length or 1
        self._rest = data[at:]
        return found

    def _take_sample(self, data: bytes, at: int, found: list[Measured[Scan]]) -> int | None:
        """Take the sample at an offset; return its length, 0: none, None: an incomplete one."""
        for k in range(at, at + (5 * RUN if self._skipping else 5), 5):
            if len(data) - k < 5:
                return None
            # bit 1 is the opposite of bit 0, and the lowest bit of the angle's field is set
            if (data[k] ^ data[k] >> 1) & data[k + 1] & 1 == 0:
                return 0
        if data[at] & 1:
            self._turn(found)
        angle = ((data[at + 1] | data[at + 2] << 8) >> 1) / 64.0
        self._add(np.array((angle,)), np.array(((data[at + 3] | data[at + 4] << 8) / 4.0,)))
        return 5

    def _take_packet(self, data: bytes, at: int, found: list[Measured[Scan]]) -> int | None:
        """Take the packet at an offset; return its length, 0: none, None: an incomplete one."""
        assert self._kind is not None
        length = LENGTHS[self._kind]
        whole = data[at : at + length]
        if not whole or (whole[0] >> 4 == 0xA and len(whole) == 1):
            return None
        if whole[0] >> 4 != 0xA or whole[1] >> 4 != 0x5:
            return 0
        if len(whole) < length:
            return None
        if xor(whole[2:]) != (whole[0] & 0xF | (whole[1] & 0xF) << 4):
            self._before = None
            return 0
        if self._skipping:
            self._before = None
        before, self._before = self._before, whole
        start, first = head(whole)
        if before is not None and not first:
            begin, _ = head(before)
            span = (start - begin) % 360.0
            if span <= LOST_PACKETS_FACTOR * self._span:
                mm, early = distances(self._kind, before, whole)
                self._sweep(begin, span / len(mm), mm, early, found)
            self._span = span
        return length

    def _sweep(self, begin: float, step: float, mm: Numbers, early: Numbers, found: list[Measured[Scan]]) -> None:
        """Take samples of a packet; the head turned by `step` degrees between two of them."""
        turned = begin + step * np.arange(len(mm))
        angles = turned - early
        cut = int(np.searchsorted(turned, 360.0))
        if begin < self._last - 180.0:
            # the turn ended in a packet that was lost, or just before this packet
            self._turn(found, 2 * len(mm))
        self._add(angles[:cut], mm[:cut])
        if cut < len(mm):
            self._turn(found, 2 * len(mm) - cut)
            self._add(angles[cut:], mm[cut:])
        self._last = float(turned[-1]) % 360.0

    def _add(self, angles: Numbers, mm: Numbers) -> None:
        """Add samples to this turn: degrees, mm."""
        if self._samples is not None:
            self._samples.append((angles, mm))
            self._count += len(mm)
            if self._count * self._sample > TURN_MAX * 1e6:
                self.faults += 1
                self._samples = None

    def _turn(self, found: list[Measured[Scan]], late: int = 0) -> None:
        """End this turn, and begin the next; `late`: number of samples that were taken since."""
        samples, count = self._samples, self._count
        self._samples, self._count = [], 0
        if not samples:
            return
        angles, mm = (np.concatenate(each) for each in zip(*samples, strict=True))
        self._beams = self._beams or beams_for(count)
        turn = count * self._sample * 1e-6
        scan = scan_of_turn(angles, mm, self._beams, turn, RANGE_MIN, self._range_max, self._mount)
        found.append(Measured(scan, None, turn + late * self._sample * 1e-6))


def head(whole: bytes) -> tuple[float, bool]:
    """Return the angle of a packet's first sample, degrees, and whether it is the first packet of a scan."""
    number = int.from_bytes(whole[2:4], "little")
    return (number & 0x7FFF) / 64.0, bool(number >> 15)


def number(asked: int, answer: bytes | None) -> int | None:
    """Return the number in the answer to a question for a setting; None if it was missed, or is another setting's."""
    if answer is None or int.from_bytes(answer[:4], "little") != asked:
        return None
    return int.from_bytes(answer[4:8], "little")


@dataclass(frozen=True, slots=True)
class RplidarOptions:
    """The place of the scanner, and its mounting."""

    port: Annotated[str, MinLen(1)] = "/dev/ttyUSB0"
    """Serial device, or socket://host:port."""
    baud: PositiveInt = 115200
    """Bits a second, 8N1; a scanner that stays silent is called at the rates of the other models, too."""
    latency: NotNegative = 0.0
    """Time from measuring to sending, s."""
    mount: Mount = LASER_MOUNT
    """x, y, z (m) and yaw (rad) on the vehicle."""


def create(setup: Setup) -> Streamed[Scan]:
    """Make the driver ``laser_rplidar``; options: those of `RplidarOptions`."""
    given = checked(RplidarOptions, setup.options, f"sensors.{setup.name}.options")
    rates = [given.baud, *(rate for rate in RATES if rate != given.baud)]

    def rate() -> int:
        return rates[sensor.ladder.connections % len(rates)]

    def known() -> None:
        # from now on it is called at no other rate
        rates[:] = [port.rate]

    port = DevicePort(given.port, rate, behind="txt1 sensor virtual rplidar", dtr=False)
    sensor = Streamed(
        scan_topic(setup.name),
        0.1,
        port,
        lambda: RplidarDecoder(given.mount, known),
        latency=given.latency,
        patience=SCAN_PATIENCE,
    )
    return sensor
