"""Bridges by name: the package's own from a table, other packages' through the entry-point group ``txt1.bridges``.

A bridge is a function that runs in a process of its own. A package announces it in its pyproject.toml::

    [project.entry-points."txt1.bridges"]
    mqtt = "mypackage.mqtt:main"

and the function is called with its end of the line and its options::

    def main(robot: txt1.sidecar.Connection, host: str = "localhost") -> None:
        robot.request("subscribe", topics=["/odom"], rate=10.0)
        for telemetry in robot:
            publish(telemetry["topics"]["/odom"])
            robot.request("drive", v=0.5, omega=0.0)

Its module is imported in that process only. The source of its commands has the bridge's name. A wrong request is
reported in the event log under the same name.
"""

import asyncio
import inspect
import json
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from difflib import get_close_matches
from math import inf, isfinite
from typing import Any, Final

from txt1.errors import CommandRefused, Txt1Error
from txt1.hal.base import Button
from txt1.kernel.clock import RealClock, seconds
from txt1.plugins import Registry
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sensors.readings import Image
from txt1.sidecar import SERVE_PRIORITY, TELEMETRY_PERIOD, Request, Restart, Sidecar
from txt1.telemetry.snapshot import Snapshot, plain
from txt1.telemetry.topics import TOPICS, Rule, Topic

BRIDGES: Final = Registry(
    "bridge",
    "txt1.bridges",
    {},
)

RESTART: Final = Restart(limit=inf)
# length of a value in a message
SHOWN_MAX: Final = 80
# length of a line that a bridge adds to the event log
TOLD_MAX: Final = 400
# s without a heartbeat after which a bridge counts as hung, is ended and started again
HEARTBEAT_SILENCE: Final = 5.0
# a stop comes through a bridge: beside busy programs it must not wait as long as a screen may
BRIDGE_NICENESS: Final = 5
# s between two pieces of telemetry for topics that a bridge wants seldom
SELDOM: Final = 1.0
# events kept for a bridge between two pieces of telemetry; the oldest are dropped first
EVENTS_MAX: Final = 100

_clock: Final = RealClock()


@asynccontextmanager
async def bridge(
    robot: Robot,
    name: str,
    options: Mapping[str, object] | None = None,
    requests: Mapping[str, Callable[..., object]] | None = None,
    *,
    restart: Restart = RESTART,
    silence: float | None = HEARTBEAT_SILENCE,
    ready: Callable[[], None] = lambda: None,
    niceness: int = BRIDGE_NICENESS,
) -> AsyncIterator[Sidecar]:
    """Run a bridge beside a robot until the block is left. `options` are keyword arguments for its function.

    `requests` are further requests, beyond driving and the joystick: functions of the request's fields. After `silence`
    s without a heartbeat the bridge is ended (None: never), and started again by `restart`. `ready` is called whenever
    it has started. `niceness` is its process's. Raises ConfigError: no bridge has this name, or it already runs.
    """
    desk = RobotEnd(robot, name, requests or {})
    async with _at_work(name, options, desk, [desk], restart, silence, ready, niceness) as beside:
        yield beside


@asynccontextmanager
async def fleet_bridge(
    robots: Mapping[str, Robot],
    name: str,
    options: Mapping[str, object] | None = None,
    requests: Mapping[str, Mapping[str, Callable[..., object]]] | None = None,
    *,
    restart: Restart = RESTART,
    silence: float | None = HEARTBEAT_SILENCE,
    ready: Callable[[], None] = lambda: None,
) -> AsyncIterator[Sidecar]:
    """Run one bridge for several robots of this process; `requests` are each robot's, by name.

    Its telemetry is a list of the robots' telemetry. Its requests have a further field, ``robot``; a request without it
    is for all robots.
    """
    desks = {each: RobotEnd(robot, name, (requests or {}).get(each, {})) for each, robot in robots.items()}
    async with _at_work(name, options, Desks(desks), list(desks.values()), restart, silence, ready) as beside:
        yield beside


@asynccontextmanager
async def _at_work(
    name: str,
    options: Mapping[str, object] | None,
    end: "RobotEnd | Desks",
    desks: "Sequence[RobotEnd]",
    restart: Restart,
    silence: float | None,
    ready: Callable[[], None] = lambda: None,
    niceness: int = BRIDGE_NICENESS,
) -> AsyncIterator[Sidecar]:
    def let_go() -> None:
        for desk in desks:
            desk.let_go()

    first = desks[0]
    # imported here: the module reads files
    where = await asyncio.to_thread(BRIDGES.place, "bridge", name)
    beside = Sidecar(
        str(where),
        end.telemetry,
        end.request,
        options=options or {},
        restart=restart,
        niceness=niceness,
        silence=silence,
        tell=lambda text: first.say(f" {text}"),
        lost=let_go,
        ready=ready,
    )
    try:
        with ExitStack() as watched:
            for desk in desks:
                watched.enter_context(warning(desk.robot.runtime, f"bridge '{name}'", beside))
            async with beside:
                first.robot.add_task(f"bridge {name}", TELEMETRY_PERIOD, beside.serve, SERVE_PRIORITY)
                yield beside
    finally:
        let_go()
        for desk in desks:
            desk.leave()


