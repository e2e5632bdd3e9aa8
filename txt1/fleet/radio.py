"""What robots tell one another, and who is heard: the air between them.

Cooperation needs no more than this: each robot tells where it is and how it moves, twenty times a second, and hears
some of the others. `Radio` is that within one process, with a range and losses if wanted; over a network it is
`txt1.fleet.network.Peer`. Both are a `Medium`.
"""

from collections.abc import Mapping
from math import cos, hypot, inf, sin
from typing import Final, NamedTuple, Protocol

from numpy.random import Generator

from txt1.fleet.body import DEFAULT_BODY, Body

SILENCE: Final = 0.5  # s after which one who was heard is silent

Pose = tuple[float, float, float]


class Said(NamedTuple):
    """Where a robot is in the common frame (m, rad), how it moves (m/s, rad/s), and when that was, s of the listener.

    `data` is what its law tells besides, `body` what the others have to know of the car.
    """

    x: float
    y: float
    theta: float
    v: float = 0.0
    omega: float = 0.0
    time: float = 0.0
    data: tuple[float, ...] = ()
    body: Body = DEFAULT_BODY


class Medium(Protocol):
    """A robot's way to the others."""

    def say(self, said: Said) -> None:
        """Tell the others."""

    def heard(self) -> Mapping[str, Said]:
        """The last that was heard of each of the others."""


class Radio:
    """Carries the words of robots of one process to one another.

    Args:
        reach: distance beyond which nobody is heard, m.
        loss: share of what is told that a listener misses.
        rng: decides that; needed where anything may be lost.

    """

    def __init__(self, reach: float = inf, loss: float = 0.0, rng: Generator | None = None) -> None:
        self.reach, self.loss, self._rng = reach, loss, rng
        self._heard: dict[str, dict[str, Said]] = {}
        self._last: dict[str, Said] = {}

    def voice(self, name: str) -> "Voice":
        """A robot's way to the others."""
        self._heard[name] = {}
        return Voice(self, name)

    def say(self, name: str, said: Said) -> None:
        """Let those who are near enough hear it."""
        self._last[name] = said
        for other, heard in self._heard.items():
            where = self._last.get(other)
            far = self.reach < inf and (where is None or hypot(where.x - said.x, where.y - said.y) > self.reach)
            missed = self._rng is not None and self.loss > 0.0 and self._rng.random() < self.loss
            if other != name and not far and not missed:
                heard[name] = said

    def heard(self, name: str) -> Mapping[str, Said]:
        """The last that a robot has heard of each of the others."""
        return self._heard[name]


class Voice(NamedTuple):
    """One robot's end of the air."""

    air: Radio
    name: str

    def say(self, said: Said) -> None:
        """Tell the others."""
        self.air.say(self.name, said)

    def heard(self) -> Mapping[str, Said]:
        """The last that was heard of each of the others."""
        return self.air.heard(self.name)


def placed(start: Pose, x: float, y: float, theta: float) -> Pose:
    """Odometry's pose in the frame in which it began at `start`; m and rad."""
    c, s = cos(start[2]), sin(start[2])
    return start[0] + c * x - s * y, start[1] + s * x + c * y, start[2] + theta
