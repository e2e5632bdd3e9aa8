"""Rendezvous: robots that hear some of the others, now these and now those, agree on a middle and meet around it.

Each keeps an estimate c of the middle, at first its own place, and moves it towards those it hears:

    c_i <- c_i + sum over j heard of (c_j - c_i) / n,      n robots in all.

All estimates become one whenever the graphs of who hears whom are, taken together over bounded times, connected
again and again (A. Jadbabaie, J. Lin and A. S. Morse, "Coordination of groups of mobile autonomous agents using nearest
neighbor rules", IEEE TAC 48, 2003; L. Moreau, IEEE TAC 50, 2005; R. Olfati-Saber, J. A. Fax and R. M. Murray, Proc.
IEEE 95, 2007); where everybody hears whoever hears him, they become the mean of the starts. As cars have a size they
meet in slots: on a circle around the middle, each in the nearest that nobody has claimed before it.

Limits: everybody knows the team's names. The way to a slot goes round the others' outside and has no plan besides,
only avoidance and, where it is blocked, chance.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import atan2, cos, hypot, pi, sin
from typing import Final

from txt1.fleet.air import Said
from txt1.fleet.steering import Helmsman
from txt1.model.kinematics import wrap_angle

SPACING: Final = 1.6  # m between two slots
ROUND: Final = 1.1  # m outside the slots, where cars drive round to their own
SECTOR: Final = 0.35  # rad from the slot's direction within which a car drives in
AHEAD: Final = 0.6  # rad, how far ahead on that circle it aims
ARRIVED: Final = 0.1  # m from the slot

Point = tuple[float, float]


def agree(mine: Point, theirs: Iterable[Point], count: int) -> Point:
    """The estimate of the middle after one step of consensus with those heard, of a team of so many; m."""
    x, y = mine
    for other in theirs:
        x += (other[0] - mine[0]) / count
        y += (other[1] - mine[1]) / count
    return x, y


def slot(middle: Point, number: int, count: int, spacing: float = SPACING) -> Point:
    """The place of robot `number` of so many around the middle, m."""
    radius = 0.0 if count == 1 else 0.5 * spacing / sin(pi / count)
    angle = 2.0 * pi * number / count
    return middle[0] + radius * cos(angle), middle[1] + radius * sin(angle)


class Rendezvous:
    """One robot's part; `speed` in m/s, `spacing` of the slots in m."""

    needs: frozenset[str] = frozenset()  # the graph may change: whoever is heard counts

    def __init__(self, name: str, team: list[str], speed: float = 0.3, spacing: float = SPACING) -> None:
        self._number, self._count = sorted(team).index(name), len(team)
        self._speed, self._spacing = speed, spacing
        self.middle: Point | None = None
        """Where it takes the middle to be, m."""
        self.slot: int | None = None
        """The number of the slot that it claims."""
        self.parked = False
        """Whether it is there."""
        self._enters = False
        self._helmsman = Helmsman(self._number)

    @property
    def data(self) -> tuple[float, ...]:
        """Its estimate of the middle, its slot, whether it is there, and its number in the team."""
        if self.middle is None or self.slot is None:
            return ()
        return *self.middle, float(self.slot), float(self.parked), float(self._number)

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """A step of consensus, and one towards the slot."""
        told = [one.data for one in heard.values() if len(one.data) == 5]
        self.middle = agree(self.middle or (me.x, me.y), ((data[0], data[1]) for data in told), self._count)
        self.slot = self._claim(me, told)
        x, y = slot(self.middle, self.slot, self._count, self._spacing)
        self.parked = hypot(x - me.x, y - me.y) < ARRIVED
        if self.parked and not self._helmsman.blocked:
            return 0.0, 0.0
        x, y = self._around(me, x, y)
        speed = min(self._speed, max(0.1, hypot(x - me.x, y - me.y)))
        return self._helmsman.steer(me, x, y, speed, heard.values())

    def _claim(self, me: Said, told: Sequence[tuple[float, ...]]) -> int:
        """Its slot, or the nearest that nobody claims who stands there or comes first in the team."""
        taken = {int(data[2]) for data in told if (data[3], -data[4]) > (float(self.parked), -self._number)}
        if self.slot is not None and self.slot not in taken:
            return self.slot
        middle = self.middle or (me.x, me.y)
        free = [number for number in range(self._count) if number not in taken] or [self._number]
        places = {number: slot(middle, number, self._count, self._spacing) for number in free}
        return min(free, key=lambda number: hypot(places[number][0] - me.x, places[number][1] - me.y))

    def _around(self, me: Said, x: float, y: float) -> Point:
        """The slot at (x, y) itself, or the next point on the way to its outside, as others stand in theirs; m."""
        middle_x, middle_y = self.middle or (me.x, me.y)
        mine = atan2(me.y - middle_y, me.x - middle_x)
        turn = wrap_angle(atan2(y - middle_y, x - middle_x) - mine)
        self._enters = abs(turn) < (2.0 * SECTOR if self._enters else SECTOR)
        if self._enters:
            return x, y
        outside, angle = hypot(x - middle_x, y - middle_y) + ROUND, mine + min(max(turn, -AHEAD), AHEAD)
        return middle_x + outside * cos(angle), middle_y + outside * sin(angle)
