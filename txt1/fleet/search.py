"""Searching the light together: all cover the floor until one of them sees it; then all drive there.

A robot sees the light when its sensors read more than `SEES`; it tells where it then takes the light to be: from its
own place along the measured bearing, as far as an inverse-square law with a lamp of known strength says. The others
believe the brightest report they have heard (source seeking by shared measurements, after P. Ogren, E. Fiorelli and
N. E. Leonard, "Cooperative control of mobile sensor networks", IEEE TAC 49, 2004, with one report, no gradient).

Limits: one light, and none of the team lies.
"""

from collections.abc import Mapping
from math import cos, hypot, sin, sqrt
from typing import Final

from txt1.fleet.coverage import Coverage
from txt1.fleet.radio import Said
from txt1.fleet.steering import DEFAULT_BODY, Body, Helmsman

SEES: Final = 30.0  # lux: with the lamp of 135 lux at 1 m that is 2.1 m away
LAMP: Final = 135.0  # lux at 1 m
FOUND: Final = 0.5  # m from the light, the goal of the thesis's episodes


class Search:
    """One robot's part; `speed` in m/s, the light is seen from `sees` lux on."""

    def __init__(
        self,
        name: str,
        team: list[str],
        room: tuple[float, float],
        speed: float = 0.3,
        sees: float = SEES,
        body: Body = DEFAULT_BODY,
    ) -> None:
        self._cover = Coverage(name, team, room, speed, body)
        self.needs = self._cover.needs
        self._speed, self._sees = speed, sees
        self._helmsman = Helmsman(sorted(team).index(name), body, room)
        self._told: tuple[float, float, float] | None = None  # lux, and where: m

    @property
    def data(self) -> tuple[float, ...]:
        """The brightest report: lux, and where it takes the light to be, m."""
        return self._told or ()

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Cover the floor, or drive to where the light is said to be."""
        if light is not None and light[0] >= self._sees and (self._told is None or light[0] > self._told[0]):
            away, bearing = sqrt(LAMP / light[0]), me.theta + light[1]
            self._told = light[0], me.x + away * cos(bearing), me.y + away * sin(bearing)
        for other in heard.values():
            if len(other.data) == 3 and (self._told is None or other.data[0] > self._told[0]):
                self._told = other.data[0], other.data[1], other.data[2]
        if self._told is None:
            return self._cover.step(me, heard, light)
        _, x, y = self._told
        if hypot(x - me.x, y - me.y) < 0.8 * FOUND:
            return 0.0, 0.0
        return self._helmsman.steer(me, x, y, self._speed, heard.values())
