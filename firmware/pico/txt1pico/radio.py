"""A radio control's hand on the board: frames of SBUS and CRSF, pulses, and the rule by which it takes over.

A switch says who drives: "hand", the sticks; "computer", the host; half way, the hand at zero. Without its transmitter
nobody drives. At power-up and after each loss nothing moves until the switch is at "hand" with the throttle at neutral.
It is the rule of `txt1.rc.take_over`, in whole numbers and without memory: pulses in us, sticks in thousandths.
"""

from array import array

from txt1pico import facts

LOST, WAITING, HAND, HALF_WAY, COMPUTER = range(5)
MODES = (b"LOST", b"WAIT", b"HAND", b"HOLD", b"COMPUTER", b"DISARMED")
"""What a transmitter shows for each state; the last one while the gate is closed."""
SILENCE = 250
"""ms without a frame that counts after which the transmitter is lost."""
MARGIN = 100
"""us by which a pulse may lie outside the range of its stick or switch."""
AGE_MAX = 1 << 20
OUT = 1 << 16
"""A stick that cannot be there."""
PWM, SBUS, CRSF = range(3)
PROTOCOLS = ("pwm", "sbus", "crsf")
BAUDS = (0, 100000, 420000)
TELLS = 500
"""ms between two pieces of telemetry."""


