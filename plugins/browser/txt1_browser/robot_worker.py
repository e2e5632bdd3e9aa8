"""The robot in a browser's worker: it runs the robot of `txt1 run`, and is the server of the one page.

How it works. static/worker.js loads Python and makes a `RobotWorker`. Texts of the page come by `receive`, and go by
`post`: the page cannot tell it from a socket. Requests of the page go through the same table of requests, budgets and
the wheel (`txt1.web.requests`), the robot's end (`txt1.bridges.registry`) and the gate as those of a page on a network;
only the process between is missing. `turn` runs the loop.
"""

from __future__ import annotations

import ast
import asyncio
import json
import traceback
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from math import inf
from pathlib import Path
from typing import Final

import txt1
from txt1 import Robot
from txt1.bridges.registry import RobotEnd
from txt1.bridges.services import services
from txt1.config import load
from txt1.errors import Txt1Error
from txt1.kernel.ticks import Ticks
from txt1.learning.live_learner import beside
from txt1.learning.options import Learner
from txt1.learning.registry import agent_of
from txt1.record.session import dated, recording
from txt1.sidecar import SERVE_PRIORITY, TELEMETRY_PERIOD, Request
from txt1.web.budgets import Budgets
from txt1.web.pages import Page, Pages, now
from txt1.web.player import RECORDING_NAME
from txt1.web.requests import take
from txt1_browser.event_loops import BrowserRealTimeLoop
from txt1_browser.serial_line import CAREFUL, GuardedPort, Send, board

FOLDER: Final = Path("/recordings")
# s between two messages about a page's own state, and between two parts of the recording for it to keep
STATUS: Final = 1.0
PROGRAM: Final = "program"
GAINS_UNCONFIRMED: Final = "the board has not acknowledged the gains yet; they are sent again and again"

Post = Callable[[str], None]
Keep = Callable[[str, int, bytes, bool], None]
"""Gives the page bytes of a recording: the file's name, where they begin, they, and whether more will come."""


class _Line:
    """Pages' connection to the robot, in the same process."""

    def __init__(self, end: RobotEnd) -> None:
        self._end = end

    def fileno(self) -> int:
        """There is no descriptor: `newest` is asked in each turn."""
        raise NotImplementedError

    def newest(self) -> bytes | None:
        """Return the newest telemetry; None: none is due."""
        return self._end.telemetry()

    def request(self, name: str, /, **fields: object) -> None:
        """Make a request, as text, so that nothing is shared that a page on a network could not send."""
        self._end.request(Request(name, json.loads(json.dumps(fields)), 0.0))


class _Socket:
    """The page's socket."""

    def __init__(self, post: Post) -> None:
        self._post = post

    async def send_str(self, data: str) -> None:
        """Send a text."""
        self._post(data)

    async def close(self, *, code: int = 1000, message: bytes = b"") -> bool:
        """Do nothing: the page and its worker end together."""
        return True


