"""The virtual board's pseudo-terminal: hosts come and go, and whoever else has its path is left alone."""

from __future__ import annotations

import asyncio
import os
import re
import termios
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from link_ends import EVERY_BYTE, FRAME, End, host_at, run_quietly, turns, waiting

from tests.patience import until
from txt1.errors import HalError
from txt1.kernel.loop import PunctualSelector, run
from txt1.link.pty import is_left_behind, listen_pty


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


def test_a_pseudo_terminal_is_raw_for_a_host_that_sets_nothing_even_later(path: str) -> None:
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


def test_an_unused_pseudo_terminal_does_not_wake_the_loop(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_link_that_leads_elsewhere_does_not_belong_to_the_board(path: str) -> None:
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
