"""The work on scans: in the event loop in virtual time, else in a process of its own.

How it works
------------

*In virtual time* no task can be late. So `Near` works at once, and the same drive gives the same results to the bit.

*On the real clock* `Far` starts a process and gives it a scan at a time. Of the scans that come meanwhile, only the
newest waits. A thread of the robot waits for each answer; it holds the interpreter lock for some microseconds only. The
process is compiled and ready before the robot drives. From then on it has a lower priority. It ignores Ctrl-C.

*The line* between the two is a socket pair. Each message is its length (4 bytes), and the exact bytes of a value
(`txt1.telemetry.exact`). After any end of the robot's process, the worker finds its line closed, saves the map and
ends.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.errors import HalError, Txt1Error
from txt1.kernel import timeslice
from txt1.mapping import scan_work
from txt1.mapping.scan_work import ScanTask, Work
from txt1.mapping.topics import MapNews
from txt1.sidecar import NICENESS, end_beside, start_beside
from txt1.telemetry import exact

LENGTH: Final = struct.Struct("<I")
MESSAGE_MAX: Final = 1 << 28
"""Bytes."""
ENDING: Final = 2.0
"""s that the process has to end after its last message."""


class Ready(NamedTuple):
    """Sent when the process is ready."""

    error: str = ""


class Finished(NamedTuple):
    """Sent when the process has finished its work."""

    lines: tuple[str, ...] = ()


class Near:
    """Works in the event loop."""

    def __init__(self, make: Callable[[], Work]) -> None:
        self._make = make
        self._work: Work | None = None
        self.done: deque[MapNews] = deque()
        """The results, oldest first; the reader removes them."""
        self.failure = ""
        """Why it has stopped working; empty while it works."""

    async def open(self) -> None:
        """Start."""
        self._work = self._make()

    def give(self, task: ScanTask) -> None:
        """Work on a scan."""
        assert self._work is not None
        self.done.append(self._work.take(task))

    async def finish(self) -> list[str]:
        """End the work, and return lines for the event log."""
        work, self._work = self._work, None
        return [] if work is None else work.finish()


class Far:
    """Works in a process of its own; `options` are those of `main`."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self._options = options
        self.done: deque[MapNews] = deque()
        """The results, oldest first; the reader removes them."""
        self.failure = ""
        """Why it has stopped working; empty while it works."""
        self._todo: ScanTask | None = None
        self._wake = threading.Condition()
        self._over = False
        self._lines: list[str] = []
        self._thread: threading.Thread | None = None
        self._ended = asyncio.Event()
        self._child: subprocess.Popen[bytes] | None = None

    async def open(self) -> None:
        """Start the process, and wait until it is ready; raises HalError."""
        ours, theirs = socket.socketpair()
        program = (sys.executable, "-m", "txt1.mapping.worker")
        try:
            with theirs:
                words = [json.dumps(dict(self._options))]
                self._child = await asyncio.to_thread(start_beside, theirs.fileno(), program, words, False, None)
            self._line = ours
            told = await self._ready()
        except OSError as error:
            ours.close()
            raise HalError(f"the process that works on the map cannot be started: {error}") from None
        if told is None or told.error:
            ours.close()
            await asyncio.to_thread(end_beside, self._child, ENDING)
            raise HalError(f"the process that works on the map has ended: {told.error if told else 'see above'}")
        self._over = False
        self._ended.clear()
        loop = asyncio.get_running_loop()
        self._thread = threading.Thread(target=self._serve, args=(loop,), daemon=True, name="map")
        self._thread.start()

    async def _ready(self) -> Ready | None:
        """Wait until the process is ready; None if it has ended. Cancelled, it does not wait for the compiler."""
        try:
            return await asyncio.to_thread(receive, self._line, Ready)
        except asyncio.CancelledError:
            self._line.shutdown(socket.SHUT_RDWR)
            self._line.close()
            if self._child is not None:
                await asyncio.to_thread(end_beside, self._child, 0.0)
            raise

    def give(self, task: ScanTask) -> None:
        """Queue a scan for the process; a scan that is still waiting is dropped."""
        with self._wake:
            if self._todo is not None and task.place is None:
                task = task._replace(place=self._todo.place)
            self._todo = task
            self._wake.notify()

    async def finish(self) -> list[str]:
        """Let the process end, however long it takes, and return lines for the event log.

        Cancelled, it ends at once, and the process goes on.
        """
        thread, self._thread = self._thread, None
        if thread is None:
            return []
        with self._wake:
            self._over = True
            self._wake.notify()
        await self._ended.wait()
        self._line.close()
        if self._child is not None:
            await asyncio.to_thread(end_beside, self._child, ENDING)
        return self._lines if not self.failure else [*self._lines, self.failure]

    def _serve(self, loop: asyncio.AbstractEventLoop) -> None:
        """In the thread: send the newest scan, and receive its result."""
        line = self._line
        try:
            while True:
                with self._wake:
                    while self._todo is None and not self._over:
                        self._wake.wait()
                    if self._over:
                        break
                    task, self._todo = self._todo, None
                send(line, task)
                news = receive(line, MapNews)
                if news is None:
                    raise EOFError
                self.done.append(news)
            line.shutdown(socket.SHUT_WR)
            told = receive(line, Finished)
            self._lines = [] if told is None else list(told.lines)
        except (OSError, EOFError, ValueError) as error:
            said = "" if isinstance(error, EOFError) else f": {error}"
            self.failure = f"the process that works on the map has ended{said}"
        finally:
            # the loop may have ended before
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self._ended.set)


