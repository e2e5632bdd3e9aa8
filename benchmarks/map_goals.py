"""A room with obstacles: a robot maps it, and drives to goals on the map. Contacts are counted.

    python -m benchmarks.map_goals                           # 100 goals; mapped obstacles only
    python -m benchmarks.map_goals --unmapped 2              # two boxes more, which came after the map was made
    python -m benchmarks.map_goals --maps flat laboratory corridor hall kart clover --goals 167 --unmapped 3 --walkers 2

The simulated TXT-1 with a Hokuyo URG-04LX (240 degrees, 4 m, noise of 1 %) in its room of 5 m x 5 m. Where the
obstacles stand is drawn from the seed. It is driven to some places as by somebody who sees the room, and makes the map
on the way. Then it is placed where it began, and `go_to` takes it by its pose on the map to goals that are drawn, too:
poses at which the body has 12 cm on all sides. It goes on from wherever it is. A contact is the robot's if its own
motion takes it into something at more than 2 cm/s. It ends when nothing has touched for a second. A goal that is
refused, because the robot finds no way, is no contact, and is told.

With `--maps` it drives on maps that come with txt1, among boxes that they do not have, and walkers: boxes of 30 cm that
go to and fro at 0.4 m/s and never stop, nor go round a robot in their way, as people do. A goal has 10 cm on all sides.
A way is allowed if a plan on the true map, with the boxes and 10 cm of margin, leads from the robot's true pose to the
goal. A walker that comes into a robot which stands, or does not drive towards the walker, is counted by itself. Each
goal is given when no walker touches the robot any more, and a robot that this has disarmed is armed again before.
"""

import argparse
import asyncio
import json
import sys
from collections import Counter
from contextlib import suppress
from math import cos, degrees, hypot, inf, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from txt1.errors import CommandRefused
from txt1.kernel.loop import run
from txt1.mapping.poses import placed
from txt1.mapping.seen_floor import with_walls_at
from txt1.maps.files import Map
from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.model.vehicle import Geometry
from txt1.navigation import NoPath, go_to, map_floor, map_pose, true_pose
from txt1.navigation.goto import Blocked, Halted
from txt1.navigation.plan import plan
from txt1.robot import Robot
from txt1.sim import world
from txt1.sim.obstacles import distance, gap
from txt1.sim.parameters import Box
from txt1.sim.room import Room, clearance
from txt1.sim.walls import Walls, walls_of

ROOM: Final = Room(5.0, 5.0)
SETTINGS: Final = ("sensors.laser.driver=sim_laser", "sim.battery.used_1=null")
VISITS: Final = 12
"""Places to which the drive leads that makes the map."""
SPARE: Final = 0.12
"""m round the body at a goal."""
AT_REST: Final = 0.02
"""m/s of the robot towards what it touches, up to which it did not drive into it."""
WAITS: Final = 60.0
"""s for which somebody waits until a walker lets the robot go."""
ALLOWED: Final = 0.1
"""m of margin on the true map with which a way is allowed."""
Pose = tuple[float, float, float]


class Contacts:
    """Counts contacts of vehicles; a contact ends when nothing has touched for a second."""

    def __init__(self) -> None:
        self.own: list[str] = []
        """In which gear the vehicle drove into something, for each contact."""
        self.walkers = 0
        """Contacts in which a walker came into a vehicle that stood, or that did not drive towards the walker."""
        self._last = {True: -inf, False: -inf}
        self._contact = world.World.contact

    def __enter__(self) -> "Contacts":
        def contact(there: world.World, vehicle: Any, after: Any, until: float) -> Any:
            before, elapsed = vehicle.motion, until - vehicle.time
            found = self._contact(there, vehicle, after, until)
            for box in there.moving(vehicle, until):
                if (left := gap(vehicle.outline(after), box)) < 0.0:
                    self._note(until, gap(vehicle.outline(before), box) - left > AT_REST * elapsed, after[3])
                    return found
            if found is not after and abs(after[3]) > AT_REST:
                self._note(until, True, after[3])
            return found

        world.World.contact = contact  # type: ignore[method-assign]
        return self

    def _note(self, time: float, own: bool, v: float) -> None:
        if time > self._last[own] + 1.0:
            if own:
                self.own.append("backward" if v < 0.0 else "forward")
            else:
                self.walkers += 1
        self._last[own] = time

    def apart(self, time: float) -> bool:
        """Return whether nothing has touched for a second."""
        return time > max(self._last.values()) + 1.0

    def __exit__(self, *_: object) -> None:
        world.World.contact = self._contact  # type: ignore[method-assign]


