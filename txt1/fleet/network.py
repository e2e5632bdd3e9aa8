"""A robot or a console in a fleet on a network: peer to peer over Zenoh, without a broker.

How it works
------------

Every robot tells its state to all others, and every robot finds the others by itself. There is no centre, so the team
goes on when any of its members ends. Messages are small JSON objects below the space of the fleet, signed with its key
(`txt1.fleet.key`). They may be lost, doubled or late. So an important message is repeated until it is answered, and the
age of each message is measured with the sender's clock.

| key | meaning |
|---|---|
| ``alive/NAME/ID`` | a liveliness token: it comes and goes with the session, so a sudden end is noticed, too |
| ``state/NAME`` | the state of a robot, 20 times a second |
| ``ping/NAME``, ``pong/NAME`` | measure clocks |
| ``stop/FROM``, ``stopped/FROM`` | the stop of all, and its answers |
| ``drive/NAME`` | a velocity for this robot |
| ``learned/NAME`` | a robot's learned rows, once a second |

**Stop of all.** A stop is repeated every 20 ms until every expected robot has answered that its gate is closed and that
it was seen to stand. A robot is expected if it is alive, was heard in the last half minute, or was named. The stop is
repeated for another second, in case a robot joins meanwhile. With a share p of all messages lost, one robot is still
missing after 0.5 s with a probability of p^25: 1e-13 for p = 0.3. Every robot obeys each stop that it hears, even a
stop that is not signed. After a second in which not all have answered, it is said through a new session, too, and
through another one every five seconds.

**Names** are unique. The peer that joined later leaves, and so does a peer that hears its own name in use. A peer looks
for its name when it joins. On a busy computer the others may not be found by then. So for another half minute it also
leaves when a peer that joined earlier sends a state under the same name. After that no message makes it leave.

**Clocks.** The ping with the shortest round trip among the last pings counts: offset = theirs - (sent + received) / 2,
with an error of at most half of the round trip (as in NTP). A velocity carries the instant at which the key was
pressed, in the clock of the robot that it drives. The possible error of the offset is subtracted from this instant. So
the command never seems younger than it is, wherever it waited.

**Waiting.** On a busy computer Zenoh took up to 20 s to accept a message. So states, answers and velocities wait in
threads of their own (`_Outbox`), and only the newest of each waits. Neither the robot's bridge nor the thread that
hears stops waits with them. A stop is said in threads of its own, too.

**Where.** On loopback a peer listens on 127.0.0.1; with a named interface it listens on that interface only, and Zenoh
asks for a password, which is made from the key.
"""

import json
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from hmac import compare_digest
from math import inf
from pathlib import Path
from random import Random
from typing import Any, Final

from txt1.errors import ConfigError, MissingExtra
from txt1.fleet.key import FLEET_NAME, FleetKey, fleet_key
from txt1.fleet.members import NEW, Member
from txt1.fleet.messages import (
    MemberState,
    StopAnswer,
    answer_of,
    drive_of,
    is_name,
    message_of,
    number,
    state_of,
    stop_of,
    time_of,
)
from txt1.fleet.radio import ROBOT_SILENCE, Said
from txt1.fleet.stopping import Standing, StopOfAll
from txt1.kernel.clock import NS_PER_S, Clock, RealClock, nanoseconds, wall_ns

