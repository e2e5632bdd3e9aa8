"""A robot, or a console without one, among others on a network: peer to peer over Zenoh, with no broker.

How it works
------------

Every robot tells all others how it is, and every robot finds out by itself who is there. Nobody is the centre, so
nobody's end ends the team. Messages are small JSON objects below the key ``txt1``. They may be lost, doubled or late:
what matters is said again until it is answered, and what came is held against the sender's clock.

| key | what it is |
|---|---|
| ``alive/NAME/ID`` | a liveliness token: it comes and goes with the session, so an end without a word is noticed |
| ``state/NAME`` | what a robot tells, 20 times a second |
| ``ping/NAME``, ``pong/NAME`` | measure clocks |
| ``stop/FROM``, ``stopped/FROM`` | the stop of all, and its answers |
| ``drive/NAME`` | a velocity for one |
| ``learned/NAME`` | what a robot has learned, once a second |

**Stop of all.** It is said every 20 ms until every robot that is alive, was heard in the last half minute or was named
has answered that its gate is closed, then a little longer, in case somebody new is there. With a share p of all
messages lost, one is still missing after 0.5 s with a probability of p^25: 1e-13 for p = 0.3.

**Names** are unique. Of two robots with one name, that one gives way that came later, by the clocks, or that finds the
other's state told already.

**Clocks.** Each robot has its own, and a command's age is judged by its sender's. So the difference is measured: a ping
carries the time at which it was sent, its answer the other's time. Of the last ones, the one with the shortest way
there and back counts: offset = theirs - (sent + received) / 2, wrong by half of that way at most (as in NTP).

**Where.** On loopback nothing is asked for. On an interface that is named a key is: a file with a password that all
share (Zenoh's user and password), and it listens on that interface only.
"""

import json
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, Final

from txt1.errors import ConfigError, MissingExtra
from txt1.fleet.members import Member
from txt1.fleet.messages import (
    MemberState,
    StopAnswer,
    answer_of,
    drive_of,
    is_name,
    message_of,
    state_of,
    stop_of,
    time_of,
)
from txt1.fleet.radio import SILENCE, Said
from txt1.fleet.stopping import Standing, StopOfAll
from txt1.kernel.clock import NS_PER_S, RealClock, wall_ns

PORTS: Final = range(7450, 7482)  # on loopback, of which each peer takes the first that is free
HUNG: Final = 300  # ms after which a peer on loopback that does not answer is passed over: Zenoh's 10 s hold up a stop
REPEAT: Final = 0.02  # s between two sayings of a stop
LONGER: Final = 1.0  # s that it is said after all have answered
STOP_FOR: Final = 30.0  # s after which whoever has not answered is given up
ALONE: Final = 3.0  # s after which it is given up where nobody is heard
RECENT: Final = 30.0  # s after it was heard last that a robot is expected to answer a stop
PING: Final = 1.0  # s between two pings
PINGS: Final = 10  # of which the fastest counts
LOOK: Final = 0.6  # s to look whether a name is taken
PING_MAX: Final = 10.0  # s after which an answer to a ping counts no more
SAID_MAX: Final = 20  # stops of our own that are told from others'
OTHERS_MAX: Final = 200  # peers of which something is kept


@dataclass
class _Other:
    """Another peer as it is known here; times are s of our clock."""

    ids: set[str] = field(default_factory=set)  # of its liveliness tokens
    heard: float = 0.0
    state: MemberState | None = None
    learned: tuple[Mapping[str, Any], float] | None = None  # as it was told, and when
    pings: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=PINGS))  # s there and back, offset

    @property
    def alive(self) -> bool:
        return bool(self.ids)


@dataclass
class Hooks:
    """Called with the messages of other peers, in a thread of Zenoh's."""

    stop: Callable[[str, str], StopAnswer | None] = lambda who, stop: None
    """Told of each saying of a stop, by whom, with its identity or ""; returns what to answer, None: nothing."""
    drive: Callable[[str, float, float], None] = lambda who, v, omega: None
    state: Callable[[Mapping[str, Any]], None] = lambda message: None


