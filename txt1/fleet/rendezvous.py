"""Rendezvous: robots that hear some of the others, now these and now those, agree on a middle and meet around it.

Each keeps an estimate c of the middle, at first its own place, and moves it towards those it hears:

    c_i <- c_i + sum over j heard of (c_j - c_i) / n,      n robots in all.

All estimates become one whenever the graphs of who hears whom are, taken together over bounded times, connected
again and again (A. Jadbabaie, J. Lin and A. S. Morse, "Coordination of groups of mobile autonomous agents using nearest
neighbor rules", IEEE TAC 48, 2003; L. Moreau, IEEE TAC 50, 2005; R. Olfati-Saber, J. A. Fax and R. M. Murray, Proc.
IEEE 95, 2007); where everybody hears whoever hears him, they become the mean of the starts.

As cars have a size they meet in slots on a circle around the middle. Each claims the nearest that, as far as it has
ever heard, nobody claims who stands there or comes before it in the team. It remembers what each has told last, so it
does not matter who is heard just now; whoever is first in the team loses its slot to nobody but one who stands there,
so each claim changes a finite number of times only (an auction in which rank is the price, after M. Zavlanos, L.
Spesivtsev and G. Pappas, "A distributed auction algorithm for the assignment problem", CDC 2008).

The way leads along a lane inside or outside of the slots and from there into one's own. The slots are so far apart that
a car passes between two that stand, so there always is such a way. Where it does not become shorter for long, the car
drives away by chance and tries anew: with every new try there is a chance, so one succeeds in the end (random walks
out of local minima, J. Barraquand and J.-C. Latombe, "Robot motion planning: a distributed representation approach",
IJRR 10, 1991). That is convergence with probability one, and not by a time that could be told beforehand.

How far apart the slots are follows from the largest body of the team, which all learn from one another as they do the
middle; the middle is moved so that all slots are within the room, where the room is large enough.

Limits: everybody knows the team's names, and who has claimed a slot and is lost keeps it. There is no plan beside lane,
guard and chance: beside obstacles it would need one.
"""

from collections.abc import Iterable, Mapping
from math import atan2, cos, hypot, isfinite, pi, sin
from typing import Final

from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.guard import MARGIN
from txt1.fleet.radio import Said
from txt1.fleet.steering import Helmsman, inside
from txt1.model.kinematics import wrap_angle

PASSING: Final = 0.48  # m more between two slots than a car needs that passes between two that stand
SPACING: Final = 4.0 * DEFAULT_BODY.reach + 2.0 * MARGIN + PASSING  # m between two slots of TXT-1s
ROUND: Final = 0.55  # of the slots' distance outside or inside of them, where cars drive round to their own
SPEED_SHARE: Final = 0.2  # of the fastest; the TXT-1's 0.3 m/s
TOLD: Final = 6  # numbers that each tells
LANES: Final = 0.1  # m beyond the circle of the slots at which a car changes from one lane to the other
GAP: Final = 0.5  # m from that circle, within which others that stand are beside a car
PROGRESS: Final = 0.05  # m by which the way to the slot is to become shorter ...
SLOT_STEPS: Final = 400  # ... within so many steps
NEAR: Final = 0.3  # m from the middle, within which every slot is straight ahead
SECTOR: Final = 0.35  # rad from the slot's direction within which a car drives in
AHEAD: Final = 0.6  # rad, how far ahead on that circle it aims
ARRIVED: Final = 0.1  # m from the slot

REACH_MAX: Final = 2.0  # m; nobody of the team is larger

Point = tuple[float, float]
Room = tuple[float, float]  # length and width, m


def agree(mine: Point, theirs: Iterable[Point], count: int) -> Point:
    """The estimate of the middle after one step of consensus with those heard, of a team of so many; m."""
    x, y = mine
    for other in theirs:
        x += (other[0] - mine[0]) / count
        y += (other[1] - mine[1]) / count
    return x, y


