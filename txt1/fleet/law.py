"""A law of cooperation: from what a robot knows of itself and hears of the others to its velocity.

The rule of silence: a law names those it cannot do without. When one of them is not heard for `TIMEOUT`, the robot lets
go of the wheel, says so, and stands; when it is heard again, it goes on.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

from txt1.errors import ConfigError
from txt1.fleet.convoy import Follower, Leader
from txt1.fleet.coverage import Coverage
from txt1.fleet.radio import Said
from txt1.fleet.rendezvous import Rendezvous
from txt1.fleet.search import Search

Rooms = tuple[float, float]  # length and width of the room, m


class Law(Protocol):
    """One robot's part of a cooperation."""

    needs: frozenset[str]
    """Whom it has to hear."""

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Velocities to command, m/s and rad/s; `light` is the brightness (lux) and bearing (rad) of the light."""

    @property
    def data(self) -> tuple[float, ...]:
        """Numbers that the others have to know besides its pose and velocities."""


def convoy(name: str, team: list[str], room: Rooms, **settings: Any) -> Law:
    """The first of the team leads, each other one follows the one before it."""
    at = team.index(name)
    return Leader(**settings) if at == 0 else Follower(team[at - 1])


def rendezvous(name: str, team: list[str], room: Rooms, **settings: Any) -> Law:
    """All meet on a circle around the middle that they agree on."""
    return Rendezvous(name, team, **settings)


def coverage(name: str, team: list[str], room: Rooms, **settings: Any) -> Law:
    """All visit the whole floor again and again."""
    return Coverage(name, team, room, **settings)


def search(name: str, team: list[str], room: Rooms, **settings: Any) -> Law:
    """All look for the light, and drive to it when one has seen it."""
    return Search(name, team, room, **settings)


LAWS: Final[dict[str, Callable[..., Law]]] = {
    "convoy": convoy,
    "rendezvous": rendezvous,
    "coverage": coverage,
    "search": search,
}


def make_law(name: str, team: list[str], room: Rooms, settings: Mapping[str, Any]) -> Law:
    """One robot's part in the law that ``cooperate`` names; raises ConfigError."""
    given = dict(settings)
    law = given.pop("law", None)
    if law not in LAWS:
        raise ConfigError(f"cooperate.law: there is no law {law!r}; choose one of: {', '.join(LAWS)}")
    try:
        return LAWS[law](name, team, room, **given)
    except TypeError as error:
        raise ConfigError(f"cooperate: {law}: {error}; see docs/fleet.md") from None
