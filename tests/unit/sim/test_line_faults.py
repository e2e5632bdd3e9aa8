"""A serial line takes its time, and a bad one damages, loses and delays in the measure it was told to."""

from __future__ import annotations

from math import inf, sqrt
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.sim.parameters import LineFaults
from txt1.sim.serial_line import Arrival, LineFault, Pace, SerialLine

FRAME = bytes(range(0x10, 0x2A))  # as long as an odometry frame: 26 bytes

pieces = st.lists(st.binary(min_size=1, max_size=64), max_size=30)
pauses = st.lists(st.floats(0.0, 0.2), min_size=30, max_size=30)


@st.composite
def timings(draw: st.DrawFn) -> LineFaults:
    """What delays and cuts up, and leaves the bytes alone."""
    return LineFaults(
        split=draw(st.booleans()),
        merge=draw(st.sampled_from([0.0, 0.02, 0.1])),
        delay=draw(st.floats(0.0, 0.5)),
        jitter=draw(st.floats(0.0, 0.5)),
        stall=draw(st.sampled_from([0.0, 0.05, 2.0])),
        stall_every=draw(st.floats(0.01, 10.0)),
    )


@st.composite
def damages(draw: st.DrawFn) -> LineFaults:
    """What loses, damages and doubles whole pieces."""
    return LineFaults(
        drop=draw(st.sampled_from([0.0, 0.3, 1.0])),
        tear=draw(st.sampled_from([0.0, 0.3, 1.0])),
        flip=draw(st.sampled_from([0.0, 1e-3, 0.5, 1.0])),
        duplicate=draw(st.sampled_from([0.0, 0.3, 1.0])),
        delay=draw(st.floats(0.0, 0.5)),
        jitter=draw(st.floats(0.0, 0.5)),
        cut=draw(st.sampled_from([0.0, 1.0])),
    )


def carried(line: SerialLine | Pace, traffic: list[bytes], pauses: list[float]) -> list[tuple[float, list[Arrival]]]:
    """When each piece was given, and what arrived of it."""
    now, out = 0.0, []
    for data, pause in zip(traffic, pauses, strict=False):
        now += pause
        out.append((now, line.carry(data, now)))
    return out


def within(count: int, trials: int, probability: float) -> bool:
    """Whether a count is within five standard deviations of what the probability says."""
    return abs(count - trials * probability) <= 5.0 * sqrt(trials * probability * (1.0 - probability))


# -- a line without faults ---------------------------------------------------------------------------------------


@given(pieces, pauses)
def test_a_good_line_delivers_every_piece_at_once_and_as_it_is(traffic: list[bytes], pauses: list[float]) -> None:
    line = SerialLine(LineFaults(), Random(1))
    for (now, arrivals), data in zip(carried(line, traffic, pauses), traffic, strict=True):
        assert arrivals == [(now, data)]
    assert not any(line.counts.values())


def test_nothing_is_wrong_with_a_line_unless_it_is_said() -> None:
    assert LineFaults().harmless
    assert LineFaults(stall_every=3.0).harmless
    assert not LineFaults(split=True).harmless
    assert not LineFaults(cut=1.0).harmless


def test_a_line_that_would_always_stall_is_refused() -> None:
    with pytest.raises(ValueError, match="stall_every"):
        SerialLine(LineFaults(stall=1.0, stall_every=0.0), Random(1))


# -- time --------------------------------------------------------------------------------------------------------


@given(timings(), pieces, pauses, st.integers(0, 100))
def test_delays_change_neither_the_bytes_nor_their_order(
    faults: LineFaults, traffic: list[bytes], pauses: list[float], seed: int
) -> None:
    line, latest = SerialLine(faults, Random(seed)), 0.0
    got = carried(line, traffic, pauses)
    for now, arrivals in got:
        for when, piece in arrivals:
            assert when >= max(now + faults.delay, latest)
            assert not faults.split or len(piece) == 1
            latest = when
    assert b"".join(piece for _, arrivals in got for _, piece in arrivals) == b"".join(traffic)


def test_a_delay_is_exact_and_jitter_comes_on_top_of_it() -> None:
    assert SerialLine(LineFaults(delay=0.05), Random(1)).carry(FRAME, 2.0) == [(2.05, FRAME)]
    line = SerialLine(LineFaults(delay=0.05, jitter=0.02), Random(1))
    extra = [line.carry(FRAME, second)[0][0] - second - 0.05 for second in range(1000)]
    assert all(-1e-9 <= late <= 0.02 + 1e-9 for late in extra)
    assert sum(extra) / len(extra) == pytest.approx(0.01, abs=0.001)


def test_pieces_that_merge_arrive_at_the_same_instants() -> None:
    line = SerialLine(LineFaults(merge=0.02, delay=0.001), Random(1))
    came = [line.carry(FRAME, 0.005 * k)[0][0] for k in range(8)]
    assert came == pytest.approx([0.02] * 4 + [0.04] * 4)


def test_a_stall_holds_everything_back_until_its_end_and_is_told_of_once() -> None:
    told: list[tuple[LineFault, bytes]] = []
    line = SerialLine(LineFaults(stall=2.0, stall_every=10.0), Random(3), lambda *fault: told.append(fault))
    held, stalls = 0.0, set()
    for k in range(100_000):  # 1000 s
        now = 0.01 * k
        ((when, _),) = line.carry(FRAME, now)
        assert now <= when <= now + 2.0
        if when > now:
            held += 0.01
            stalls.add(round(when, 6))
    assert told == [("stall", FRAME)] * line.counts["stall"]
    assert line.counts["stall"] == len(stalls)
    assert within(len(stalls), 1000, 1.0 / 12.0)
    assert held == pytest.approx(2.0 * len(stalls), rel=0.02)