# ports on loopback; each peer takes the first free port
PORTS: Final = range(7450, 7482)
# ms; a peer on loopback that does not answer in this time is skipped, as Zenoh's 10 s would hold up a stop
OPEN_TIME_OUT_MS: Final = 300
# s between two repetitions of a stop
REPEAT: Final = 0.02
# s for which a stop is repeated after all have answered
LONGER: Final = 1.0
# s after which a stop no longer waits for an answer
STOP_FOR: Final = 30.0
# s after the last gate has closed; a robot that was not seen to stand by then is given up
STAND_PATIENCE: Final = 5.0
# s after which a stop that some robot has not answered is also said through a new session
UNANSWERED: Final = 1.0
# s after which that session is replaced by another one, if the stop is still not answered
ANEW: Final = 5.0
# s after which a stop ends if no robot is heard
ALONE: Final = 3.0
# s; a robot that was heard within this time is expected to answer a stop
HEARD_LATELY: Final = 30.0
# s between two pings
PING_PERIOD: Final = 1.0
# s between two pings while a clock is not known
PING_LEAST: Final = 0.05
# kept for each peer; the fastest counts
PINGS: Final = 10
# s; a peer that joins looks this long whether its name is taken
NAME_CHECK_TIME: Final = 0.6
# s; a namesake that has been in the fleet longer by more than this was certainly there first
EARLIER: Final = 0.5
# s; a namesake that is younger by up to this much may have been first: then the IDs decide
AS_EARLY: Final = 1.5
# s; longer times in the fleet are sent as this
UP_MAX: Final = 1e5
# s by which a command may seem to come from the future, as clocks drift between two pings
FUTURE_MAX: Final = 0.01
# s after which the answer to a ping is ignored
PING_MAX: Final = 10.0
# number of this peer's last stops that are recognised when they come back
SAID_MAX: Final = 20
# largest number of peers that are remembered
OTHERS_MAX: Final = 200
REAL: Final = RealClock()
# the sender of a message that is not signed
STRANGER: Final = "somebody"


@dataclass
class _Other:
    """What this peer knows of another peer; times are s of this computer's clock."""

    # IDs of its liveliness tokens
    ids: set[str] = field(default_factory=set)
    heard: float = 0.0
    state: MemberState | None = None
    # the last message, and its arrival
    learned: tuple[Mapping[str, Any], float] | None = None
    # round trip and offset, s
    pings: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=PINGS))

    @property
    def alive(self) -> bool:
        return bool(self.ids)


@dataclass
class Hooks:
    """Called with the messages of other peers, in a thread of Zenoh's."""

    stop: Callable[[str, str], StopAnswer | None] = lambda who, stop: None
    """A stop was heard: called with its sender and its identity or ""; returns the answer, None for no answer."""
    drive: Callable[[str, float, float, float], None] = lambda who, v, omega, given: None
    """A velocity for this robot, m/s and rad/s, and when it was given, s of this computer's clock."""
    double: Callable[[str], None] = lambda why: None
    """Another robot of the same name was there before, so this robot has to leave; called with the reason."""
    state: Callable[[Mapping[str, Any]], None] = lambda message: None


def configuration(interface: str = "", key: FleetKey | None = None, dictionary: str = "") -> Any:
    """Zenoh's configuration; `key` and `dictionary`, the file of its password, are for an interface beyond loopback.

    Two peers that connect to each other in the same instant may end up with a session that carries messages one way
    only. So on loopback only the joining peer connects to the peers that are there; every few seconds it tries again
    those that were too busy to answer. Peers do not introduce each other. On an interface the peer with the greater ID
    connects.
    """
    zenoh = need_zenoh()
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "peer", "scouting/multicast/enabled": bool(interface), "scouting/gossip/enabled": bool(interface),
        "listen/exit_on_failure": True, "listen/timeout_ms": 0,
        "connect/exit_on_failure": False, "connect/timeout_ms": -1,
        "connect/retry": {"period_init_ms": 1500, "period_max_ms": 4000, "period_increase_factor": 2},
    }  # fmt: skip
    if not interface:
        settings["connect/endpoints"] = [f"tcp/127.0.0.1:{port}" for port in PORTS]
        # a peer that joins tries one port after the other
        settings["transport/unicast/open_timeout"] = OPEN_TIME_OUT_MS
    else:
        assert key is not None
        password = {"user": key.fleet, "password": key.password, "dictionary_file": dictionary}
        settings["transport/auth/usrpwd"] = password
        settings["scouting/multicast/interface"] = interface
        for each in ("multicast", "gossip"):
            settings[f"scouting/{each}/autoconnect_strategy"] = {"peer": {"to_peer": "greater-zid"}}
        settings["listen/endpoints"] = [f"tcp/0.0.0.0:0#iface={interface}"]
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def need_zenoh() -> Any:
    """Return the module `zenoh`; raises MissingExtra."""
    try:
        import zenoh
    except ImportError:
        raise MissingExtra("a fleet over a network", "fleet") from None
    return zenoh