@contextmanager
def warning(runtime: Runtime, name: str, beside: Sidecar) -> Iterator[None]:
    """Show a warning on every screen of the robot while a process beside it does not work, until the block is left."""

    def trouble() -> str:
        return beside.trouble and f"{name} {beside.trouble}"

    runtime.state.warnings.append(trouble)
    try:
        yield
    finally:
        runtime.state.warnings.remove(trouble)


class RobotEnd:
    """The robot's end of a bridge: it answers requests and sends telemetry."""

    def __init__(self, robot: Robot, name: str, requests: Mapping[str, Callable[..., object]]) -> None:
        # whether it is a stranger's: topics that the robot does not have are refused, as ours ask for those of all
        # additions; and readings are among the topics, as ours take them from the events
        self._strict = not str(BRIDGES.ours.get(name, "")).startswith("txt1.")
        self.leave: Callable[[], None] = lambda: None
        """Unsubscribes from the bus."""
        self.robot, self._name = robot, name
        self.source = robot.source(name)
        """The bridge's source of commands."""
        # age of the present request, s
        self._age = 0.0
        self._told = ""
        # whether it was told that commands are ignored, since the robot was last armed
        self._told_ignored = False
        self._topics: frozenset[str] | None = None
        self._seldom: frozenset[str] | None = frozenset()
        self._interval, self._due, self._due_seldom = 0.1, 0.0, 0.0
        self._events: deque[dict[str, object]] = deque(maxlen=EVENTS_MAX)
        # of each camera the picture that waits, and its time: an older one is dropped
        self._pictures: dict[Topic[Any], tuple[Any, float]] = {}
        # the newest of each sensor that the bridge has named
        self._newest: dict[Topic[Any], Any] = {}
        self._requests: dict[str, Callable[..., object]] = {
            "subscribe": self._subscribe,
            "drive": self.drive,
            "request": self.source.request,
            "release": self.source.release,
            "arm": robot.arm_by_hand,
            "disarm": lambda reason="": robot.disarm(str(reason)[:TOLD_MAX] or f"disarmed by bridge '{name}'"),
            "stop": robot.stop,
            "press": lambda button: robot.press(_button(button)),
            "tell": lambda text: self.say(f": {text}"),
            **requests,
        }
        self._signatures = {name: inspect.signature(do) for name, do in self._requests.items()}

    def telemetry(self) -> bytes | None:
        """Return the topics that the bridge wants, at its rate; None until they are due."""
        robot, now, topics = self.robot, self.robot.now, self._topics
        if now < self._due:
            return None
        # in step with the task's ticks, even if telemetry comes late
        self._due = max(self._due + self._interval, now)
        if now >= self._due_seldom and topics is not None:
            self._due_seldom = now + SELDOM
            topics = None if self._seldom is None else topics | self._seldom
        snapshot = Snapshot.take(robot.runtime.bus, now, robot.runtime.name, topics)
        line = (snapshot.replaced(self._newest) if self._newest else snapshot).encode()
        for topic, (value, time) in self._pictures.items():
            # on the clock that both processes share
            exposed = seconds(_clock.now_ns()) - (now - time)
            self._events.append({"topic": topic.name, "time": time, "exposed": exposed, "value": plain(value)})
        self._pictures.clear()
        if self._events:
            line = line[:-2] + b',"events":' + json.dumps(list(self._events)).encode() + b"}\n"
            self._events.clear()
        return line

    def request(self, request: Request) -> None:
        """Carry out a request, or tell once why not. An error in a request does not end the bridge."""
        if not request.name:
            return
        self._age = request.age
        try:
            self._do(request)
            self._told = ""
        except (Txt1Error, ValueError) as error:
            self._refuse(str(error))
        except Exception as error:
            self._refuse(f"request '{request.name}' failed: {type(error).__name__}: {error}")

    def _do(self, request: Request) -> None:
        do = self._requests.get(request.name)
        if do is None:
            raise ValueError(f"there is no request {shown(request.name)}; there are {', '.join(self._requests)}")
        fields = request.fields
        try:
            self._signatures[request.name].bind(**fields)
        except TypeError as error:
            if request.name != "stop":
                raise ValueError(f"request '{request.name}': {error}") from None
            # a stop is obeyed whatever else the message contains
            fields = {}
        do(**fields)

    def _refuse(self, why: str) -> None:
        if why != self._told:
            self._told = why
            self.say(f": {why}")

    def say(self, text: str) -> None:
        """Add a line about the bridge to the event log."""
        self.robot.tell(f"bridge '{self._name}'{text}"[:TOLD_MAX])

    def let_go(self) -> None:
        """Release the wheel."""
        with suppress(CommandRefused):
            self.source.release()

    # -- inside ------------------------------------------------------------------------------------------------

    def drive(self, v: object, omega: object, age: object = 0.0, held: bool = False) -> None:
        """Command a velocity. `age` is the command's age in s when the bridge passed it on; `held`: a hand holds."""
        since = _number("age", age)
        if not isfinite(since):
            raise ValueError(f"age: {since} is not finite")
        old = self._age + max(0.0, since)
        give = self.source.hold if held else self.source.command
        give(_number("v", v), _number("omega", omega), max(0.0, self.robot.now - old))
        if self.robot.armed:
            self._told_ignored = False
        elif (v or omega) and not self._told_ignored:
            self._told_ignored = True
            name, reason = self._name, self.robot.reason
            self.robot.tell(f"commands of '{name}' are ignored: the robot is not armed ({reason}); {self.how_to_arm()}")

    def how_to_arm(self) -> str:
        """Return what to do for commands that are ignored because nobody has armed the robot."""
        return "arm it first"

    def _subscribe(
        self, topics: Sequence[str] | None = None, rate: object = 10.0, seldom: Sequence[str] | None = ()
    ) -> None:
        """Send `topics` at a rate in Hz, and `seldom` once a second; None for all topics."""
        hertz = _number("rate", rate)
        if not 0.0 < hertz <= 1.0 / TELEMETRY_PERIOD:
            raise ValueError(f"rate: {hertz:g} Hz; give one above 0, and at most {1.0 / TELEMETRY_PERIOD:g}")
        wanted, rarely = _names("topics", topics), _names("seldom", seldom)
        if self._strict:
            self._check({*(wanted or ()), *(rarely or ())})
        self._interval = 1.0 / hertz
        self._topics, self._seldom = wanted, rarely
        self._due = self._due_seldom = 0.0
        self.leave()
        self._newest.clear()
        self._pictures.clear()
        events = [t for t in TOPICS.values() if t.rule is Rule.EVENT and (topics is None or t.name in topics)]
        self.leave = self.robot.runtime.bus.subscribe(self._event, events) if events else lambda: None

    def _check(self, names: Iterable[str]) -> None:
        """Raise ValueError for a topic that this robot does not have."""
        known = {*TOPICS, *(topic.name for topic in self.robot.runtime.bus.offered)}
        for name in sorted(names):
            if name not in known:
                near = get_close_matches(name, known, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(sorted(known))}"
                raise ValueError(f"topics: this robot has no {shown(name)}; {hint}")

    def _event(self, topic: Topic[Any], value: Any, time: float) -> None:
        if topic.type is Image:
            self._pictures[topic] = value, time
        else:
            self._events.append({"topic": topic.name, "time": time, "value": plain(value)})
        if self._strict and self._topics is not None and topic.name.startswith("/sensors/"):
            self._newest[topic] = value


