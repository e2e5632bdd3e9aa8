"""A process beside the event loop: telemetry in, requests out, a heartbeat. Both ends of the line between them.

How it works
------------

Screens and bridges draw, compress and wait for networks. None of that may delay the tasks. So each of them is a process
of its own, and this module is the line to it: `Sidecar` is the robot's end, `Connection` is the process's end.

*The messages.* Both ends send one JSON object a line over a socket pair. The robot sends its newest telemetry, but only
after the last piece was received. So a slow reader gets fewer pieces, and none of them is old. The process sends
``{"time": ..., "received": ...}`` again and again as its heartbeat; for a request it adds "request" and further fields.
"time" is the origin's, in ns of the monotonic clock, which both processes share. So the robot knows how old a request
is, however late it is read.

*When it is read.* In real time, the task `serve` reads in its tick, behind all other tasks, and the socket never wakes
the event loop. With `prompt` its messages are read at once, except in the last millisecond before a tick. Before the
robot starts there is no `serve`; then a timer reads the line.

*A flood.* At most 20 messages are taken at a time; each tick allows 8 more. The rest is dropped and counted. An
emergency stop is never dropped: dropped and malformed messages are searched for one.

*The start.* A process has the full share of the processor until its first heartbeat, and less from then on. On a busy
computer the start may take minutes, which is no fault. So the process counts as hung only after `START` s in which it
used no processor time, or after `START` s of processor time. Both double with each failure.

*The end.* The line ends after a message that is too long, after a heartbeat that is too late (with `silence`), or when
the process ends. Its memory is limited, and the system ends it first when memory runs out. A process that failed is
started again, after longer and longer pauses, as often as `Restart` allows. A silent process loses the wheel by the
ordinary rule: its commands go stale. A trouble is told the first time, the tenth, the hundredth.

*A life.* `_start` starts the process and makes the line. `_drop` closes the line and puts the reason into the future
`_end`. The coroutine `_live` waits for that, reaps the process, and starts it again or returns the reason. All other
methods run in callbacks of the loop and never wait. Starting and reaping take milliseconds, so threads do both.
"""

import asyncio
import json
import resource
import select
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from importlib import import_module
from math import inf
from pathlib import Path
from types import FrameType
from typing import Any, Final, Literal, NamedTuple

from txt1.kernel import timeslice
from txt1.kernel.clock import RealClock, nanoseconds, process_time, seconds
from txt1.kernel.loop import VirtualTimeLoop
from txt1.kernel.ticks import Ticks

Reason = Literal["ended", "failed"]

# s between heartbeats
BEAT: Final = 0.05
# s without a heartbeat after which the process counts as silent
HEARTBEAT_LATE: Final = 0.25
# s without work, or of work, after which a process that has not sent its first heartbeat counts as hung
START: Final = 30.0
# s after which it is told that the start takes long
START_SLOW: Final = 10.0
# s between two looks at a starting process, and the work in it that counts as work
START_LOOK: Final = 1.0
START_WORK: Final = 0.005
# numbers of a trouble of one kind that are told, after the first
TOLD_TIMES: Final = (10, 100, 1000, 10_000, 100_000)
# s without a trouble after which the next one is told as the first
TROUBLE_OVER: Final = 600.0
# s of real time that it has to end by itself
END_PATIENCE: Final = 1.0
# on a shared processor the robot's process is then woken at once, and not at the end of a time slice
NICENESS: Final = 10
# bytes of memory that the process may take
MEMORY_MAX: Final = 1 << 30
# messages taken at once; the newest are kept
MESSAGES: Final = 20
# messages that may be taken in addition after each tick
REFILL: Final = 8
# bytes of the longest message, and of one reading
LINE_MAX: Final = 1 << 15
# s between two ticks: the same as the controller's, after which it runs
TELEMETRY_PERIOD: Final = 0.02
# s before a tick in which nothing is read: the time that it takes to obey `MESSAGES`
READ_PAUSE: Final = 0.001
# of the task `Sidecar.serve`: after all tasks of the robot and the user
SERVE_PRIORITY: Final = -50

ENDING: Final = (signal.SIGTERM, signal.SIGHUP)

_STOP: Final = b'"stop"'
# fields of a message that do not belong to the request
_OUTER: Final = ("time", "received", "request")
_clock: Final = RealClock()


class Request(NamedTuple):
    """A request of the process: its name, further fields, and its age in s of real time when it was read."""

    name: str
    fields: Mapping[str, Any]
    age: float