class _Outbox:
    """Sends messages in a thread of its own; of those that wait under one key the newest is sent."""

    def __init__(self, put: Callable[[str, Mapping[str, Any]], None]) -> None:
        self._put = put
        self._waiting: dict[str, Mapping[str, Any]] = {}
        self._some = threading.Condition()
        self._open = True
        self._error: Exception | None = None
        threading.Thread(target=self._send_all, name="fleet sends", daemon=True).start()

    def add(self, key: str, message: Mapping[str, Any]) -> None:
        """Send a message soon; raises the error by which an earlier one failed."""
        if self._error is not None:
            raise self._error
        with self._some:
            self._waiting[key] = message
            self._some.notify()

    def close(self) -> None:
        """Send nothing more."""
        with self._some:
            self._open = False
            self._some.notify()

    def _send_all(self) -> None:
        while True:
            with self._some:
                self._some.wait_for(lambda: self._waiting or not self._open)
                if not self._open:
                    return
                key = next(iter(self._waiting))
                message = self._waiting.pop(key)
            try:
                self._put(key, message)
            except Exception as error:
                self._error = error
                return


class Peer:
    """A member of a fleet on a network.

    Args:
        name: its name, unique in the fleet.
        interface: network interface; empty for loopback.
        key: file with the common password; None: the user's own, on loopback only.
        hooks: called with received messages.
        loss: share of the messages that it loses, sending and receiving, for tests.
        fleet: name of the fleet; fleets with another name or key are not heard.
        console: it has no robot: it is not listed, its answer is not awaited, and its name need not be unique.
        clock: this computer's clock.

    Raises ConfigError: the name is taken, the key is not valid, or the network cannot be used; MissingExtra.
    """

    def __init__(
        self,
        name: str,
        interface: str = "",
        key: Path | None = None,
        hooks: Hooks | None = None,
        loss: float = 0.0,
        fleet: str = FLEET_NAME,
        console: bool = False,
        clock: Clock = REAL,
    ) -> None:
        self._zenoh = need_zenoh()
        self._key = fleet_key(interface, key, fleet)
        self._space = self._key.space
        self.name, self._hooks, self._loss, self._rng = name, hooks or Hooks(), loss, Random(name)
        self._clock = clock
        self._lock = threading.Lock()
        self._others: dict[str, _Other] = {}
        self._refused: dict[str, str] = {}
        # the newest stop that began here
        self._stop: StopOfAll | None = None
        # threads that say a stop through a new session
        self._anew: list[threading.Thread] = []
        # identities of the stops that began here
        self._said: deque[str] = deque(maxlen=SAID_MAX)
        self._closing = threading.Event()
        # set while the clock of some peer is not known
        self._unmeasured = threading.Event()
        self._console = console
        if not is_name(name):
            raise ConfigError(f"name: '{name}': in a fleet a name has small letters, digits and _, 64 at most")
        self._interface = interface
        self._session = self._open(interface)
        # one for states and learned rows, one for all that is urgent
        self._outboxes = tuple(_Outbox(lambda key, message: self._put(key, message)) for _ in range(2))
        self.id = f"{wall_ns():020d}-{self._session.zid()}"
        self.began = self.now
        """When this peer joined, s of its clock."""
        self._token = None if console else self._claim()
        self._session.declare_subscriber(f"{self._space}/state/*", self._checked(self._take_state))
        self._session.declare_subscriber(f"{self._space}/learned/*", self._checked(self._take_learned))
        self._session.declare_subscriber(f"{self._space}/stop/*", self._take_stop)
        self._session.declare_subscriber(f"{self._space}/stopped/{name}", self._checked(self._take_answer))
        self._session.declare_subscriber(f"{self._space}/drive/{name}", self._checked(self._take_drive))
        self._session.declare_subscriber(f"{self._space}/ping/{name}", self._checked(self._take_ping))
        self._session.declare_subscriber(f"{self._space}/pong/{name}", self._checked(self._take_pong))
        self._session.liveliness().declare_subscriber(f"{self._space}/alive/*/*", self._take_alive, history=True)
        self._pinging = threading.Thread(target=self._ping_all, name="fleet pings", daemon=True)
        self._pinging.start()

    def close(self) -> None:
        """Leave the fleet."""
        self._closing.set()
        self._unmeasured.set()
        with self._lock:
            saying = tuple(self._anew)
        for outbox in self._outboxes:
            outbox.close()
        # Python cannot end while a thread opens a session
        for each in saying:
            each.join(ANEW)
        # one that cannot be closed in time ends with the process
        with suppress(self._zenoh.ZError):
            self._session.close()

    @property
    def now(self) -> float:
        """Time of this computer's clock, s."""
        return self._clock.now_ns() / NS_PER_S

    # -- sending ---------------------------------------------------------------------------------------------------

    def tell(self, state: Mapping[str, Any]) -> None:
        """Send the others this robot's state."""
        self._send(f"state/{self.name}", {**state, "up": min(self.now - self.began, UP_MAX)})

    def teach(self, learned: Mapping[str, Any]) -> None:
        """Send the others this robot's learned rows; the message may be lost."""
        self._send(f"learned/{self.name}", learned)

    def drive(self, name: str, v: float, omega: float, age: float = 0.0) -> None:
        """Command another robot for 0.25 s, m/s and rad/s; the key was pressed `age` s ago.

        Nothing is sent until that robot's clock is known: without it the robot could not tell an old command from a new
        one.
        """
        given = self.now - age
        with self._lock:
            other = self._others.get(name)
            clock = min(other.pings) if other is not None and other.pings else None
        if clock is None:
            self._unmeasured.set()
            return
        self._send(f"drive/{name}", {"v": v, "omega": omega, "given": max(0, nanoseconds(theirs(given, *clock)))})

    def stop_all(self, expected: Iterable[str] = ()) -> threading.Thread:
        """Stop every robot of the fleet; the thread returned repeats the stop until all have stopped.

        Robots in `expected` have to answer even if they are not heard. `standing` tells which robots have answered.
        """
        stop = StopOfAll(expected, self.now)
        with self._lock:
            self._stop = stop
            self._said.append(stop.identity)
            self._expect(stop)
        watching = threading.Thread(target=self._see_stop, args=(stop,), name="fleet stop", daemon=True)
        watching.start()
        return watching

    def _expect(self, stop: StopOfAll) -> None:
        now, others = self.now, self._others.items()
        stop.expect(name for name, one in others if one.alive or 0.0 < now - one.heard < HEARD_LATELY)

    def _see_stop(self, stop: StopOfAll) -> None:
        """Have other threads say a stop until all have stopped; through new sessions, too, if that takes long.

        A thread that sends may wait for long: a message that nobody takes can hold up those that follow
        (https://github.com/eclipse-zenoh/zenoh/issues/2584).
        """
        complete = closed = 0.0
        anew = stop.began + UNANSWERED
        ends = threading.Event()
        threading.Thread(target=self._say_stop, args=(stop, ends), name="fleet says stop", daemon=True).start()
        try:
            while stop is self._stop and self.now < stop.began + STOP_FOR:
                with self._lock:
                    now = self.now
                    self._expect(stop)
                    standing = stop.standing()
                    # `close` waits for those that are in the list, and none comes after it has begun
                    if now > anew and not standing.closed and not self._closing.is_set():
                        anew = now + ANEW
                        more = threading.Thread(target=self._say_anew, args=(stop, ends), name="fleet stop anew")
                        more.daemon = True
                        self._anew.append(more)
                        more.start()
                alone = standing == Standing() and now > stop.began + ALONE
                complete = (complete or now) if standing.complete else 0.0
                closed = (closed or now) if standing.closed else 0.0
                done = (complete and now > complete + LONGER) or (closed and now > closed + STAND_PATIENCE)
                if alone or done or self._closing.wait(REPEAT):
                    return
        finally:
            ends.set()

    def _say_stop(self, stop: StopOfAll, ends: threading.Event, session: Any = None, until: float = inf) -> None:
        """Repeat a stop through a session."""
        while self.now < until and not self._closing.is_set():
            self._put(f"stop/{self.name}", {"stop": stop.identity}, session)
            if ends.wait(REPEAT):
                return

    def _say_anew(self, stop: StopOfAll, ends: threading.Event) -> None:
        """Send a stop through a new session, too, which connects to all peers again, whatever is wrong with the others;
        after `ANEW` another one replaces it.
        """
        try:
            with suppress(ConfigError, self._zenoh.ZError), self._open(self._interface) as session:
                session.declare_subscriber(f"{self._space}/stopped/{self.name}", self._checked(self._take_answer))
                self._say_stop(stop, ends, session, self.now + ANEW)
        finally:
            with self._lock:
                self._anew.remove(threading.current_thread())

    def listen(self, duration: float) -> None:
        """Wait for `duration` s."""
        self._closing.wait(duration)

    # -- received state --------------------------------------------------------------------------------------------

    def heard(self) -> Mapping[str, Said]:
        """Pose and motion of each peer that has told them, with times of this computer's clock."""
        with self._lock:
            known = {name: (other.state, other.heard) for name, other in self._others.items()}
        return {
            name: Said(state.x, state.y, state.theta, state.v, state.omega, heard, state.data, state.body)
            for name, (state, heard) in known.items()
            if state is not None
        }

    def refused(self) -> Mapping[str, str]:
        """Why the first message of a peer was refused, by its name; only peers with a refused message are listed."""
        with self._lock:
            return dict(self._refused)

    def taught(self) -> Mapping[str, tuple[Mapping[str, Any], float]]:
        """The rows that each present robot has learned, unchecked, and their arrival by this computer's clock."""
        with self._lock:
            return {name: one.learned for name, one in self._others.items() if one.alive and one.learned is not None}

    def members(self) -> tuple[Member, ...]:
        """Every peer that was ever heard."""
        now = self.now
        with self._lock:
            return tuple(_member(name, other, now) for name, other in sorted(self._others.items()) if other.heard)

    def standing(self) -> tuple[Standing, float] | None:
        """Progress of the last stop that was given here, and its age in s; None: none was given here."""
        with self._lock:
            return None if self._stop is None else (self._stop.standing(), self.now - self._stop.began)

    # -- in Zenoh's threads ------------------------------------------------------------------------------------

    def _send(self, key: str, message: Mapping[str, Any]) -> None:
        """Send a message without waiting."""
        self._outboxes[_is_urgent(key)].add(key, message)

    def _put(self, key: str, message: Mapping[str, Any], session: Any = None) -> None:
        """Send a message; see "Waiting"."""
        if self._closing.is_set() or (self._loss and self._rng.random() < self._loss):
            return
        whole = {"from": self.name, "id": self.id, "sent": self._clock.now_ns(), **message}
        try:
            (session or self._session).put(
                f"{self._space}/{key}",
                self._key.signed(key, json.dumps(whole).encode()),
                express=True,
                congestion_control=self._zenoh.CongestionControl.DROP,
                priority=self._zenoh.Priority.REAL_TIME if _is_urgent(key) else self._zenoh.Priority.DATA,
            )
        except self._zenoh.ZError:
            # it was closed in this instant
            if not self._closing.is_set():
                raise

    def _where(self, sample: Any) -> str:
        """The Zenoh key that a message came on, without the space."""
        return str(sample.key_expr).removeprefix(f"{self._space}/")

    def _read(self, sample: Any) -> dict[str, Any] | None:
        """Return a message from another peer; None for this peer's own, a lost message, and malformed text.

        Raises ValueError: it is not signed with the fleet's key.
        """
        if self._loss and self._rng.random() < self._loss:
            return None
        text = self._key.opened(self._where(sample), bytes(sample.payload))
        if text is None:
            raise ValueError("it is not signed with the fleet's key")
        message = message_of(text)
        return None if message is None or message.get("id") == self.id else message

    def _other(self, name: str) -> _Other:
        """Return the record of another peer; of more than `OTHERS_MAX` peers the longest silent is forgotten."""
        if len(self._others) >= OTHERS_MAX and name not in self._others:
            gone = [each for each, other in self._others.items() if not other.alive]
            if not gone:
                return _Other()
            del self._others[min(gone, key=lambda each: self._others[each].heard)]
        return self._others.setdefault(name, _Other())

    def _checked(self, take: Callable[[dict[str, Any]], None]) -> Callable[[Any], None]:
        """Return a listener that passes valid messages to `take`; for a bad message it keeps only the reason."""

        def listen(sample: Any) -> None:
            who = STRANGER
            try:
                message = self._read(sample)
                if message is not None:
                    who = message["from"]
                    take(message) if who != self.name else self._meet_double(message)
            except ValueError as error:
                with self._lock:
                    if len(self._refused) < OTHERS_MAX:
                        self._refused.setdefault(who, str(error))

        return listen

    def _meet_double(self, message: dict[str, Any]) -> None:
        """Leave if another robot of the same name was there before, unless this robot has been there for long."""
        if self._console or "up" not in message:
            return
        if not gives_way(self.now - self.began, number(message, "up"), self.id, str(message.get("id"))):
            raise ValueError("another robot has this robot's name; choose another with --name")
        self._hooks.double(_taken(self.name))

    def _take_state(self, message: dict[str, Any]) -> None:
        state = state_of(message)
        with self._lock:
            other = self._other(message["from"])
            other.state, other.heard = state, self.now
        self._hooks.state(message)

    def _take_learned(self, message: dict[str, Any]) -> None:
        with self._lock:
            self._other(message["from"]).learned = message, self.now

    def _take_stop(self, sample: Any) -> None:
        """Obey a stop, whatever its message says; a message without a signature is a stop without identity."""
        if self._loss and self._rng.random() < self._loss:
            return
        where = self._where(sample)
        who, text = where.split("/")[-1], self._key.opened(where, bytes(sample.payload))
        stop = "" if text is None else stop_of(text)
        if stop and stop in self._said:
            return  # our own
        who = who if text is not None and is_name(who) else STRANGER
        answer = self._hooks.stop(who, stop)
        if stop and answer is not None:
            self._send(f"stopped/{who}", {"stop": stop, **answer._asdict()})

    def _take_answer(self, message: dict[str, Any]) -> None:
        with self._lock:
            if self._stop is not None and message.get("stop") == self._stop.identity:
                self._stop.answered(message["from"], answer_of(message))

    def _take_drive(self, message: dict[str, Any]) -> None:
        v, omega = drive_of(message)
        given = time_of(message, "given") / NS_PER_S
        if given > self.now + FUTURE_MAX:
            raise ValueError("given: that is in the future of this computer's clock")
        self._hooks.drive(message["from"], v, omega, given)

    def _take_ping(self, message: dict[str, Any]) -> None:
        self._put(f"pong/{message['from']}", {"began": time_of(message, "sent")})

    def _take_pong(self, message: dict[str, Any]) -> None:
        began, sent = time_of(message, "began") / NS_PER_S, time_of(message, "sent") / NS_PER_S
        now = self.now
        if not 0.0 <= now - began <= PING_MAX:
            raise ValueError("began: that ping was never sent")
        with self._lock:
            self._other(message["from"]).pings.append((now - began, sent - 0.5 * (began + now)))

    def _take_alive(self, sample: Any) -> None:
        name, own = self._where(sample).split("/")[-2:]
        if name == self.name or not is_name(name) or not self._is_ours(name, own):
            return
        with self._lock:
            other = self._other(name)
            if sample.kind != self._zenoh.SampleKind.PUT:
                other.ids.discard(own)
            elif own not in other.ids:
                other.ids.add(own)
                # the peer was started again, perhaps with its computer and its clock
                other.pings.clear()
                self._unmeasured.set()

    def _ping_all(self) -> None:
        """Ping all living peers once a second, and sooner while a clock is not known."""
        while not self._closing.wait(PING_LEAST):
            self._unmeasured.wait(PING_PERIOD - PING_LEAST)
            self._unmeasured.clear()
            with self._lock:
                names = [name for name, other in self._others.items() if other.alive]
            for name in names:
                self._put(f"ping/{name}", {})

    # -- coming in ---------------------------------------------------------------------------------------------

    def _open(self, interface: str) -> Any:
        if interface:
            try:
                with self._key.dictionary() as dictionary:
                    return self._zenoh.open(configuration(interface, self._key, dictionary))
            except self._zenoh.ZError as error:
                raise ConfigError(f"--fleet {interface}: {error}; check the interface's name") from None
        for port in PORTS:
            if _free(port):
                config = configuration()
                config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
                others = [f"tcp/127.0.0.1:{each}" for each in PORTS if each != port]
                config.insert_json5("connect/endpoints", json.dumps(others))
                # another process has taken the port in this instant
                with suppress(self._zenoh.ZError):
                    return self._zenoh.open(config)
        raise ConfigError(f"--fleet: no port free on loopback from {PORTS[0]} to {PORTS[-1]}; end some robots")

    def _claim(self) -> Any:
        """Take the name, unless a peer with a smaller ID has it already."""
        where = f"alive/{self.name}/{self.id}"
        token = self._session.liveliness().declare_token(f"{self._space}/{where}-{self._key.signature(where, b'')}")
        ends = self.now + NAME_CHECK_TIME
        while self.now < ends:
            for reply in self._session.liveliness().get(f"{self._space}/alive/{self.name}/*", timeout=0.2):
                other = "" if reply.ok is None else str(reply.ok.key_expr).split("/")[-1]
                if other and other < self.id and self._is_ours(self.name, other):
                    self.close()
                    raise ConfigError(_taken(self.name))
            self._closing.wait(0.1)
        return token

    def _is_ours(self, name: str, own: str) -> bool:
        """Whether the ID of a liveliness token is signed with the fleet's key."""
        one, _, signature = own.rpartition("-")
        return compare_digest(signature.encode(), self._key.signature(f"alive/{name}/{one}", b"").encode())


