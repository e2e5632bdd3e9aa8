"""Host and board as two processes, in real time, and what happens when one of them is killed, stopped or unplugged.

Times are taken by the clock of the side that has to notice.
"""

from __future__ import annotations

import asyncio
import os
import re
import select
import signal
import sys
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block, passing
from tests.patience import LIMIT, PATIENT, TXT1, lateness, until
from txt1.board.board import Board, DevicePlace
from txt1.config import Config, load
from txt1.control.standstill import Stop
from txt1.errors import StopNotVerified
from txt1.hal.base import Outputs
from txt1.kernel.loop import run
from txt1.link.pty import listen_pty
from txt1.protocol.layout import encode
from txt1.protocol.messages import Velocity
from txt1.robot import Robot

ROOT = Path(__file__).parents[2]
TICK = 0.02
LATE = 0.05
"""s from an event to the look that notices it."""


@pytest.fixture(autouse=True)
def what_the_test_itself_does_may_block(blocking_calls_fail: BlockBuster) -> None:
    """Starting processes and looking at files; and a pseudo-terminal is made before the board has power."""
    may_block(blocking_calls_fail, "tests/e2e/test_processes.py", "process", "<lambda>", "body", "adapter", "answers")
    may_block(blocking_calls_fail, "tests/patience.py", "until")
    may_block(blocking_calls_fail, "txt1/link/pty.py", "listen_pty", "_let_go")


@asynccontextmanager
async def process(*words: str) -> AsyncIterator[asyncio.subprocess.Process]:
    started = await asyncio.create_subprocess_exec(
        *TXT1, *words, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL
    )
    try:
        yield started
    finally:
        if started.returncode is None:
            started.kill()
        await started.wait()


def board_words(path: Path) -> tuple[str, ...]:
    rooms = [word for setting in ENDLESS for word in ("--set", setting)]
    return ("board", "--pty", str(path), "--json", *rooms)


def host_config(path: Path) -> Config:
    return load(None, [f"serial.port={path}", *PATIENT], None, {"hal": "serial"}).config


async def driving(hosts: AsyncExitStack, path: Path, speed: Callable[[], float]) -> asyncio.subprocess.Process:
    """A host that drives the board at 1 m/s.

    A busy computer may halt the board or the host for so long that they stop the car, as they should, and keep it
    stopped. Then another host drives it.
    """
    words = ("run", "--hal", "serial", "--port", str(path), "--arm", "--drive", "1,0", "--headless")
    for _ in range(4):
        host = await hosts.enter_async_context(process(*words))
        with suppress(TimeoutError):
            await until(lambda: speed() > 0.95, LIMIT / 4.0)
            return host
        host.kill()
        await host.wait()
    raise TimeoutError("no host drives the board")


@pytest.mark.parametrize(
    ("number", "timeout", "limit"),
    [
        pytest.param(signal.SIGKILL, "0.25", 0.25, id="killed-time-out"),
        pytest.param(signal.SIGKILL, "null", 2.0, id="killed-link rule alone", marks=pytest.mark.long),
        pytest.param(signal.SIGSTOP, "0.25", 0.25, id="stopped-time-out", marks=pytest.mark.long),
        pytest.param(signal.SIGSTOP, "null", 2.0, id="stopped-link rule alone", marks=pytest.mark.long),
    ],
)
def test_a_host_that_dies_at_1_metre_a_second_leaves_a_board_that_stops(
    number: signal.Signals, timeout: str, limit: float, tmp_path: Path
) -> None:
    async def body() -> None:
        config = load(None, [*ENDLESS, *PATIENT, f"board.link_timeout={timeout}"]).config
        board, path = Board(config), tmp_path / "board"
        listener = listen_pty(str(path), board.paced)
        await board.power_up()
        passed = passing(board.runtime)
        speed = lambda: board.runtime.hal.vehicle.state.v  # type: ignore[attr-defined] # noqa: E731
        outputs = lambda: board.runtime.hal.outputs[:3]  # type: ignore[attr-defined] # noqa: E731
        try:
            async with AsyncExitStack() as hosts:
                host = await driving(hosts, path, speed)
                host.send_signal(number)
                with lateness() as late:
                    # on a busy computer the board may read the host's last words late, and stop again
                    await until(lambda: abs(speed()) < 0.05 and outputs() == Outputs()[:3])
                command = board.runtime.state.command
                assert command is not None and command.v == 1.0, "its last words were to drive on"
                assert passed[-1].time - passed[-1].given <= limit + TICK + (late() if timeout == "null" else 0.0)
        finally:
            await board.power_down()
            listener.close()

    run(body())


