"""The frames of radio control receivers: SBUS, and CRSF as ExpressLRS and TBS Crossfire speak it.

Both carry 16 channels of 11 bits, low bits first. Channels are told here as the pulses that a servo output of the same
receiver would have, us: 172 is 988 us, 992 is 1500 us, 1811 is 2012 us.

SBUS has no checksum, and its head may also be data. So a stream is in step only when two frames follow each other, and
out of step with the first frame that does not end as it should.
"""

from typing import Final, NamedTuple, Protocol

CHANNELS: Final = 16
# bytes of the packed channels
PACKED: Final = 22

SBUS_SIZE: Final = 25
SBUS_HEAD: Final = 0x0F
# the last byte; SBUS2 counts in it
SBUS_ENDS: Final = frozenset((0x00, 0x04, 0x14, 0x24, 0x34))
# bits of the byte before it: the receiver missed a frame of its transmitter; it has lost its transmitter; unused
SBUS_LOST: Final = 0x04
SBUS_FAILSAFE: Final = 0x08
SBUS_UNUSED: Final = 0xF0

# a receiver's, a transmitter's, a remote's, ExpressLRS's and the common address
CRSF_HEADS: Final = frozenset((0xC8, 0xEE, 0xEA, 0xEC, 0x00))
CRSF_SYNC: Final = 0xC8
# smallest and largest second byte: the number of bytes that follow it
CRSF_LENGTHS: Final = (2, 62)
CRSF_BATTERY: Final = 0x08
CRSF_STATISTICS: Final = 0x14
CRSF_CHANNELS: Final = 0x16
CRSF_MODE: Final = 0x21
# place of the uplink's quality in the statistics
UPLINK_QUALITY: Final = 2
# longest text of a flight mode
MODE_MAX: Final = 13


class RcFrame(NamedTuple):
    """What a frame tells: pulses of the channels, us, or None; whether the link to the transmitter is lost, or None."""

    pulses: tuple[int, ...] | None
    lost: bool | None = None


class FrameDecoder(Protocol):
    """The decoder of a protocol."""

    faults: int
    """Number of times that bytes were no frame."""

    def feed(self, data: bytes) -> list[RcFrame]:
        """Take bytes; return what the frames tell that they complete. A frame that does not count is left out."""


def unpack(data: bytes) -> tuple[int, ...]:
    """Return the pulses of packed channels, us."""
    bits = int.from_bytes(data[:PACKED], "little")
    return tuple(880 + (bits >> 11 * k & 0x7FF) * 5 // 8 for k in range(CHANNELS))


class SbusDecoder:
    """Decodes SBUS. A frame that is marked lost repeats old channels, so it does not count."""

    def __init__(self) -> None:
        self.faults = 0
        self._rest = b""
        self._in_step = False

    def feed(self, data: bytes) -> list[RcFrame]:
        """Take bytes; return what the frames tell."""
        rest, found, at = self._rest + data, [], 0
        while len(rest) - at >= (SBUS_SIZE if self._in_step else 2 * SBUS_SIZE):
            if _is_sbus(rest, at) and (self._in_step or _is_sbus(rest, at + SBUS_SIZE)):
                self._in_step = True
                flags = rest[at + SBUS_SIZE - 2]
                if flags & SBUS_FAILSAFE:
                    found.append(RcFrame(None, True))
                elif not flags & SBUS_LOST:
                    found.append(RcFrame(unpack(rest[at + 1 :]), False))
                at += SBUS_SIZE
                continue
            self.faults += self._in_step
            self._in_step = False
            at += 1
        self._rest = rest[at:]
        return found


def _is_sbus(data: bytes, at: int) -> bool:
    return data[at] == SBUS_HEAD and data[at + 24] in SBUS_ENDS and not data[at + 23] & SBUS_UNUSED


def crc8(data: bytes) -> int:
    """Return CRSF's checksum: CRC-8 with the polynomial 0xD5, beginning with 0."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0xD5 if crc & 0x80 else crc << 1) & 0xFF
    return crc


class CrsfDecoder:
    """Decodes CRSF: channels, and the quality of the uplink. Link statistics are no sign of life."""

    def __init__(self) -> None:
        self.faults = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[RcFrame]:
        """Take bytes; return what the frames tell."""
        rest, found, at = self._rest + data, [], 0
        while len(rest) - at >= 2:
            size = rest[at + 1]
            if rest[at] not in CRSF_HEADS or not CRSF_LENGTHS[0] <= size <= CRSF_LENGTHS[1]:
                at += 1
                continue
            if len(rest) - at < size + 2:
                break
            body, end = rest[at + 2 : at + 1 + size], rest[at + 1 + size]
            if crc8(body) != end:
                self.faults += 1
                at += 1
                continue
            if body[0] == CRSF_CHANNELS and len(body) == 1 + PACKED:
                found.append(RcFrame(unpack(body[1:])))
            elif body[0] == CRSF_STATISTICS and len(body) > 1 + UPLINK_QUALITY:
                found.append(RcFrame(None, body[1 + UPLINK_QUALITY] == 0))
            at += 2 + size
        self._rest = rest[at:]
        return found


def crsf_frame(kind: int, payload: bytes) -> bytes:
    """Return a frame of CRSF."""
    body = bytes((kind,)) + payload
    return bytes((CRSF_SYNC, len(body) + 1)) + body + bytes((crc8(body),))


def telemetry(voltage: float | None, mode: str) -> bytes:
    """Return the frames that a transmitter shows: battery, V (None: not known), and the mode in a few letters."""
    shown = crsf_frame(CRSF_MODE, mode.encode("ascii", "replace")[:MODE_MAX] + b"\0")
    if voltage is None:
        return shown
    # 0.1 V; 0.1 A, mAh and per cent are not known
    tenths = min(max(round(10.0 * voltage), 0), 0xFFFF)
    return crsf_frame(CRSF_BATTERY, tenths.to_bytes(2, "big") + bytes(6)) + shown