def circle(count: int, spacing: float) -> float:
    """Radius of the circle on which so many slots are, m."""
    return 0.0 if count == 1 else 0.5 * spacing / sin(pi / count)


def slot(middle: Point, number: int, count: int, spacing: float = SPACING) -> Point:
    """The place of robot `number` of so many around the middle, m."""
    radius = circle(count, spacing)
    angle = 2.0 * pi * number / count
    return middle[0] + radius * cos(angle), middle[1] + radius * sin(angle)


class Rendezvous:
    """One robot's part.

    `speed` in m/s, None: a share of its fastest; `spacing` of the slots in m, None: by the bodies.
    """

    needs: frozenset[str] = frozenset()  # the graph may change: whoever is heard counts

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
        self._team = frozenset(team)  # whoever else is heard claims no slot, or there would be too few
        self._speed, self._given, self._body = body.speed(SPEED_SHARE, speed), spacing, body
        self._room = room if room is not None and all(map(isfinite, room)) else None
        self._largest = body.reach  # of all bodies of which it was told, m
        self.middle: Point | None = None
        """Where it takes the middle to be, m."""
        self.slot: int | None = None
        """The number of the slot that it claims."""
        self.parked = False
        """Whether it is there."""
        self._enters = self._inside = False
        self._way: tuple[int | None, float, int] = None, 0.0, 0  # slot, shortest way there so far (m), steps since then
        self._claims: dict[str, tuple[float, ...]] = {}  # the last that each of the others has told
        self._helmsman = Helmsman(self._number, body, self._room)

    @property
    def data(self) -> tuple[float, ...]:
        """Its estimate of the middle, its slot, whether it is there, its number in the team, the largest body."""
        if self.middle is None or self.slot is None:
            return ()
        return *self.middle, float(self.slot), float(self.parked), float(self._number), self._largest

    @property
    def spacing(self) -> float:
        """Distance of two slots, m."""
        return self._given or 4.0 * self._largest + 2.0 * MARGIN + PASSING

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """A step of consensus, and one towards the slot."""
        told = {name: one.data for name, one in heard.items() if name in self._team and len(one.data) == TOLD}
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
        """The middle, moved until all slots are within the room; m."""
        x, y = self.middle or (0.0, 0.0)
        if self._room is None:
            return x, y
        widest = Body(0.0, 0.0, self._largest + circle(self._count, self.spacing))
        return inside(x, y, widest, self._room)

    def _claim(self, me: Said) -> int:
        """Its slot, or the nearest that nobody claims who stands there or comes first in the team."""
        mine = float(self.parked), -self._number
        taken = {int(data[2]) for data in self._claims.values() if (data[3], -data[4]) > mine}
        if self.slot is not None and self.slot not in taken:
            return self.slot
        middle = self._among_walls()
        free = [number for number in range(self._count) if number not in taken]  # one at least, as n - 1 are others
        places = {number: slot(middle, number, self._count, self.spacing) for number in free}
        return min(free, key=lambda number: hypot(places[number][0] - me.x, places[number][1] - me.y))

    def _watch(self, me: Said, x: float, y: float) -> None:
        """Take a detour when the way to the slot at (x, y), m, has not become shorter for long."""
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
        beside = ROUND * self.spacing
        radius, from_middle = hypot(x - middle_x, y - middle_y), hypot(me.x - middle_x, me.y - middle_y)
        self._inside = from_middle < radius + (LANES if self._inside else -LANES)
        lane = max(radius - beside, 0.0) if self._inside else radius + beside
        mine = atan2(me.y - middle_y, me.x - middle_x)
        turn = wrap_angle(atan2(y - middle_y, x - middle_x) - mine)
        wider = 2.0 if self._enters else 1.0
        self._enters = abs(turn) < wider * SECTOR or from_middle < wider * NEAR
        if self._enters:
            return x, y
        ahead = 0.0 if abs(from_middle - radius) < GAP else AHEAD  # between two slots: out of there first
        angle = mine + min(max(turn, -ahead), ahead)
        return middle_x + lane * cos(angle), middle_y + lane * sin(angle)
