"""Links carry bytes both ways in order, say in words when they are lost, and never keep anyone waiting.

What takes time runs in virtual time over the pair in memory; devices and TCP need the real clock, and nothing here
depends on how fast the machine is.
"""

from __future__ import annotations

import asyncio
import errno
import fcntl
import gc
import os
import re
import socket
import termios
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from blockbuster import blockbuster_ctx
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import SeedSequence, default_rng
from serial import SerialException

from txt1.errors import HalError, LinkLost
from txt1.kernel.clock import VirtualClock
from txt1.kernel.loop import PunctualSelector, VirtualTimeLoop, clock_of, run
from txt1.link import device, tcp
from txt1.link.base import BACKLOG, Link, Listener, connect
from txt1.link.base import End as EndProtocol
from txt1.link.device import STANDARD_BAUDS, baud_warning, open_link
from txt1.link.impairments import Way, faulty, paced
from txt1.link.pty import is_left_behind, listen_pty
from txt1.link.tcp import listen_tcp
from txt1.sim.line import Line, LineFault, LineFaults

FRAME = bytes(range(0x10, 0x2A))
EVERY_BYTE = bytes(range(256))


class End:
    """Remembers what happens to it, and when."""

    def __init__(self) -> None:
        self.links: list[Link] = []
        self.pieces: list[bytes] = []
        self.times: list[float] = []
        self.reasons: list[str] = []
        self.lost_at: list[float] = []

    @property
    def link(self) -> Link:
        return self.links[-1]

    @property
    def data(self) -> bytes:
        return b"".join(self.pieces)

    def has(self, size: int) -> bool:
        return len(self.data) >= size

    def connected(self, link: Link) -> None:
        self.links.append(link)

    def received(self, data: bytes) -> None:
        self.pieces.append(data)
        self.times.append(asyncio.get_running_loop().time())

    def lost(self, reason: str) -> None:
        self.reasons.append(reason)
        self.lost_at.append(asyncio.get_running_loop().time())


class Echo(End):
    """Sends back what comes."""

    def received(self, data: bytes) -> None:
        super().received(data)
        self.link.write(data)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(30.0):
        while not condition():
            await asyncio.sleep(0.001)


async def turns() -> None:
    """Enough turns of the loop, and real time, for anything under way to arrive."""
    for _ in range(20):
        await asyncio.sleep(0.002)


@pytest.fixture(autouse=True)
def nothing_blocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A call that blocks the loop fails, and so does one that would wait until a device has taken everything."""

    def drain(fd: int) -> None:
        raise AssertionError("tcdrain waits for ever when nobody reads")

    monkeypatch.setattr(termios, "tcdrain", drain)
    with blockbuster_ctx("txt1") as blockbuster:
        for name in ("os.path.islink", "os.readlink", "os.unlink", "os.symlink"):  # of listen_pty, and its close
            blockbuster.functions[name].can_block_in("txt1/link/pty.py", {"listen_pty", "_let_go"})
        yield


def timers() -> list[asyncio.TimerHandle]:
    """What a loop is still to call later."""
    now = asyncio.get_running_loop().time()
    handles = (one for one in gc.get_objects() if isinstance(one, asyncio.TimerHandle))
    return [handle for handle in handles if not handle.cancelled() and handle.when() > now]


def run_quietly(main: Coroutine[Any, Any, None], speed: Any = None) -> None:
    """Run to the end; the loop had no unhandled exception to report, and no timer is left."""
    reports: list[dict[str, Any]] = []

    async def body() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, report: reports.append(report))
        before = timers()
        await main
        await asyncio.sleep(0)
        assert [timer for timer in timers() if timer not in before] == []

    run(body(), speed=speed)
    assert reports == []


@contextmanager
def opened_pty() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal of nobody's making: its master and the path of its other side."""
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    try:
        yield master, path
    finally:
        with suppress(OSError):  # it may be gone already
            os.close(master)