def send(line: socket.socket, value: object) -> None:
    """Send a value; raises OSError."""
    data = exact.encode(value)
    line.sendall(LENGTH.pack(len(data)) + data)


def receive(line: socket.socket, kind: type[Any]) -> Any:
    """Return the next value, None if the other end is gone; raises OSError, ValueError."""
    head = _bytes(line, LENGTH.size)
    if head is None:
        return None
    (length,) = LENGTH.unpack(head)
    if length > MESSAGE_MAX:
        raise ValueError(f"a message of {length} bytes")
    data = _bytes(line, length)
    return None if data is None else exact.decode(kind, data)


def _bytes(line: socket.socket, count: int) -> bytes | None:
    data = bytearray()
    while len(data) < count:
        try:
            part = line.recv(min(count - len(data), 1 << 20))
        except ConnectionError:
            return None
        if not part:
            return None
        data += part
    return bytes(data)


# -- in the other process ----------------------------------------------------------------------------------------


def made(options: Mapping[str, Any]) -> Work:
    """Return the requested work; raises Txt1Error."""
    if "room" in options:
        return scan_work.locating(options["room"], options["seed"])
    return scan_work.Mapping(Path(options["make"]), options["resolution"], saves=True)


def main(fd: str, options: str) -> None:
    """Work on scans that come through the socket `fd` until it is closed."""
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # the robot's process decides when it is over; when it is gone, the line is closed
        signal.signal(each, signal.SIG_IGN)
    with socket.socket(fileno=int(fd)) as line:
        asked = json.loads(options)
        try:
            scan_work.warm()
            work = made(asked)
        except (Txt1Error, ImportError) as error:
            send(line, Ready(str(error)))
            return
        # compiling first, at this priority, a busy computer never got done
        timeslice.ordinary(os.getpid(), NICENESS, session=True)
        send(line, Ready())
        while (task := receive(line, ScanTask)) is not None:
            try:
                send(line, work.take(task))
            except ConnectionError:
                break
        lines = tuple(work.finish())
        try:
            send(line, Finished(lines))
        except OSError:
            # the robot's process is gone
            return


if __name__ == "__main__":
    # under the module's own name, by which values find their types
    from txt1.mapping.worker import main as begin

    begin(*sys.argv[1:])