def test_what_would_arrive_after_the_cut_is_lost_and_told_of() -> None:
    told: list[tuple[LineFault, bytes]] = []
    line = SerialLine(LineFaults(delay=0.5, cut=2.0), Random(1), lambda *fault: told.append(fault), start=10.0)
    assert line.ends == 12.0
    assert line.carry(b"in time", 11.5) == [(12.0, b"in time")]
    assert line.carry(b"too late", 11.6) == []
    assert told == [("cut", b"too late")]
    assert SerialLine(LineFaults(), Random(1)).ends == inf


# -- damage ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.01, 0.2, 0.9])
def test_the_share_of_lost_pieces_is_the_one_asked_for(share: float) -> None:
    line = SerialLine(LineFaults(drop=share), Random(1))
    arrived = sum(len(line.carry(FRAME, float(k))) for k in range(20_000))
    assert within(arrived, 20_000, 1.0 - share)
    assert line.counts["drop"] == 20_000 - arrived


@pytest.mark.parametrize("share", [0.01, 0.2, 1.0])
def test_the_share_of_doubled_pieces_is_the_one_asked_for(share: float) -> None:
    line = SerialLine(LineFaults(duplicate=share), Random(1))
    for k in range(20_000):
        arrivals = line.carry(FRAME, float(k))
        assert arrivals in ([(k, FRAME)], [(k, FRAME), (k, FRAME)])
    assert within(line.counts["duplicate"], 20_000, share)


def test_a_torn_piece_is_its_beginning_and_the_share_is_the_one_asked_for() -> None:
    line, torn = SerialLine(LineFaults(tear=0.2), Random(1)), 0
    for k in range(20_000):
        arrived = b"".join(piece for _, piece in line.carry(FRAME, float(k)))
        assert FRAME.startswith(arrived)
        torn += arrived != FRAME
    assert within(torn, 20_000, 0.2)
    assert line.counts["tear"] == torn


@pytest.mark.parametrize("share", [1e-4, 1e-3, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("size", [pytest.param(1, marks=pytest.mark.long), 26, 4096])
def test_every_bit_is_hit_with_the_probability_asked_for_wherever_it_is(share: float, size: int) -> None:
    line = SerialLine(LineFaults(flip=share), Random(1))
    bits, hits, places = 400_000, 0, [0] * 8
    for k in range(bits // (8 * size) + 1):
        ((_, arrived),) = line.carry(bytes(size), float(k))
        assert len(arrived) == size
        hits += int.from_bytes(arrived, "big").bit_count()
        for bit in range(8):
            places[bit] += sum(byte >> bit & 1 for byte in arrived) if any(arrived) else 0
    trials = (bits // (8 * size) + 1) * size * 8
    assert within(hits, trials, share)
    for place in places:
        assert within(place, trials // 8, share)


@pytest.mark.long
@given(damages(), pieces, pauses, st.integers(0, 100))
def test_whatever_does_not_arrive_as_it_was_given_is_told_of(
    faults: LineFaults, traffic: list[bytes], pauses: list[float], seed: int
) -> None:
    told: list[tuple[LineFault, bytes]] = []
    line = SerialLine(faults, Random(seed), lambda *fault: told.append(fault))
    now = 0.0
    for data, pause in zip(traffic, pauses, strict=False):
        told.clear()
        now += pause
        arrived = [piece for _, piece in line.carry(data, now)]
        kinds = {kind for kind, _ in told}
        assert all(piece == data for _, piece in told)
        assert bool(kinds & {"drop", "cut"}) <= (not arrived) <= bool(kinds & {"drop", "cut", "tear"})
        assert (bool(arrived) and arrived[0] != data) == bool(arrived and kinds & {"tear", "flip"})
        assert (len(arrived) == 2) == ("duplicate" in kinds)
        assert arrived[1:] in ([], arrived[:1])
        assert all((len(piece) < len(data)) == ("tear" in kinds) for piece in arrived)


@given(damages(), pieces, pauses, st.integers(0, 100))
def test_the_same_seed_repeats_every_fault(
    faults: LineFaults, traffic: list[bytes], pauses: list[float], seed: int
) -> None:
    one, two = (carried(SerialLine(faults, Random(seed)), traffic, pauses) for _ in range(2))
    assert one == two


# -- the baud rate -----------------------------------------------------------------------------------------------


@given(pieces, pauses, st.sampled_from([300, 9600, 57600, 250_000]))
def test_a_byte_takes_ten_bits_and_queues_behind_those_before_it(
    traffic: list[bytes], pauses: list[float], baud: int
) -> None:
    pace, passed = Pace(baud), 0.0
    for (now, arrivals), data in zip(carried(pace, traffic, pauses), traffic, strict=True):
        ((when, piece),) = arrivals
        assert piece == data
        assert when == pytest.approx(max(now, passed) + len(data) * 10.0 / baud)
        assert when > now
        passed = when
    assert pace.busy_until == passed


def test_a_line_at_57600_baud_carries_5760_bytes_a_second_however_they_are_cut_up() -> None:
    for size in (1, 24, 240, 5760):
        pace = Pace(57600)
        for _ in range(5760 // size):
            pace.carry(bytes(size), 1.0)
        assert pace.busy_until == pytest.approx(2.0)


def test_no_bytes_take_no_time() -> None:
    pace = Pace(57600)
    assert pace.carry(b"", 5.0) == []
    assert pace.busy_until == 0.0


@pytest.mark.parametrize("baud", [0, -57600])
def test_a_baud_rate_that_is_not_positive_is_refused(baud: int) -> None:
    with pytest.raises(ValueError, match="positive"):
        Pace(baud)