def configuration(interface: str = "", key: Path | None = None) -> Any:
    """Zenoh's configuration; raises ConfigError: an interface beyond loopback has no key, or is not there."""
    zenoh = need_zenoh()
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "peer", "scouting/multicast/enabled": bool(interface), "scouting/gossip/enabled": True,
        "listen/exit_on_failure": True, "listen/timeout_ms": 0,
        "connect/exit_on_failure": False, "connect/timeout_ms": 0,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
    }  # fmt: skip
    if not interface:
        settings["connect/endpoints"] = [f"tcp/127.0.0.1:{port}" for port in PORTS]
        settings["transport/unicast/open_timeout"] = HUNG  # whoever comes looks at one port after the other
    else:
        if key is None:
            raise ConfigError(f"--fleet {interface}: beyond loopback all share a key; add --fleet-key FILE")
        try:
            password = key.read_text(encoding="utf-8").strip()
        except OSError as error:
            raise ConfigError(f"--fleet-key {key}: cannot read it: {error.strerror}; put a password into it") from None
        if len(password) < 16 or ":" in password:
            raise ConfigError(f"--fleet-key {key}: a password of 16 characters or more, and no ':'")
        known = key.with_name(f".{key.name}.zenoh")
        known.touch(mode=0o600)
        known.write_text(f"txt1:{password}\n", encoding="utf-8")
        settings["transport/auth/usrpwd"] = {"user": "txt1", "password": password, "dictionary_file": str(known)}
        settings["scouting/multicast/interface"] = interface
        settings["listen/endpoints"] = [f"tcp/0.0.0.0:0#iface={interface}"]
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def need_zenoh() -> Any:
    """The module; raises MissingExtra."""
    try:
        import zenoh
    except ImportError:
        raise MissingExtra("a fleet over a network", "fleet") from None
    return zenoh


