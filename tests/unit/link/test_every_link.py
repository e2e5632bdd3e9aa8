"""Links of every kind carry bytes both ways in order, and say in words when they are lost."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from link_ends import EVERY_BYTE, FRAME, Echo, End, run_quietly, turns

from tests.patience import until
from txt1.errors import LinkLost
from txt1.link.base import End as EndProtocol
from txt1.link.base import Listener, connect
from txt1.link.device import open_link
from txt1.link.impairments import faulty, paced
from txt1.link.pty import listen_pty
from txt1.link.tcp import listen_tcp
from txt1.sim.parameters import LineFaults

Pair = Callable[[EndProtocol, EndProtocol], Any]


@pytest.fixture(params=["memory", "pty", "pty by serialx", "tcp"])
def kind(request: pytest.FixtureRequest) -> str:
    if request.param == "pty by serialx":
        pytest.importorskip("serialx", reason="serialx is not installed")
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
            if kind.startswith("pty"):
                listener = listen_pty(str(tmp_path / "board"), board)
            else:
                listener = await listen_tcp("127.0.0.1", 0, board)
            transport = "serialx" if "serialx" in kind else "pyserial-asyncio"
            other = listener  # type: ignore[assignment]
            link = await open_link(listener.address, host, transport=transport)
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


def test_a_board_is_told_that_the_host_has_closed_except_on_a_serial_line(pair: Pair, kind: str) -> None:
    async def main() -> None:
        host, board = End(), End()
        async with pair(host, board):
            host.link.close()
            if kind.startswith("pty"):
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