class Desks:
    """The robots' ends of a bridge for several robots."""

    def __init__(self, desks: Mapping[str, RobotEnd]) -> None:
        self._desks = desks

    def telemetry(self) -> bytes | None:
        """The telemetry of all robots as a JSON list; None until something is due."""
        lines = [line[:-1] for desk in self._desks.values() if (line := desk.telemetry()) is not None]
        return b"[%b]\n" % b",".join(lines) if lines else None

    def request(self, request: Request) -> None:
        """Pass a request to its robot; a request without a robot goes to all."""
        fields = dict(request.fields)
        name = fields.pop("robot", None)
        meant = [self._desks.get(str(name))] if name is not None else self._desks.values()
        for desk in meant:
            if desk is not None:
                desk.request(request._replace(fields=fields))
            else:
                next(iter(self._desks.values())).say(f": there is no robot '{name}'")


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name}: {shown(value)} is no number")
    try:
        return float(value)
    except OverflowError:
        # an integer may have any number of digits
        raise ValueError(f"{name}: {shown(value)} is too large") from None


def shown(value: object) -> str:
    """Return a received value as text for a message to people, in 80 characters at most."""
    text = repr(value)
    return text if len(text) <= SHOWN_MAX else f"{text[: SHOWN_MAX - 3]}..."


def _names(field: str, names: object) -> frozenset[str] | None:
    if names is None:
        return None
    if not (isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)):
        raise ValueError(f"{field}: {shown(names)}; give a list of names, such as ['/odom']")
    return frozenset(names)


def _button(name: object) -> Button:
    for button in Button:
        if str(button.name).lower() == name:
            return button
    raise ValueError(f"button: {shown(name)} is none; there are left, right, up, down, centre")
