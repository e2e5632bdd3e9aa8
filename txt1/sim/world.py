"""The world of the simulated robots: a room with a light, obstacles, and any number of vehicles that share it.

**Time.** Every vehicle keeps the time of its own robot's run and moves when its robot reads or writes at a later one.
Several vehicles move on together. Drag is constant for 20 ms at a time, and each vehicle stops over at the end of each
such interval. Before a vehicle moves to an instant, all vehicles are brought to the ends of all intervals before it: in
the order of these ends and, at the same instant, in the order in which the vehicles came into the world. So as long as
vehicles do not touch, the motion of a vehicle does not depend by a bit on the other vehicles, on how often they are
read, or on the order.

**Contact.** Each motion of a vehicle is compared with everything near: walls, obstacles, and the bodies of other
vehicles at the same instant. A vehicle that would get deeper into a wall or an obstacle stays where it was, at speed 0.
Two vehicles that would get deeper into each other both stay where they were at the last instant at which either of them
moved. The result does not depend on the order in which they are read. A mover never stops: a vehicle that it runs into
cannot get deeper into it by itself, and is free when the mover has passed.
"""

from heapq import heapify, heapreplace
from math import hypot, inf, isfinite
from typing import TYPE_CHECKING, Final

from txt1.kernel.clock import NS_PER_S, Clock
from txt1.sim.dynamics import Motion
from txt1.sim.obstacles import Obstacle, distance, gap
from txt1.sim.parameters import Box, Post
from txt1.sim.room import Room, clearance
from txt1.sim.vehicle import Vehicle

if TYPE_CHECKING:
    from txt1.sim.movers import Moving

# m along x or y after which a vehicle looks for things in its way again
ROAM: Final = 0.25

# m by which two vehicles may approach in 20 ms: that is 7.5 m/s each
APPROACH_MAX: Final = 0.3

# vehicles whose circles were nearer than this, m, at their last look, watch each other; 3 for twice a diagonal
NEAR: Final = 3.0 * ROAM + APPROACH_MAX

NOWHERE: Final = (inf, -inf, inf, -inf)