def stop_in(line: bytes) -> Request | None:
    """Return the emergency stop in a message, by itself or in a node's "call"; None for any other message."""
    if _STOP not in line:
        return None
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        return None
    name = message.get("request") if isinstance(message, dict) else None
    if name != "stop" and not (name == "call" and message.get("name") == "stop"):
        return None
    return Request(name, {key: value for key, value in message.items() if key not in _OUTER}, 0.0)


class Restart(NamedTuple):
    """How often a process that failed is started again (inf: for ever), and after how many s.

    The pause doubles with each failure up to the longest. When the process has worked for the longest pause, the pause
    is short again.
    """

    limit: float = 0
    pause: float = 0.5
    longest: float = 30.0


@dataclass(eq=False)
class Sidecar:
    """``async with Sidecar("package.module:function", telemetry, request) as sidecar``, with `serve` as a task."""

    # the function that the process calls with its `Connection` and the options
    target: str
    telemetry: Callable[[], bytes | None]
    """Returns the next line to send, or None if there is nothing new; called when the last line was received."""
    request: Callable[[Request], None]
    """Called with each request, and with an empty name for every heartbeat without a request."""
    _: KW_ONLY
    # keyword arguments of the function
    options: Mapping[str, object] = field(default_factory=dict)
    # another Python calls `main` of this module, too
    program: Sequence[str] = (sys.executable, "-m", "txt1.sidecar")
    # of the process; None: this one's
    environment: Mapping[str, str] | None = None
    # s of real time between heartbeats
    beat: float = BEAT
    restart: Restart = field(default_factory=Restart)
    # of the process once it is ready; 0: it has as large a share of the processor as any program
    niceness: int = NICENESS
    # whether requests are read at once, up to `READ_PAUSE` s before a tick; otherwise in the ticks
    prompt: bool = False
    # stays in the terminal's session; otherwise it has its own session, with its own share of the processor
    on_terminal: bool = False
    # s without a heartbeat after which it counts as hung and is ended; None: never
    silence: float | None = None
    # called with a text when it fails, falls silent or is started again
    tell: Callable[[str], None] = lambda text: None
    # called at once when it has ended
    lost: Callable[[], None] = lambda: None
    # called at each first heartbeat: it has started, and works
    ready: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        self.counts: Counter[str] = Counter()
        """Numbers of messages taken, dropped (there were too many) and malformed; of restarts; and of silences."""
        self.returncode: int | None = None
        """Exit code of the process, once it has ended."""
        self.trouble = ""
        """Why it does not work, as it was reported; "" while it works."""
        # number of failures in a row, each soon after the start
        self._failures = 0
        # of troubles in a row by kind, and when the last was reported
        self._troubles: Counter[str] = Counter()
        self._reported_at = 0
        self._allowance = MESSAGES
        self._ticking = False
        # whether the line is read only in the ticks
        self._polled = False
        # the loop's time at the next tick
        self._due = 0.0
        self._child: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None

    async def __aenter__(self) -> "Sidecar":
        self._loop = asyncio.get_running_loop()
        self._closing = asyncio.Event()
        await self._start()
        self._life = self._loop.create_task(self._live())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._closing.set()
        self._drop("")
        # goes on if a second Ctrl-C ends this: no process is left running
        await asyncio.wait([self._life])
        # the loop may have cancelled it with all other tasks
        await self._reap(END_PATIENCE)

    @property
    def pid(self) -> int | None:
        """The process's id; None while there is no process."""
        return None if self._child is None else self._child.pid

    @property
    def answers(self) -> bool:
        """Whether it has started, and no trouble was told since its last heartbeat."""
        return self._socket is not None and self._ready and not self.trouble

    async def ended(self) -> Reason:
        """Wait until it has ended for good: by itself, or after more failures than `Restart` allows.

        Raises any error of `telemetry`, `request` or `lost`; if the process is started again, the error is only
        reported.
        """
        return await asyncio.shield(self._life)

    async def serve(self, ticks: Ticks) -> None:
        """Run the task that sends telemetry and reads; it has the lowest priority, after the controller."""
        self._ticking = True
        loop = asyncio.get_running_loop()
        # the process may write just when the controller is due; and in virtual time no task is late, and to look at a
        # socket 50 times a second of virtual time would cost a tenth of the speed
        real = not isinstance(loop, VirtualTimeLoop)
        self._poll(real and not self.prompt)
        try:
            async for now in ticks:
                self._due = loop.time() + TELEMETRY_PERIOD - now % TELEMETRY_PERIOD if real else inf
                self._turn()
        finally:
            self._poll(False)

    def _poll(self, polled: bool) -> None:
        """Choose whether to read only in the ticks, or whenever data has come."""
        if polled is not self._polled:
            self._polled = polled
            if self._socket is not None and not self._loop.is_closed():
                if polled:
                    self._loop.remove_reader(self._socket)
                else:
                    self._loop.add_reader(self._socket, self._readable)

    # -- inside ------------------------------------------------------------------------------------------------

    async def _start(self) -> None:
        words = [self.target, str(self.beat), json.dumps(dict(self.options))]
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                # in a thread: starting a process takes milliseconds, and virtual time waits for a thread
                self._child = await asyncio.to_thread(
                    start_beside,
                    theirs.fileno(),
                    self.program,
                    words,
                    self.on_terminal,
                    self.environment,
                )
        except BaseException:
            ours.close()
            raise
        ours.setblocking(False)
        self._socket, self._tail, self._unsent = ours, b"", b""
        self._sent = self._received = 0
        # of its start; once it is ready, of that
        self._began = self._heard = self._looked = self._worked_at = _clock.now_ns()
        # processor time that it has used, s, when it was last looked at
        self._worked = 0.0
        self._ready = self._hushed = self._paused = False
        self._end: asyncio.Future[str | Exception] = self._loop.create_future()
        if not self._polled:
            self._loop.add_reader(ours, self._readable)

    def _readable(self) -> None:
        """Take a few messages; in a flood the rest waits for the next turn."""
        if self._ticking and not self._polled and self._loop.time() > self._due - READ_PAUSE:
            # until the controller's tick is over
            self._pause()
            return
        try:
            fault = self._take()
            if fault is not None:
                self._gone(fault)
            elif self._allowance <= 0 and not self._polled:
                self._pause()
            if not self._ticking:
                self._loop.call_later(TELEMETRY_PERIOD, self._turn) if self._paused else self._turn()
        except Exception as error:
            self._drop(error)

    def _pause(self) -> None:
        """Go on reading in the next turn."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._paused = True

    def _turn(self) -> None:
        """Go on reading, and check the process."""
        self._allowance = min(MESSAGES, max(self._allowance, 0) + REFILL)
        if self._socket is None:
            return
        if self._polled:
            self._readable()
        elif self._paused:
            self._paused = False
            self._loop.add_reader(self._socket, self._readable)
            self._readable()
        self._tend()

    def _tend(self) -> None:
        """Check whether the process still runs, and send it the newest telemetry."""
        if self._socket is None:
            return
        quiet = seconds(_clock.now_ns() - self._heard)
        try:
            if not self._ready:
                self._judge_start(quiet)
            elif self.silence is not None and quiet > self.silence:
                self._gone(f"was silent for {quiet:.1f} s")
            elif quiet > HEARTBEAT_LATE and not self._hushed:
                self._hushed = True
                self.counts["silent"] += 1
                self._report(
                    "silent",
                    "is silent: this computer is too busy, or the program hangs; if this lasts, start txt1 again",
                )
            self._send()
        except Exception as error:
            self._drop(error)

    def _judge_start(self, since: float) -> None:
        """Give up a process that hangs before its first heartbeat, `since` s after its start; slowness is no fault."""
        now = _clock.now_ns()
        if self._child is None or now - self._looked < nanoseconds(START_LOOK):
            return
        self._looked = now
        work = process_time(self._child.pid)
        if work is not None and work - self._worked >= START_WORK:
            self._worked, self._worked_at = work, now
        patience = START * 2.0 ** min(self._failures, 60)
        idle = seconds(now - self._worked_at)
        if self.silence is not None and max(idle, work or 0.0) > patience:
            self._gone(f"did not start within {since:.1f} s")
        elif since > START_SLOW and not self._hushed:
            self._hushed = True
            self._report("slow", "is still starting: this computer is busy")

    def _take(self) -> str | None:
        """Act on the data that has arrived; return why the process is lost, if it is."""
        assert self._socket is not None
        try:
            data = self._socket.recv(LINE_MAX)
        except BlockingIOError:
            return None
        except ConnectionError:
            data = b""
        if not data:
            return ""
        lines = (self._tail + data).rsplit(b"\n", self._allowance + 1)
        self._tail = lines.pop()
        if len(lines) > self._allowance:
            dropped = lines.pop(0)
            self.counts["dropped"] += dropped.count(b"\n") + 1
            self._obey_stops(dropped)
        self._allowance -= len(lines)
        for line in lines:
            self._obey(line)
        return f"sent a message of more than {LINE_MAX} bytes" if len(self._tail) > LINE_MAX else None

    def _obey(self, line: bytes) -> None:
        """Act on one message; a stop is obeyed even if the rest of the message is malformed."""
        now = _clock.now_ns()
        try:
            message = json.loads(line)
            age = seconds(now - int(message.pop("time")))
            received = int(message.pop("received", self._received))
            name = str(message.pop("request", ""))
            if age < 0.0 or not self._received <= received <= self._sent:
                raise ValueError
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            self.counts["malformed"] += 1
            self._obey_stops(line)
            return
        self.counts["taken"] += 1
        self.trouble = ""
        self._heard, self._received, self._hushed = now, received, False
        if not self._ready:
            self._ready, self._began = True, now
            assert self._child is not None
            timeslice.ordinary(self._child.pid, self.niceness, session=not self.on_terminal)
            self.ready()
        self.request(Request(name, message, age))

    def _obey_stops(self, data: bytes) -> None:
        """Act on the stops, and only the stops, among messages that are not taken."""
        # nearly always, and looking costs nothing
        if _STOP not in data:
            return
        obeyed: set[str] = set()
        for line in data.split(b"\n"):
            if (stop := stop_in(line)) is not None and repr(stop) not in obeyed:
                obeyed.add(repr(stop))
                self.request(stop)

    def _send(self) -> None:
        """Send the newest telemetry if the last was received, so that never more than one line is on its way."""
        if self._socket is None:
            return
        if not self._unsent:
            line = self.telemetry() if self._received == self._sent else None
            if line is None:
                return
            self._sent, self._unsent = self._sent + 1, line
        # otherwise at the next time
        with suppress(BlockingIOError, ConnectionError):
            self._unsent = self._unsent[self._socket.send(self._unsent) :]

    def _gone(self, fault: str) -> None:
        """Note that the process is lost, or has to be ended for a fault."""
        self.lost()
        self._drop(fault)

    def _drop(self, end: str | Exception) -> None:
        """Close the line and have the process ended, for a fault or for an error of the owner, which is passed on."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None
            self._end.set_result(end)

    async def _reap(self, patience: float) -> None:
        if self._child is not None:
            self.returncode = await asyncio.to_thread(end_beside, self._child, patience)
            self._child = None

    async def _live(self) -> Reason:
        """End the process when its line is closed, and start it again if it failed and `Restart` allows it."""
        while True:
            end = await asyncio.shield(self._end)
            await self._reap(0.0 if end else END_PATIENCE)
            if isinstance(end, Exception):
                if not self.restart.limit:
                    raise end
                end = f"is at fault here: {type(end).__name__}: {end}"
            if self._closing.is_set():
                return "ended"
            if not end and self.returncode == 0:
                self._report("end", "has ended")
                return "ended"
            if self._ready and seconds(_clock.now_ns() - self._began) > self.restart.longest:
                self._failures = 0
            why = end or f"ended with {self.returncode}"
            while not self._closing.is_set():
                if not await self._may_start(why):
                    return "ended" if self._closing.is_set() else "failed"
                try:
                    await self._start()
                    break
                except OSError as error:
                    # the system has no processes or descriptors left
                    why = f"cannot be started: {error}"
            if self._closing.is_set():
                self._drop("")

    async def _may_start(self, why: str) -> bool:
        """Report why it does not work, and wait until it may be started again; False: it may not."""
        if self.counts["restarts"] >= self.restart.limit:
            self._report("end", f"{why} and is not started again")
            return False
        pause = min(self.restart.pause * 2.0 ** min(self._failures, 60), self.restart.longest)
        self.counts["restarts"] += 1
        self._failures += 1
        self._report("restart", f"{why} and is started again in {pause:g} s")
        with suppress(TimeoutError):
            await asyncio.wait_for(self._closing.wait(), pause)
            return False
        return True

    def _report(self, kind: str, trouble: str) -> None:
        """Report that it does not work; tell a trouble of a kind that repeats the first, tenth, hundredth time."""
        now = _clock.now_ns()
        if now - self._reported_at > nanoseconds(TROUBLE_OVER):
            self._troubles.clear()
        self.trouble, self._reported_at = trouble, now
        self._troubles[kind] += 1
        times = self._troubles[kind]
        if times == 1:
            self.tell(trouble)
        elif times in TOLD_TIMES:
            self.tell(f"{trouble} ({times} times so far)")


