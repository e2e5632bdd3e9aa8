"""Links in memory: baud rates, delays and faults, in virtual time."""

from __future__ import annotations

import asyncio
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_ends import FRAME, End, run_quietly

from tests.examples import examples
from txt1.errors import LinkLost
from txt1.kernel.clock import VirtualClock
from txt1.kernel.loop import VirtualTimeLoop, clock_of
from txt1.link.base import BYTES_WAITING_MAX, connect
from txt1.link.impairments import Way, faulty, paced
from txt1.sim.parameters import LineFaults
from txt1.sim.serial_line import LineFault, SerialLine


def test_memory_takes_no_time_and_keeps_pieces_as_they_were_written() -> None:
    async def main() -> None:
        one, two = End(), End()
        link, _ = connect(one, two)
        await asyncio.sleep(1.0)
        link.write(b"a")
        link.write(b"bc")
        assert two.pieces == []
        await asyncio.sleep(0)
        assert two.pieces == [b"a", b"bc"]
        assert two.times == [1.0, 1.0]
        assert link.address == "memory"

    run_quietly(main(), "max")


def test_a_paced_frame_arrives_when_its_last_bit_has_passed() -> None:
    async def main() -> None:
        host, board = End(), End()
        connect(host, paced(board, 57600))
        board.link.write(FRAME)
        await asyncio.sleep(0.1)
        assert host.pieces == [FRAME]
        assert host.times == pytest.approx([260 / 57600], abs=2e-9)
        host.link.write(FRAME)
        await asyncio.sleep(0.1)
        assert board.pieces == [FRAME]
        assert board.times == pytest.approx([0.1 + 260 / 57600], abs=2e-9)
        board.link.close()

    run_quietly(main(), "max")