class _Whereabouts:
    """Place and result of a vehicle's last look for things in its way."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.reach = 0.5 * hypot(vehicle.body.length, vehicle.body.width) + abs(vehicle.body.centre)
        self.x = self.y = 0.0
        # nothing can be in its way
        self.roam = inf
        self.others: list[_Whereabouts] = []
        self.obstacles: list[Obstacle] = []


class World:
    """The common world of simulated robots, on a single event loop.

    Args:
        room: the four walls, or a map's.
        light: place of the light, x and y in m.
        obstacles: boxes and posts.
        movers: boxes that move along paths and never stop.

    Raises ValueError: a number of an obstacle is not finite, or one of its lengths is not positive.
    """

    def __init__(
        self,
        room: Room = Room(),  # noqa: B008 - immutable
        light: tuple[float, float] = (0.0, 0.0),
        obstacles: tuple[Obstacle, ...] = (),
        movers: "tuple[Moving, ...]" = (),
    ) -> None:
        for number, obstacle in enumerate(obstacles):
            sizes = (obstacle.radius,) if isinstance(obstacle, Post) else (obstacle.length, obstacle.width)
            if not all(isfinite(value) for value in (obstacle.x, obstacle.y, *sizes)) or min(sizes) <= 0.0:
                raise ValueError(f"obstacle {number}, {obstacle}: its numbers are finite, and its lengths more than 0")
        self.room = room
        self.light = light
        self.obstacles = obstacles
        self.movers = movers
        self._clock: Clock
        self._origin_ns = -1
        self._all: list[_Whereabouts] = []
        self._of: dict[Vehicle, _Whereabouts] = {}
        # heap: time of the next change of a running vehicle's drag, and the vehicle's index
        self._ends: list[tuple[float, int]] = []

    @property
    def vehicles(self) -> list[Vehicle]:
        """The vehicles in the order of their arrival."""
        return [each.vehicle for each in self._all]

    def add(self, vehicle: Vehicle) -> None:
        """Add a vehicle. It has room, and stands until its run begins."""
        self._of[vehicle] = _Whereabouts(vehicle)
        self._all.append(self._of[vehicle])
        self.look_round(vehicle)

    def in_the_way(self, vehicle: Vehicle, x: float, y: float, theta: float, margin: float = 0.0) -> str | None:
        """Return the thing that a vehicle at (x, y, theta) would touch, in words; None if it has `margin` m of room."""
        room, body = self.room, vehicle.outline((x, y, theta))
        if clearance(x, y, theta, room, vehicle.body) < margin:
            return f"a wall of the {room.length:g} x {room.width:g} m room" if room.walls is None else room.walls.told
        for number, obstacle in enumerate(self.obstacles):
            if gap(body, obstacle) < margin:
                return f"obstacle {number}, a {type(obstacle).__name__.lower()} at ({obstacle.x:g}, {obstacle.y:g})"
        if any(gap(body, each) < margin for each in self.moving(vehicle, vehicle.time)):
            return "something that moves"
        for other in self.vehicles:
            if other is not vehicle and gap(body, other.outline(other.pose)) < margin:
                return f"another vehicle{other.name and ', '}{other.name}"
        return None

    def moving(self, vehicle: Vehicle, time: float) -> list[Box]:
        """Return the movers' boxes at `time`, s of a vehicle's own clock."""
        return [each.at(vehicle.began + time) for each in self.movers]

    # -- time --------------------------------------------------------------------------------------------------

    def expect(self, vehicle: Vehicle, clock: Clock) -> None:
        """Prepare for a run of a vehicle's robot on this event loop's clock; the run begins with the first motion."""
        if self._origin_ns < 0:
            self._origin_ns = clock.now_ns()
        self._clock = clock
        vehicle.rewind()
        vehicle.running = False
        self._gather()
        vehicle.accompanied = True

    def advance(self, vehicle: Vehicle, time: float) -> None:
        """Let all vehicles move on, one of them to `time`, s of its own clock."""
        if not vehicle.running:
            vehicle.began = (self._clock.now_ns() - self._origin_ns) / NS_PER_S - time
            vehicle.running = True
            self._gather()
        now, ends = vehicle.began + time, self._ends
        while ends[0][0] <= now:
            index = ends[0][1]
            each = self._all[index].vehicle
            each.finish_piece()
            heapreplace(ends, (each.began + each.piece_ends, index))
        vehicle.move_to(time)

    def _gather(self) -> None:
        """Note which vehicles move whenever another moves."""
        running = [(index, each.vehicle) for index, each in enumerate(self._all) if each.vehicle.running]
        self._ends = [(each.began + each.piece_ends, index) for index, each in running]
        heapify(self._ends)
        for _, each in running:
            each.accompanied = len(running) > 1

    # -- contact -----------------------------------------------------------------------------------------------

    def contact(self, vehicle: Vehicle, after: Motion, until: float) -> Motion:
        """Return a vehicle's motion at `until`, s of its own clock: `after`, or its old place if something is
        in its way.
        """
        here = self._of[vehicle]
        if abs(after[0] - here.x) > here.roam or abs(after[1] - here.y) > here.roam:
            self.look_round(vehicle, after)
        after = self._blocked(here, after, until)
        for there in here.others:
            x, y = there.vehicle.pose[:2]
            if hypot(after[0] - x, after[1] - y) < here.reach + there.reach + APPROACH_MAX:
                after = self._collide(here, there, after, until)
        return after

    def _blocked(self, here: _Whereabouts, after: Motion, until: float) -> Motion:
        """Return a vehicle's motion at `until`.

        It stops if it would get deeper into something, but not on its way out.
        """
        vehicle, room = here.vehicle, self.room
        before = vehicle.motion
        left = clearance(after[0], after[1], after[2], room, vehicle.body)
        if left < 0.0 and left < clearance(before[0], before[1], before[2], room, vehicle.body):
            return halted(vehicle, before, after)
        for obstacle in (*here.obstacles, *self.moving(vehicle, until)) if self.movers else here.obstacles:
            left = gap(vehicle.outline(after), obstacle)
            if left < 0.0 and left < gap(vehicle.outline(before), obstacle):
                return halted(vehicle, before, after)
        return after

    def _collide(self, here: _Whereabouts, there: _Whereabouts, after: Motion, until: float) -> Motion:
        """Return a vehicle's motion at `until`; if it runs into the other vehicle, both stop."""
        vehicle, other = here.vehicle, there.vehicle
        # vehicle's clock minus other's; a vehicle that has not started is compared at the same instant
        ahead = other.began - vehicle.began if other.running else vehicle.time - other.time
        its_until = until - ahead
        its_after = self._blocked(there, other.motion_at(its_until), its_until)
        left = gap(vehicle.outline(after), other.outline(its_after))
        if left >= 0.0:
            return after
        # this vehicle's time at the last motion of either
        last = max(vehicle.time, other.time + ahead)
        mine = self._blocked(here, vehicle.motion_at(last), last) if last > vehicle.time else vehicle.motion
        its_last = last - ahead
        its = self._blocked(there, other.motion_at(its_last), its_last) if its_last > other.time else other.motion
        if left >= gap(vehicle.outline(mine), other.outline(its)):
            return after
        if other.running:
            other.arrive(halted(other, its, its_after), its_until)
        return halted(vehicle, mine, after)

    def look_round(self, vehicle: Vehicle, motion: Motion | None = None) -> None:
        """Find the things a vehicle may run into before its next look, and the space in which it is free to move."""
        here = self._of[vehicle]
        here.x, here.y = (vehicle.motion if motion is None else motion)[:2]
        here.obstacles = [
            each for each in self.obstacles if distance(each, here.x, here.y) < here.reach + 1.5 * ROAM + APPROACH_MAX
        ]
        if self.obstacles or len(self._all) > 1 or self.room.walls is not None:
            here.roam = ROAM
        for there in self._all:
            if there is here:
                continue
            # it was alone
            if there.roam > ROAM:
                self.look_round(there.vehicle)
            near = hypot(here.x - there.x, here.y - there.y) < here.reach + there.reach + NEAR
            if near is not (there in here.others):
                for one, two in ((here, there), (there, here)):
                    if near:
                        one.others.append(two)
                    else:
                        one.others.remove(two)
                self._set_free(there)
        self._set_free(here)

    def _set_free(self, here: _Whereabouts) -> None:
        """Store the range of the vehicle's centre in which nothing is in reach, whatever its heading."""
        vehicle, room, roam = here.vehicle, self.room, here.roam
        if room.walls is not None:
            roam = min(roam, room.walls.roam(here.x, here.y, here.reach))
        vehicle.crowded = bool(here.others or here.obstacles or self.movers)
        x, y = 0.5 * room.length - here.reach, 0.5 * room.width - here.reach
        free = max(-x, here.x - roam), min(x, here.x + roam), max(-y, here.y - roam), min(y, here.y + roam)
        vehicle.free = NOWHERE if vehicle.crowded else free


def halted(vehicle: Vehicle, before: Motion, after: Motion) -> Motion:
    """Return the motion at contact: pose and wheels as before, at rest, the steering as turned."""
    x, y, theta, _, _, _, right, left, _ = before
    front, rear = (0.0, 0.0) if vehicle.skids else (after[4], after[5])
    return x, y, theta, 0.0, front, rear, right, left, 0.0
