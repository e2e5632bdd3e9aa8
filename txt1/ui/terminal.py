"""The robot's side of the terminal: starts the drawing process, obeys its keys, sends it the newest snapshot.

A command from the keyboard is renewed at every heartbeat of the drawing process and at no other time, so when
that process falls silent the command goes stale and the robot stops by the ordinary rule.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Final, Literal, Protocol, Self

from txt1.errors import CommandRefused, NotCapable, TerminalLost
from txt1.hal.base import Button
from txt1.kernel.ticks import Ticks
from txt1.tasks.fields import Snapshot
from txt1.ui import frames, modes
from txt1.ui.teleop import Teleop

Reason = Literal["quit", "lost"]

TTY_IN: Final = 0
TTY_OUT: Final = 1

PATIENCE: Final = 1.0
"""s that the drawing process gets to end by itself, in real time."""

NICENESS: Final = 10
"""Of the drawing process: on a processor they share, the robot's process is woken at once, not when a slice ends."""

PERIOD: Final = 0.1
PRIORITY: Final = -50
"""Of the task `Terminal.screens`: with the display task's period, behind all the robot's and the user's."""

BACKLOG: Final = 0.5
"""s of heartbeats: keys older than that, found after this process was held up, no longer drive or arm."""

LINE_MAX: Final = 1 << 16
"""Bytes of the longest heartbeat."""

_BUTTONS: Final = {
    "left": Button.LEFT,
    "right": Button.RIGHT,
    "up": Button.UP,
    "down": Button.DOWN,
    "c": Button.CENTRE,
}
_ALWAYS: Final = frozenset(("space", "q"))


class Robot(Protocol):
    """What the terminal needs of a robot."""

    @property
    def snapshot(self) -> Snapshot | None:
        """Everything to be shown, newest; None before the first."""

    @property
    def now(self) -> float:
        """Time of the run, s."""

    def command(self, v: float, omega: float) -> None:
        """Drive at v m/s and omega rad/s, until the command goes stale."""

    def stop(self) -> None:
        """Emergency stop."""

    def arm(self) -> None:
        """Open the safety gate; raises CommandRefused if that is not allowed now."""

    def disarm(self, reason: str) -> None:
        """Close the safety gate."""

    def press(self, button: Button) -> None:
        """Press a button of the joystick."""

    def tell(self, text: str) -> None:
        """Add to the event log."""