def crc8(data, start, end):
    """Return CRSF's checksum of the bytes from `start` up to `end`: CRC-8, polynomial 0xD5."""
    crc = 0
    for at in range(start, end):
        crc ^= data[at]
        for _ in range(8):
            crc = (crc << 1 ^ 0xD5 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def place(pulse, least, middle, most):
    """Return where a stick is, -1000 to 1000, without its dead middle; OUT if it cannot be there."""
    if pulse < min(least, most) - MARGIN or pulse > max(least, most) + MARGIN:
        return OUT
    forward = (pulse - middle) * (most - middle) > 0
    share = 1000 * abs(pulse - middle) // abs(most - middle if forward else middle - least)
    share = min(max(share - 100, 0) * 10 // 9, 1000)
    return share if forward else -share


class Radio:
    """The receiver's end.

    Args:
        settings: the setting `receiver`, as `txt1pico.store.check` returns it.

    Attributes:
        state: who drives.
        v: set-point of the sticks, mm/s; 0 unless they drive.
        omega: 1/16 mrad/s.
        heard: the last pulses of throttle, steering and switch, us, also those that no stick makes; 0 after a loss.
        faults: bytes of a frame in vain.

    """

    def __init__(self, settings):
        self.protocol = PROTOCOLS.index(settings["protocol"])
        self.baud = BAUDS[self.protocol]
        self._throttle = array("h", settings["throttle"])
        self._steering = array("h", settings["steering"])
        self._switch = array("h", settings["switch"])
        self._speed = min(settings.get("speed", facts.V_MAX), facts.V_MAX)
        self._buffer = bytearray(64)
        self._end = 0
        self._in_step = False
        self._age = AGE_MAX
        self._lost = False
        self._waiting = self._let_go = True
        self.state = LOST
        self.v = self.omega = self.faults = 0
        self.heard = array("h", (0, 0, 0))
        self.telemetry = bytearray(28)
        self.telemetry_length = 0
        self._to_tell = 0

    @property
    def holds(self):
        """Whether the hand holds the wheel."""
        return self.state == HAND or self.state == HALF_WAY

    def let_go(self):
        """Let the throttle drive only once it was seen at neutral."""
        self._let_go = True
        self.v = self.omega = 0

    def step(self, dt):
        """Let `dt` ms pass."""
        self._age = min(self._age + dt, AGE_MAX)
        if self._age > SILENCE:
            self.lose()

    def lose(self):
        """Take the loss of the transmitter."""
        self.heard[0] = self.heard[1] = self.heard[2] = 0
        self._waiting = self._let_go = True
        self.state = LOST
        self.v = self.omega = 0

    # -- frames ----------------------------------------------------------------------------------------------------

    def receive(self, data, count):
        """Take `count` bytes of the receiver."""
        for at in range(count):
            if self._end == 64:
                self._drop(1)
            self._buffer[self._end] = data[at]
            self._end += 1
            if self.protocol == SBUS:
                self._find_sbus()
            else:
                self._find_crsf()

    def _drop(self, count):
        buffer = self._buffer
        for at in range(count, self._end):
            buffer[at - count] = buffer[at]
        self._end -= count

    def _is_sbus(self, at):
        buffer = self._buffer
        last = buffer[at + 24]
        ends = last == 0 or (last & 0x0F == 4 and last <= 0x34)
        return buffer[at] == 0x0F and ends and not buffer[at + 23] & 0xF0

    def _find_sbus(self):
        """Take whole frames; out of step, only one that is followed by another."""
        while self._end >= (25 if self._in_step else 50):
            if not (self._is_sbus(0) and (self._in_step or self._is_sbus(25))):
                self.faults += self._in_step
                self._in_step = False
                self._drop(1)
                continue
            self._in_step = True
            flags = self._buffer[23]
            if flags & 8:
                self._lost = True
                self.lose()
            elif not flags & 4:
                self._lost = False
                self._take_packed(1)
            self._drop(25)

    def _find_crsf(self):
        buffer = self._buffer
        while self._end >= 2:
            size = buffer[1]
            head = buffer[0]
            if not (head == 0xC8 or head == 0xEE or head == 0xEA or head == 0xEC or head == 0) or not 2 <= size <= 62:
                self._drop(1)
                continue
            if self._end < size + 2:
                return
            if crc8(buffer, 2, size + 1) != buffer[size + 1]:
                self.faults += 1
                self._drop(1)
                continue
            if buffer[2] == 0x16 and size == 24:
                self._take_packed(3)
            elif buffer[2] == 0x14 and size > 4:
                self._lost = buffer[5] == 0
                if self._lost:
                    self.lose()
            self._drop(size + 2)

    def _raw(self, at, channel):
        """Return the pulse of a channel, us, of the packed channels at an offset."""
        bit = 11 * (channel - 1)
        at += bit >> 3
        buffer = self._buffer
        # never beyond the 22 bytes: the last channel ends with them
        bits = buffer[at] | buffer[at + 1] << 8 | (buffer[at + 2] << 16 if bit & 7 > 5 else 0)
        return 880 + (bits >> (bit & 7) & 0x7FF) * 5 // 8

    def _take_packed(self, at):
        self.take(self._raw(at, self._throttle[0]), self._raw(at, self._steering[0]), self._raw(at, self._switch[0]))

    def pulses(self, throttle, steering, switch):
        """Take a new pulse of each of a receiver's three servo outputs, us."""
        self._lost = False
        self.take(throttle, steering, switch)

    # -- the rule --------------------------------------------------------------------------------------------------

    def take(self, throttle, steering, switch):
        """Take the pulses of a frame, us; one that no stick makes does not count."""
        a, b, heard = self._throttle, self._steering, self.heard
        heard[0], heard[1], heard[2] = throttle, steering, switch
        ahead = place(throttle, a[1], a[2], a[3])
        left = place(steering, b[1], b[2], b[3])
        hand, computer = self._switch[1], self._switch[2]
        if ahead == OUT or left == OUT:
            return
        if switch < min(hand, computer) - MARGIN or switch > max(hand, computer) + MARGIN:
            return
        self._age = 0
        if self._lost:
            return
        share = 1000 * (switch - hand) // (computer - hand)
        position = HAND if share < 250 else COMPUTER if share > 750 else HALF_WAY
        if ahead == 0:
            self._let_go = False
            if position == HAND:
                self._waiting = False
        self.state = WAITING if self._waiting else position
        self.v = self.omega = 0
        if self.state == HAND and not self._let_go:
            self.v = v = self._speed * ahead // 1000 if ahead >= 0 else -(self._speed * -ahead // 1000)
            # the side to which the front wheels point, so a car in reverse turns the other way round
            turn = 16 * abs(v) * abs(left) // facts.RADIUS_MIN
            self.omega = turn if (v >= 0) == (left >= 0) else -turn

    # -- telemetry -------------------------------------------------------------------------------------------------

    def tell(self, dt, millivolts, armed):
        """Write the frames for the transmitter, every half second: the battery's voltage, and who drives."""
        self._to_tell -= dt
        if self.protocol != CRSF or self._to_tell > 0:
            return
        self._to_tell = TELLS
        out = self.telemetry
        out[0], out[1], out[2] = 0xC8, 10, 0x08
        tenths = (millivolts + 50) // 100
        out[3], out[4] = tenths >> 8 & 0xFF, tenths & 0xFF
        out[11] = crc8(out, 2, 11)
        mode = MODES[self.state if armed else 5]
        size = len(mode)
        out[12], out[13], out[14] = 0xC8, size + 3, 0x21
        for at in range(size):
            out[15 + at] = mode[at]
        out[15 + size] = 0
        out[16 + size] = crc8(out, 14, 16 + size)
        self.telemetry_length = 17 + size