@pytest.mark.long
@pytest.mark.parametrize("way", ["killed", "unplugged"])
def test_a_host_whose_board_vanishes_notices_stays_up_and_finds_it_again(way: str, tmp_path: Path) -> None:
    path, found_again = tmp_path / "board", []

    async def body() -> None:
        async with process(*board_words(path)) as first:
            await until(path.is_symlink)
            async with Robot.open(config=host_config(path), arm=True) as robot:
                assert await robot.load_gains()
                await robot.drive(0.5, 0.0, 1.0)
                gone = robot.now
                first.send_signal(signal.SIGKILL if way == "killed" else signal.SIGTERM)
                with lateness() as late:
                    await until(lambda: not robot.armed)
                assert robot.now - gone <= 0.5 + LATE + 3.0 * late()
                assert "lost" in robot.reason
                await first.wait()
                await asyncio.sleep(1.5)
                async with process(*board_words(path)):
                    await until(lambda: path.exists())
                    back = robot.now
                    with lateness() as late:
                        await until(lambda: robot.faults["reconnects"] == 1)
                    assert robot.now - back <= 1.0 + LATE + 3.0 * late()
                    await robot.linked(LIMIT)
                    assert not robot.armed
                    await until(lambda: robot.runtime.state.gains.loaded)
                    robot.arm()
                    x = robot.odometry.x
                    await robot.drive(0.5, 0.0, 2.0)
                    assert robot.odometry.x - x > 0.5, "it has its gains again"
                    await until(lambda: robot.stop_state is Stop.STANDING)
                    found_again.append(True)

    with suppress(StopNotVerified):  # where the board went before it was seen to stand
        run(body())
    assert found_again


@pytest.mark.long
def test_a_board_that_is_stopped_is_noticed_and_its_return_too(tmp_path: Path) -> None:
    path = tmp_path / "board"

    async def body() -> None:
        async with process(*board_words(path)) as board:
            await until(path.is_symlink)
            async with Robot.open(config=host_config(path), arm=True) as robot:
                assert await robot.load_gains()
                await robot.drive(0.5, 0.0, 1.0)
                stopped = robot.now
                board.send_signal(signal.SIGSTOP)
                with lateness() as late:
                    await until(lambda: not robot.armed)
                assert robot.now - stopped <= 0.5 + LATE + 3.0 * late()
                await asyncio.sleep(2.0)
                board.send_signal(signal.SIGCONT)
                await robot.linked(LIMIT)
                assert not robot.armed
                assert robot.faults["reconnects"] == 0, "the line was there all the time"

    with pytest.raises(StopNotVerified, match="this was not seen: there was no odometry") as told:
        run(body())
    assert told.value.__cause__ is None, "an error in the body would be its cause"


@pytest.mark.long
def test_a_host_does_not_open_what_a_killed_board_has_left_behind(tmp_path: Path) -> None:
    """The pseudo-terminal's name may belong to somebody else's terminal by now."""
    path = tmp_path / "board"

    async def body() -> None:
        async with process(*board_words(path)) as board:
            await until(path.is_symlink)
            async with Robot.open(config=host_config(path)) as robot:
                board.send_signal(signal.SIGKILL)
                await board.wait()
                strangers = [os.openpty() for _ in range(20)]
                assert os.readlink(path) in [os.ttyname(slave) for _, slave in strangers]
                await asyncio.sleep(2.5)
                assert robot.faults["reconnects"] == 0
                board_text = robot.runtime.state.board
                assert board_text is not None and "left behind" in board_text.text
                for pair in strangers:
                    assert not select.select([pair[0]], [], [], 0.0)[0], "nobody wrote to it"
                    for fd in pair:
                        os.close(fd)

    run(body())


def test_a_board_whose_serial_device_is_unplugged_serves_it_again_when_it_is_back(tmp_path: Path) -> None:
    device = tmp_path / "adapter"

    def adapter() -> int:
        """Plug one in; the host's side of its cable."""
        host, board = os.openpty()
        tty.setraw(board)
        os.set_blocking(host, False)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(board))
        os.close(board)
        return host

    def answers(host: int) -> bool:
        try:
            os.write(host, encode(Velocity(0.0, 0.0)))
            return b"\xfa\xfb" in os.read(host, 1 << 12)
        except OSError:  # nothing yet, or the board has not opened it
            return False

    async def body() -> None:
        config = load(None, []).config
        board, host = Board(config), adapter()
        place = DevicePlace(board, str(device))
        await place.open()
        await board.power_up()
        try:
            await until(lambda: answers(host))
            os.close(host)
            await until(lambda: board.link is None)
            host = adapter()
            await until(lambda: answers(host))
            os.close(host)
        finally:
            await board.power_down()
            place.close()

    run(body())


@pytest.mark.long
def test_an_agent_goes_on_learning_on_a_board_while_its_gate_is_shut(tmp_path: Path) -> None:
    path, example = tmp_path / "board", ROOT / "examples" / "learn_on_the_robot.py"

    async def body() -> str:
        async with process("board", "--pty", str(path), "--set", "sim.room.length=40", "--set", "sim.room.width=40"):
            await until(path.exists, LIMIT)
            words = (sys.executable, str(example), str(path), "0.5")
            learns = await asyncio.create_subprocess_exec(*words, cwd=ROOT, stdout=asyncio.subprocess.PIPE)
            told, _ = await asyncio.wait_for(learns.communicate(), 4.0 * LIMIT)
            assert learns.returncode == 0
            return told.decode().splitlines()[-1]

    counted, _, shut = map(int, re.findall(r"\d+", asyncio.run(body()))[:3])
    assert counted > 0 and shut == 1
