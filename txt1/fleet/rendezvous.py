"""Rendezvous: the robots agree on a middle and meet around it, although each hears only some others at a time.

Each robot keeps an estimate c of the middle, at first its own place. It moves c towards the estimates that it hears:

    c_i <- c_i + sum over j heard of (c_j - c_i) / n,      n robots in all.

All estimates become equal if the graphs of who hears whom, taken together over bounded times, are connected again and
again (A. Jadbabaie, J. Lin and A. S. Morse, "Coordination of groups of mobile autonomous agents using nearest neighbor
rules", IEEE TAC 48, 2003; L. Moreau, IEEE TAC 50, 2005; R. Olfati-Saber, J. A. Fax and R. M. Murray, Proc. IEEE 95,
2007). If hearing is always mutual, they become the mean of the starts.

Cars have a size, so they meet in slots on a circle around the middle. Each car claims the nearest free slot. A slot is
taken if a car stands in it, or if a car of higher rank was ever heard to claim it. Each car remembers the last claim of
every other car, so it does not matter which cars are heard at the moment. The first car of the team loses its slot only
to a car that stands there. So each claim changes a finite number of times (an auction in which rank is the price, after
M. Zavlanos, L. Spesivtsev and G. Pappas, "A distributed auction algorithm for the assignment problem", CDC 2008).

The way leads along a lane inside or outside of the slots, and from there into the car's own slot. The slots are so far
apart that a car passes between two standing cars, so there always is a way. If the way has not become shorter for long,
the car drives away at random and tries again. Each try succeeds with some probability, so the car arrives in the end
(random walks out of local minima, J. Barraquand and J.-C. Latombe, "Robot motion planning: a distributed representation
approach", IJRR 10, 1991). This is convergence with probability one; no time can be given beforehand.

The distance of the slots follows from the largest body of the team, which is agreed on like the middle. The middle is
moved until all slots are within the room, if the room is large enough.

Limits: every robot knows the team's names. A robot that has claimed a slot and is then lost keeps it. There is no plan
beside lane, guard and chance, so obstacles may block a car. A parked car makes no way: a car between it and a wall may
stay there for good (2 of 5000 random runs).
"""

from collections.abc import Iterable, Mapping
from math import atan2, cos, hypot, isfinite, pi, sin
from typing import Final

from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.guard import ROBOT_MARGIN
from txt1.fleet.radio import Said
from txt1.fleet.steering import Helmsman, inside
from txt1.model.kinematics import wrap_angle

# m of room that a passing car has between two standing cars
PASSING: Final = 0.48
# m between two slots of TXT-1s
SPACING: Final = 4.0 * DEFAULT_BODY.reach + 2.0 * ROBOT_MARGIN + PASSING
# of the slots' distance: how far outside or inside the slots the lanes are
LANE_SHARE: Final = 0.55
# of the fastest; the TXT-1's 0.3 m/s
SPEED_SHARE: Final = 0.2
# numbers in each robot's message
MESSAGE_NUMBERS: Final = 6
# m beyond the circle of the slots at which a car changes from one lane to the other
LANES: Final = 0.1
# m from that circle; other cars that stand within it are beside the car
CIRCLE_WIDTH: Final = 0.5
# m by which the way to the slot has to become shorter ...
PROGRESS: Final = 0.05
# ... within this many steps
SLOT_STEPS: Final = 400
# m from the middle; from within it every slot is straight ahead
MIDDLE_SHARE: Final = 0.3
# rad from the slot's direction within which a car drives in
SECTOR: Final = 0.35
# rad by which the car aims ahead on that circle
AIM_AHEAD: Final = 0.6
# m from the slot
ARRIVED: Final = 0.1

# m; no body of the team is larger
REACH_MAX: Final = 2.0

Point = tuple[float, float]
# length and width of the room, m
Room = tuple[float, float]


def agree(mine: Point, theirs: Iterable[Point], count: int) -> Point:
    """Return the estimate of the middle after one step of consensus, for a team of `count` robots; m."""
    x, y = mine
    for other in theirs:
        x += (other[0] - mine[0]) / count
        y += (other[1] - mine[1]) / count
    return x, y


def circle(count: int, spacing: float) -> float:
    """Radius of a circle with `count` slots, m."""
    return 0.0 if count == 1 else 0.5 * spacing / sin(pi / count)


def slot(middle: Point, number: int, count: int, spacing: float = SPACING) -> Point:
    """The place of robot `number` of `count` around the middle, m."""
    radius = circle(count, spacing)
    angle = 2.0 * pi * number / count
    return middle[0] + radius * cos(angle), middle[1] + radius * sin(angle)