def _is_urgent(key: str) -> bool:
    """Whether messages under a key go before states and learned rows."""
    return not key.startswith(("state/", "learned/"))


def theirs(time: float, there_and_back: float, offset: float) -> float:
    """Convert a time of this computer's clock to a peer's clock, s; earlier by the largest error of the ping,
    never later.
    """
    return time + offset - 0.5 * there_and_back


def gives_way(ours: float, others: float, own: str, other: str) -> bool:
    """Return whether a robot leaves the fleet to another of its name, from their times in it (s) and their IDs.

    Each may see the other's time too short, by the delay of a message. So the robot that certainly came later leaves.
    If neither is certain, the robot with the larger ID leaves; at worst both do. A robot that has been there for long
    stays.
    """
    return ours < NEW and (others > ours + EARLIER or (others > ours - AS_EARLY and other < own))


def _taken(name: str) -> str:
    return f"name: there is a robot '{name}' in the fleet; choose another with --name"


def _free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _member(name: str, other: _Other, now: float) -> Member:
    offset = min(other.pings)[1] if other.pings else None
    age = now - other.heard
    alive = other.alive and age < 10.0 * ROBOT_SILENCE
    state = other.state
    if state is None:
        return Member(name, armed=False, age=age, offset=offset, alive=alive)
    pose = (state.x, state.y, state.theta)
    return Member(
        name,
        state.armed,
        state.reason,
        pose,
        state.v,
        state.omega,
        state.driver,
        state.battery,
        age,
        offset,
        alive,
        state.silent,
        stuck=state.stuck,
        hand=state.hand,
    )
