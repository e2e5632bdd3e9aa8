"""A law of cooperation: it makes a robot's velocity from its own state and the states of the others.

A law proposes; the guard (`txt1.fleet.guard`) decides how much of it the car drives.

The rule of silence: a law names the robots that it needs to hear. When one of them is not heard for `SILENCE`, the
robot lets go of the wheel, says so, and stands. When that robot is heard again, it goes on.
"""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, Final, Protocol

from txt1.errors import ConfigError
from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.convoy import Follower, Leader
from txt1.fleet.coverage import Coverage
from txt1.fleet.radio import Said
from txt1.fleet.rendezvous import Rendezvous
from txt1.fleet.search import Search

# length and width of the room, m
Rooms = tuple[float, float]


class Law(Protocol):
    """One robot's part of a cooperation."""

    needs: frozenset[str]
    """Names of the robots that it needs to hear."""

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Return velocities to command, m/s and rad/s; `light` is the light's brightness (lux) and bearing (rad)."""

    @property
    def data(self) -> tuple[float, ...]:
        """Numbers that the others need besides its pose and velocities."""


def _convoy(name: str, team: list[str], room: Rooms, body: Body, **settings: Any) -> Law:
    at = team.index(name)
    return Leader(body, **settings) if at == 0 else Follower(team[at - 1], body)


LAWS: Final[Mapping[str, Callable[..., Law]]] = {
    "convoy": _convoy,
    "rendezvous": lambda name, team, room, body, **settings: Rendezvous(name, team, room, body=body, **settings),
    "coverage": lambda name, team, room, body, **settings: Coverage(name, team, room, body=body, **settings),
    "search": lambda name, team, room, body, **settings: Search(name, team, room, body=body, **settings),
}
"""By name; called with the robot's name, the team in its order, the room, its body, and the law's settings.

In a convoy the first of the team leads, and each robot follows the robot before it.
"""


def make_law(name: str, team: list[str], room: Rooms, settings: Mapping[str, Any], body: Body = DEFAULT_BODY) -> Law:
    """Make one robot's part in the law that ``cooperate`` names, for a car of this body; raises ConfigError."""
    given = dict(settings)
    law = given.pop("law", None)
    if law not in LAWS:
        raise ConfigError(f"cooperate.law: there is no law {law!r}; choose one of: {', '.join(LAWS)}")
    if law in ("coverage", "search") and not all(map(isfinite, room)):
        raise ConfigError(f"cooperate.law: {law} sweeps a rectangle: give sim.room.length and width, and no map")
    try:
        return LAWS[law](name, team, room, body, **given)
    except TypeError as error:
        raise ConfigError(f"cooperate: {law}: {error}; see docs/fleet.md") from None
