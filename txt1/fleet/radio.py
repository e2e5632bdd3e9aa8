"""The states that robots send to each other, and which robots receive them.

Each robot sends its pose and velocities twenty times a second, and receives the states of some other robots.
Cooperation needs no more. `Radio` connects robots of one process, with a range and losses if wanted.
`txt1.fleet.network.Peer` connects robots over a network. Both are a `Medium`.
"""

from collections.abc import Mapping
from math import cos, hypot, inf, sin
from typing import Final, NamedTuple, Protocol

from numpy.random import Generator

from txt1.fleet.body import DEFAULT_BODY, Body

# s without a message after which a robot is silent
ROBOT_SILENCE: Final = 0.5

Pose = tuple[float, float, float]


class Said(NamedTuple):
    """A robot's pose in the common frame (m, rad), its velocities (m/s, rad/s), and their time, s of the listener.

    `data` are further numbers of its law; `body` describes the car to the others.
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
    """A robot's connection to the others."""

    def say(self, said: Said) -> None:
        """Send a state to the others."""

    def heard(self) -> Mapping[str, Said]:
        """The last state heard of each other robot, by name."""


class Radio:
    """Carries the states between the robots of a process.

    Args:
        reach: range, m.
        loss: share of the messages that a listener misses.
        rng: decides which messages are lost; needed with a `loss`.

    """

    def __init__(self, reach: float = inf, loss: float = 0.0, rng: Generator | None = None) -> None:
        self.reach, self.loss, self._rng = reach, loss, rng
        self._heard: dict[str, dict[str, Said]] = {}
        self._last: dict[str, Said] = {}

    def voice(self, name: str) -> "Voice":
        """Return a robot's connection to the others."""
        self._heard[name] = {}
        return Voice(self, name)

    def say(self, name: str, said: Said) -> None:
        """Deliver a state to all robots within range."""
        self._last[name] = said
        for other, heard in self._heard.items():
            where = self._last.get(other)
            far = self.reach < inf and (where is None or hypot(where.x - said.x, where.y - said.y) > self.reach)
            missed = self._rng is not None and self.loss > 0.0 and self._rng.random() < self.loss
            if other != name and not far and not missed:
                heard[name] = said

    def heard(self, name: str) -> Mapping[str, Said]:
        """The last state that a robot has heard of each other robot."""
        return self._heard[name]


class Voice(NamedTuple):
    """One robot's connection to the radio."""

    air: Radio
    name: str

    def say(self, said: Said) -> None:
        """Send a state to the others."""
        self.air.say(self.name, said)

    def heard(self) -> Mapping[str, Said]:
        """The last state heard of each other robot, by name."""
        return self.air.heard(self.name)


def placed(start: Pose, x: float, y: float, theta: float) -> Pose:
    """Convert a pose of the odometry to the frame in which the robot began at `start`; m and rad."""
    c, s = cos(start[2]), sin(start[2])
    return start[0] + c * x - s * y, start[1] + s * x + c * y, start[2] + theta
