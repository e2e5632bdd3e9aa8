"""The robot's side of the terminal: starts the drawing process, obeys its keys, sends it the newest snapshot.

Only a heartbeat of the drawing process renews a command from the keyboard. So when this process falls silent, the
command goes stale, and the robot stops by the ordinary rule.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from math import inf
from types import TracebackType
from typing import Final, Literal, Protocol, Self

from txt1.errors import CommandRefused, NotCapable, TerminalLost
from txt1.hal.base import Button
from txt1.sidecar import BEAT, TELEMETRY_PERIOD, Request, Sidecar
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import tty
from txt1.ui.teleop import Teleop

Reason = Literal["quit", "lost"]

# s between snapshots
SNAPSHOT_PERIOD: Final = 0.1
# s: older keys, found after this process was delayed, no longer drive or arm
KEY_AGE_MAX: Final = 0.5
_BUTTONS: Final = dict(zip(("left", "right", "up", "down", "c"), Button, strict=True))
DRIVES: Final = frozenset("wsad")
_ALWAYS: Final = frozenset(("space", "x", "q"))


class Operated(Protocol):
    """The subject of the screens, which obeys the keys: a robot, a board, a fleet, a recording."""

    @property
    def now(self) -> float:
        """Seconds since the run started."""

    @property
    def snapshot(self) -> Snapshot:
        """Return the values for the screens."""

    def stop(self) -> None:
        """Stop at once."""

    def arm(self) -> None:
        """Arm, or refuse."""

    def disarm(self, reason: str) -> None:
        """Disarm."""

    def press(self, button: Button) -> None:
        """Press a button of the joystick."""

    def tell(self, text: str) -> None:
        """Add a line to the event log."""


class Driven(Protocol):
    """The receiver of the driving keys' commands."""

    def hold(self, v: float, omega: float, time: float, /) -> object:
        """Command m/s and rad/s as long as keys are held; `time` is the origin, s of the run."""

    def release(self) -> None:
        """Release the wheel."""


class DrivingKeys(Protocol):
    """The meaning of the driving keys."""

    def key(self, key: str, now: float, /) -> str | None:
        """Take a key; return what it has changed, in words, unless that is seen anyway."""

    def command(self, now: float, /) -> tuple[float, float] | None:
        """Return the command in m/s and rad/s; None without a command. Raises CommandRefused: its hold has ended."""

    def release(self) -> None:
        """Release all keys."""


class Terminal:
    """``async with Terminal(robot) as terminal: reason = await terminal.wait()``.

    The keys are for `robot`. `keys` takes the commands of the driving keys; None: the driving keys do nothing. `beat`
    is the time between heartbeats of the drawing process, s of real time. `shown` are the keys of the last row and
    their meaning, by default a robot's. `more` are the actions of further keys (m, e, b, r, n, x, p); they may refuse.
    `idle` returns why a driving key moves nothing, "" if it does. `waits`: a simulation, whose time waits for a busy
    computer, so no key is too old for it.
    Entering raises TerminalLost if standard input or output is no terminal.
    """

    def __init__(
        self,
        robot: Operated,
        keys: Driven | None = None,
        beat: float = BEAT,
        teleop: DrivingKeys | None = None,
        shown: Mapping[str, str] | None = None,
        more: Mapping[str, Callable[[], None]] | None = None,
        idle: Callable[[], str] = lambda: "",
        waits: bool = False,
    ) -> None:
        self._robot, self._keys, self._waits = robot, keys, waits
        # times of the newest command and of the newest snapshot, s of the run
        self._origin = self._sent = -inf
        self._teleop: DrivingKeys = teleop or Teleop()
        self._more = more or {}
        self._idle = idle
        target, options = "txt1.ui.terminal_process:main", {"keys": shown, "waits": waits}
        self._beside = Sidecar(
            target, self.telemetry, self.request, options=options, beat=beat, lost=self._lost, on_terminal=True
        )
        self._quit = asyncio.Event()
        self.screens = self._beside.serve
        """A task for the robot's scheduler, of the lowest priority: it sends the snapshots from then on.

        Encoding a snapshot takes a quarter of a millisecond. Heartbeats come at any time, so if they encoded, the
        controller would have to wait in one tick of two hundred. A task waits for the controller instead.
        """

    async def __aenter__(self) -> Self:
        try:
            self._modes = tty.saved()
        except OSError as error:
            raise TerminalLost(f"standard input and output are no terminal ({error}): run it --headless") from error
        await self._beside.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._beside.__aexit__(kind, error, trace)
        # otherwise the process has cleaned up
        killed = self._beside.returncode is not None and self._beside.returncode < 0
        await asyncio.shield(asyncio.to_thread(tty.put_back, self._modes, killed))

    async def wait(self) -> Reason:
        """Wait; return "quit" when the user pressed q, "lost" when the drawing process ended unasked.

        Raises an error that a key caused in the robot, except a refusal.
        """
        ended, quitting = asyncio.ensure_future(self._beside.ended()), asyncio.ensure_future(self._quit.wait())
        try:
            await asyncio.wait((ended, quitting), return_when=asyncio.FIRST_COMPLETED)
            if ended.done():
                ended.result()
            return "quit" if quitting.done() else "lost"
        finally:
            ended.cancel()
            quitting.cancel()

    def telemetry(self) -> bytes | None:
        """Return a snapshot, ten times a second."""
        now = self._robot.now
        # at the nearest tick
        if now < self._sent + SNAPSHOT_PERIOD - 0.5 * TELEMETRY_PERIOD:
            return None
        self._sent = now
        return self._robot.snapshot.encode()

    def request(self, request: Request) -> None:
        """Obey the keys, and renew the command."""
        age = 0.0 if self._waits else request.age
        fresh = age <= KEY_AGE_MAX
        for key in request.fields.get("keys", ()):
            if fresh or key in _ALWAYS:
                self.obey(key)
        if fresh and not self._quit.is_set():
            self._origin = max(self._origin, self._robot.now - age)
            self._try(self._drive)

    def obey(self, key: str) -> None:
        """Carry out a key."""
        robot = self._robot
        if key == "space":
            robot.stop()
            self._let_go()
        elif key == "q":
            self._let_go()
            self._quit.set()
        elif key == "m":
            # a key pressed while stopped does not count
            self._let_go()
            self._try(self._more.get("m", robot.arm))
        elif key in self._more:
            self._try(self._more[key])
        elif key in _BUTTONS:
            self._try(lambda: robot.press(_BUTTONS[key]))
        elif key == "ctrl-z":
            robot.tell("Ctrl-Z does nothing here: a robot that is suspended cannot stop; q quits")
        else:
            said = self._teleop.key(key, robot.now) or (self._idle() if key in DRIVES else "")
            if said:
                robot.tell(said)

    def _drive(self) -> None:
        command = self._teleop.command(self._robot.now)
        if command is None:
            return
        if self._keys is None:
            raise CommandRefused("the driving keys do nothing here: the host drives")
        v, omega = command
        if v or omega:
            self._keys.hold(v, omega, self._origin)
        else:
            self._keys.release()

    def _let_go(self) -> None:
        self._teleop.release()
        if self._keys is not None:
            self._keys.release()

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except (CommandRefused, NotCapable) as refusal:
            # otherwise the refusal would be repeated at every heartbeat
            self._let_go()
            self._robot.tell(str(refusal))

    def _lost(self) -> None:
        self._let_go()
        self._robot.disarm("terminal lost")