def boxes(rng: np.random.Generator, count: int, others: list[Box]) -> list[Box]:
    """Draw boxes that leave the start alone, and room to pass between each other."""
    found: list[Box] = []
    while len(found) < count:
        x, y = rng.uniform(-2.2, 2.2, 2)
        length, width = rng.uniform(0.2, 0.6, 2)
        box = Box(round(x, 2), round(y, 2), round(length, 2), round(width, 2), round(rng.uniform(0.0, pi), 2))
        # as discs, so the gap between two is wider than that
        if hypot(x, y) > 1.1 and all(gap(box, each) > 0.9 for each in (*others, *found)):
            found.append(box)
    return found


def setting(obstacles: list[Box]) -> str:
    """Return them as a setting."""
    told = [
        f"{{kind: box, x: {each.x}, y: {each.y}, length: {each.length}, width: {each.width}, theta: {each.theta}}}"
        for each in obstacles
    ]
    return f"sim.obstacles=[{', '.join(told)}]"


def seen_by_a_person(obstacles: list[Box]) -> Room:
    """Return the room as somebody sees it who drives by hand."""
    size, corner = 0.05, -2.6
    cells = np.full((104, 104), OCCUPIED, np.int8)
    for row, column in np.ndindex(cells.shape):
        x, y = corner + size * (column + 0.5), corner + size * (row + 0.5)
        if max(abs(x), abs(y)) < 2.5 and all(distance(each, x, y) > 0.5 * size for each in obstacles):
            cells[row, column] = FREE
    return Room(walls=Walls(Map("room", Path(), Grid(cells, size, (corner, corner, 0.0)), "")))


async def mapped(name: Path, obstacles: list[Box], seed: int) -> None:
    """Make the map."""
    settings = (*SETTINGS, setting(obstacles), f"mapping.make={name}")
    async with Robot.open("sim", seed=seed, settings=settings) as robot:
        assert await robot.load_gains()
        room, source = seen_by_a_person(obstacles), true_pose(robot)
        for goal in goals(np.random.default_rng(seed + 3), obstacles, VISITS, robot.config.geometry):
            with suppress(NoPath):
                await go_to(robot, goal, pose_source=source, room=room)


def goals(rng: np.random.Generator, obstacles: list[Box], count: int, body: Any) -> list[Pose]:
    """Draw poses at which the body has room."""
    found: list[Pose] = []
    while len(found) < count:
        x, y, theta = (float(each) for each in rng.uniform((-2.5, -2.5, -pi), (2.5, 2.5, pi)))
        c, s = body.centre * cos(theta), body.centre * sin(theta)
        outline = Box(x + c, y + s, body.length, body.width, theta)
        if clearance(x, y, theta, ROOM, body) > SPARE and all(gap(outline, each) > SPARE for each in obstacles):
            found.append((x, y, theta))
    return found


def walkers(rng: np.random.Generator, count: int, walls: Walls) -> str:
    """Draw walkers on straight ways of 1 to 4 m that keep 0.4 m from walls, away from (0, 0), as a setting."""
    found: list[str] = []
    while len(found) < count:
        ends = [free_place(rng, walls, 0.4) for _ in range(2)]
        way = np.linspace(*ends, 40)
        if 1.0 < hypot(*np.subtract(*ends)) < 4.0 and all(
            walls.distance(*each) > 0.4 and hypot(*each) > 1.0 for each in way.tolist()
        ):
            path = [[round(each, 2) for each in end] for end in ends]
            found.append(f"{{path: {path}, speed: 0.4, length: 0.3, width: 0.3}}")
    return f"sim.movers=[{', '.join(found)}]"