class RobotWorker:
    """A robot and its page. `post` sends a text to the page; `tell` says something, and if it is bad; "": ready."""

    def __init__(self, post: Post, tell: Callable[[str, bool], None], keep: Keep) -> None:
        self._post, self._tell, self._keep = post, tell, keep
        self._loop = BrowserRealTimeLoop()
        self._pages: Pages | None = None
        self._page: Page | None = None
        self._sender: asyncio.Task[None] | None = None
        self._run: asyncio.Task[None] | None = None
        # held by a run to its very end, for which the next one waits
        self._alone = asyncio.Lock()
        # the run's recording, and how many bytes of each the page has
        self._file, self._kept = "", dict[str, int]()
        self._robot: Robot | None = None
        # a program of the page
        self._program: asyncio.Task[None] | None = None
        # of a board; None for a simulation
        self._port: GuardedPort | None = None
        FOLDER.mkdir()

    # -- called by the worker ----------------------------------------------------------------------------------

    def begin(self, settings: Sequence[str], send: Send | None, learn: str | None) -> None:
        """Start a robot, after the end of the one before it; settings are ``a.b=c`` each.

        `send` is the way to the guard of a board; None: simulated. `learn` is the name of a learner that drives.
        """
        if self._run is not None:
            self._run.cancel()
        port = None if send is None else GuardedPort(send)
        self._run = self._loop.create_task(self._guarded(list(settings), port, learn))

    def turn(self) -> float:
        """Run what is due; return after how many ms to call again; -1: when something has come."""
        pause = self._loop.turn()
        return -1.0 if pause == inf else 1000.0 * pause

    def open(self) -> None:
        """Take a page's new connection."""
        self._loop.call_soon(self._join)

    def receive(self, text: str) -> None:
        """Take a text of the page."""
        self._loop.call_soon(self._receive, text)

    def heard(self, what: str, text: str) -> None:
        """Take a message of the board's guard."""
        if self._port is not None:
            self._loop.call_soon(self._port.heard, what, text)

    def perform(self, code: str) -> None:
        """Run a program of the page, in place of the one before it; it has the names `robot`, `asyncio` and `txt1`."""
        if self._program is not None:
            self._program.cancel()
        if self._robot is None:
            self._tell("there is no robot yet: run the program again when it is there", True)
        else:
            self._program = self._loop.create_task(self._perform(code, self._robot))

    def keep(self, name: str, data: bytes) -> None:
        """Keep a recording that was made elsewhere."""
        if not RECORDING_NAME.fullmatch(name):
            self._tell(f"{name}: no name of a recording; it ends with .mcap", True)
        elif (FOLDER / name).exists():
            self._tell(f"{name}: there is such a recording already; give the file another name", True)
        else:
            (FOLDER / name).write_bytes(data)
            self._pass_on()
            # the page's list shows it
            self.receive('{"do": "files"}')

    # -- inside ------------------------------------------------------------------------------------------------

    async def _guarded(self, settings: Sequence[str], port: GuardedPort | None, learn: str | None) -> None:
        async with self._alone:
            self._port = port
            try:
                await self._drive(settings, port, learn)
            except (Txt1Error, ImportError) as error:
                self._tell(str(error), True)
            except Exception as error:
                traceback.print_exc()
                self._tell(f"a mistake in the program: {type(error).__name__}: {error}", True)
            finally:
                self._file = ""
                self._pass_on()

    async def _drive(self, settings: Sequence[str], port: GuardedPort | None, learn: str | None) -> None:
        if port is not None:
            settings = ["hal=serial", f"safety.v_max={CAREFUL}", *settings]
        config = load(None, settings, {}, {}).config
        layer = None if port is None else board(config, port)
        agent = agent_of(config, learn, None)
        file = dated(FOLDER, config.hal)
        self._file = file.name
        async with (
            recording(file, config, None, {}, lambda text: self._tell(text, True)) as attach,
            Robot.open(layer, config=config, patience=0.0, attach=attach) as robot,
        ):
            if port is not None:
                port.on_stop = robot.stop
            async with (
                nullcontext() if agent is None else beside(robot, Learner(learn, agent, None)),
                services(robot, None, FOLDER) as requests,
            ):
                end = RobotEnd(robot, "web", {**robot.requests, **requests, "stop": robot.stop})
                pages = Pages(_Line(end), FOLDER, robot.config.safety.v_max, {}, [], invites=False)
                pages.begin()
                robot.add_task("page", TELEMETRY_PERIOD, self._serve, SERVE_PRIORITY)
                self._pages, self._robot = pages, robot
                self._tell("", False)
                try:
                    await self._get_ready(robot)
                    await robot.runtime.scheduler.ended
                finally:
                    self._pages = self._robot = None
                    for each in filter(None, (self._program, self._sender)):
                        each.cancel()
                    end.let_go()
                    end.leave()

    async def _get_ready(self, robot: Robot) -> None:
        """Wait for the link, arm a simulation, load the gains."""
        await robot.linked()
        if robot.arms_by_itself and not robot.touched:
            robot.arm()
        while not await robot.load_gains():
            robot.tell(GAINS_UNCONFIRMED)
        for begin in robot.on_ready:
            await begin()

    async def _perform(self, code: str, robot: Robot) -> None:
        why, bad = "the program has ended", False
        try:
            # the page's own user wrote it, and it can do no more than the page
            compiled = compile(code, PROGRAM, "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
            if (rest := eval(compiled, {"robot": robot, "asyncio": asyncio, "txt1": txt1})) is not None:  # noqa: S307
                await rest
        except Exception as error:
            places = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == PROGRAM]
            line = error.lineno if isinstance(error, SyntaxError) else places[-1]
            why, bad = f"the program, line {line}: {error or type(error).__name__}", True
        finally:
            robot.program.command(0.0, 0.0)
        self._tell(why, bad)

    def _pass_on(self) -> None:
        """Give the page what was recorded since the last time, to keep when this worker is ended."""
        for path in FOLDER.iterdir():
            with path.open("rb") as file:
                file.seek(at := self._kept.get(path.name, 0))
                new = file.read()
            if new:
                self._keep(path.name, at, new, path.name == self._file)
            self._kept[path.name] = at + len(new)

    def _join(self) -> None:
        if self._pages is None:
            return
        account = Budgets().account("page")
        account.operator = True
        self._page = self._pages.join("operator", "page", _Socket(self._post), account)
        self._sender = self._loop.create_task(self._pages.send(self._page))

    def _receive(self, text: str) -> None:
        if self._pages is not None and self._page is not None:
            take(self._pages, self._page, text)

    async def _serve(self, ticks: Ticks) -> None:
        """Send the page telemetry and its own state, tick by tick."""
        due = now()
        async for _ in ticks:
            if self._port is not None:
                self._port.beat()
            if self._pages is None:
                continue
            self._pages.hear()
            if now() >= due:
                due = now() + STATUS
                self._pages.status_of_all()
                self._pass_on()
