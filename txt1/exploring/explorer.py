"""The explorer: it drives from frontier to frontier on the map in the making, and back to where it began.

How it works. With each choice it looks for frontiers (`txt1.exploring.frontiers`) and takes the cheapest, by the way to
it, its size, and how far the robot has to turn. It stays with its choice until most of the frontier is known, it has
looked at it in vain, or no way leads there. In the last two cases the frontier is set aside, and tried from other
places when no other is left; where there is no other place, from the same, as whatever stood there may have left.
`go_to` plans and drives every way, on the floor seen so far.

It is a source of commands like any other. When a hand takes the wheel, or the robot is stopped, it waits until the
robot is armed anew. The pose is the mapper's.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from importlib import import_module
from math import degrees, hypot
from typing import Final, NamedTuple

from txt1.commands import say
from txt1.driver import REFRESH
from txt1.errors import A_STOP, CommandRefused, NotArmed, Overruled, Txt1Error
from txt1.exploring.frontiers import SAME_PLACE, Frontier, Places, View, best_view, frontiers
from txt1.exploring.growing_floor import GrowingFloor
from txt1.guards.obstacle_stop.guard import LaserGuard
from txt1.mapping.map_sensors import NEWS, OnMap
from txt1.maps.grid import FREE, Grid
from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.model.reeds_shepp import Pose
from txt1.navigation import NoPath, PoseSource, go_to, ways
from txt1.navigation.goto import in_thread, rest
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.tasks.on_map import Line
from txt1.telemetry.topics import Rule, Topic, declare

SOURCE: Final = "explore"
"""The name of the source of commands."""
EXPLORING_SPEED: Final = 0.4
"""m/s."""
FRONTIER_CHECK_PERIOD: Final = 0.2
"""s between two looks whether the frontier is gone."""
THERE: Final = 0.15
"""m from its pose, and"""
FACING: Final = 20.0
"""degrees, within which the robot looks at the frontier."""
MAPPED: Final = 2.0
"""s until what it sees is on the map."""
OFTEN: Final = 3
"""Number of times that it drives to the same frontier, which may come again as the map changes."""
WAY_PATIENCE: Final = 20.0
"""s that it waits where no way leads to a frontier, as somebody may stand in it,"""
WAY_CHECK_PERIOD: Final = 4.0
"""s between its looks for a way."""
AWAITS: Final = 30.0
"""s that it waits for a pose."""
BACK: Final = (0.0, 0.1, 0.2, 0.3, 0.5)
"""m ahead of where it began, for a robot that began with a wall at its back."""


LOST: Final = "the robot does not know where it is on its map"


class Frontiers(NamedTuple):
    """The frontiers, for screens; empty when none is looked for any more."""

    cells: Line = ()
    """Places of all their cells on the map, m."""
    goal: tuple[float, float] | None = None
    """The one to which the robot drives, m."""


FRONTIERS: Final = declare(
    Topic("/frontiers", Frontiers, "m", "std_msgs/String", Rule.SNAPSHOT, "the frontiers on the map, while it explores")
)


class GivesUp(Txt1Error):
    """The explorer cannot go on."""


class Try(NamedTuple):
    """A frontier to which it drove."""

    place: tuple[float, float]
    """m."""
    view: tuple[float, float]
    """Place to look at it from, m."""
    why: str
    """Why it is still there; empty if it was gone."""


class Explorer:
    """Maps the room."""

    def __init__(self, robot: Robot, there: OnMap) -> None:
        self._robot, self._there = robot, there
        guard = robot.runtime.part(LaserGuard)
        self._keep = 0.0 if guard is None else guard.margin
        self._floor = GrowingFloor(there, robot.config.geometry)
        robot.runtime.sensors[NEWS].listeners.append(self._floor.heard)
        self._wheel = robot.source(SOURCE)
        self._pose = PoseSource("pose on the growing map", self._read, self._floor)
        self._tries: list[Try] = []
        self._again = False
        self._shown = Frontiers()
        robot.runtime.bus.offer(FRONTIERS, lambda: self._shown)
        self.unfinished = "it was ended before all was explored"
        """Why the room is not explored; empty if it is."""

    async def explore(self) -> None:
        """Drive to the frontiers until none is left, and back."""
        robot, began = self._robot, self._robot.now
        try:
            await self._until(lambda: self._floor.mapped() is not None and self._read() is not None, "no scan comes")
            start = self._pose.pose()
            while (view := await self._soon()) is not None:
                await self._look(view)
            left, beyond = await self._left()
            if beyond and not self._tries:
                raise GivesUp(f"no way leads from its place to the frontier at {_at(beyond[0])}: give it more room")
            home = await self._home(start)
            self.unfinished = "; ".join([*left, *([home] if home else [])])
            rest_of_it = remaining(len(left), [each.middle for each in beyond])
        except GivesUp as error:
            self.unfinished = rest_of_it = str(error)
        self._shown = Frontiers()
        told = f"explored {self._area()} in {robot.now - began:.0f} s: {rest_of_it}"
        robot.tell(told)
        say(told)

    async def _soon(self) -> View | None:
        """Return the next view, for which it waits where no way leads to a frontier; None: there is none."""
        began, told = self._robot.now, False
        while (view := await self._next()) is None and self._robot.now < began + WAY_PATIENCE:
            if not any(self._may_try(each) for each in await self._every()):
                break
            if not told:
                told = True
                self._robot.tell(f"no way leads to a frontier now: waits for one, {WAY_PATIENCE:.0f} s at most")
            await asyncio.sleep(WAY_CHECK_PERIOD)
        return view

    async def _every(self) -> list[Frontier]:
        """Return all frontiers of the map, found in a thread: a large map takes longer than a cycle."""
        room = self._floor.floor()
        assert room is not None and room.walls is not None
        grid = room.walls.grid
        return await in_thread(lambda: frontiers(grid))

    async def _next(self) -> View | None:
        """Return the cheapest view of a frontier that may be tried; None: there is none."""
        view = await self._best(self._may_try, self._vain)
        if view is None and not self._again:
            self._again = True
            view = await self._best(self._may_try, self._vain)
        return view or await self._best(self._may_try)

    async def _best(
        self, wanted: Callable[[Frontier], bool], vain: Callable[[Frontier], Places] = lambda _: ()
    ) -> View | None:
        await self._until(lambda: self._read() is not None, LOST)
        pose, room, body = self._pose.pose(), self._floor.floor(), self._robot.config.geometry
        assert room is not None

        def search() -> View | None:
            assert room.walls is not None
            every = frontiers(room.walls.grid)
            there = [each._replace(vain=vain(each)) for each in every if wanted(each)]
            view = best_view(there, pose, room, body, self._keep) if there else None
            cells = tuple((x, y) for each in every for x, y in each.cells.round(2).tolist())
            self._shown = Frontiers(cells, view and view.frontier.middle)
            return view

        return await in_thread(search)

    def _may_try(self, frontier: Frontier) -> bool:
        """Whether the frontier was not tried in vain, or no other is left; at most OFTEN in all."""
        return len(self._before(frontier)) < OFTEN and (self._again or not self._vain(frontier))

    def _before(self, frontier: Frontier) -> list[Try]:
        x, y = frontier.middle
        return [each for each in self._tries if hypot(each.place[0] - x, each.place[1] - y) < SAME_PLACE]

    def _vain(self, frontier: Frontier) -> Places:
        """Return the places from which it was tried in vain."""
        return tuple(each.view for each in self._before(frontier) if each.why)

    async def _left(self) -> tuple[list[str], list[Frontier]]:
        """Return in words the frontiers that are left, and those from which the car is kept away."""
        left: list[Frontier] = []
        while (view := await self._best(lambda each: each.middle not in [other.middle for other in left])) is not None:
            left.append(view.frontier)
        told = []
        for each in left:
            why = next(
                (before.why for before in reversed(self._before(each)) if before.why), "it comes again and again"
            )
            told.append(f"a frontier is left at {_at(each)}: {why}")
        known = [each.middle for each in left]
        return told, [each for each in await self._every() if each.middle not in known]

    async def _look(self, view: View) -> None:
        """Drive to a view, and note what came of it."""
        robot, (x, y) = self._robot, view.frontier.middle
        robot.tell(
            f"explores {view.frontier.length:.1f} m of frontier at ({x:.2f} m, {y:.2f} m); {self._area()} so far"
        )

        def on(test: Callable[[Grid], bool]) -> bool:
            room = self._floor.mapped()
            return room is not None and room.walls is not None and test(room.walls.grid)

        def looks() -> bool:
            here = self._read()
            return here is not None and (
                hypot(view.pose[0] - here[0], view.pose[1] - here[1]) < THERE
                and abs(degrees(wrap_angle(view.pose[2] - here[2]))) < FACING
            )

        def seen() -> bool:
            return on(view.frontier.gone) or on(view.frontier.known)

        why = await self._drive(view.pose, lambda: on(view.frontier.gone) or looks())
        ends = robot.now + MAPPED
        while not why and not seen() and robot.now < ends:
            await asyncio.sleep(FRONTIER_CHECK_PERIOD)
        if not why and not seen():
            why = "the laser has looked there in vain"
        self._tries.append(Try(view.frontier.middle, view.pose[:2], why))
        if why:
            robot.tell(f"the frontier at {_at(view.frontier)} is set aside: {why}")

    async def _home(self, start: Pose) -> str:
        """Drive back to where it began; return why it is not there."""
        why = ""
        for ahead in BACK:
            why = await self._drive(move_along_arc(*start, ahead, 0.0, 0.0), lambda: False)
            if not why:
                return ""
        return f"the robot did not come back: {why}"

    async def _drive(self, pose: Pose, over: Callable[[], bool]) -> str:
        """Drive to a pose, m and rad, at most until it is over; return why that was impossible."""
        robot, wheel = self._robot, self._wheel
        while True:
            if not robot.armed:
                robot.tell(f"exploring waits: {robot.told}")
                while not robot.armed:
                    await asyncio.sleep(REFRESH)
            drive = asyncio.ensure_future(
                go_to(
                    robot, pose, pose_source=self._pose, room=self._floor.floor(), speed=EXPLORING_SPEED, source=wheel
                )
            )
            try:
                while not drive.done() and not over():
                    await asyncio.wait([drive], timeout=FRONTIER_CHECK_PERIOD)
                if drive.done():
                    await drive
                else:
                    drive.cancel()
                    await asyncio.wait([drive])
                    await rest(robot, wheel, self._pose)
                return ""
            except Overruled as error:
                await self._give_way(error.driver)
            except NotArmed:
                continue
            except NoPath as error:
                return str(error)
            except CommandRefused as error:
                if self._read() is not None:
                    return str(error)
                await self._until(lambda: self._read() is not None, LOST)
            finally:
                drive.cancel()
                wheel.release()

    async def _give_way(self, driver: str) -> None:
        """Wait until the robot is armed anew, and the wheel is free."""
        robot, gate = self._robot, self._robot.runtime.gate
        epoch = gate.epoch
        why = "the robot was stopped" if driver == A_STOP else f"'{driver}' drives"
        robot.tell(f"{why}; exploring goes on when the robot is armed anew (press m)")
        while gate.epoch == epoch or not robot.armed or not self._wheel.request():
            await asyncio.sleep(REFRESH)

    async def _until(self, known: Callable[[], bool], why: str) -> None:
        """Wait until something is known; raises GivesUp."""
        ends = self._robot.now + AWAITS
        while not known():
            if self._robot.now >= ends:
                raise GivesUp(why)
            await asyncio.sleep(REFRESH)

    def _read(self) -> Pose | None:
        found = self._there.pose()
        return None if found is None or found.lost else found[:3]

    def _area(self) -> str:
        sheet = self._there.sheet
        return (
            "nothing" if sheet is None else f"{(sheet.grid.cells == FREE).sum() * sheet.resolution**2:.1f} m2 of floor"
        )


def remaining(left: int, beyond: Sequence[tuple[float, float]]) -> str:
    """Return in words how many frontiers are left, and how many the car cannot look at, by their places, m."""
    if not left and not beyond:
        return "no frontiers left"
    told = [f"{left} frontier{'s' * (left > 1)} left"] if left else []
    if beyond:
        x, y = beyond[0]
        kind = f"frontier{'s' * (len(beyond) > 1)} that the car cannot come near, "
        told.append(f"{len(beyond)} {kind}{'the first ' * (len(beyond) > 1)}at ({x:.2f} m, {y:.2f} m)")
    return " and ".join(told)


def _at(frontier: Frontier) -> str:
    return "({:.2f} m, {:.2f} m)".format(*frontier.middle)


async def prepare(runtime: Runtime, name: str) -> None:
    """Import and compile what the planner needs before the robot drives."""
    import_module("scipy.ndimage")
    await in_thread(ways.prepare)


@asynccontextmanager
async def beside(robot: Robot, name: str) -> AsyncIterator[None]:
    """Explore as soon as the robot is ready; the run ends with it."""
    there = robot.runtime.part(OnMap)
    assert there is not None and there.making
    explorer, ready = Explorer(robot, there), asyncio.Event()

    async def explore() -> None:
        await ready.wait()
        await explorer.explore()

    async def begin() -> None:
        ready.set()

    exploring = asyncio.ensure_future(explore())
    robot.on_ready.append(begin)
    robot.alongside.append(exploring)
    robot.unfinished.append(lambda: explorer.unfinished)
    try:
        yield
    finally:
        exploring.cancel()
