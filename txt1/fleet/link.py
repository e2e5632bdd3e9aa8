"""A robot's end of the bridge to its fleet: what it tells, what it has heard, and the rule of silence among them."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import inf
from typing import Any, Final

from txt1.control.hand import Hand
from txt1.errors import ConfigError
from txt1.fleet.body import Body
from txt1.fleet.cooperation import Cooperation, body_of, pose_in_room, see_simulated
from txt1.fleet.law import make_law
from txt1.fleet.members import FLEET, FLEET_STOP, NEW, Member, member_of
from txt1.fleet.radio import Said
from txt1.learning.learned import FORGET, LEARNED, TOLD, Learned, learned_of
from txt1.robot import Robot
from txt1.telemetry.topics import Rule, Topic, declare

SAID: Final = declare(Topic("/said", Said, "m, rad, m/s, rad/s", "std_msgs/String", Rule.SNAPSHOT, "told to the fleet"))
MEMBER: Final = declare(
    Topic("/member", Member, "", "std_msgs/String", Rule.SNAPSHOT, "this robot, as the fleet sees it")
)
BRIDGE_PATIENCE: Final = 15.0  # s in which the bridge comes up, or there is no fleet
ORDER: Final = declare(
    Topic("/fleet_order", str, "", "std_msgs/String", Rule.EVENT, "what this robot asks of the fleet: stop")
)
STOPS: Final[Topic[tuple[str, ...]]] = declare(
    Topic(
        "/fleet_stops",
        tuple[str, ...],
        "",
        "std_msgs/String",
        Rule.SNAPSHOT,
        "the stops of all that this robot has obeyed",
    )
)
STOPS_MAX: Final = 20  # stops of all that are remembered: an older one is obeyed again if somebody still says it
QUIET: Final = 1.0  # s without a word of the bridge after which the fleet is not reached


class FleetLink:
    """To a `txt1.fleet.cooperation.Cooperation` it is the air, to a `txt1.learning.sharing.Sharing` the exchange."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._heard: dict[str, Said] = {}
        self._members: tuple[Member, ...] = ()
        self._said: Said | None = None
        self._cooperation: Cooperation | None = None
        self._joined = asyncio.Event()
        self._since = inf  # when it joined the fleet, s of the loop
        self._took = -inf  # when the bridge told of the others last, s of the loop
        self._obeyed: deque[str] = deque(maxlen=STOPS_MAX)  # identities of stops of all
        self._standing = ""  # how the last one stands that this robot has said
        self._learned: Learned | None = None
        self._taught: dict[str, tuple[Learned, float]] = {}  # by the others, and when that was
        self._refused: dict[str, str] = {}  # names of those whose words are no table, and why
        self.refused: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done, with a ConfigError, when the fleet does not let the robot in."""
        self.requests: Mapping[str, Callable[..., object]] = {
            "fleet": self._take,
            "stop": self._stop,
            "learned": self._hear,
            "refused": self._refuse,
        }
        """What the bridge may ask for."""
        bus = robot.runtime.bus
        bus.offer(SAID, lambda: self._said or self._own())
        bus.offer(MEMBER, self._member)
        bus.offer(STOPS, lambda: tuple(self._obeyed) or None)
        bus.offer(FLEET_STOP, lambda: self._standing or None)
        bus.offer(LEARNED, lambda: self._learned)
        bus.offer(FLEET, lambda: (self._member(), *self._members))

    def cooperate(self, law: str, team: Sequence[str], **settings: Any) -> None:
        """Drive by a law with the others of a team; raises ConfigError."""
        config, given = self._robot.config, {"law": law, **settings}
        room = config.sim.room.length, config.sim.room.width
        made = make_law(config.name, list(team), room, given, body_of(config))
        self._cooperation = Cooperation(self._robot, self, made, room, see_simulated)
        self._cooperation.begin()

    def stop_all(self) -> None:
        """Stop this robot at once, and all others of the fleet; the event log then says who has stopped."""
        self._robot.stop()
        self._robot.runtime.bus.publish(ORDER, "stop", self._robot.now)
        if asyncio.get_running_loop().time() - self._took > QUIET:
            self._robot.tell("the fleet is not reached: only this robot was stopped; stop the others otherwise")

    def say(self, said: Said) -> None:
        """Tell the others."""
        self._said = said

    def heard(self) -> Mapping[str, Said]:
        """The last that was heard of each of the others."""
        return self._heard

    def teach(self, learned: Learned) -> None:
        """Tell the others what this robot has learned; it is said again once a second."""
        self._learned = learned

    def taught(self) -> Mapping[str, Learned]:
        """The learned rows of each robot that was heard a moment ago, by name."""
        since = asyncio.get_running_loop().time() - FORGET
        return {who: learned for who, (learned, time) in self._taught.items() if time >= since}

    async def joined(self) -> None:
        """Wait until each of the others has had the time to tell what it has learned, but not for ever."""
        with suppress(TimeoutError):
            async with asyncio.timeout(BRIDGE_PATIENCE):
                await self._joined.wait()
                await asyncio.sleep(TOLD)

    # -- what the bridge asks for ------------------------------------------------------------------------------

    def _take(self, members: list[list[Any]], heard: Mapping[str, list[Any]], stop: str = "") -> None:
        """Take note of the others and of their words, whose times are given as ages, s; and how our stop stands."""
        self._joined.set()
        self._took = now = asyncio.get_running_loop().time()
        self._since = min(self._since, now)
        if stop != self._standing:
            self._standing = stop
            if stop:
                self._robot.tell(f"stop of all: {stop}")
        for name, said in heard.items():
            x, y, theta, v, omega, age, data, body = said
            self._heard[name] = Said(x, y, theta, v, omega, now - age, tuple(data), Body(*body))
        self._members = tuple(_member(each) for each in members)

    def _stop(self, who: str = "somebody", stop: str = "") -> None:
        """Stop at another's word, once for each identity: it is said again and again, and must not undo an arming."""
        if stop and stop in self._obeyed:
            return
        self._robot.stop()
        self._robot.tell(f"stopped by {who}")
        if stop:
            self._obeyed.append(stop)

    def _hear(self, who: str, learned: Mapping[str, Any] | None, age: float = 0.0, why: str = "") -> None:
        """Take note of the rows that another learned `age` s ago; None: they are refused, and `why` is told once."""
        if learned is not None:
            self._taught[who] = learned_of(learned), asyncio.get_running_loop().time() - age
            return
        self._taught.pop(who, None)
        if self._refused.get(who) != why:
            self._refused[who] = why
            self._robot.tell(f"refuses what {who} has learned: it {why}")

    def _refuse(self, reason: str) -> None:
        """End the run of a robot that is new in the fleet; one that has been there goes on, whatever others say."""
        if asyncio.get_running_loop().time() > self._since + NEW:
            self._robot.tell(f"the fleet does not let this robot in again, which is tried on: {reason}")
        elif not self.refused.done():
            self.refused.set_exception(ConfigError(reason))

    def _own(self) -> Said:
        odometry = self._robot.odometry
        x, y, theta = pose_in_room(self._robot) or (odometry.x, odometry.y, odometry.theta)
        return Said(x, y, theta, odometry.v, odometry.omega, body=body_of(self._robot.config))

    def _member(self) -> Member:
        part = self._cooperation
        return member_of(self._robot) if part is None else member_of(self._robot, part.silent, part.stuck)


def _member(told: Sequence[Any]) -> Member:
    """Return a line of the others', of which JSON has made lists."""
    one = Member._make(told)
    pose = None if one.pose is None else (one.pose[0], one.pose[1], one.pose[2])
    return one._replace(pose=pose, hand=None if one.hand is None else Hand(*one.hand))
