"""A robot, or a console without one, among others on a network: peer to peer over Zenoh, with no broker.

Keys, all below ``txt1``: ``alive/NAME/ID`` is a liveliness token; ``state/NAME`` what a robot tells, 20 times a second;
``ping/NAME`` and ``pong/NAME`` measure clocks; ``stop/FROM`` and ``stopped/FROM`` are the stop of all and its answers;
``drive/NAME`` is a velocity for one; ``learned/NAME`` what a robot has learned, once a second. Messages are small JSON
objects that may be lost: what matters is said again.

**Stop of all.** It is said every 20 ms until everybody who is alive has answered, then a little longer, in case
somebody new is there; a stop has a number and is obeyed once. With a share p of all messages lost, one is
still missing after 0.5 s with a probability of p^25: 1e-13 for p = 0.3.

**Names** are unique: the one gives way
that came later, by the clocks, or finds that another one tells its state already.

**Clocks.** Of the last pings the one with the shortest way there and back counts:
offset = theirs - (sent + received) / 2, wrong by half of that way at most (as in NTP).

**Where.** On loopback nothing is asked for. On an interface that is named a key is: a file with a password that all
share (Zenoh's user and password), and it listens on that interface only.
"""

import json
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, Final

from txt1.errors import ConfigError, MissingExtra
from txt1.fleet.air import TIMEOUT, Said
from txt1.fleet.members import Member
from txt1.kernel.clock import NS_PER_S, RealClock, wall_ns

PORTS: Final = range(7450, 7482)  # on loopback, of which each peer takes the first that is free
REPEAT: Final = 0.02  # s between two sayings of a stop
LONGER: Final = 1.0  # s that it is said after all have answered
STOP_FOR: Final = 30.0  # s after which whoever has not answered is given up
PING: Final = 1.0  # s between two pings
PINGS: Final = 10  # of which the fastest counts
LOOK: Final = 0.6  # s to look whether a name is taken
SIZE: Final = 1 << 15  # bytes of the longest message that is read
FIELDS: Final = ("x", "y", "theta", "v", "omega")


@dataclass
class _Other:
    """Another peer as it is known here; times are s of our clock."""

    ids: set[str] = field(default_factory=set)  # of its liveliness tokens
    heard: float = 0.0
    state: Mapping[str, Any] = field(default_factory=dict)
    learned: tuple[Mapping[str, Any], float] | None = None  # as it was told, and when
    pings: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=PINGS))  # s there and back, offset

    @property
    def alive(self) -> bool:
        return bool(self.ids)


