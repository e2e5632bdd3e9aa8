"""What an original board answers to what: 200 exchanges by hand and 2000 at random, byte for byte.

Frames are built here from the thesis's description (3.5) and from what was seen of the original's firmware, not by the
codec of txt1: 0xFA 0xFB, the number of data bytes, the command, the data, the checksum. A PID set is the only message
with an answer, so each exchange that asks whether a frame got through ends in one.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Iterator, Sequence
from random import Random
from typing import Final, NamedTuple

import pytest

from tests.e2e.test_board import Desk, Host
from txt1.board.original import OriginalFirmware
from txt1.hal.base import Capabilities, Inputs
from txt1.link.base import connect
from txt1.link.impairments import paced
from txt1.protocol.layout import encode
from txt1.protocol.messages import BoardMessage
from txt1.tasks.state import State

ANSWER: Final = bytes.fromhex("fafb01703c703c")
SILENCE: Final = b""
PAUSE: Final = 0.3  # s, in the middle of a frame: there is no time-out
BAUD: Final = 57600
EMPTY: Final = bytes(255)  # ends whatever an exchange has begun


def frame(command: int, data: bytes = b"") -> bytes:
    """A frame as the thesis describes it."""
    body, total = bytes((command, *data)), 0
    for high, low in zip(body[0::2], body[1::2], strict=False):
        total = (total + 256 * high + low) % 65536
    if len(body) % 2:
        total ^= body[-1]
    return b"\xfa\xfb" + bytes((len(data),)) + body + total.to_bytes(2, "big")


def words(*values: int) -> bytes:
    """Whole numbers of 32 bits, high byte first."""
    return b"".join(value.to_bytes(4, "big", signed=True) for value in values)


GAINS: Final = words(11000, 18000, 250)
SET: Final = words(1500, 4000, 130000, 5)
GOOD: Final = frame(0x70, GAINS)


class Exchange(NamedTuple):
    """Pieces that are sent, with a pause between them, and everything that comes back but odometry and batteries."""

    about: str
    sent: tuple[bytes, ...]
    answered: bytes


def exchanges() -> Iterator[Exchange]:
    def said(about: str, answered: bytes, *sent: bytes) -> Exchange:
        return Exchange(about, sent, answered)

    for sets in range(15):
        yield said(f"a PID set with {sets} angular gains", ANSWER, frame(0x70, GAINS + sets * SET))
    for value in (0, -1, 2**31 - 1, -(2**31)):
        yield said(f"gains of {value}", ANSWER, frame(0x70, words(value, value, value)))
    for header in ("fafb0c70", "fafbfafb", "0000fafb"):
        yield said("a header in the data", ANSWER, frame(0x70, bytes.fromhex(3 * header)))
    for data in (bytes(14), GAINS + b"\x01\x02", bytes(range(14)), b"\xfa\xfb" * 7):
        yield said("a PID set of 14 bytes", ANSWER, frame(0x70, data))
    for sets in (0, 1, 3, 13):
        for more in (1, 2, 3):
            about = f"a PID set with {sets} angular gains and {more} bytes too many"
            yield said(about, ANSWER, frame(0x70, GAINS + sets * SET + b"\x01\xfa\xfb"[:more]))
    for length in sorted({*range(12), *range(16, 28), *range(32, 44), 75, 80, 100, 235, *range(237, 241), 249}):
        yield said(f"a PID set of {length} bytes, and a good one", ANSWER, frame(0x70, bytes(length)) + GOOD)

    for bit in range(8 * 6):
        damaged = bytearray(frame(0x70, GAINS + SET))
        damaged[4 + 3 * (bit // 8)] ^= 1 << bit % 8
        yield said(f"a flipped bit {bit}, and a good one", ANSWER, bytes(damaged) + GOOD)
    for cover, ending in ((0x70, b""), (0x67, b""), (0x71, b""), (0x70, bytes(3))):
        whole = frame(cover, GOOD + ending)
        broken = whole[:-1] + bytes((whole[-1] ^ 1,))
        yield said(f"a good one within a broken frame {cover:02x}, {len(whole)}", SILENCE, broken)
        yield said(f"a good one within a broken frame {cover:02x}, {len(whole)}, and one", ANSWER, broken + GOOD)
        if cover != 0x70:
            yield said(f"a good one within a frame {cover:02x} that means nothing", SILENCE, whole)
    yield said("a PID set of 14 bytes with a wrong checksum", SILENCE, frame(0x70, bytes(14))[:-1] + b"\x01")

    yield said("a lone 0xFA before it", SILENCE, b"\xfa" + GOOD)
    yield said("a lone 0xFA between two", ANSWER, GOOD + b"\xfa" + GOOD)
    for stray in (0x00, 0x01, 0x02, 0x0C, 0x20, 0x3C, 0x55, 0x70, 0x7F, 0x80, 0xF0, 0xF9, 0xFB, 0xFC, 0xFF):
        yield said(f"a stray byte {stray:02x} before it", ANSWER, bytes((stray,)) + GOOD)
    for length in range(250, 256):
        false = b"\xfa\xfb" + bytes((length,))
        yield said(f"a false length {length} takes 255 bytes", ANSWER, false + bytes(252) + GOOD)
        yield said(f"a false length {length} takes a frame", SILENCE, false + bytes(251) + GOOD)
        yield said(f"a false length {length} takes all", SILENCE, false + 13 * GOOD)

    for cut in range(1, len(GOOD)):
        yield said(f"a pause after {cut} bytes", ANSWER, GOOD[:cut], GOOD[cut:])
    for number in (2, 3, 5):
        yield said(f"{number} without a gap", number * ANSWER, number * GOOD)

    for name, silent in {
        "velocity": frame(0x67, bytes(4)),
        "its own odometry": frame(0x68, bytes(20)),
        "combined odometry": frame(0x69, bytes(20)),
        "its own batteries": frame(0x6A, bytes(4)),
        "one gain set of long ago": frame(0x6B, bytes(24)),
        "a PWM test": frame(0x6C, bytes(20)),
        "PID terms of long ago": frame(0x6D, bytes(16)),
        "a power switch": frame(0x6E, b"\x01\x01"),
        "a PWM command": frame(0x6F, bytes(8)),
        "its own answer": ANSWER,
        "an unknown command": frame(0x71, bytes(4)),
        "the command 0": frame(0x00, bytes(4)),
    }.items():
        yield said(f"{name} is not answered", SILENCE, silent)
        yield said(f"{name}, and then a PID set", ANSWER, silent + GOOD)


EXCHANGES: Final = list(exchanges())


def answers(heard: bytes) -> bytes:
    """All frames that a host heard but odometry and batteries."""
    told, rest = b"", heard
    while rest:
        assert rest[:2] == b"\xfa\xfb", rest
        size = rest[2] + 6
        if rest[3] not in (0x68, 0x6A):
            told += rest[:size]
        rest = rest[size:]
    return told


def test_frames_are_those_of_the_thesis() -> None:
    assert frame(0x67, bytes.fromhex("01f402ee")) == bytes.fromhex("fafb046701f402ee5bed")


async def answered_differently(exchanges: Sequence[Exchange]) -> list[str]:
    """Those that a virtual board of the original answers in another way."""
    desk, host = Desk("virtual", "board.habits=original"), Host()
    await desk.power_up()
    connect(host, paced(desk, BAUD))
    assert host.link is not None
    wrong = []
    for about, sent, answered in exchanges:
        host.raw.clear()
        for number, piece in enumerate(sent):
            await asyncio.sleep(PAUSE if number else 0.0)
            host.link.write(piece)
        await asyncio.sleep(0.1 + 10.0 * sum(map(len, sent)) / BAUD)
        host.link.write(EMPTY)
        await asyncio.sleep(0.05)
        if answers(b"".join(data for _, data in host.raw)) != answered:
            wrong.append(about)
    await desk.power_down()
    return wrong


async def test_bytes_are_answered_as_an_original_answers_them() -> None:
    assert not await answered_differently(EXCHANGES)


# -- at random -------------------------------------------------------------------------------------------------------


def heard_of(stream: bytes) -> list[bytes]:
    """The frames that an original board finds: it looks at no byte twice, and takes lengths up to 249."""
    found, at = [], 0
    while at < len(stream):
        if stream[at] != 0xFA:
            at += 1
        elif stream[at + 1 : at + 2] != b"\xfb":
            at += 2
        elif stream[at + 2 : at + 3] >= b"\xfa":
            at += 255
        else:
            end = at + stream[at + 2] + 6 if at + 2 < len(stream) else len(stream) + 1
            if end <= len(stream):
                found.append(stream[at:end])
            at = end
    return found


def answer_to(stream: bytes) -> bytes:
    """A PID set is answered if its checksum is right and its whole integers of four bytes are 12 + 16 n bytes.

    One of more than 236 bytes is not.
    """
    told = SILENCE
    for each in heard_of(stream):
        integers = each[2] // 4
        sound = each[2] <= 236 and each == frame(0x70, each[4:-2])
        if sound and integers >= 3 and integers % 4 == 3:
            told += ANSWER
    return told


def piece(random: Random, depth: int = 0) -> bytes:
    """Something that a host, a bad line or an attacker sends."""
    kind = random.randrange(8 if depth < 2 else 5)
    if kind == 0:
        return GOOD
    if kind == 1:
        return frame(0x70, random.randbytes(random.choice((12, 28, 44, 236)) + random.randrange(-4, 5)))
    if kind == 2:
        length = random.choice((0, 1, 2, 4, 8, 16, 20, 24))
        return frame(random.choice((0x67, 0x68, 0x69, 0x6A, 0x6B, 0x6D, 0x70, 0x71)), random.randbytes(length))
    if kind == 3:
        return bytes(random.choices((0x00, 0xFA, 0xFB, 0x0C, 0x70, 0xFF), k=random.randrange(1, 6)))
    if kind == 4:
        return b"\xfa\xfb" + bytes((random.randrange(256),))
    inner = piece(random, depth + 1)
    if kind == 5:
        return frame(random.choice((0x67, 0x70, 0x71)), (inner + piece(random, depth + 1))[:249])
    if not inner:
        return GOOD
    damaged = bytearray(inner)
    at = random.randrange(len(damaged))
    if kind == 6:
        damaged[at] ^= 1 << random.randrange(8)
        return bytes(damaged)
    return bytes(damaged[:at])


def random_exchange(seed: int) -> Exchange:
    """One to five pieces, sometimes with a pause in the middle."""
    random = Random(seed)
    stream = b"".join(piece(random) for _ in range(random.randrange(1, 6)))
    cut = random.randrange(len(stream) + 1)
    sent = (stream,) if random.random() < 0.9 else (stream[:cut], stream[cut:])
    return Exchange(f"seed {seed}: {stream.hex()}", sent, answer_to(stream + EMPTY))


@pytest.mark.parametrize("seeds", [range(200), pytest.param(range(200, 2000), marks=pytest.mark.long)], ids=len)
async def test_exchanges_at_random_are_answered_as_an_original_answers_them(seeds: range) -> None:
    scripted = [random_exchange(seed) for seed in seeds]
    answered = sum(each.answered != SILENCE for each in scripted)
    assert 0.25 < answered / len(seeds) < 0.75, "both are common"
    assert not await answered_differently(scripted)


# -- what it tells by itself -----------------------------------------------------------------------------------------


class Wheels:
    """Encoders, and nothing else."""

    capabilities = Capabilities(pwm=True, ticks=True, battery=True)

    def __init__(self, right: int, left: int) -> None:
        self.step = right, left
        self.counts = [0, 0]

    def read(self, now: float) -> Inputs:
        counts = self.counts[0], self.counts[1]
        self.counts = [count + more for count, more in zip(counts, self.step, strict=True)]
        return Inputs(ticks=counts, batteries=(12.0, 10.0))


async def at(times: Sequence[float]) -> AsyncIterator[float]:
    for time in times:
        yield time


def firmware(right: int, left: int) -> tuple[OriginalFirmware, list[BoardMessage]]:
    """It, on wheels that count this in each of its periods, and what it sends."""
    wheels, sent = Wheels(right, left), list[BoardMessage]()
    state = State(wheels.capabilities)
    return OriginalFirmware(state, wheels, deque(), deque(), sent.append), sent  # type: ignore[arg-type]


@pytest.mark.parametrize("periods", [1, 2])
async def test_odometry_has_15_mm_a_second_for_a_tick_and_no_fraction(periods: int) -> None:
    """v = 15 (right + left) / 2 mm/s, omega = 15 (right - left) / 0.25 mrad/s, two ticks counting as none."""
    for right in (-100, -67, -31, -11, -3, -2, 0, 1, 2, 3, 4, 11, 15, 22, 27, 30, 31, 45, 60, 67, 99, 100):
        for left in (right, -right):
            board, sent = firmware(right, left)
            await board.encoder(at([0.02 * k for k in range(periods + 1)]))  # type: ignore[arg-type]
            await board.odometry(at([0.05]))  # type: ignore[arg-type]
            v, omega = (15 * right, 0) if right == left else (0, 120 * right)
            if abs(right) <= 2:
                v = omega = 0
            x = int(v * periods / 50)
            theta = omega * periods / 50 % 6283.1853
            assert [encode(message) for message in sent] == [frame(0x68, words(x, 0, int(theta), v, omega))], right


async def test_batteries_are_smoothed_from_zero_on() -> None:
    """Both packs, in mV: 0.6 of the old value and 0.4 of the new one."""
    board, sent = firmware(0, 0)
    await board.battery(at([0.0, 1.0, 2.0]))  # type: ignore[arg-type]
    expected = [(4800, 4000), (7680, 6400), (9408, 7840)]
    told = [frame(0x6A, one.to_bytes(2, "big") + two.to_bytes(2, "big")) for one, two in expected]
    assert [encode(message) for message in sent] == told


def test_there_are_200_exchanges() -> None:
    assert len(EXCHANGES) >= 200
    assert len(set(EXCHANGES)) == len(EXCHANGES)