@contextmanager
def host_at(path: str) -> Iterator[int]:
    """A host that has the device open, and does nothing else to it."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        yield fd
    finally:
        os.close(fd)


def waiting(fd: int) -> bytes:
    """What there is to read, without waiting."""
    data = b""
    with suppress(BlockingIOError):
        while piece := os.read(fd, 4096):
            data += piece
    return data


# -- every kind of link ------------------------------------------------------------------------------------------

Pair = Callable[[EndProtocol, EndProtocol], Any]


@pytest.fixture(params=["memory", "pty", "tcp"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def pair(kind: str, tmp_path: Path) -> Pair:
    """Connects a host and a board."""

    @asynccontextmanager
    async def pair(host: EndProtocol, board: EndProtocol) -> AsyncIterator[None]:
        listener: Listener | None = None
        if kind == "memory":
            link, other = connect(host, board)
        else:
            if kind == "pty":
                listener = listen_pty(str(tmp_path / "board"), board)
            else:
                listener = await listen_tcp("127.0.0.1", 0, board)
            other, link = listener, await open_link(listener.address, host)  # type: ignore[assignment]
        try:
            yield
        finally:
            link.close()
            other.close()
            await asyncio.sleep(0)

    return pair


def test_every_byte_goes_both_ways_in_order(pair: Pair) -> None:
    async def main() -> None:
        host, board = End(), Echo()
        async with pair(host, board):
            sent = b""
            for k in range(100):
                frame = bytes([k]) + EVERY_BYTE[k:] + EVERY_BYTE[:k]
                host.link.write(frame)
                sent += frame
                if k % 8 == 7:  # no more at a time than a link stores
                    await until(partial(host.has, len(sent)))
            await until(lambda: len(host.data) >= len(sent))
            assert board.data == sent
            assert host.data == sent
            assert host.link.overflows == board.link.overflows == 0
            assert (len(host.links), len(board.links)) == (1, 1)

    run_quietly(main())


def test_a_closed_link_is_silent_and_refuses_to_write(pair: Pair) -> None:
    async def main() -> None:
        host, board = End(), End()
        async with pair(host, board):
            host.link.write(FRAME)
            await until(lambda: board.pieces)
            host.link.close()
            with pytest.raises(LinkLost, match=f"nothing was sent: the link {host.link.address} was closed"):
                host.link.write(FRAME)
            host.link.close()
            if not board.reasons:
                board.link.write(FRAME)
            await turns()
            assert host.pieces == []
            assert host.reasons == []
            assert board.data == FRAME

    run_quietly(main())


def test_a_host_is_told_once_in_words_that_the_board_has_closed(pair: Pair, kind: str) -> None:
    async def main() -> None:
        host, board = End(), End()
        async with pair(host, board):
            board.link.close()
            host.link.write(FRAME)  # it cannot know yet
            await until(lambda: host.reasons)
            with pytest.raises(LinkLost) as refusal:
                host.link.write(FRAME)
            assert str(refusal.value) == f"nothing was sent: {host.reasons[0]}"
            host.link.close()
            await turns()
            assert len(host.reasons) == 1
            assert host.link.address in host.reasons[0]
            assert board.reasons == []
            assert board.pieces == []

    run_quietly(main())


def test_a_board_is_told_that_the_host_has_closed_except_on_a_serial_line_where_nobody_can_tell(
    pair: Pair, kind: str
) -> None:
    async def main() -> None:
        host, board = End(), End()
        async with pair(host, board):
            host.link.close()
            if kind == "pty":
                await turns()
                board.link.write(FRAME)
                assert board.reasons == []
            else:
                await until(lambda: board.reasons)
                assert len(board.reasons) == 1
                with pytest.raises(LinkLost):
                    board.link.write(FRAME)

    run_quietly(main())


def test_whoever_closes_on_receiving_something_receives_nothing_more(pair: Pair) -> None:
    class Shy(End):
        def received(self, data: bytes) -> None:
            super().received(data)
            self.link.close()

    async def main() -> None:
        host, board = Shy(), End()
        async with pair(faulty(host, LineFaults(split=True), 1), board):
            board.link.write(FRAME)
            board.link.write(FRAME)
            await until(lambda: host.pieces)
            await turns()
            assert host.data == FRAME[:1]
            assert host.reasons == []

    run_quietly(main())


def test_the_same_body_of_traffic_survives_a_baud_rate_and_single_bytes(pair: Pair) -> None:
    async def main() -> None:
        host, board = End(), Echo()
        async with pair(faulty(host, LineFaults(split=True, delay=0.01, jitter=0.01), 1), paced(board, 57600)):
            for _ in range(5):
                host.link.write(EVERY_BYTE)
            await until(lambda: len(host.data) >= 1280)
            assert host.data == 5 * EVERY_BYTE
            assert all(len(piece) == 1 for piece in host.pieces)
            host.link.write(FRAME)  # still under way when the link closes

    run_quietly(main())


# -- in memory, in virtual time ----------------------------------------------------------------------------------


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
        assert board.link.overflows == 1000 - BACKLOG // 26
        await asyncio.sleep(1.0)
        assert host.data == FRAME * (BACKLOG // 26)
        board.link.write(FRAME)
        await asyncio.sleep(1.0)
        assert len(host.data) == 26 * (BACKLOG // 26 + 1)
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
        connect(host, paced(faulty(board, LineFaults(drop=0.2), 1, on_fault), 57600))
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
@settings(deadline=None, max_examples=8)
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


def test_the_same_seed_repeats_the_faults_of_all_connections_and_the_directions_differ() -> None:
    def traffic(seed: int | SeedSequence) -> list[list[bytes]]:
        host, board = End(), End()

        async def main() -> None:
            end = faulty(host, LineFaults(drop=0.5), seed)
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
    assert traffic(7) == one == traffic(SeedSequence(7))
    assert traffic(8) != one
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
        way = Way(Line(LineFaults(merge=0.02), default_rng(1)), got.append)
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


# -- devices -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("baud", "speed"), [(57600, termios.B57600), (115200, termios.B115200), (250_000, None)])
def test_a_device_is_opened_raw_with_8_data_bits_no_parity_and_one_stop_bit(baud: int, speed: int | None) -> None:
    async def main() -> None:
        with opened_pty() as (master, path):
            link = await open_link(path, End(), baud)
            _, oflag, cflag, lflag, ispeed, ospeed, _ = termios.tcgetattr(master)
            link.close()
        assert cflag & termios.CSIZE == termios.CS8
        assert not cflag & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
        assert not lflag & (termios.ECHO | termios.ICANON | termios.ISIG)
        assert not oflag & termios.OPOST
        assert speed is None or ispeed == ospeed == speed

    run_quietly(main())


def test_a_device_nobody_reads_costs_writes_and_never_time() -> None:
    async def main() -> None:
        with opened_pty() as (_, path):
            end = End()
            link = await open_link(path, end)
            for _ in range(40):
                for _ in range(50):
                    link.write(FRAME)
                await asyncio.sleep(0.001)  # the loop goes on
            assert link.overflows > 100
            link.close()
            with host_at(path) as other:
                fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)  # it is free at once
            assert end.reasons == []

    run_quietly(main())


@pytest.mark.parametrize("noticed", ["on reading", "on writing"])
def test_a_device_unplugged_with_its_output_full_is_lost_without_noise(noticed: str) -> None:
    async def main() -> None:
        with opened_pty() as (master, path):
            end = End()
            link = await open_link(path, end)
            for _ in range(20):  # what the loop stores, and what the kernel does
                for _ in range(100):
                    link.write(FRAME)
                await asyncio.sleep(0.001)
            assert link.overflows > 0
            if noticed == "on writing":
                link.transport.pause_reading()  # type: ignore[attr-defined]
            os.close(master)
            await until(lambda: end.reasons)
            assert end.reasons == [f"{path} is gone: the program behind it has ended or closed it"]
            with pytest.raises(LinkLost, match="is gone"):
                link.write(FRAME)

    run_quietly(main())


def test_an_adapter_pulled_out_is_called_unplugged() -> None:
    assert device.unplugged("/dev/ttyUSB0", SerialException(errno.EIO, "")) == "/dev/ttyUSB0 was unplugged"


def test_a_device_has_one_user() -> None:
    async def main() -> None:
        with opened_pty() as (_, path):
            link = await open_link(path, End())
            with pytest.raises(HalError, match=f"{path} is busy: another program has it open"):
                await open_link(path, End())
            link.close()

    run_quietly(main())


def test_opening_that_nobody_waits_for_any_more_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    go, opened, really_open = threading.Event(), threading.Event(), device.open_port

    ports: list[Any] = []

    def slow(*given: Any) -> Any:
        go.wait(30.0)
        port, explain = really_open(*given)
        ports.append(port)
        opened.set()
        return port, explain

    monkeypatch.setattr(device, "open_port", slow)

    async def main() -> None:
        with opened_pty() as (_, path):
            end = End()
            opening = asyncio.create_task(open_link(path, end))
            await asyncio.sleep(0.01)
            opening.cancel()
            with pytest.raises(asyncio.CancelledError):
                await opening
            go.set()
            await until(opened.is_set)
            await until(lambda: not ports[0].is_open)
            assert end.links == []

    run_quietly(main())


def refusal(address: str, baud: int = 57600) -> str:
    """What is said when this address cannot be opened."""

    async def main() -> str:
        with pytest.raises(HalError) as error:
            await open_link(address, End(), baud)
        return str(error.value)

    return run(main())


def test_a_missing_device_is_named_with_the_ports_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "candidates", list)
    assert refusal("/dev/ttyUSB77") == (
        "/dev/ttyUSB77 does not exist: is the adapter plugged in? no serial port was found"
    )
    monkeypatch.setattr(device, "candidates", lambda: ["/dev/ttyUSB0 (FT232R)", "/dev/ttyS0"])
    assert refusal("/dev/ttyUSB77").endswith("plugged in? ports found: /dev/ttyUSB0 (FT232R), /dev/ttyS0")


@pytest.mark.parametrize("made", [False, True], ids=["no such path", "left by a killed board"])
def test_a_missing_virtual_board_is_named_with_the_command_that_starts_it(tmp_path: Path, made: bool) -> None:
    path = tmp_path / "txt1-board"
    if made:
        path.symlink_to("/dev/pts/99999")
    assert f"{path} does not exist: is `txt1 board --pty {path}` running?" in refusal(str(path))
    assert refusal("127.0.0.1:2947") == "127.0.0.1:2947 is no device; for TCP write socket://127.0.0.1:2947"


def test_what_is_no_serial_port_is_called_that(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (str(tmp_path / "file"), str(tmp_path), "/dev/null"):
        assert refusal(path).startswith(f"{path} is no serial port")


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EACCES, "no permission to use PORT"),
        (errno.EBUSY, "PORT is busy: another program has it open"),
        (errno.EAGAIN, "PORT is busy: another program has it open"),
        (errno.ENXIO, "PORT has no hardware behind it"),
        (errno.EIO, "PORT has no hardware behind it"),
        (errno.EINVAL, "PORT is no serial port"),
    ],
)
def test_every_cause_has_its_own_words(monkeypatch: pytest.MonkeyPatch, number: int, said: str) -> None:
    def fail(*_: object, **__: object) -> None:
        raise SerialException(number, "could not open port")

    monkeypatch.setattr(device, "_Device", fail)
    with opened_pty() as (_, path):
        assert refusal(path).startswith(said.replace("PORT", path))


@pytest.mark.parametrize("baud", [-1, 0, 10**12])
def test_an_impossible_baud_rate_is_refused_by_name(baud: int) -> None:
    with opened_pty() as (_, path):
        assert refusal(path, baud) == f"{path} does not work at {baud} baud: the board's rate is 57600"


def test_unusual_baud_rates_get_one_line_of_warning() -> None:
    assert 57600 in STANDARD_BAUDS
    assert [baud_warning(baud) for baud in STANDARD_BAUDS] == [None] * len(STANDARD_BAUDS)
    warning = baud_warning(56700)  # the thesis's misprint
    assert warning is not None
    assert "56700 baud is unusual" in warning
    assert "nearest usual rate is 57600" in warning
    assert "\n" not in warning


# -- the virtual board's pseudo-terminal -------------------------------------------------------------------------


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "txt1-board")


def test_hosts_come_and_go_and_find_nothing_stale(path: str) -> None:
    async def main() -> None:
        board = End()
        with closing(listen_pty(path, board)) as listener:
            assert listener.address == path
            for k in range(3):
                board.link.write(b"nobody is here to read this")
                with host_at(path) as host:
                    await asyncio.sleep(0.1)
                    assert waiting(host) == b""
                    board.link.write(b"news")
                    os.write(host, b"host %d" % k)
                    await until(partial(board.has, 6 * (k + 1)))
                    assert waiting(host) == b"news"
                    board.link.write(b"the host leaves without having read this")
                await asyncio.sleep(0.1)
            assert board.data == b"host 0host 1host 2"
            assert len(board.links) == 1
            assert board.reasons == []
            assert board.link.overflows == 0

    run_quietly(main())


@pytest.mark.parametrize("said", [b"bye", b""])
def test_a_host_that_only_looks_in_leaves_nothing_to_the_next_one(path: str, said: bytes) -> None:
    async def main() -> None:
        board = End()
        with closing(listen_pty(path, board)):
            for _ in range(20):
                await asyncio.sleep(0.007)  # anywhere between two looks at the hosts
                with host_at(path) as host:
                    board.link.write(b"not read")
                    if said:
                        os.write(host, said)
                await asyncio.sleep(0.06)
                await turns()  # one reads, one finds that nobody is there
                assert board.data == said
                board.pieces.clear()
                with host_at(path) as host:
                    assert waiting(host) == b""

    run_quietly(main())


def test_a_pseudo_terminal_is_raw_for_a_host_that_sets_nothing_even_after_one_that_did(path: str) -> None:
    async def main() -> None:
        board = End()
        with closing(listen_pty(path, board)):
            for _ in range(2):
                board.pieces.clear()
                with host_at(path) as host:
                    os.write(host, EVERY_BYTE)
                    await until(lambda: len(board.data) >= 256)
                    board.link.write(EVERY_BYTE)
                    await asyncio.sleep(0.01)
                    assert board.data == EVERY_BYTE
                    assert waiting(host) == EVERY_BYTE
                    mode = termios.tcgetattr(host)
                    mode[3] |= termios.ECHO | termios.ICANON
                    termios.tcsetattr(host, termios.TCSANOW, mode)
                await asyncio.sleep(0.1)

    run_quietly(main())


def test_a_host_that_does_not_read_costs_writes_and_keeps_their_order(path: str) -> None:
    async def main() -> None:
        board = End()
        with closing(listen_pty(path, board)), host_at(path) as host:
            await asyncio.sleep(0.1)
            for k in range(4000):
                board.link.write(k.to_bytes(2, "big") + FRAME)
            assert board.link.overflows > 1000
            got = b""
            while data := waiting(host):
                got += data
                await asyncio.sleep(0.01)
            whole = [int.from_bytes(k, "big") for k in re.findall(b"(..)" + re.escape(FRAME), got, re.DOTALL)]
            assert whole == sorted(set(whole))
            assert whole[:100] == list(range(100))
            assert 4000 - board.link.overflows <= len(whole) < 2000

    run_quietly(main())


def test_a_pseudo_terminal_nobody_uses_leaves_the_loop_asleep(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        with closing(listen_pty(path, End())):
            with host_at(path):
                await asyncio.sleep(0.1)
            turns, select = 0, PunctualSelector.select

            def count(selector: PunctualSelector, timeout: float | None = None) -> Any:
                nonlocal turns
                turns += 1
                return select(selector, timeout)

            monkeypatch.setattr(PunctualSelector, "select", count)
            await asyncio.sleep(0.5)
            assert turns < 50

    run_quietly(main())


def lead(path: str, elsewhere: str) -> None:
    """Replace a symbolic link."""
    os.unlink(path)
    os.symlink(elsewhere, path)


def test_closing_removes_the_path_unless_it_is_another_board_s_by_now(path: str) -> None:
    async def main() -> None:
        first = listen_pty(path, End())
        await asyncio.to_thread(lead, path, "/dev/pts/ptmx")
        first.close()
        assert os.path.lexists(path)

        second = listen_pty(path, End())  # as after a kill: what is left behind is replaced
        second.close()
        second.close()
        assert not os.path.lexists(path)

    run_quietly(main())
    assert os.listdir(Path(path).parent) == []


def test_a_second_board_does_not_take_the_path_of_a_running_one(path: str) -> None:
    async def main() -> None:
        with closing(listen_pty(path, End())):
            before = await asyncio.to_thread(os.readlink, path)
            with pytest.raises(HalError, match="another board's, which is running"):
                listen_pty(path, End())
            assert await asyncio.to_thread(os.readlink, path) == before
            assert await asyncio.to_thread(is_left_behind, path) is False

    asyncio.run(main())


def test_a_terminal_that_no_running_board_holds_is_left_behind(path: str) -> None:
    master, slave = os.openpty()  # a stranger's, who got the name of a killed board's
    try:
        Path(path).symlink_to(os.ttyname(slave))
        assert is_left_behind(path) is None, "another program's, which has no lock file"
        Path(f"{path}.lock").write_text(os.ttyname(slave))
        assert is_left_behind(path) is True
        assert is_left_behind("/dev/null") is None
    finally:
        os.close(master)
        os.close(slave)


def test_a_link_that_leads_elsewhere_than_its_board_says_is_none_of_it(path: str) -> None:
    async def main() -> None:
        with closing(listen_pty(path, End())):
            await asyncio.to_thread(lead, path, "/dev/pts/999999")
            assert await asyncio.to_thread(is_left_behind, path) is True

    asyncio.run(main())


@pytest.mark.parametrize("what", ["file", "directory", "link"])
def test_whatever_else_is_at_the_path_is_left_alone(path: str, what: str) -> None:
    if what == "file":
        Path(path).write_text("thesis")
    elif what == "directory":
        Path(path).mkdir()
    else:
        Path(path).symlink_to("/dev/ttyUSB0")

    async def main() -> None:
        before = len(os.listdir("/proc/self/fd"))
        with pytest.raises(HalError, match=f"{path} exists and is no pseudo-terminal: remove it or choose another"):
            listen_pty(path, End())
        assert len(os.listdir("/proc/self/fd")) == before

    asyncio.run(main())
    assert os.path.lexists(path)


def test_a_path_in_no_directory_is_refused(tmp_path: Path) -> None:
    async def main() -> None:
        with pytest.raises(HalError, match="there is no such directory"):
            listen_pty(str(tmp_path / "nowhere" / "board"), End())
        with pytest.raises(HalError, match=r"cannot make /proc/board: .*choose another path"):
            listen_pty("/proc/board", End())

    run(main())


# -- TCP ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_a_board_listens_where_it_is_told_and_says_how_to_reach_it(host: str) -> None:
    async def main() -> None:
        board, end = End(), End()
        try:
            listener = await listen_tcp(host, 0, board)
        except HalError:
            pytest.skip("this computer has no such address")
        assert listener.address.startswith("socket://[::1]:" if ":" in listener.address[9:14] else "socket://127.")
        link = await open_link(listener.address, end)
        link.write(FRAME)
        await until(lambda: board.pieces)
        assert board.link.address.startswith("socket://")
        link.close()
        await until(lambda: board.reasons)
        assert board.reasons[0].startswith(board.link.address)
        listener.close()

    run_quietly(main())


def test_a_second_host_is_turned_away_while_the_first_talks() -> None:
    async def main() -> None:
        board, first, second = End(), End(), End()
        with closing(await listen_tcp("127.0.0.1", 0, board)) as listener:
            link = await open_link(listener.address, first)
            await open_link(listener.address, second)
            await until(lambda: second.reasons)
            link.write(FRAME)
            await until(lambda: board.pieces)
            assert first.reasons == board.reasons == []
            assert len(board.links) == 1
            link.close()
            await until(lambda: board.reasons)
            third = End()
            link = await open_link(listener.address, third)
            board.link.write(FRAME)
            await until(lambda: third.pieces)
            assert len(board.links) == 2
            link.close()

    run_quietly(main())


def test_a_silent_host_gives_way_to_a_new_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "SILENT", 0.0)

    async def main() -> None:
        board, first, second = End(), End(), End()
        with closing(await listen_tcp("127.0.0.1", 0, board)) as listener:
            await open_link(listener.address, first)
            link = await open_link(listener.address, second)
            await until(lambda: first.reasons and len(board.links) == 2)
            assert "silent, and another host took its place" in board.reasons[0]
            link.write(FRAME)
            await until(lambda: board.pieces)
            board.link.write(FRAME)
            await until(lambda: second.pieces)
            assert first.pieces == []
            assert second.reasons == []
            with pytest.raises(LinkLost, match="another host"):
                board.links[0].write(FRAME)
            link.close()

    run_quietly(main())


def test_closing_the_listener_lets_go_of_the_host_too() -> None:
    async def main() -> None:
        board, host = End(), End()
        listener = await listen_tcp("127.0.0.1", 0, paced(board, 57600))
        await open_link(listener.address, host)
        board.link.write(FRAME)
        listener.close()
        with pytest.raises(LinkLost):
            board.link.write(FRAME)
        await until(lambda: host.reasons)
        with pytest.raises(HalError, match="refuses the connection"):
            await open_link(listener.address, End())
        assert board.reasons == []

    run_quietly(main())


def test_a_peer_that_does_not_read_costs_writes_and_never_time() -> None:
    async def main() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.setblocking(False)
            link = await open_link(f"socket://127.0.0.1:{server.getsockname()[1]}", End())
            peer, _ = await asyncio.get_running_loop().sock_accept(server)
            for _ in range(40):
                for _ in range(500):
                    link.write(EVERY_BYTE)
                await asyncio.sleep(0.001)
            assert link.overflows > 1000
            link.close()
            await asyncio.sleep(0)
            peer.close()

    run_quietly(main())


def test_a_peer_that_breaks_off_is_told_from_one_that_closes() -> None:
    assert tcp.broken_off("socket://a:1", None) == "socket://a:1 was closed by the other side"
    assert tcp.broken_off("socket://a:1", ConnectionResetError()) == "socket://a:1 was broken off by the other side"
    assert tcp.broken_off("socket://a:1", TimeoutError()) == "socket://a:1 no longer answers"


def test_a_tcp_peer_that_vanishes_is_noticed_after_three_seconds() -> None:
    async def main() -> None:
        with closing(await listen_tcp("127.0.0.1", 0, End())) as listener:
            link = await open_link(listener.address, End())
            sock = link.transport.get_extra_info("socket")  # type: ignore[attr-defined]
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 3000
            link.close()

    run_quietly(main())


@pytest.mark.parametrize(
    "address",
    [
        "socket://",
        "socket://127.0.0.1",
        "socket://:5000",
        "socket://127.0.0.1:port",
        "socket://127.0.0.1:70000",
        "socket://127.0.0.1:0",
        "socket://[::1:5000",
        "socket://me@127.0.0.1:5000",
        "socket://127.0.0.1:5000/board",
        "socket://127.0.0.1:5000?logging=debug",
        "tcp://127.0.0.1:5000",
        "rfc2217://127.0.0.1:5000",
    ],
)
def test_a_malformed_address_is_refused_with_an_example(address: str) -> None:
    said = refusal(address)
    assert said.startswith(f"{address} is no address")
    assert "socket://127.0.0.1:5000" in said


def test_a_port_nobody_listens_at_is_said_to_refuse() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    said = refusal(f"socket://127.0.0.1:{port}")
    assert said == (
        f"socket://127.0.0.1:{port} refuses the connection: is `txt1 board --tcp 127.0.0.1:{port}` running there?"
    )


def test_an_unknown_computer_and_a_silent_one_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    async def unknown(host: str, port: int) -> socket.socket:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    async def silent(host: str, port: int) -> socket.socket:
        await asyncio.sleep(3600.0)
        raise AssertionError

    monkeypatch.setattr(tcp, "_connected_socket", unknown)
    assert refusal("socket://robto:5000") == (
        "socket://robto:5000: no computer is known by the name 'robto': check the spelling"
    )
    monkeypatch.setattr(tcp, "_connected_socket", silent)
    monkeypatch.setattr(tcp, "ANSWER", 0.01)
    assert refusal("socket://10.0.0.9:5000").startswith("socket://10.0.0.9:5000 does not answer")


@pytest.mark.parametrize(
    ("host", "port", "said"),
    [
        ("127.0.0.1", 70000, "a port is a number from 0 to 65535"),
        ("127.0.0.1", -1, "a port is a number from 0 to 65535"),
        ("192.0.2.1", 5000, "this computer has no such address"),
    ],
)
def test_what_cannot_be_listened_on_is_refused_with_the_reason(host: str, port: int, said: str) -> None:
    async def main() -> None:
        with pytest.raises(HalError, match=f"cannot listen on {host}:{port}: {said}"):
            await listen_tcp(host, port, End())

    run(main())


def test_a_port_in_use_is_refused_with_a_remedy() -> None:
    async def main() -> None:
        with closing(await listen_tcp("127.0.0.1", 0, End())) as listener:
            port = int(listener.address.rpartition(":")[2])
            with pytest.raises(HalError, match=f"127.0.0.1:{port}: it is in use, perhaps by another board; choose"):
                await listen_tcp("127.0.0.1", port, End())

    run_quietly(main())
