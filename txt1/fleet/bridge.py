"""The bridge to a fleet on a network: a process of its own, which speaks Zenoh beside the robot.

The robot's state goes out twenty times a second, and the others' states come in as often. The robot's learned rows are
sent once a second. Rows that others have learned are checked here and passed on about as often. When another robot
stops all, this robot stops. The answer contains the robot's own report on its gate and its watch over stops. A console
may take the robot's wheel as the source "fleet"; its commands are as old as the key that was pressed there.
"""

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from math import inf
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

from txt1.control.standstill import Stop
from txt1.errors import ConfigError
from txt1.fleet.key import FLEET_NAME
from txt1.fleet.messages import StopAnswer
from txt1.fleet.network import Hooks, Peer
from txt1.fleet.radio import ROBOT_SILENCE
from txt1.fleet.shared_knowledge import learned_of
from txt1.fleet.stopping import Standing
from txt1.kernel.clock import NS_PER_S, RealClock
from txt1.sidecar import LINE_MAX, Connection

FLEET_RATE: Final = 20.0  # Hz
TOPICS: Final = ["/said", "/member", "/fleet_order", "/fleet_stops"]
# messages a second about the robot itself
SELDOM: Final = ["/learned"]
# s between two tables of a robot that are passed on
PASSED: Final = 0.8
# tables that are passed on at a time
TABLES_AT_ONCE: Final = 5
# orders of each kind that wait for the next look; only the newest are kept
ORDERS: Final = 20
# bytes of a list about the others
ROOM: Final = LINE_MAX * 2 // 5
# s after which an incomplete stop of all is reported as it stands
ANSWERED: Final = 1.0
# s for which a stop of all is shown
STOP_SHOWN: Final = 60.0
# s that an order of the others may wait
WAIT: Final = 0.01

T = TypeVar("T")


def main(
    robot: Connection,
    name: str,
    interface: str = "",
    key: str | None = None,
    loss: float = 0.0,
    fleet: str = FLEET_NAME,
) -> None:
    """Speak for the robot in the fleet until its run ends; the arguments are the same as those of `Peer`."""
    gate = ReportedGate(RealClock().now_ns)
    # filled by Zenoh's threads, which must not wait
    stops: deque[tuple[str, str]] = deque(maxlen=ORDERS)
    # a queue of its own, so that many commands push no stop out
    drives: deque[tuple[float, float, float]] = deque(maxlen=ORDERS)
    doubles: deque[str] = deque(maxlen=1)

    def stop(who: str, identity: str) -> StopAnswer:
        if identity not in gate.obeyed:
            stops.append((who, identity))
        return gate.answer(identity)

    hooks = Hooks(stop, lambda who, v, omega, given: drives.append((v, omega, given)), doubles.append)
    robot.request("subscribe", topics=TOPICS, rate=FLEET_RATE, seldom=SELDOM)
    try:
        # to look whether a name is taken takes longer than a heartbeat
        with ThreadPoolExecutor(1) as beside:
            joining = beside.submit(Peer, name, interface, None if key is None else Path(key), hooks, loss, fleet)
            while not joining.done():
                robot.receive(WAIT)
        peer = joining.result()
    except ConfigError as error:
        refused(robot, str(error))
    # each robot whose message was refused, and why
    told: set[tuple[str, str]] = set()
    # when the last table of each robot that was passed on was heard
    passed: dict[str, float] = {}
    try:
        while True:
            telemetry = robot.receive(WAIT)
            # a flood of stops without identity is one request, so that it pushes no other request out
            for who, identity in dict.fromkeys(stops.popleft() for _ in range(len(stops))):
                robot.request("stop", who=who, stop=identity)
            for _ in range(len(drives)):
                v, omega, given = drives.popleft()
                if v or omega:
                    robot.request("drive", v=v, omega=omega, age=peer.now - given, held=True)
                else:
                    robot.request("release")
            if doubles:
                refused(robot, doubles.popleft())
            if telemetry is None:
                continue
            gate.reported(telemetry["topics"])
            peer.tell(_state(telemetry["topics"]))
            if learned := telemetry["topics"].get("/learned"):
                peer.teach(learned)
            if any(event["topic"] == "/fleet_order" for event in telemetry.get("events", ())):
                peer.stop_all()
            now = peer.now
            heard = ((who, [*said[:5], now - said.time, said.data, said.body]) for who, said in peer.heard().items())
            members = sorted(fitting(sorted(peer.members(), key=lambda one: not one.alive)))
            robot.request("fleet", members=members, heard=dict(fitting(heard)), stop=_stop(peer))
            _pass_on(robot, peer, passed)
            for who, why in peer.refused().items() - told:
                told.add((who, why))
                robot.request("tell", text=f"a message of {who} is refused: {why}")
    finally:
        peer.close()