class Peer:
    """One of a fleet on a network.

    Args:
        name: its own, unique in the fleet.
        interface: of the network; empty for loopback.
        key: file with the password that all share.
        hooks: what it is told.
        loss: share of the messages that it loses, sending and receiving, for tests.
        space: what stands before all keys: fleets of different ones do not hear one another.
        console: it has no robot: nobody lists it or waits for its answer, and its name may be taken.

    Raises ConfigError: the name is taken, or the network cannot be used; MissingExtra.
    """

    def __init__(
        self,
        name: str,
        interface: str = "",
        key: Path | None = None,
        hooks: Hooks | None = None,
        loss: float = 0.0,
        space: str = "txt1",
        console: bool = False,
    ) -> None:
        self._zenoh = need_zenoh()
        self._space = space
        self.name, self._hooks, self._loss, self._rng = name, hooks or Hooks(), loss, Random(name)
        self._clock = RealClock()
        self._lock = threading.Lock()
        self._others: dict[str, _Other] = {}
        self._refused: dict[str, str] = {}
        self._stop: StopOfAll | None = None  # the newest that was said here
        self._said: deque[str] = deque(maxlen=SAID_MAX)  # identities of those that were said here
        self._closing = threading.Event()
        if not is_name(name):
            raise ConfigError(f"name: '{name}': in a fleet a name has small letters, digits and _, 64 at most")
        self._session = self._open(interface, key)
        self.id = f"{wall_ns():020d}-{self._session.zid()}"
        self._token = None if console else self._claim()
        self._session.declare_subscriber(f"{self._space}/state/*", self._checked(self._take_state))
        self._session.declare_subscriber(f"{self._space}/learned/*", self._take_learned)
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
        self._session.close()

    @property
    def now(self) -> float:
        """S of this computer's clock."""
        return self._clock.now_ns() / NS_PER_S

    # -- telling -----------------------------------------------------------------------------------------------

    def tell(self, state: Mapping[str, Any]) -> None:
        """Tell the others how it is."""
        self._put(f"state/{self.name}", state)

    def teach(self, learned: Mapping[str, Any]) -> None:
        """Tell the others what was learned; it may be lost."""
        self._put(f"learned/{self.name}", learned)

    def drive(self, name: str, v: float, omega: float) -> None:
        """Command another robot, m/s and rad/s, for the next 0.25 s."""
        self._put(f"drive/{name}", {"v": v, "omega": omega})

    def stop_all(self, expected: Iterable[str] = ()) -> threading.Thread:
        """Stop every robot of the fleet: said again and again until all have, by the thread returned.

        Those in `expected` have to answer, too, whether they are heard or not; `standing` says who has.
        """
        stop = StopOfAll(expected, self.now)
        with self._lock:
            self._stop = stop
            self._said.append(stop.identity)
        saying = threading.Thread(target=self._say_stop, args=(stop,), name="fleet stop", daemon=True)
        saying.start()
        return saying

    def _say_stop(self, stop: StopOfAll) -> None:
        complete = 0.0
        while stop is self._stop and self.now < stop.began + STOP_FOR:
            self._put(f"stop/{self.name}", {"stop": stop.identity})
            with self._lock:
                now = self.now
                stop.expect(name for name, one in self._others.items() if one.alive or 0.0 < now - one.heard < RECENT)
                standing = stop.standing()
            alone = standing == Standing() and now > stop.began + ALONE
            complete = (complete or now) if standing.complete else 0.0
            if alone or (complete and now > complete + LONGER) or self._closing.wait(REPEAT):
                return

    def listen(self, duration: float) -> None:
        """Wait so many s."""
        self._closing.wait(duration)

    # -- knowing -----------------------------------------------------------------------------------------------

    def heard(self) -> Mapping[str, Said]:
        """Where the others are and how they move, those who have told it, by this computer's clock."""
        with self._lock:
            known = {name: (other.state, other.heard) for name, other in self._others.items()}
        return {
            name: Said(state.x, state.y, state.theta, state.v, state.omega, heard, state.data)
            for name, (state, heard) in known.items()
            if state is not None
        }

    def refused(self) -> Mapping[str, str]:
        """Why a message of each of the others was refused last, of those of whom one was."""
        with self._lock:
            return dict(self._refused)

    def taught(self) -> Mapping[str, tuple[Mapping[str, Any], float]]:
        """The learned rows of each robot that is there, not checked, and when they were told by our clock."""
        with self._lock:
            return {name: one.learned for name, one in self._others.items() if one.alive and one.learned is not None}

    def members(self) -> tuple[Member, ...]:
        """All others that were ever heard, a line each."""
        now = self.now
        with self._lock:
            return tuple(_member(name, other, now) for name, other in sorted(self._others.items()) if other.heard)

    def standing(self) -> tuple[Standing, float] | None:
        """How the last stop of all stands that was said here, and how long ago it was, s; None: there was none."""
        with self._lock:
            return None if self._stop is None else (self._stop.standing(), self.now - self._stop.began)

    # -- in Zenoh's threads ------------------------------------------------------------------------------------

    def _put(self, key: str, message: Mapping[str, Any]) -> None:
        if self._closing.is_set() or (self._loss and self._rng.random() < self._loss):
            return
        whole = {"from": self.name, "sent": self._clock.now_ns(), **message}
        urgent = not key.startswith(("state", "learned"))
        self._session.put(
            f"{self._space}/{key}", json.dumps(whole), express=True,
            congestion_control=self._zenoh.CongestionControl.DROP,
            priority=self._zenoh.Priority.REAL_TIME if urgent else self._zenoh.Priority.DATA,
        )  # fmt: skip

    def _read(self, sample: Any) -> dict[str, Any] | None:
        """A message from another peer; None for its own, a lost one, and one that is no message."""
        if self._loss and self._rng.random() < self._loss:
            return None
        message = message_of(bytes(sample.payload))
        return None if message is None or message["from"] == self.name else message

    def _other(self, name: str) -> _Other:
        """What is known of another peer; nothing is kept of more than so many."""
        if len(self._others) >= OTHERS_MAX and name not in self._others:
            gone = [each for each, other in self._others.items() if not other.alive]
            if not gone:
                return _Other()
            del self._others[min(gone, key=lambda each: self._others[each].heard)]
        return self._others.setdefault(name, _Other())

    def _checked(self, take: Callable[[dict[str, Any]], None]) -> Callable[[Any], None]:
        """A listener that takes messages; of one that is not as it should be it keeps why, and nothing else."""

        def listen(sample: Any) -> None:
            message = self._read(sample)
            if message is None:
                return
            try:
                take(message)
            except ValueError as error:
                with self._lock:
                    if len(self._refused) < OTHERS_MAX:
                        self._refused.setdefault(message["from"], str(error))

        return listen

    def _take_state(self, message: dict[str, Any]) -> None:
        state = state_of(message)
        with self._lock:
            other = self._other(message["from"])
            other.state, other.heard = state, self.now
        self._hooks.state(message)

    def _take_learned(self, sample: Any) -> None:
        message = self._read(sample)
        name = str(sample.key_expr).split("/")[-1]
        if message is not None and message["from"] == name:
            with self._lock:
                self._other(name).learned = message, self.now

    def _take_stop(self, sample: Any) -> None:
        """Obey a stop, whatever its message says: one that is none is a stop without identity."""
        if self._loss and self._rng.random() < self._loss:
            return
        who, stop = str(sample.key_expr).split("/")[-1], stop_of(bytes(sample.payload))
        if stop and stop in self._said:
            return  # our own
        who = who if is_name(who) else "somebody"
        answer = self._hooks.stop(who, stop)
        if stop and answer is not None:
            self._put(f"stopped/{who}", {"stop": stop, **answer._asdict()})

    def _take_answer(self, message: dict[str, Any]) -> None:
        with self._lock:
            if self._stop is not None and message.get("stop") == self._stop.identity:
                self._stop.answered(message["from"], answer_of(message))

    def _take_drive(self, message: dict[str, Any]) -> None:
        self._hooks.drive(message["from"], *drive_of(message))

    def _take_ping(self, message: dict[str, Any]) -> None:
        self._put(f"pong/{message['from']}", {"began": time_of(message, "sent")})

    def _take_pong(self, message: dict[str, Any]) -> None:
        began, theirs = time_of(message, "began") / NS_PER_S, time_of(message, "sent") / NS_PER_S
        now = self.now
        if not 0.0 <= now - began <= PING_MAX:
            raise ValueError("began: that ping was never sent")
        with self._lock:
            self._other(message["from"]).pings.append((now - began, theirs - 0.5 * (began + now)))

    def _take_alive(self, sample: Any) -> None:
        name, own = str(sample.key_expr).split("/")[-2:]
        if name != self.name and is_name(name):
            with self._lock:
                ids = self._other(name).ids
                (ids.add if sample.kind == self._zenoh.SampleKind.PUT else ids.discard)(own)

    def _ping_all(self) -> None:
        while not self._closing.wait(PING):
            with self._lock:
                names = [name for name, other in self._others.items() if other.alive]
            for name in names:
                self._put(f"ping/{name}", {})

    # -- coming in ---------------------------------------------------------------------------------------------

    def _open(self, interface: str, key: Path | None) -> Any:
        if interface:
            config = configuration(interface, key)
            try:
                return self._zenoh.open(config)
            except self._zenoh.ZError as error:
                raise ConfigError(f"--fleet {interface}: {error}; check the interface's name") from None
        for port in PORTS:
            if _free(port):
                config = configuration()
                config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
                others = [f"tcp/127.0.0.1:{each}" for each in PORTS if each != port]
                config.insert_json5("connect/endpoints", json.dumps(others))
                with suppress(self._zenoh.ZError):  # another has taken the port in this instant
                    return self._zenoh.open(config)
        raise ConfigError(f"--fleet: no port free on loopback from {PORTS[0]} to {PORTS[-1]}; end some robots")

    def _claim(self) -> Any:
        token = self._session.liveliness().declare_token(f"{self._space}/alive/{self.name}/{self.id}")
        ends = self.now + LOOK
        while self.now < ends:
            for reply in self._session.liveliness().get(f"{self._space}/alive/{self.name}/*", timeout=0.2):
                other = str(reply.ok.key_expr).split("/")[-1] if reply.ok is not None else self.id
                if other != self.id and (other < self.id or self._tells(ends)):
                    self.close()
                    raise ConfigError(f"name: there is a robot '{self.name}' in the fleet; choose another with --name")
            self._closing.wait(0.1)
        return token

    def _tells(self, ends: float) -> bool:
        """Whether somebody of our name tells its state already: it was there first, whatever the IDs."""
        told = threading.Event()
        listener = self._session.declare_subscriber(f"{self._space}/state/{self.name}", lambda sample: told.set())
        try:
            return told.wait(max(0.15, ends - self.now))
        finally:
            listener.undeclare()


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
    alive = other.alive and age < 10.0 * SILENCE
    state = other.state
    if state is None:
        return Member(name, armed=False, age=age, offset=offset, alive=alive)
    pose = (state.x, state.y, state.theta)
    return Member(
        name, state.armed, state.reason, pose, state.v, state.omega, state.driver, state.battery, age, offset, alive,
        state.silent,
    )  # fmt: skip