class Terminal:
    """``async with Terminal(robot) as terminal: reason = await terminal.wait()``.

    Args:
        robot: whom the keys are for.
        beat: s (real time) between the drawing process's heartbeats.
        speed: that w and s drive at first, m/s.
        turn: share of the largest yaw rate that a and d ask for.
        radius_min: R_min of the vehicle, m.

    Raises:
        TerminalLost: on entering, if standard input or output is no terminal.

    """

    def __init__(
        self, robot: Robot, beat: float = 0.05, speed: float = 0.5, turn: float = 0.8, radius_min: float = 0.56
    ) -> None:
        self._robot = robot
        self._beat = beat
        self._teleop = Teleop(speed, turn, radius_min)
        self._tail = b""
        self._shown: Snapshot | None = None
        self._sent = 0
        self._received = 0
        self._ticking = False
        self._unsent = b""

        self._finishing: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        try:
            self._modes = modes.saved(TTY_IN, TTY_OUT)
        except OSError as error:
            raise TerminalLost(f"standard input and output are no terminal ({error}): run it --headless") from error
        self._loop = asyncio.get_running_loop()
        self._ended: asyncio.Future[Reason] = self._loop.create_future()
        self._link, theirs = socket.socketpair()
        self._link.setblocking(False)
        try:
            with theirs:
                # in a thread: starting a process takes milliseconds, and virtual time waits for a thread
                self._child = await asyncio.to_thread(_start_drawing, theirs.fileno(), self._beat)
        except BaseException:
            self._link.close()
            raise
        self._loop.add_reader(self._link, self._readable)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # shielded: a second Ctrl-C must not leave the terminal behind as it is now
        await asyncio.shield(self._finish())

    async def wait(self) -> Reason:
        """ "quit" when the user pressed q, "lost" when the drawing process ended unasked.

        Raises whatever the robot raised on a key, unless it merely refused.
        """
        return await asyncio.shield(self._ended)

    def _readable(self) -> None:
        """Take what the drawing process sent; its end means that the operator is gone."""
        try:
            alive = self._receive()
        except Exception as error:
            # asyncio would only log it; `wait` hands it on
            self._loop.remove_reader(self._link)
            if not self._ended.done():
                self._ended.set_exception(error)
            return
        if not alive:
            self._teleop.release()
            self._finish().add_done_callback(lambda _: self._end("lost"))
            self._robot.disarm("terminal lost")

    def _receive(self) -> bool:
        """Obey the heartbeats that have arrived; False at the end of the stream."""
        data, alive = _read_all(self._link)
        *lines, self._tail = (self._tail + data).split(b"\n")
        if len(self._tail) > LINE_MAX:
            raise TerminalLost("the drawing process sent a line without end")
        fresh = max(1, round(BACKLOG / self._beat))
        for age, line in enumerate(lines, start=-len(lines)):
            heartbeat = json.loads(line)
            for key in heartbeat["keys"]:
                if age >= -fresh or key in _ALWAYS:
                    self._obey(key)
            self._received = heartbeat["drawn"]
        if not self._ticking:
            self._send_snapshot()
        if lines and alive and not self._ended.done():
            command = self._teleop.command(self._robot.now)
            if command is not None:
                self._try(lambda: self._robot.command(*command))
        return alive

    def _obey(self, key: str) -> None:
        """Do what a key means."""
        robot = self._robot
        if key == "space":
            self._teleop.release()
            robot.stop()
        elif key == "q":
            self._teleop.release()
            self._end("quit")
        elif key == "m":
            self._teleop.release()  # a key pressed while stopped does not count
            self._try(robot.arm)
        elif key in _BUTTONS:
            self._try(lambda: robot.press(_BUTTONS[key]))
        else:
            self._teleop.key(key, robot.now)

    def _try(self, action: Callable[[], None]) -> None:
        """Do it, or tell the user why the robot refused."""
        try:
            action()
        except (CommandRefused, NotCapable) as refusal:
            self._teleop.release()  # or the refusal would be repeated at every heartbeat
            self._robot.tell(str(refusal))

    async def screens(self, ticks: Ticks) -> None:
        """A task for the robot's scheduler, of the lowest priority: there the snapshots are sent from now on.

        To make bytes of one takes a quarter of a millisecond. With the heartbeats, which come at any time, one tick of
        the controller in two hundred would have to wait for it; among the tasks it waits for the controller.
        """
        self._ticking = True
        async for _ in ticks:
            if self._finishing is None:
                self._send_snapshot()

    def _send_snapshot(self) -> None:
        """Send the newest snapshot if the last one has been received: never more than one is on its way."""
        if not self._unsent:
            snapshot = self._robot.snapshot
            if self._received != self._sent or snapshot is None or snapshot is self._shown:
                return
            self._shown, self._sent = snapshot, self._sent + 1
            self._unsent = frames.encode(snapshot)
        try:
            self._unsent = self._unsent[self._link.send(self._unsent) :]
        except (BlockingIOError, ConnectionError):
            return  # next time, if there is one

    def _end(self, reason: Reason) -> None:
        """Let `wait` return."""
        if not self._ended.done():
            self._ended.set_result(reason)

    def _finish(self) -> asyncio.Task[None]:
        """The task, started once, that ends the drawing process and restores the terminal."""
        if self._finishing is None:
            self._loop.remove_reader(self._link)
            self._link.close()
            self._finishing = self._loop.create_task(asyncio.to_thread(_end_drawing, self._child, self._modes))
        return self._finishing


def _read_all(link: socket.socket) -> tuple[bytes, bool]:
    """What has arrived, and whether more can come."""
    data = b""
    try:
        while chunk := link.recv(1 << 16):
            data += chunk
    except BlockingIOError:
        return data, True
    except ConnectionError:
        return data, False
    return data, False


def _start_drawing(fd: int, beat: float) -> subprocess.Popen[bytes]:
    """The drawing process, which inherits the terminal and the socket `fd`; to be called in a thread."""
    # Ctrl-C goes to the whole foreground group: the child is born deaf to it, before it can say so itself
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        command = [sys.executable, "-m", "txt1.ui.drawing", "--fd", str(fd), "--interval", str(beat)]
        child = subprocess.Popen(command, pass_fds=(fd,))  # noqa: S603 - our own module
        with suppress(OSError):  # it has ended already
            os.setpriority(os.PRIO_PROCESS, child.pid, NICENESS)
        return child
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_drawing(child: subprocess.Popen[bytes], saved: modes.Modes) -> None:
    """Wait for the drawing process to end, end it if it does not, and put the terminal back; in a thread."""
    try:
        child.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
    if child.returncode < 0:  # killed by a signal it could not handle; in any other case it has cleaned up
        modes.leave_screen(TTY_OUT)
    modes.restore(TTY_IN, saved)