class Rendezvous:
    """One robot's part.

    `speed` in m/s, None: a share of its fastest; `spacing` of the slots in m, None: by the bodies.
    """

    # the graph may change, so no robot has to be heard
    needs: frozenset[str] = frozenset()

    def __init__(
        self,
        name: str,
        team: list[str],
        room: Room | None = None,
        speed: float | None = None,
        spacing: float | None = None,
        body: Body = DEFAULT_BODY,
    ) -> None:
        self._number, self._count = sorted(team).index(name), len(team)
        # only members of the team claim slots: there are no more slots
        self._team = frozenset(team)
        self._speed, self._given, self._body = body.speed(SPEED_SHARE, speed), spacing, body
        self._room = room if room is not None and all(map(isfinite, room)) else None
        # largest of all bodies heard, m
        self._largest = body.reach
        self.middle: Point | None = None
        """Its estimate of the middle, m."""
        self.slot: int | None = None
        """The number of the slot that it claims."""
        self.parked = False
        """Whether it stands in its slot."""
        self._enters = self._inside = False
        # slot, shortest way to it so far (m), steps since then
        self._way: tuple[int | None, float, int] = None, 0.0, 0
        # the last numbers of each other robot
        self._claims: dict[str, tuple[float, ...]] = {}
        self._helmsman = Helmsman(self._number, body, self._room)

    @property
    def data(self) -> tuple[float, ...]:
        """Its estimate of the middle, its slot, whether it is there, its number in the team, the largest body."""
        if self.middle is None or self.slot is None:
            return ()
        return *self.middle, float(self.slot), float(self.parked), float(self._number), self._largest

    @property
    def spacing(self) -> float:
        """Distance between two slots, m."""
        return self._given or 4.0 * self._largest + 2.0 * ROBOT_MARGIN + PASSING

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Make a step of consensus, and drive towards the slot."""
        told = {
            name: one.data for name, one in heard.items() if name in self._team and len(one.data) == MESSAGE_NUMBERS
        }
        self.middle = agree(self.middle or (me.x, me.y), ((data[0], data[1]) for data in told.values()), self._count)
        self._largest = max(self._largest, *(min(data[5], REACH_MAX) for data in told.values()), 0.0)
        self._claims.update(told)
        self.slot = self._claim(me)
        x, y = slot(self._among_walls(), self.slot, self._count, self.spacing)
        self.parked = hypot(x - me.x, y - me.y) < (2.0 * ARRIVED if self.parked else ARRIVED)
        if self.parked and not self._helmsman.blocked:
            return 0.0, 0.0
        self._watch(me, x, y)
        x, y = self._around(me, x, y)
        speed = min(self._speed, max(0.1, hypot(x - me.x, y - me.y)))
        return self._helmsman.steer(me, x, y, speed)

    def _among_walls(self) -> Point:
        """The middle, moved until all slots are within the room, m."""
        x, y = self.middle or (0.0, 0.0)
        if self._room is None:
            return x, y
        widest = Body(0.0, 0.0, self._largest + circle(self._count, self.spacing))
        return inside(x, y, widest, self._room)

    def _claim(self, me: Said) -> int:
        """Return its slot, or else the nearest slot without a car that stands there or has a higher rank."""
        mine = float(self.parked), -self._number
        taken = {int(data[2]) for data in self._claims.values() if (data[3], -data[4]) > mine}
        if self.slot is not None and self.slot not in taken:
            return self.slot
        middle = self._among_walls()
        # at least one, for n - 1 other cars
        free = [number for number in range(self._count) if number not in taken]
        places = {number: slot(middle, number, self._count, self.spacing) for number in free}
        return min(free, key=lambda number: hypot(places[number][0] - me.x, places[number][1] - me.y))

    def _watch(self, me: Said, x: float, y: float) -> None:
        """Take a detour if the way to the slot at (x, y), m, has not become shorter for long."""
        way = hypot(x - me.x, y - me.y)
        if self.slot != self._way[0] or way < self._way[1] - PROGRESS:
            self._way = self.slot, way, 0
        elif self._way[2] < SLOT_STEPS:
            self._way = *self._way[:2], self._way[2] + 1
        else:
            self._way = self.slot, way, 0
            self._helmsman.detour(me, self._speed)

    def _around(self, me: Said, x: float, y: float) -> Point:
        """The slot at (x, y) itself, or the next point on the lane before it, inside or outside of all slots; m."""
        middle_x, middle_y = self._among_walls()
        beside = LANE_SHARE * self.spacing
        radius, from_middle = hypot(x - middle_x, y - middle_y), hypot(me.x - middle_x, me.y - middle_y)
        self._inside = from_middle < radius + (LANES if self._inside else -LANES)
        lane = max(radius - beside, 0.0) if self._inside else radius + beside
        mine = atan2(me.y - middle_y, me.x - middle_x)
        turn = wrap_angle(atan2(y - middle_y, x - middle_x) - mine)
        wider = 2.0 if self._enters else 1.0
        self._enters = abs(turn) < wider * SECTOR or from_middle < wider * MIDDLE_SHARE
        if self._enters:
            return x, y
        # between two slots: out of there first
        ahead = 0.0 if abs(from_middle - radius) < CIRCLE_WIDTH else AIM_AHEAD
        angle = mine + min(max(turn, -ahead), ahead)
        return middle_x + lane * cos(angle), middle_y + lane * sin(angle)
