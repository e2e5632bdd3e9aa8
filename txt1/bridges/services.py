"""Requests of bridges beyond driving: routes, gains, recordings."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from math import atan2
from pathlib import Path
from typing import Any, Final

from txt1.bridges.registry import shown
from txt1.commands import need
from txt1.config import Config
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet, Schedule
from txt1.driver import finite
from txt1.errors import CommandRefused, NotArmed, Overruled, Txt1Error
from txt1.kernel.loop import Speed
from txt1.kernel.ticks import Ticks
from txt1.record.session import dated, recording
from txt1.robot import Robot
from txt1.tasks.on_map import MapInUse
from txt1.telemetry.topics import Rule, Topic, declare

FOLDER: Final = Path("out/recordings")
# s between two checks whether the route is still held
SERVICES_PERIOD: Final = 0.02

RECORDING: Final = declare(
    Topic(
        "/recording", str, "", "std_msgs/String", Rule.SNAPSHOT, "the recording that a bridge has begun; empty for none"
    )
)
ROUTE: Final = declare(
    Topic[tuple[tuple[float, float], ...]](
        "/route", tuple, "m", "std_msgs/String", Rule.SNAPSHOT, "the waypoints that a bridge has the robot drive along"
    )
)


@asynccontextmanager
async def services(robot: Robot, speed: Speed, folder: Path) -> AsyncIterator[Mapping[str, Callable[..., object]]]:
    """Provide the requests of one robot's bridges until the block is left; all bridges of the robot share them.

    `speed` is that of the robot's time, and `folder` is for recordings. The first bridge of a robot decides both.
    """
    if (there := robot.runtime.part(Services)) is not None:
        yield there.requests
        return
    made = Services(robot, robot.config, speed, folder)
    robot.runtime.parts.append(made)
    try:
        yield made.requests
    finally:
        robot.runtime.parts.remove(made)
        await made.close()


class Services:
    """The services of one robot's bridges; `requests` holds the functions."""

    def __init__(self, robot: Robot, config: Config, speed: Speed, folder: Path) -> None:
        self._robot, self._config, self._speed, self._folder = robot, config, speed, folder
        self._source = robot.source("route")
        # time of the last request to hold the route, s of the run
        self._held = 0.0
        self._route: asyncio.Task[None] | None = None
        self._points: tuple[tuple[float, float], ...] = ()
        self._recording: AsyncExitStack | None = None
        self._file = ""
        self._tasks: set[asyncio.Task[None]] = set()
        self._watched = False
        robot.runtime.bus.offer(RECORDING, lambda: self._file)
        robot.runtime.bus.offer(ROUTE, lambda: self._points)
        self.requests: Mapping[str, Callable[..., object]] = {
            "go": self._go,
            "here": self._here,
            "hold": self._hold,
            "halt": self._halt,
            "gains": self._gains,
            "record": self._record,
        }

    async def close(self) -> None:
        """Stop the route, and complete the recording."""
        self._halt()
        for task in tuple(self._tasks):
            task.cancel()
        if self._recording is not None:
            stack, self._recording = self._recording, None
            await stack.aclose()

    # -- routes ------------------------------------------------------------------------------------------------

    def _go(self, points: Sequence[Sequence[float]], speed: float = 0.5) -> None:
        """Drive along points (m; on the map, in the room or in the odometry's frame) as long as `hold` is repeated."""
        self._halt()
        robot = self._robot
        if not robot.armed:
            raise NotArmed(robot.reason)
        try:
            way = tuple((x, y) for x, y in (finite("go", x=x, y=y) for x, y in points))
            speed = min(*finite("go", speed=speed), robot.config.safety.v_max)
        except (TypeError, ValueError):
            raise CommandRefused(f"go: {shown(points)}; give a list of pairs in m") from None
        if not speed > 0.0:
            raise CommandRefused(f"go: a speed of {speed:g}; give more than 0 m/s")
        # the filter and the planner come with it, and numpy: robots that drive by hand need none of them
        from txt1.navigation import best_pose, follow, go_to_places, map_floor

        source = best_pose(robot)
        source.pose()
        self._held = robot.now
        self._points = way
        if not self._watched:
            self._watched = True
            robot.add_task("route", SERVICES_PERIOD, self._watch)
        room = map_floor(robot)
        if room is None:
            drive = follow(robot, way, closed=False, speed=speed, pose_source=source, source=self._source)
        else:
            drive = go_to_places(robot, way, speed=speed, pose_source=source, room=room, source=self._source)
        self._route = self._start(drive)
        self._route.add_done_callback(self._arrived)

    def _here(self, points: Sequence[Sequence[float]]) -> None:
        """Set the robot's place on its map, m, and a place that it faces; without the second its heading is
        searched for.
        """
        there = self._robot.runtime.part(MapInUse)
        if there is None:
            raise CommandRefused("there is no map: give --in MAP")
        try:
            (x, y), *ahead = [finite("here", x=x, y=y) for x, y in points]
        except (TypeError, ValueError):
            raise CommandRefused(f"here: {shown(points)}; give one or two pairs in m") from None
        self._halt()
        there.place(x, y, atan2(ahead[0][1] - y, ahead[0][0] - x) if ahead else None)

    def _hold(self, age: float = 0.0) -> None:
        """Let the route go on: an operator watched it `age` s ago."""
        (since,) = finite("hold", age=age)
        self._held = max(self._held, self._robot.now - max(0.0, since))

    def _halt(self) -> None:
        """End the route."""
        if self._route is not None:
            route, self._route = self._route, None
            self._points = ()
            route.cancel()
            self._source.release()

    async def _watch(self, ticks: Ticks) -> None:
        """End the route when no operator has held it for as long as a command is fresh."""
        async for now in ticks:
            if self._route is not None and now - self._held > self._robot.config.safety.command_timeout:
                self._halt()
                self._robot.tell("the route was ended: it is no longer held")

    def _arrived(self, route: asyncio.Task[None]) -> None:
        if self._route is route:
            self._route, self._points = None, ()
        if not route.cancelled():
            from txt1.navigation import NoPath

            error = route.exception()
            if isinstance(error, NotArmed | Overruled | CommandRefused | NoPath):
                self._robot.tell(f"the route was ended: {error}")
            elif error is None:
                self._robot.tell("the route has been driven")
            else:
                self._robot.tell(f"the route was ended: {type(error).__name__}: {error}")

    # -- gains -------------------------------------------------------------------------------------------------

    def _gains(self, linear: Sequence[float], angular: Sequence[Sequence[float]]) -> None:
        """Load new gains: K_P, K_I, K_D of the speed, and sets of v_max, K_P, K_I, K_D of the yaw rate."""
        try:
            kp, ki, kd = linear
            gains = Gains(*finite("speed", kp=kp, ki=ki, kd=kd))
            rows = [finite("yaw rate", v_max=v_max, kp=p, ki=i, kd=d) for v_max, p, i, d in angular]
            sets = tuple(GainSet(v_max, Gains(*each)) for v_max, *each in rows)
            if not sets:
                raise ValueError("there are none for the yaw rate, which would not be steered")
            Schedule(sets)
        except (TypeError, ValueError) as error:
            raise CommandRefused(f"gains: {error}") from None
        self._start(self._load(gains, sets))

    async def _load(self, linear: Gains, angular: Sequence[GainSet]) -> None:
        try:
            taken = await self._robot.load_gains(linear, angular)
            self._robot.tell("the gains are in force" if taken else "the gains were not accepted")
        except CommandRefused as error:
            self._robot.tell(str(error))

    # -- recordings --------------------------------------------------------------------------------------------

    def _record(self, on: bool) -> None:
        """Begin a recording, or complete the present recording."""
        need("recording", "record", "mcap", "zstandard", "lz4")
        self._start(self._begin() if on else self._complete())

    async def _begin(self) -> None:
        if self._recording is not None:
            return
        robot = self._robot
        self._recording = stack = AsyncExitStack()
        file = dated(self._folder, robot.runtime.name)
        try:
            await asyncio.to_thread(self._folder.mkdir, parents=True, exist_ok=True)
            attach = await stack.enter_async_context(
                recording(file, self._config, self._speed, {"begun": robot.now}, robot.tell)
            )
        except (Txt1Error, OSError) as error:
            self._recording = None
            robot.tell(f"nothing is recorded: {error}")
            return
        attach(robot.runtime)
        self._file = file.name
        robot.tell(f"recording {file.name}")

    async def _complete(self) -> None:
        if self._recording is None:
            return
        stack, self._recording, name, self._file = self._recording, None, self._file, ""
        try:
            await stack.aclose()
            self._robot.tell(f"recorded {name}")
        except Txt1Error as error:
            self._robot.tell(str(error))

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
