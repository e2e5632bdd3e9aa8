"""The web page of a fleet on a network: the page's server on one side, a peer without a robot on the other.

The page shows the state that each robot sends 20 times a second: pose, velocities, whether it may drive and which
source drives it. A stop is a stop of all, repeated until all have answered. Driving commands go to the robot that the
page shows. Everything else is done at the robot itself.
"""

from __future__ import annotations

import json
import socket
import threading
from contextlib import suppress
from math import inf
from typing import TYPE_CHECKING, Any, Final

from txt1.control.hand import DEFAULT_HAND
from txt1.errors import CommandRefused
from txt1.fleet.members import Member
from txt1.telemetry.snapshot import plain

if TYPE_CHECKING:
    from txt1.fleet.network import Peer

# looks a second
FLEET_PAGE_RATE: Final = 20.0
# requests without a meaning here
QUIET: Final = ("", "subscribe", "request", "halt")
# s after a command during which a robot that "fleet" drives counts as driven from this page
DROVE_LATELY: Final = 0.5


class Network:
    """All robots of a fleet on a network, as the page's server sees robots (`txt1.web.pages.Robots`)."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._began = peer.now
        # time at which each robot was last driven from here
        self._drove: dict[str, float] = {}
        self._ours, self._theirs = socket.socketpair()
        self._ours.setblocking(False)
        self._closing = threading.Event()
        self._beating = threading.Thread(target=self._beat, name="fleet page", daemon=True)
        self._beating.start()

    def close(self) -> None:
        """Stop looking for news."""
        self._closing.set()
        self._beating.join()
        self._ours.close()
        self._theirs.close()

    def names(self) -> list[str]:
        """The robots that are present."""
        return [one.name for one in self._peer.members() if one.alive]

    def fileno(self) -> int:
        """The file descriptor that becomes readable whenever it is time to look."""
        return self._ours.fileno()

    def newest(self) -> bytes:
        """The telemetry of all robots present, as a list; each robot's telemetry holds the poses of the others."""
        with suppress(BlockingIOError):
            self._ours.recv(4096)
        members = self._peer.members()
        there = [one for one in members if one.alive and one.pose is not None]
        told = [_telemetry(self._seen(one), there, members, self._peer.now - self._began) for one in there]
        if (stop := self._peer.standing()) is not None:
            for each in told:
                each["topics"]["/fleet_stop"] = str(stop[0])
        return json.dumps(told).encode()

    def request(self, name: str, /, **fields: object) -> None:
        """Carry out a page's request; raises CommandRefused if it is impossible from here."""
        if name == "stop":
            self._peer.stop_all()
        elif name == "drive":
            self._drove[str(fields["robot"])] = self._peer.now
            v, omega, age = (float(str(fields.get(each, 0.0))) for each in ("v", "omega", "age"))
            self._peer.drive(str(fields["robot"]), v, omega, age)
        elif name == "release":
            self._peer.drive(str(fields["robot"]), 0.0, 0.0)
        elif name not in QUIET:
            raise CommandRefused(f"a fleet's page stops and drives; '{name}' is done at the robot or on its own page")

    def _seen(self, one: Member) -> Member:
        """Return a robot that this page drives as driven by "web"; a robot driven by another console stays at
        "fleet".
        """
        ours = one.driver == "fleet" and self._peer.now - self._drove.get(one.name, -inf) < DROVE_LATELY
        return one._replace(driver="web") if ours else one

    def _beat(self) -> None:
        while not self._closing.wait(1.0 / FLEET_PAGE_RATE):
            self._theirs.send(b".")


def _telemetry(one: Member, there: list[Member], members: tuple[Member, ...], time: float) -> dict[str, Any]:
    assert one.pose is not None
    x, y, theta = one.pose
    topics: dict[str, object] = {
        "/odom": {"x": x, "y": y, "theta": theta, "v": one.v, "omega": one.omega},
        "/mode": {"armed": one.armed, "reason": one.reason, "link": {"alive": True}, "remote": True},
        "/driver": {"name": one.driver},
        "/vehicles": [other.pose for other in there if other is not one],
        "/fleet": plain(members),
        "/hand": (one.hand or DEFAULT_HAND)._asdict(),
        # marks telemetry that has nothing more
        "/capabilities": None,
    }
    return {"name": one.name, "time": time, "topics": topics}