def refused(robot: Connection, reason: str) -> NoReturn:
    """Tell the robot that the fleet does not let it in, and end as failed, so that another try follows."""
    robot.request("refused", reason=reason)
    raise SystemExit(1)


def _pass_on(robot: Connection, peer: Peer, passed: dict[str, float]) -> None:
    """Tell the robot what others have learned, or why their tables are refused."""
    new = [(who, *told) for who, told in peer.taught().items() if told[1] >= passed.get(who, -inf) + PASSED]
    for who, told, heard in new[:TABLES_AT_ONCE]:
        passed[who] = heard
        try:
            robot.request("learned", who=who, learned=learned_of(told)._asdict(), age=peer.now - heard)
        except ValueError as error:
            robot.request("learned", who=who, learned=None, why=str(error))


class ReportedGate:
    """The robot's safety gate and its last stop, as the robot reported them; every answer to a stop comes from here."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self.obeyed: frozenset[str] = frozenset()
        """Identities of the stops of all that the robot has obeyed."""
        self._clock = clock
        self._armed, self._stop, self._at = True, "", -inf

    def reported(self, topics: Mapping[str, Any]) -> None:
        """Take the robot's telemetry."""
        self.obeyed = frozenset(topics.get("/fleet_stops") or ())
        member = topics.get("/member") or {}
        self._armed, self._stop = member.get("armed") is not False, str(member.get("stop") or "")
        self._at = self._clock() / NS_PER_S

    def answer(self, stop: str) -> StopAnswer:
        """Return the answer to a stop of this identity."""
        if self._clock() / NS_PER_S - self._at > ROBOT_SILENCE:
            return StopAnswer(closed=False, why="its program is silent")
        if stop not in self.obeyed:
            return StopAnswer(closed=False, why="it has not obeyed yet")
        if self._armed:
            return StopAnswer(closed=False, why="it was armed again")
        stands = self._stop == Stop.STANDING
        return StopAnswer(closed=True, stands=stands, why="" if stands else self._stop)


def _stop(peer: Peer) -> str:
    """Return the progress of this robot's last stop of all, once there was time to answer; "" after a minute."""
    standing, age = peer.standing() or (Standing(), inf)
    return str(standing) if age < STOP_SHOWN and (standing.complete or age > ANSWERED) else ""


def fitting(values: Iterable[T]) -> Iterator[T]:
    """Yield as many of the values as fit into a message to the robot: a message too long would end this bridge."""
    room = ROOM
    for value in values:
        room -= len(json.dumps(value)) + 2
        if room < 0:
            return
        yield value


def _state(topics: dict[str, Any]) -> dict[str, Any]:
    """Return the part of the robot's telemetry for the others."""
    said, member = topics.get("/said") or {}, topics.get("/member") or {}
    told = ("armed", "reason", "driver", "battery", "silent", "stuck", "hand")
    return {**{key: value for key, value in said.items() if key != "time"}, **{key: member.get(key) for key in told}}
