"""The decoder beside pymavlink's on clean frames, and its time on garbage of growing length.

Both make message objects. A frame of ours with odometry has 26 bytes. pymavlink's ATTITUDE has 36 (MAVLink 1), or the
same 26 when MAVLink 2 leaves out the zeros at its end; both are shown. Bytes come in reads of 4 KiB.
"""

from __future__ import annotations

import gc
import random
from collections.abc import Callable, Iterator
from functools import partial
from statistics import median
from time import process_time_ns
from typing import Any

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import EncoderOdometry

READ = 4096
"""Bytes handed to a decoder at a time."""

AT_LEAST = 4.0
"""Times pymavlink's rate that is asked for."""

AT_MOST = 11.0
"""Times the time that ten times the garbage may take."""


def main(*, quick: bool) -> None:
    """Print decoding rates beside pymavlink's, and the times for garbage."""
    rounds, frames = (3, 4_000) if quick else (15, 20_000)
    contestants: dict[str, Callable[[], float]] = {"txt1, 26-byte odometry": partial(ours_us, odometry_frames(frames))}
    try:
        contestants |= mavlink_contestants(frames)
    except ImportError:
        print("\n  pymavlink is not installed (pip install pymavlink): its rate is left out")
    results = interleave(rounds, contestants)
    first, *others = results
    rows = [(first, spread(results[first]), "")]
    for name in others:
        ratios = [theirs / ours for theirs, ours in zip(results[name], results[first], strict=True)]
        met = verdict(median(ratios) >= AT_LEAST)
        rows.append((name, spread(results[name]), f"{spread(ratios)} {met}"))
    table(
        f"Decoding clean frames, message objects included, us a frame, {rounds} interleaved rounds of {frames} frames",
        ("", "median (smallest .. largest)", f"times ours; at least {AT_LEAST:.0f}"),
        rows,
    )
    _garbage(rounds, 50_000 if quick else 200_000)


def _garbage(rounds: int, size: int) -> None:
    """Print the time for garbage and for a tenth of it, in reads of 4 KiB and byte by byte.

    The tenth is decoded ten times, each by a decoder of its own, so that both measurements take about as long.
    """
    rows = []
    for name, unit in garbage().items():
        for way, read in (("reads of 4 KiB", READ), ("byte by byte", 1)):
            tenth, whole = ((unit * (length // len(unit) + 1))[:length] for length in (size // 10, size))
            contestants = {"tenth": partial(decode_ns, tenth, read, 10), "whole": partial(decode_ns, whole, read, 1)}
            times = interleave(rounds, contestants)
            ratios = [10 * long / short for long, short in zip(times["whole"], times["tenth"], strict=True)]
            each = spread([time / size for time in times["whole"]], 1)
            rows.append((f"{name}, {way}", each, f"{spread(ratios)} {verdict(median(ratios) <= AT_MOST)}"))
    table(
        f"Garbage, ns a byte of {size} bytes, and the time for them over that for a tenth, {rounds} interleaved rounds",
        ("", "median (smallest .. largest)", f"ratio; at most {AT_MOST:.0f}"),
        rows,
    )


def garbage() -> dict[str, bytes]:
    """Pieces of streams without a single frame: noise, and headers that promise one again and again."""
    return {
        "noise": random.Random(1).randbytes(4_000_000),
        "FA FB F9": b"\xfa\xfb\xf9",
        "FA only": b"\xfa",
        "FA FB 14 68 (odometry)": b"\xfa\xfb\x14\x68",
        "FA FB EC 70 (full PID set)": b"\xfa\xfb\xec\x70",
    }


def odometry_frames(count: int) -> bytes:
    """The stream of a board that drives about, `count` frames."""
    rng = random.Random(2)
    return b"".join(encode(EncoderOdometry(*(rng.uniform(-3, 3) for _ in range(5)))) for _ in range(count))


def ours_us(stream: bytes) -> float:
    """Microseconds a frame for our decoder on clean odometry frames."""
    decoder = Decoder(Role.HOST)
    frames = 0
    gc.collect()
    began = process_time_ns()
    for read in reads(stream, READ):
        frames += len(decoder.feed(read))
    took = process_time_ns() - began
    assert frames == len(stream) // 26
    return took / frames / 1e3


def decode_ns(stream: bytes, size: int, times: int) -> float:
    """Nanoseconds to decode a stream as a board, in reads of `size` bytes, so many times from the start."""
    gc.collect()
    began = process_time_ns()
    for _ in range(times):
        decoder = Decoder(Role.BOARD)
        for read in reads(stream, size):
            decoder.feed(read)
    return process_time_ns() - began


def mavlink_contestants(frames: int) -> dict[str, Callable[[], float]]:
    """What to time pymavlink with, on its ATTITUDE message; an ImportError says that it is not there."""
    from pymavlink.dialects.v10 import common as v1
    from pymavlink.dialects.v20 import common as v2

    rng = random.Random(3)
    full = [[rng.uniform(-3, 3) for _ in range(6)] for _ in range(frames)]
    # Zeros at the end of the data are not sent: two bytes of yaw are left, and a frame of 26 bytes.
    tiny = 2.0**-134
    short = [[*angles[:2], tiny, 0.0, 0.0, 0.0] for angles in full]
    return {
        "pymavlink, 26-byte ATTITUDE (MAVLink 2)": partial(mavlink_us, v2, mavlink_frames(v2, short, 26)),
        "pymavlink, 36-byte ATTITUDE (MAVLink 1)": partial(mavlink_us, v1, mavlink_frames(v1, full, 36)),
    }


def mavlink_frames(dialect: Any, values: list[list[float]], size: int) -> list[bytes]:
    """ATTITUDE frames, each of `size` bytes."""
    sender = dialect.MAVLink(None)
    frames = [dialect.MAVLink_attitude_message(0x01000000 + k, *each).pack(sender) for k, each in enumerate(values)]
    assert {len(frame) for frame in frames} == {size}
    return frames


def mavlink_us(dialect: Any, frames: list[bytes]) -> float:
    """Microseconds a frame for pymavlink's decoder on the same number of frames."""
    decoder = dialect.MAVLink(None)
    stream = b"".join(frames)
    decoded = 0
    gc.collect()
    began = process_time_ns()
    for read in reads(stream, READ):
        decoded += len(decoder.parse_buffer(read) or ())
    took = process_time_ns() - began
    assert decoded == len(frames), f"{decoded} of {len(frames)}"
    return took / decoded / 1e3


def reads(stream: bytes, size: int) -> Iterator[bytes]:
    """A stream in pieces of `size` bytes."""
    for start in range(0, len(stream), size):
        yield stream[start : start + size]