def free_place(rng: np.random.Generator, walls: Walls, room: float) -> tuple[float, float]:
    """Draw a place of a map that is `room` m from walls."""
    grid = walls.grid
    rows, columns = np.nonzero(~grid.solid)
    while True:
        chosen = rng.integers(len(rows))
        x, y = (float(each) for each in grid.to_room(columns[chosen] + rng.random(), rows[chosen] + rng.random()))
        if walls.distance(x, y) > room:
            return x, y


def boxes_on(rng: np.random.Generator, count: int, walls: Walls) -> list[Box]:
    """Draw boxes on the floor of a map."""
    found: list[Box] = []
    while len(found) < count:
        x, y = free_place(rng, walls, 0.1)
        length, width = rng.uniform(0.2, 0.5, 2)
        box = Box(round(x, 2), round(y, 2), round(length, 2), round(width, 2), round(rng.uniform(0.0, pi), 2))
        if hypot(x, y) > 1.1 and all(gap(box, each) > 0.9 for each in found):
            found.append(box)
    return found


def true_floor(walls: Walls, obstacles: list[Box]) -> Room:
    """Return a map with the boxes that stand on it."""
    room, points = Room(walls=walls), [np.empty((0, 2))]
    for box in obstacles:
        along, aside = np.meshgrid(np.linspace(-0.5, 0.5, 40) * box.length, np.linspace(-0.5, 0.5, 40) * box.width)
        points.append(placed((box.x, box.y, box.theta), np.column_stack((along.ravel(), aside.ravel()))))
    found = with_walls_at(np.concatenate(points), room)
    assert found is not None
    return found


async def on_map(name: str, given: argparse.Namespace, results: list[dict[str, Any]]) -> None:
    """Drive to goals on a map of the package."""
    rng, walls = np.random.default_rng(given.seed), walls_of(name)
    there = boxes_on(rng, given.unmapped, walls)
    settings = (*SETTINGS, f"sim.room.map={name}", setting(there), walkers(rng, given.walkers, walls))
    body = Geometry()
    floor = true_floor(walls, there)
    drawn: list[Pose] = []
    while len(drawn) < given.goals:
        pose = (*free_place(rng, walls, 0.1), float(rng.uniform(-pi, pi)))
        if clearance(*pose, floor, body) > ALLOWED:
            drawn.append(pose)
    await visited(name, settings, drawn, given, results, floor)


async def visited(
    name: str,
    settings: tuple[str, ...],
    drawn: list[Pose],
    given: argparse.Namespace,
    results: list[dict[str, Any]],
    floor: Room | None,
) -> None:
    """Drive to the goals; each one's result is added."""
    settings = (*settings, f"mapping.room={name}", "mapping.at=[0, 0, 0]", f"obstacle_stop.people={given.people}")
    with Contacts() as contacts:
        async with Robot.open("sim", seed=given.seed + 1, settings=settings) as robot:
            assert await robot.load_gains()
            await asyncio.sleep(1.0)
            for goal in drawn:
                await left_alone(robot, contacts)
                touched, walked, begun = len(contacts.own), contacts.walkers, robot.now
                allowed = floor is None or is_allowed(robot.pose, goal, floor, robot.config.geometry)
                try:
                    arrival = await go_to(robot, goal, pose_source=map_pose(robot), room=map_floor(robot))
                    told = "arrived" if arrival.arrived else "near"
                except NoPath:
                    told = "no way"
                except Halted:
                    told = "halted"
                except Blocked:
                    told = "blocked"
                except CommandRefused as error:
                    told = str(error)
                true = robot.pose
                assert true is not None
                result = {
                    "goal": goal,
                    "told": told,
                    "allowed": allowed,
                    "contacts": contacts.own[touched:],
                    "walked into": contacts.walkers - walked,
                    "off": hypot(true[0] - goal[0], true[1] - goal[1]),
                    "turn": abs(degrees((true[2] - goal[2] + pi) % (2.0 * pi) - pi)),
                    "seconds": robot.now - begun,
                }
                results.append(result)
                if given.each:
                    print(json.dumps(result), flush=True)


