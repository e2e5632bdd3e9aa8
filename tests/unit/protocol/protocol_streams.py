"""Streams to decode, and a slow decoder straight from the rule, sharing nothing with the program but its messages."""

from __future__ import annotations

import random
from math import inf

from hypothesis import strategies as st

from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
    BatteryLevels,
    BoardMessage,
    CombinedOdometry,
    EncoderOdometry,
    HostMessage,
    Message,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)
from txt1.protocol.radio_control import RcPermit, RcReport

LENGTHS = {
    Role.BOARD: {
        0x67: {4},
        0x69: {20},
        0x6C: {20},
        0x6E: {2},
        0x6F: {8},
        0x70: {12 + 16 * n for n in range(15)},
        0x72: {2},
    },
    Role.HOST: {0x68: {20}, 0x6A: {4}, 0x70: {1}, 0x71: {12}},
}


def int16() -> st.SearchStrategy[float]:
    return st.floats(-32.768, 32.767)


def int32() -> st.SearchStrategy[float]:
    return st.floats(-(2**31) / 1000, (2**31 - 1) / 1000)


def counts() -> st.SearchStrategy[int]:
    return st.integers(-(2**31), 2**31 - 1)


def short() -> st.SearchStrategy[int]:
    return st.integers(-(2**15), 2**15 - 1)


def uint16() -> st.SearchStrategy[float]:
    return st.floats(0.0, 65.535)


SETS = st.lists(st.tuples(int32(), int32(), int32(), int32()), max_size=14).map(tuple)
HOST_MESSAGES: st.SearchStrategy[HostMessage] = st.one_of(
    st.builds(Velocity, int16(), int16()),
    st.builds(CombinedOdometry, int32(), int32(), int32(), int32(), int32()),
    st.builds(PwmTest, counts(), counts(), counts(), counts(), counts()),
    st.builds(PowerControl, st.sampled_from(Switch), st.booleans()),
    st.builds(PwmCommand, counts(), counts()),
    st.builds(RcPermit, st.booleans(), st.booleans()),
    st.builds(PidSet, st.tuples(int32(), int32(), int32()), SETS),
)
BOARD_MESSAGES: st.SearchStrategy[BoardMessage] = st.one_of(
    st.builds(EncoderOdometry, int32(), int32(), int32(), int32(), int32()),
    st.builds(BatteryLevels, uint16(), uint16()),
    st.builds(PidResponse, st.booleans()),
    st.builds(RcReport, *(short() for _ in range(6))),
)
MESSAGES = {Role.BOARD: HOST_MESSAGES, Role.HOST: BOARD_MESSAGES}


def frame_at(stream: bytes, at: int, role: Role) -> bytes | None:
    """The valid frame that begins there, if one does."""
    if stream[at : at + 2] != b"\xfa\xfb" or len(stream) < at + 4:
        return None
    length, command = stream[at + 2], stream[at + 3]
    if length not in LENGTHS[role].get(command, ()) or len(stream) < at + 6 + length:
        return None
    body = stream[at + 3 : at + 4 + length]
    total = 0
    for k in range(0, len(body) - 1, 2):
        total = (total + 256 * body[k] + body[k + 1]) % 65536
    if len(body) % 2:
        total ^= body[-1]
    frame = stream[at : at + 6 + length]
    return frame if frame[-2:] == bytes([total // 256, total % 256]) else None


def frames_by_the_rule(stream: bytes, role: Role) -> list[tuple[int, bytes]]:
    """Every valid frame that is not inside a longer valid frame, with its offset."""
    valid = [(at, frame) for at in range(len(stream)) if (frame := frame_at(stream, at, role))]
    return [
        (at, frame)
        for at, frame in valid
        if not any(
            other <= at and at + len(frame) <= other + len(longer) and len(longer) > len(frame)
            for other, longer in valid
        )
    ]


def grammar(rng: random.Random, size: int) -> bytes:
    """About `size` bytes of frames whole, cut off, mutated and nested, false headers and noise."""
    frames = [
        encode(message)
        for message in (
            Velocity(0.5, -0.75),
            EncoderOdometry(1.0, -2.0, 3.0, 0.4, -0.5),
            CombinedOdometry(-1.0, 2.0, 6.2, 0.4, -0.5),
            BatteryLevels(12.6, 11.1),
            PwmTest(8000, -2000, 2000, 1, -1),
            PowerControl(Switch.ESC, True),
            PwmCommand(1000, -1000),
            PidSet((11.0, 18.0, 0.25), ((-0.15, 1.0, 30.0, 0.005), (0.15, 6.0, 200.0, 0.005))),
            PidResponse(True),
            PidResponse(False),
        )
    ]
    pairs = [(length, command) for of in LENGTHS.values() for command, lengths in of.items() for length in lengths]
    parts: list[bytes] = []
    total = 0
    while total < size:
        frame = rng.choice(frames)
        match rng.randrange(9):
            case 0 | 1:
                part = frame
            case 2:
                part = frame[: rng.randrange(1, len(frame))]
            case 3:
                mutated = bytearray(frame)
                mutated[rng.randrange(len(frame))] = rng.randrange(256)
                part = bytes(mutated)
            case 4:
                part = bytes([0xFA, 0xFB, *rng.choice(pairs)])
            case 5:
                part = rng.choice((b"\xfa", b"\xfa\xfb", b"\xfa\xfb\xff", b"\xfa\xfb\xf9", b"\xfa\xfa\xfb", b"\0"))
            case 6:
                part = rng.randbytes(rng.randrange(1, 40))
            case 7:
                part = nested(frame, rng)
            case _:
                part = bytes(rng.choice((0xFA, 0xFB, 0x70, 0x67, 0x04, 0xEC)) for _ in range(rng.randrange(1, 12)))
        parts.append(part)
        total += len(part)
    return b"".join(parts)


def nested(frame: bytes, rng: random.Random) -> bytes:
    """A frame of a PID set that carries other frames as its data; its checksum right or wrong."""
    length = 12 + 16 * rng.randrange(15)
    data = (frame * (length // len(frame) + 1))[:length]
    body = bytes([0x70]) + data
    total = sum(256 * body[k] + body[k + 1] for k in range(0, len(body) - 1, 2))
    check = (total % 65536) ^ body[-1]
    if rng.random() < 0.5:
        check ^= 1
    return bytes([0xFA, 0xFB, length]) + body + check.to_bytes(2, "big")


def difference(one: Message, other: Message) -> float:
    """The largest difference between two messages' numbers; infinite when they are not of one shape."""
    mine, theirs = flat(one), flat(other)
    if type(one) is not type(other) or len(mine) != len(theirs):
        return inf
    return max(abs(a - b) for a, b in zip(mine, theirs, strict=True))


def flat(message: Message) -> list[float]:
    if isinstance(message, PidSet):
        return [*message.linear, *(number for each in message.angular for number in each)]
    return [float(getattr(message, name)) for name in type(message).__slots__]