def test_a_paced_line_that_is_given_too_much_drops_whole_writes_and_counts_them() -> None:
    async def main() -> None:
        host, board = End(), End()
        connect(host, paced(board, 57600))
        for _ in range(1000):  # 4.5 s worth of frames at once
            board.link.write(FRAME)
        assert board.link.overflows == 1000 - BYTES_WAITING_MAX // 26
        await asyncio.sleep(1.0)
        assert host.data == FRAME * (BYTES_WAITING_MAX // 26)
        board.link.write(FRAME)
        await asyncio.sleep(1.0)
        assert len(host.data) == 26 * (BYTES_WAITING_MAX // 26 + 1)
        board.link.close()

    run_quietly(main(), "max")


def test_faults_behind_a_baud_rate_hit_whole_frames_both_ways() -> None:
    """As `paced(faulty(board))`: what is dropped is a frame, and all that arrives is whole frames."""

    async def main() -> None:
        dropped: list[int] = []

        def on_fault(fault: LineFault, piece: bytes) -> None:
            assert fault == "drop"
            dropped.append(piece[0])

        host, board = End(), End()
        connect(host, paced(faulty(board, LineFaults(drop=0.2), 1, on_fault=on_fault), 57600))
        for k in range(200):
            host.link.write(bytes([k]) + FRAME)
            board.link.write(bytes([k]) + FRAME)
            await asyncio.sleep(0.05)
        got = [piece[0] for piece in board.pieces] + [host.data[at] for at in range(0, len(host.data), 27)]
        assert host.data == b"".join(bytes([k]) + FRAME for k in host.data[::27])
        assert all(piece[1:] == FRAME for piece in board.pieces)
        assert sorted(got + dropped) == sorted(2 * list(range(200)))
        assert 40 < len(dropped) < 120
        board.link.close()

    run_quietly(main(), "max")


@given(st.integers(0, 1000), st.lists(st.binary(min_size=1, max_size=40), max_size=20))
@settings(max_examples=examples(8))
def test_whatever_delays_them_the_bytes_keep_their_order(seed: int, traffic: list[bytes]) -> None:
    async def main() -> None:
        faults = LineFaults(split=seed % 2 == 0, delay=0.01, jitter=0.1, stall=0.3, stall_every=0.5)
        host, board = End(), End()
        connect(faulty(host, faults, seed), paced(faulty(board, faults, seed), 9600))
        for data in traffic:
            host.link.write(data)
            board.link.write(data)
            await asyncio.sleep(0.02)
        await asyncio.sleep(15.0)
        assert board.data == host.data == b"".join(traffic)
        host.link.close()
        await asyncio.sleep(0.0)

    run_quietly(main(), "max")


@pytest.mark.long
def test_a_seed_repeats_the_faults_of_all_connections_and_directions_differ() -> None:
    def traffic(seed: int, name: str = "line") -> list[list[bytes]]:
        host, board = End(), End()

        async def main() -> None:
            end = faulty(host, LineFaults(drop=0.5), seed, name)
            for _ in range(2):
                connect(end, board)
                for k in range(100):
                    host.link.write(bytes([k]))
                    board.link.write(bytes([k]))
                await asyncio.sleep(0)
                host.link.close()
                await asyncio.sleep(0)

        run_quietly(main(), "max")
        assert len(board.reasons) == 2
        return [host.pieces, board.pieces]

    one = traffic(7)
    assert traffic(7) == one
    assert traffic(8) != one
    assert traffic(7, "other line") != one
    assert one[0] != one[1]


def test_a_line_without_faults_is_no_line_at_all() -> None:
    end = End()
    assert faulty(end, LineFaults(), 1) is end


def test_a_cut_line_is_lost_at_its_time_for_both_and_a_new_one_lives_as_long() -> None:
    async def main() -> None:
        host, board = End(), End()
        end = faulty(host, LineFaults(cut=2.0, delay=0.5), 1)
        loop = asyncio.get_running_loop()
        for start in (0.0, 5.0):
            await asyncio.sleep(start - loop.time())
            connect(end, board)
            await asyncio.sleep(1.5)
            board.link.write(b"in time")  # it arrives with the last bit the line carries
            host.link.write(b"in time")
            loop.call_at(start + 1.6, board.link.write, b"too late")
            await asyncio.sleep(0.501)
            assert host.reasons[-1] == "memory: the line was cut, as its faults say"
            with pytest.raises(LinkLost, match="cut"):
                host.link.write(FRAME)
        assert host.lost_at == [2.0, 7.0]
        assert len(host.reasons) == len(board.reasons) == 2
        assert host.data == board.data == b"in time" * 2

    run_quietly(main(), "max")


def test_a_loop_that_is_late_does_not_let_a_piece_overtake_another() -> None:
    class Held:
        """Holds the first piece back for 10 ms, as a stall that ends then."""

        merges = False

        def carry(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
            return [(max(now, 0.01), data)]

    async def main() -> None:
        got: list[bytes] = []
        way = Way(Held(), got.append)
        way.send(b"first")
        clock = clock_of(asyncio.get_running_loop())
        assert isinstance(clock, VirtualClock)
        clock.spend(0.05)
        way.send(b"second")
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.1)
        assert got == [b"first", b"second"]

    run_quietly(main(), "max")


def test_pieces_that_merge_are_handed_on_as_one() -> None:
    async def main() -> None:
        got: list[bytes] = []
        way = Way(SerialLine(LineFaults(merge=0.02), Random(1)), got.append)
        for piece in (b"one, ", b"two, ", b"three"):
            await asyncio.sleep(0.004)
            way.send(piece)
        await asyncio.sleep(0.02)
        assert got == [b"one, two, three"]

    run_quietly(main(), "max")


@pytest.mark.parametrize("closer", ["inner", "outer", "other"])
def test_what_is_under_way_when_a_link_closes_goes_nowhere(closer: str) -> None:
    async def main() -> None:
        host, board = End(), End()
        outer, other = connect(paced(faulty(host, LineFaults(delay=0.5, cut=9.0), 1), 57600), board)
        host.link.write(FRAME)
        board.link.write(FRAME)
        await asyncio.sleep(0.1)
        {"inner": host.link, "outer": outer, "other": other}[closer].close()
        await asyncio.sleep(0)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        assert [timer for timer in loop.timers if not timer.cancelled()] == []
        await asyncio.sleep(10.0)
        assert host.pieces == board.pieces == []
        assert len(host.reasons) == (closer == "other")
        assert len(board.reasons) == (closer != "other")
        with pytest.raises(LinkLost):
            host.link.write(FRAME)

    run_quietly(main(), "max")


def test_a_wrong_baud_rate_is_refused_before_any_host_connects() -> None:
    with pytest.raises(ValueError, match="positive"):
        paced(End(), 0)