def start_beside(
    fd: int,
    program: Sequence[str],
    words: Sequence[str],
    on_terminal: bool,
    environment: Mapping[str, str] | None,
) -> subprocess.Popen[bytes]:
    """Start the process, which inherits the socket `fd`, and the terminal's session or none; call it in a thread."""
    # Ctrl-C goes to the whole foreground group: the child ignores it from its birth, before its own code can say so
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        child = subprocess.Popen(  # noqa: S603
            [*program, str(fd), *words],
            pass_fds=(fd,),
            env=environment,
            # Linux first divides the processor among sessions: in this session it would use up the loop's own share
            start_new_session=not on_terminal,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    timeslice.ordinary(child.pid, 0, session=not on_terminal)
    # it has ended already
    with suppress(OSError):
        if hasattr(resource, "prlimit"):
            resource.prlimit(child.pid, resource.RLIMIT_DATA, (MEMORY_MAX, MEMORY_MAX))
            # the first process to be ended when memory runs out
            Path(f"/proc/{child.pid}/oom_score_adj").write_text("1000")
    return child


def end_beside(child: subprocess.Popen[bytes], patience: float) -> int:
    """Wait `patience` s for a process to end, then kill it; return its exit code; call it in a thread."""
    try:
        return child.wait(patience)
    except subprocess.TimeoutExpired:
        child.kill()
        return child.wait()


# -- in the other process --------------------------------------------------------------------------------------


class Connection:
    """The process's end: ``for telemetry in connection: ... connection.request("drive", v=0.5, omega=0.0)``.

    Its heartbeat comes from `receive`, which the process has to call again and again; iterating does so. When the
    process hangs, the heartbeat stops, so that the robot notices.
    """

    def __init__(self, link: socket.socket, beat: float = BEAT) -> None:
        self._socket, self._beat = link, nanoseconds(beat)
        self._tail = b""
        # number of pieces of telemetry received
        self._received = 0
        self._next = _clock.now_ns()
        self._lock = threading.Lock()

    def fileno(self) -> int:
        """The descriptor to wait on."""
        return self._socket.fileno()

    def due(self) -> float:
        """Time until the next heartbeat, s; 0 when it is due."""
        return max(0.0, seconds(self._next - _clock.now_ns()))

    def request(self, name: str, /, **fields: object) -> None:
        """Send the robot a request with the present time, from any thread; OSError: its process is gone."""
        with self._lock:
            now = _clock.now_ns()
            message = {"time": now, "received": self._received, "request": name, **fields}
            self._socket.sendall(json.dumps(message).encode() + b"\n")
            self._next = now + self._beat

    def receive(self, timeout: float = 0.0) -> dict[str, Any] | None:
        """Return the newest telemetry; None if none comes within `timeout` s, and after each heartbeat.

        Raises EOFError: the robot's process is gone.
        """
        if self.due() <= 0.0:
            self.request("")
        line = self.newest() if select.select([self._socket], [], [], min(timeout, self.due()))[0] else None
        return None if line is None else json.loads(line)

    def newest(self) -> bytes | None:
        """Return the last complete line that has arrived, None if there is none; waits until some data comes.

        Raises EOFError: the robot's process is gone.
        """
        chunk = self._socket.recv(1 << 18)
        if not chunk:
            raise EOFError
        *lines, self._tail = (self._tail + chunk).split(b"\n")
        self._received += len(lines)
        return lines[-1] if lines else None

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield every piece of telemetry until the run ends."""
        while True:
            try:
                telemetry = self.receive(seconds(self._beat))
            except (EOFError, ConnectionError):
                return
            if telemetry is not None:
                yield telemetry


def _terminated(number: int, _: FrameType | None) -> None:
    """End this process by way of every `finally`; further signals have no effect."""
    for each in ENDING:
        signal.signal(each, signal.SIG_IGN)
    sys.exit(128 + number)


def main(fd: str, target: str, beat: str, options: str) -> None:
    """Call the target with the connection over the socket `fd`."""
    # Ctrl-C is for the robot's process, which then closes the socket
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for each in ENDING:
        signal.signal(each, _terminated)
    module, _, function = target.partition(":")
    # the robot's process has ended
    with socket.socket(fileno=int(fd)) as link, suppress(EOFError, ConnectionError):
        getattr(import_module(module), function)(Connection(link, float(beat)), **json.loads(options))


if __name__ == "__main__":
    # under the module's own name, by which the target knows it
    from txt1.sidecar import main as begin

    begin(*sys.argv[1:])
