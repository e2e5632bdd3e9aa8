"""Frames in and out (thesis 3.5), without memory: bytes stay in buffers that were made at the start.

0xFA 0xFB | length (data bytes) | command | data | checksum high | checksum low
"""

from txt1pico import facts

DATA = 4
"""Where a frame's data begins."""
SPACER = 0x00
"""Between frames back to back: original hosts lose the byte behind a frame when it is there already."""
INT_MAX = (1 << 29) - 1
"""Larger integers of the wire are cut to this, which is small enough for MicroPython to need no object for it."""


def legal(length, command):
    """Whether a host sends frames of this length with this command."""
    if command == facts.PID_SET:
        return length >= 12 and length <= 12 + 16 * facts.SETS_MAX and (length - 12) % 16 == 0
    for at in range(0, len(facts.HOST_FRAMES), 2):
        if facts.HOST_FRAMES[at] == command:
            return facts.HOST_FRAMES[at + 1] == length
    return False


class Receiver:
    """Finds frames in a stream of bytes; resynchronises after whatever is none.

    `next` returns the place of a whole, intact frame in `buffer`, or -1. It stays valid until the next call of `next`.

    Attributes:
        damaged: frames whose checksum was wrong.
        foreign: what began like a frame and is none of ours.
        refused: True when a PID set of a wrong length has come; whoever answers it sets it to False.

    """

    def __init__(self, size=512):
        self.buffer = bytearray(size)
        self.size = size
        self.clear()

    def clear(self):
        """Forget what has come."""
        self.start = self.end = self._settled = 0
        self.damaged = self.foreign = self.lost = 0
        self.refused = False

    def put(self, byte):
        """Take a byte that has arrived."""
        if self.end == self.size:
            self._shift()
        self.buffer[self.end] = byte
        self.end += 1

    def _shift(self):
        """Make room at the end of the buffer; what does not fit is lost."""
        if not self.start:  # the longest frame has half of the buffer's length, so this is noise that nobody took
            self.start = self.size // 2
            self.lost += self.size // 2
        buffer, shift = self.buffer, self.start
        for at in range(shift, self.end):
            buffer[at - shift] = buffer[at]
        self.start, self.end = 0, self.end - shift
        self._settled = max(self._settled - shift, 0)

    def pending(self):
        """How many bytes wait for more."""
        return self.end - self.start

    def expire(self):
        """Give up the half frame at the front, as no more of it came for 50 ms; frames behind it are found."""
        if self.end > self.start:
            self.foreign += 1
            self.start += 1

    def next(self):
        """Return the place of the next whole frame, or -1 when more bytes have to come."""
        buffer, end = self.buffer, self.end
        while end - self.start >= 2:
            at = self.start
            if buffer[at] != 0xFA or buffer[at + 1] != 0xFB:
                self.start = at + 1
                continue
            if end - at < DATA:
                return -1
            length, command = buffer[at + 2], buffer[at + 3]
            inside = at < self._settled  # of an intact frame, where only one that goes beyond it counts
            if not legal(length, command):
                self.start = at + 1
                if not inside:
                    self.foreign += 1
                    if command == facts.PID_SET and length != 1:
                        self.refused = True
                continue
            whole = at + length + 6
            if end < whole:
                return -1
            if checksum(buffer, at + 3, at + DATA + length) != buffer[whole - 2] << 8 | buffer[whole - 1]:
                self.damaged += not inside
                self.start = at + 1
                continue
            self.start = at + 1
            if whole > self._settled:
                self._settled = whole
                return at
        if end > self.start and buffer[self.start] != 0xFA:
            self.start = end
        if self.start == self.end:
            self.start = self.end = self._settled = 0
        return -1


def checksum(buffer, start, end):
    """Return the checksum of the bytes from `start` up to `end`: pairs added modulo 65536, an odd last one XORed."""
    total = 0
    while end - start > 1:
        total += buffer[start] << 8 | buffer[start + 1]
        start += 2
    if start < end:
        total ^= buffer[start]
    return total & 0xFFFF


def int16(buffer, at):
    """Return the big-endian two's-complement integer of two bytes."""
    value = buffer[at] << 8 | buffer[at + 1]
    return value - 65536 if value & 0x8000 else value


def int32(buffer, at):
    """Return that of four bytes, cut to +-INT_MAX."""
    high = int16(buffer, at)
    if high >= 1 << 13:
        return INT_MAX
    if high < -(1 << 13):
        return -INT_MAX
    return (high << 16) + (buffer[at + 2] << 8 | buffer[at + 3])


class Transmitter:
    """Writes frames behind one another into a buffer that the hardware empties.

    Attributes:
        buffer: the bytes.
        length: how many of them wait to be sent.
        lost: frames for which there was no room.

    """

    def __init__(self, size=256):
        self.buffer = bytearray(size)
        self.size = size
        self.length = 0
        self.lost = 0
        self._at = 0

    def begin(self, command, length):
        """Begin a frame; False when there is no room for it."""
        at = self.length
        if at + length + 7 > self.size:
            self.lost += 1
            return False
        if at:
            self.buffer[at] = SPACER
            at += 1
        self._at = at
        self.buffer[at] = 0xFA
        self.buffer[at + 1] = 0xFB
        self.buffer[at + 2] = length
        self.buffer[at + 3] = command
        self.length = at + DATA
        return True

    def byte(self, value):
        """Append a byte of data."""
        self.buffer[self.length] = value
        self.length += 1

    def int16(self, value):
        """Append an integer as two bytes."""
        self.byte(value >> 8 & 0xFF)
        self.byte(value & 0xFF)

    def int32(self, value):
        """Append an integer as four bytes."""
        self.int16(value >> 16)
        self.int16(value & 0xFFFF)

    def finish(self):
        """Append the checksum."""
        self.int16(checksum(self.buffer, self._at + 3, self.length))
