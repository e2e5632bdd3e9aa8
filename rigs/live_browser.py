"""A robot with its web page, in real time, in a thread of its own: browsers are driven from the main one."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import AsyncExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple, TypeVar

from rigs.patience import LIMIT, TXT1, surviving, wait_until
from rigs.ports import free_port
from txt1.bridges.registry import bridge
from txt1.bridges.services import Services
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.kit.app import real_time
from txt1.robot import Robot
from txt1.sidecar import Sidecar
from txt1.web.robot_end import cameras_of

T = TypeVar("T")

CHROMIUM = next((path for path in ("/usr/bin/chromium", "/usr/bin/chromium-browser") if os.path.exists(path)), None)
"""A distribution's browser."""
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
)


class Sample(NamedTuple):
    """One tick of the controller, on the monotonic clock, and the set-point behind the gate."""

    time: float
    v: float
    omega: float
    origin: float  # of the command behind it, on the same clock


class Live:
    """The robot, its set-points tick by tick, and the page's address."""

    def __init__(self, robot: Robot, loop: asyncio.AbstractEventLoop, port: int) -> None:
        self.robot, self.loop, self.port = robot, loop, port
        self.samples: list[Sample] = []
        self.beside: Sidecar
        """The page's server."""
        self.eyes: Sidecar | None = None
        """The server of the cameras' pictures, and its port, if there are any."""
        self.camera = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    @property
    def pid(self) -> int:
        """Of the page's server; 0 while there is none."""
        return self.beside.pid or 0

    @property
    def restarts(self) -> int:
        """How often the page's server was started again."""
        return self.beside.counts["restarts"]

    def call(self, do: Callable[[Robot], T]) -> T:
        """What `do` returns, called in the robot's loop."""
        answer: Future[T] = Future()
        self.loop.call_soon_threadsafe(lambda: answer.set_result(do(self.robot)))
        return answer.result(LIMIT)

    def until(self, condition: Callable[[Robot], object], limit: float = LIMIT) -> None:
        """Wait until something is true of the robot; TimeoutError when it does not come true."""
        wait_until(lambda: self.call(condition), limit)

    async def watch(self, ticks: Ticks) -> None:
        state = self.robot.runtime.state
        async for _ in ticks:
            present = monotonic()
            origin = present if state.command is None else present - (self.robot.now - state.command.time)
            self.samples.append(Sample(present, state.control.v, state.control.omega, origin))

    def misses(self) -> int:
        return self.call(lambda robot: robot.runtime.statistics()["controller"].misses)


@contextmanager
def live(
    settings: Sequence[str] = (),
    *,
    hal: str = "sim",
    folder: Path = Path("out/recordings"),
    speed: float = 0.5,
    realtime: bool = False,
    silence: float = LIMIT,
    **options: Any,
) -> Iterator[Live]:
    """A robot, armed, its gains loaded, and its page; `options` are the server's.

    With `realtime` it asks to go before all other programs, as `txt1 run --realtime` does. A server that is silent for
    `silence` s is ended and started again.
    """
    port = free_port()
    begun: Future[tuple[asyncio.AbstractEventLoop, asyncio.Task[None]]] = Future()
    started: Future[Live] = Future()
    given = {"port": port, "folder": str(folder), "speed": speed, **options}
    main = partial(_main, begun, started, hal, settings, given, folder, realtime, silence)
    # a daemon, so that a robot that does not end fails one test and does not keep the program
    thread = threading.Thread(target=lambda: run(main()), name="robot", daemon=True)
    with surviving():
        thread.start()
        try:
            yield started.result(LIMIT)
        finally:
            loop, task = begun.result(LIMIT)
            with suppress(RuntimeError):
                # the loop has ended by itself
                loop.call_soon_threadsafe(task.cancel)
            thread.join(LIMIT)
            assert not thread.is_alive(), "the robot did not end"


async def _answers(port: int) -> None:
    """Wait until something listens there."""
    while True:
        try:
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.close()
            return
        except OSError:
            await asyncio.sleep(0.05)


async def _main(
    begun: Future[tuple[asyncio.AbstractEventLoop, asyncio.Task[None]]],
    started: Future[Live],
    hal: str,
    settings: Sequence[str],
    given: dict[str, Any],
    folder: Path,
    realtime: bool,
    silence: float,
) -> None:
    task = asyncio.current_task()
    assert task is not None
    begun.set_result((asyncio.get_running_loop(), task))
    try:
        async with Robot.open(hal=hal, seed=1, settings=settings) as robot, AsyncExitStack() as rights:
            if realtime:
                rights.enter_context(real_time(robot))
            await robot.load_gains()
            if not robot.armed:
                robot.arm()
            here = Live(robot, asyncio.get_running_loop(), given["port"])
            robot.add_task("watch", 0.02, here.watch, -10)
            services = Services(robot, robot.config, None, folder)
            if cameras := cameras_of(robot):
                here.camera = given["camera"] = free_port()
                page = {name: given[name] for name in ("host", "token", "certificate", "key") if name in given}
                looks = {"host": "127.0.0.1", **page, "port": here.camera, "page": here.port, "cameras": cameras}
                here.eyes = await rights.enter_async_context(bridge(robot, "web_camera", looks, silence=silence))
                await _answers(here.camera)
            async with bridge(robot, "web", given, services.requests, silence=silence) as beside:
                await _answers(here.port)
                here.beside = beside
                started.set_result(here)
                with suppress(asyncio.CancelledError):
                    await asyncio.Future()
                task.uncancel()
            await services.close()
    except asyncio.CancelledError:
        # nobody waits for it any more
        return
    except BaseException as error:
        if not started.done():
            started.set_exception(error)
        raise


@contextmanager
def command(*words: str) -> Iterator[str]:
    """A command with a page, and the page's address."""
    port = free_port()
    with subprocess.Popen([*TXT1, *words, "--web", str(port), "--headless"], stdout=subprocess.DEVNULL) as process:
        try:
            yield f"http://127.0.0.1:{port}/"
        finally:
            process.send_signal(signal.SIGINT)


def arrive(page: Any, url: str) -> None:
    """Open a page of a robot that is still on its way up."""

    def answers() -> bool:
        try:
            page.goto(url)
            return True
        except Exception:
            return False

    wait_until(answers, look=0.5)