@dataclass
class Hooks:
    """Called with the messages of other peers, in a thread of Zenoh's."""

    stop: Callable[[str], None] = lambda who: None
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
    ) -> None:
        self._zenoh = need_zenoh()
        self._space = space
        self.name, self._hooks, self._loss, self._rng = name, hooks or Hooks(), loss, Random(name)
        self._clock = RealClock()
        self._lock = threading.Lock()
        self._others: dict[str, _Other] = {}
        self._stops: dict[str, int] = {}  # the number of each peer's newest stop that was obeyed
        self._stop_number = self._clock.now_ns() // 1_000_000  # grows, and goes on growing after a restart
        self._answered: set[str] = set()
        self._stopping: threading.Thread | None = None
        self._closing = threading.Event()
        self._session = self._open(interface, key)
        self.id = f"{wall_ns():020d}-{self._session.zid()}"
        self._token = self._claim()
        self._session.declare_subscriber(f"{self._space}/state/*", self._take_state)
        self._session.declare_subscriber(f"{self._space}/learned/*", self._take_learned)
        self._session.declare_subscriber(f"{self._space}/stop/*", self._take_stop)
        self._session.declare_subscriber(f"{self._space}/stopped/{name}", self._take_answer)
        self._session.declare_subscriber(f"{self._space}/drive/{name}", self._take_drive)
        self._session.declare_subscriber(f"{self._space}/ping/{name}", self._take_ping)
        self._session.declare_subscriber(f"{self._space}/pong/{name}", self._take_pong)
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

    def stop_all(self) -> threading.Thread:
        """Stop every robot of the fleet: said again and again until all have answered, by the thread returned."""
        with self._lock:
            self._stop_number += 1
            self._answered.clear()
            number = self._stop_number
        self._stopping = threading.Thread(target=self._say_stop, args=(number,), name="fleet stop", daemon=True)
        self._stopping.start()
        return self._stopping

    def _say_stop(self, number: int) -> None:
        began, complete = self.now, 0.0
        while number == self._stop_number and self.now < began + STOP_FOR:
            self._put(f"stop/{self.name}", {"number": number})
            with self._lock:
                missing = {name for name, other in self._others.items() if other.alive} - self._answered
            complete = 0.0 if missing else complete or self.now
            if (complete and self.now > complete + LONGER) or self._closing.wait(REPEAT):
                return

    def listen(self, duration: float) -> None:
        """Wait so many s."""
        self._closing.wait(duration)

    # -- knowing -----------------------------------------------------------------------------------------------

    def heard(self) -> Mapping[str, Said]:
        """Where the others are and how they move, those who have told it, by this computer's clock."""
        with self._lock:
            known = {name: (other.state, other.heard) for name, other in self._others.items() if other.state}
        return {
            name: Said(
                **{each: float(state.get(each, 0.0)) for each in FIELDS}, time=heard, data=tuple(state.get("data", ()))
            )
            for name, (state, heard) in known.items()
        }

    def taught(self) -> Mapping[str, tuple[Mapping[str, Any], float]]:
        """The learned rows of each robot that is there, not checked, and when they were told by our clock."""
        with self._lock:
            return {name: one.learned for name, one in self._others.items() if one.alive and one.learned is not None}

    def members(self) -> tuple[Member, ...]:
        """All others that were ever heard, a line each."""
        now = self.now
        with self._lock:
            return tuple(_member(name, other, now) for name, other in sorted(self._others.items()) if other.heard)

    def answered(self) -> set[str]:
        """Names of the robots that have answered the last stop."""
        with self._lock:
            return set(self._answered)

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
        """A message from another peer; None for its own, a lost one, one that is too long, or none at all."""
        if self._loss and self._rng.random() < self._loss:
            return None
        try:
            whole = bytes(sample.payload)
            message = json.loads(whole) if len(whole) <= SIZE else {"from": self.name}
            return message if message["from"] != self.name else None
        except (ValueError, KeyError, TypeError, RecursionError):
            return None

    def _other(self, name: str) -> _Other:
        return self._others.setdefault(name, _Other())

    def _take_state(self, sample: Any) -> None:
        if (message := self._read(sample)) is not None:
            with self._lock:
                other = self._other(message["from"])
                other.state, other.heard = message, self.now
            self._hooks.state(message)

    def _take_learned(self, sample: Any) -> None:
        message = self._read(sample)
        name = str(sample.key_expr).split("/")[-1]
        if message is not None and message["from"] == name:
            with self._lock:
                self._other(name).learned = message, self.now

    def _take_stop(self, sample: Any) -> None:
        message = self._read(sample)
        if message is None:
            return
        who, number = message["from"], int(message["number"])
        if self._stops.get(who, -1) < number:
            self._stops[who] = number
            self._hooks.stop(who)
        self._put(f"stopped/{who}", {"number": number})

    def _take_answer(self, sample: Any) -> None:
        message = self._read(sample)
        if message is not None and message["number"] == self._stop_number:
            with self._lock:
                self._answered.add(message["from"])

    def _take_drive(self, sample: Any) -> None:
        if (message := self._read(sample)) is not None:
            self._hooks.drive(message["from"], float(message["v"]), float(message["omega"]))

    def _take_ping(self, sample: Any) -> None:
        if (message := self._read(sample)) is not None:
            self._put(f"pong/{message['from']}", {"began": message["sent"]})

    def _take_pong(self, sample: Any) -> None:
        message = self._read(sample)
        if message is not None:
            began, theirs, now = message["began"] / NS_PER_S, message["sent"] / NS_PER_S, self.now
            with self._lock:
                self._other(message["from"]).pings.append((now - began, theirs - 0.5 * (began + now)))

    def _take_alive(self, sample: Any) -> None:
        name, own = str(sample.key_expr).split("/")[-2:]
        if name != self.name:
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
    state = other.state
    pose = (state["x"], state["y"], state["theta"]) if "x" in state else None
    offset = min(other.pings)[1] if other.pings else None
    age = now - other.heard
    return Member(
        name, bool(state.get("armed")), str(state.get("reason", "")), pose,
        state.get("v", 0.0), state.get("omega", 0.0), state.get("driver", ""), state.get("battery"),
        age, offset, other.alive and age < 10.0 * TIMEOUT, str(state.get("silent", "")),
    )  # fmt: skip
