"""A robot's end of the bridge to its fleet: its states, the states it has heard, and what robots have learned."""

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
from txt1.fleet.shared_knowledge import ALL_TOLD, FORGET, LEARNED, learned_of
from txt1.learning.agent import Learned
from txt1.robot import Robot
from txt1.telemetry.topics import Rule, Topic, declare

SAID: Final = declare(Topic("/said", Said, "m, rad, m/s, rad/s", "std_msgs/String", Rule.SNAPSHOT, "told to the fleet"))
MEMBER: Final = declare(
    Topic("/member", Member, "", "std_msgs/String", Rule.SNAPSHOT, "this robot, as the fleet sees it")
)
# s; without a bridge by then, the robot has no fleet
BRIDGE_PATIENCE: Final = 15.0
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
# stops of all that are remembered; an older stop would be obeyed again if it were repeated
STOPS_MAX: Final = 20
# s without a message of the bridge after which the fleet counts as not reached
BRIDGE_SILENCE: Final = 1.0


class FleetLink:
    """The medium of a `txt1.fleet.cooperation.Cooperation`, and the exchange of a `txt1_learners.sharing.Sharing`."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._heard: dict[str, Said] = {}
        self._members: tuple[Member, ...] = ()
        self._said: Said | None = None
        self._cooperation: Cooperation | None = None
        self._joined = asyncio.Event()
        # time at which it joined the fleet, s of the loop
        self._since = inf
        # last message of the bridge about the others, s of the loop
        self._took = -inf
        # identities of stops of all
        self._obeyed: deque[str] = deque(maxlen=STOPS_MAX)
        # progress of the last stop of all that this robot gave
        self._standing = ""
        self._learned: Learned | None = None
        # rows learned by the others, and when they came
        self._taught: dict[str, tuple[Learned, float]] = {}
        # names of robots whose rows were refused, and why
        self._refused: dict[str, str] = {}
        self.refused: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done, with a ConfigError, when the fleet does not let the robot in."""
        self.requests: Mapping[str, Callable[..., object]] = {
            "fleet": self._take,
            "stop": self._stop,
            "learned": self._hear,
            "refused": self._refuse,
        }
        """The requests that the bridge may make."""
        bus = robot.runtime.bus
        bus.offer(SAID, lambda: self._said or self._own())
        bus.offer(MEMBER, self._member)
        bus.offer(STOPS, lambda: tuple(self._obeyed) or None)
        bus.offer(FLEET_STOP, lambda: self._standing or None)
        bus.offer(LEARNED, lambda: self._learned)
        bus.offer(FLEET, lambda: (self._member(), *self._members))

    def cooperate(self, law: str, team: Sequence[str], **settings: Any) -> None:
        """Drive by a law together with a team; raises ConfigError."""
        config, given = self._robot.config, {"law": law, **settings}
        room = config.sim.room.length, config.sim.room.width
        made = make_law(config.name, list(team), room, given, body_of(config))
        self._cooperation = Cooperation(self._robot, self, made, room, see_simulated)
        self._cooperation.begin()

    def unfinished(self) -> str:
        """Return that the robot is stuck, and what blocks it; "" if it is not stuck."""
        part = self._cooperation
        return f"the robot is stuck; in its way: {part.stuck}" if part is not None and part.stuck else ""

    def stop_all(self) -> None:
        """Stop this robot at once, and the others of the fleet; the event log then names the robots that stopped."""
        self._robot.stop()
        self._robot.runtime.bus.publish(ORDER, "stop", self._robot.now)
        if asyncio.get_running_loop().time() - self._took > BRIDGE_SILENCE:
            self._robot.tell(
                "the fleet is not reached: only this robot was stopped; stop the other robots in another way"
            )

    def say(self, said: Said) -> None:
        """Send a state to the others."""
        self._said = said

    def heard(self) -> Mapping[str, Said]:
        """The last state heard of each other robot, by name."""
        return self._heard

    def teach(self, learned: Learned) -> None:
        """Tell the others what this robot has learned; it is repeated once a second."""
        self._learned = learned

    def taught(self) -> Mapping[str, Learned]:
        """The learned rows of each robot that was heard a moment ago, by name."""
        since = asyncio.get_running_loop().time() - FORGET
        return {who: learned for who, (learned, time) in self._taught.items() if time >= since}

    async def joined(self) -> None:
        """Wait until the others could send what they have learned, at most `BRIDGE_PATIENCE` and `ALL_TOLD`."""
        with suppress(TimeoutError):
            async with asyncio.timeout(BRIDGE_PATIENCE):
                await self._joined.wait()
                await asyncio.sleep(ALL_TOLD)

    # -- requests of the bridge ------------------------------------------------------------------------------------

    def _take(self, members: list[list[Any]], heard: Mapping[str, list[Any]], stop: str = "") -> None:
        """Take the others' states, with their ages in s, and the progress of this robot's stop of all."""
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
        """Obey another robot's stop, once for each identity: a stop is repeated, and a repetition must not undo
        an arming.
        """
        if stop and stop in self._obeyed:
            return
        stopped = self._robot.runtime.gate.stopped
        self._robot.stop()
        # a flood of stops without identity fills no log
        if stop or not stopped:
            self._robot.tell(f"stopped by {who}")
        if stop:
            self._obeyed.append(stop)

    def _hear(self, who: str, learned: Mapping[str, Any] | None, age: float = 0.0, why: str = "") -> None:
        """Take the rows that another robot learned `age` s ago; None: they are refused, and `why` is reported once."""
        if learned is not None:
            self._taught[who] = learned_of(learned), asyncio.get_running_loop().time() - age
            return
        self._taught.pop(who, None)
        if self._refused.get(who) != why:
            self._refused[who] = why
            self._robot.tell(f"refuses what {who} has learned: it {why}")

    def _refuse(self, reason: str) -> None:
        """End the run of a robot that is new in the fleet; a robot that has been in it goes on driving."""
        if asyncio.get_running_loop().time() > self._since + NEW:
            self._robot.tell(f"the fleet does not let this robot in again; it keeps trying: {reason}")
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
    """Return a member from its lists in JSON."""
    one = Member._make(told)
    pose = None if one.pose is None else (one.pose[0], one.pose[1], one.pose[2])
    return one._replace(pose=pose, hand=None if one.hand is None else Hand(*one.hand))