async def left_alone(robot: Robot, contacts: Contacts) -> None:
    """Wait until what holds the robot has gone, and arm it again if that disarmed it."""
    ends = robot.now + WAITS
    while not (robot.armed and contacts.apart(robot.now)) and robot.now < ends:
        await asyncio.sleep(1.0)
        if contacts.apart(robot.now):
            with suppress(CommandRefused):
                robot.arm()


def is_allowed(start: Pose | None, goal: Pose, floor: Room, body: Geometry) -> bool:
    """Return whether a plan on the true map with the margin leads to the goal."""
    assert start is not None
    try:
        plan(start, goal, floor, body, ALLOWED)
    except NoPath:
        return False
    return True


def main() -> int:
    """Map the room, drive to the goals, and print what came of it, losses first."""
    parser = argparse.ArgumentParser(prog="benchmarks.map_goals", description=__doc__.split("\n\n")[0])
    parser.add_argument("--goals", type=int, default=100, help="how many (default 100)")
    parser.add_argument("--seed", type=int, default=1, help="of the room, the goals and all noise (default 1)")
    parser.add_argument("--obstacles", type=int, default=4, help="boxes in the room when it is mapped (default 4)")
    parser.add_argument("--unmapped", type=int, default=0, help="boxes that come afterwards (default 0)")
    parser.add_argument("--each", action="store_true", help="print each goal's result")
    parser.add_argument("--maps", nargs="+", default=[], help="drive on these maps of the package instead")
    parser.add_argument("--walkers", type=int, default=0, help="walkers on each of these maps (default 0)")
    parser.add_argument("--people", type=float, default=0.0, help="obstacle_stop.people, m/s (default 0)")
    given = parser.parse_args()
    results: list[dict[str, Any]] = []
    if given.maps:
        for name in given.maps:
            run(on_map(name, given, results), speed="max")
        print(f"{', '.join(given.maps)}: {given.unmapped} unmapped boxes and {given.walkers} walkers on each")
        return told_of(results)
    rng = np.random.default_rng(given.seed)
    there = boxes(rng, given.obstacles, [])
    later = boxes(rng, given.unmapped, there)
    with TemporaryDirectory() as folder:
        name = Path(folder, "room")
        with Contacts() as contacts:
            run(mapped(name, there, given.seed), speed="max")
        print(f"{given.obstacles} boxes mapped, with {len(contacts.own)} contacts; {given.unmapped} came afterwards")
        everything = [*there, *later]
        drawn = goals(np.random.default_rng(given.seed + 2), everything, given.goals, Geometry())
        run(visited(str(name), (*SETTINGS, setting(everything)), drawn, given, results, None), speed="max")
    return told_of(results)


def told_of(results: list[dict[str, Any]]) -> int:
    """Print what came of the goals, losses first."""
    touched = Counter(gear for each in results for gear in each["contacts"])
    print(
        f"{'DOES NOT HOLD' if touched else 'holds'}: the robot drove into something {touched.total()} times at "
        f"{len(results)} goals (aim 0), {touched['backward']} of them backward; walkers came into it "
        f"{sum(each['walked into'] for each in results)} times"
    )
    told = Counter(each["told"] for each in results)
    print("; ".join(f"{count} {word}" for word, count in told.most_common()))
    allowed = [each for each in results if each["allowed"]]
    reached = sum(each["told"] == "arrived" for each in allowed)
    print(f"{reached} reached of {len(allowed)} to which the true floor allows a way")
    there_now = [each for each in results if each["told"] == "arrived"]
    if there_now:
        off, turn, seconds = (np.array([each[key] for each in there_now]) for key in ("off", "turn", "seconds"))
        print(
            f"arrived, by the simulation: {100.0 * off.mean():.1f} cm and {turn.mean():.1f} degrees off in the mean, "
            f"{100.0 * off.max():.1f} cm and {turn.max():.1f} degrees at worst; {seconds.mean():.0f} s a goal"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
