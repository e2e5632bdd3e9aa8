"""A peer of a fleet whose network is in the test's hands: what it hears, what it says, and when it stops saying it."""

from __future__ import annotations

import json
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from types import SimpleNamespace
from typing import Any, Final

import pytest

from tests.patience import LIMIT, wait_until
from txt1.errors import ConfigError, MissingExtra
from txt1.fleet import network
from txt1.fleet.key import FleetKey, fleet_key
from txt1.fleet.members import NEW, Member
from txt1.fleet.messages import StopAnswer
from txt1.fleet.network import OTHERS_MAX, PORTS, REPEAT, Hooks, Peer, configuration, gives_way
from txt1.fleet.radio import ROBOT_SILENCE
from txt1.fleet.stopping import Standing, StopOfAll
from txt1.kernel.clock import NS_PER_S, RealClock, VirtualClock

FLEET: Final = "alone"
FREE: Final = vars(network)["_free"]
ONE: Final = "1" * 32
BEGAN: Final = 100.0  # s, when the peer joins
STATE: Final[dict[str, Any]] = {
    "x": 1.0,
    "y": 2.0,
    "theta": 0.5,
    "v": 0.3,
    "omega": 0.1,
    "armed": True,
    "battery": 12.5,
    "data": [7.0],
}
DOUBLE: Final = "name: there is a robot 'net01' in the fleet; choose another with --name"


class ZError(Exception):
    """An error of Zenoh's."""


class Settings:
    """A configuration of Zenoh's."""

    def __init__(self) -> None:
        self.of: dict[str, Any] = {}

    def insert_json5(self, name: str, value: str) -> None:
        self.of[name] = json.loads(value)


class Session:
    """A session of Zenoh's that nobody else is in: it notes what is put, and hears what the test says."""

    def __init__(self, air: Air, settings: Settings) -> None:
        self.air, self.settings = air, settings.of
        self.put_there: list[tuple[str, bytes, dict[str, Any]]] = []
        self.tokens: list[str] = []
        self.takes: list[tuple[str, Callable[[Any], None]]] = []
        self.closed = False

    def zid(self) -> str:
        return "5"

    def put(self, key: str, payload: bytes, **how: Any) -> None:
        self.air.before(key)
        self.put_there.append((key, payload, how))

    def declare_subscriber(self, key: str, take: Callable[[Any], None], history: bool = False) -> None:
        self.takes.append((key, take))
        if history:
            for token in self.air.tokens:
                self.hear(token, b"")

    def liveliness(self) -> Session:
        return self

    def declare_token(self, key: str) -> str:
        self.tokens.append(key)
        return key

    def get(self, key: str, timeout: float) -> list[Any]:
        del timeout
        self.air.clock.spend(1.0)
        found = [each for each in (*self.tokens, *self.air.tokens) if fnmatchcase(each, key)]
        return [SimpleNamespace(ok=None), *(SimpleNamespace(ok=SimpleNamespace(key_expr=each)) for each in found)]

    def hear(self, key: str, payload: bytes, kind: str = "put") -> None:
        for place, take in self.takes:
            if fnmatchcase(key, place):
                take(SimpleNamespace(key_expr=key, payload=payload, kind=kind))

    def close(self) -> None:
        self.closed = True

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Air:
    """The module `zenoh` without a network."""

    ZError = ZError
    Config = Settings
    SampleKind = SimpleNamespace(PUT="put", DELETE="delete")
    CongestionControl = SimpleNamespace(DROP="drop")
    Priority = SimpleNamespace(REAL_TIME="real time", DATA="data")

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.clock.spend(BEGAN)
        self.sessions: list[Session] = []
        self.tokens: list[str] = []  # of others
        self.looks = 0  # of a peer at the stop that it gave
        self.before: Callable[[str], object] = lambda key: None
        """Called before each message is put."""
        self.opening: Callable[[dict[str, Any]], object] = lambda settings: None
        """Called before a session opens."""

    def open(self, settings: Settings) -> Session:
        self.opening(settings.of)
        self.sessions.append(Session(self, settings))
        return self.sessions[-1]


class Alone:
    """A peer to which only the test speaks, and what its hooks were called with."""

    def __init__(self, air: Air, name: str = "net01", **more: Any) -> None:
        self.air, self.clock = air, air.clock
        self.stops: list[tuple[str, str]] = []
        self.drives: list[tuple[str, float, float, float]] = []
        self.doubles: list[str] = []
        self.states: list[Any] = []
        self.answer: StopAnswer | None = StopAnswer(True, why="slowing down")

        def stop(who: str, identity: str) -> StopAnswer | None:
            self.stops.append((who, identity))
            return self.answer

        hooks = Hooks(stop, lambda *given: self.drives.append(given), self.doubles.append, self.states.append)
        self.key: FleetKey = fleet_key("", None, FLEET)
        self.peer = Peer(name, hooks=hooks, fleet=FLEET, clock=self.clock, **more)
        self.session = air.sessions[-1]

    def says(self, where: str, signed: bool = True, **message: Any) -> None:
        """Somebody else sends a message, by default net07."""
        text = json.dumps({"from": "net07", "id": "7", "sent": 0, **message}).encode()
        self.session.hear(f"{self.key.space}/{where}", self.key.signed(where, text) if signed else text)

    def token(self, name: str, own: str = "7", signature: str | None = None) -> str:
        """The liveliness token of another peer."""
        where = f"alive/{name}/{own}"
        return f"{self.key.space}/{where}-{self.key.signature(where, b'') if signature is None else signature}"

    def comes(self, name: str, own: str = "7", signature: str | None = None) -> None:
        self.session.hear(self.token(name, own, signature), b"")

    def goes(self, name: str, own: str = "7") -> None:
        self.session.hear(self.token(name, own), b"", "delete")

    def pong(self, there_and_back: float, ahead: float, who: str = "net07") -> None:
        """Another peer, whose clock is ahead, answers a ping that has taken so long, s."""
        began = self.clock.ns - int(there_and_back * NS_PER_S)
        sent = (began + self.clock.ns) // 2 + int(ahead * NS_PER_S)
        self.says(f"pong/{self.peer.name}", **{"from": who, "began": began, "sent": sent})

    def said(self, where: str, session: Session | None = None) -> list[dict[str, Any]]:
        """What the peer has sent to a place, each message signed for it."""
        found = []
        for key, payload, _ in list((session or self.session).put_there):
            if key == f"{self.key.space}/{where}":
                text = self.key.opened(where, payload)
                assert text is not None
                found.append(json.loads(text))
        return found

    def alive(self) -> set[str]:
        """The peers that were told here and are there."""
        return {each.name for each in self.peer.members() if each.alive}

    def standing(self) -> Standing:
        last = self.peer.standing()
        assert last is not None
        return last[0]

    def repeats(self, number: int = 3) -> None:
        """Wait until the stop is said some times more, and is looked at as often: two threads do that."""
        where = f"stop/{self.peer.name}"
        most, looks = len(self.said(where)) + number, self.air.looks + number
        wait_until(lambda: self.air.looks >= looks and len(self.said(where)) >= most)


@pytest.fixture
def air(monkeypatch: pytest.MonkeyPatch) -> Air:
    made = Air()
    monkeypatch.setattr(network, "need_zenoh", lambda: made)
    monkeypatch.setattr(network, "_free", lambda port: True)
    monkeypatch.setattr(network, "REPEAT", 0.002)
    monkeypatch.setattr(network, "PING_LEAST", 0.002)
    expect = vars(Peer)["_expect"]

    def looked(peer: Peer, stop: StopOfAll) -> None:
        made.looks += 1
        expect(peer, stop)

    monkeypatch.setattr(Peer, "_expect", looked)
    return made


@pytest.fixture
def join(air: Air) -> Iterator[Callable[..., Alone]]:
    before, made = set(threading.enumerate()), []

    def joined(name: str = "net01", **more: Any) -> Alone:
        made.append(Alone(air, name, **more))
        return made[-1]

    yield joined
    for each in made:
        each.peer.close()
        assert each.session.closed
    wait_until(lambda: set(threading.enumerate()) <= before)  # no thread of a peer is left


Join = Callable[..., Alone]


def sent(own: Alone, where: str, number: int = 1) -> list[dict[str, Any]]:
    """So many messages that the peer sends to a place, from a thread of its own."""
    wait_until(lambda: len(own.said(where)) >= number)
    return own.said(where)


# -- stops that it hears


@pytest.mark.parametrize(
    ("where", "signed", "identity", "who", "obeyed"),
    [
        ("stop/console1", True, ONE, "console1", ONE),
        ("stop/console1", True, 7, "console1", ""),
        ("stop/console1", True, "f" * 31, "console1", ""),
        ("stop/console1", False, ONE, "somebody", ""),
        ("stop/NOBODY", True, ONE, "somebody", ONE),
    ],
)
def test_a_stop_is_obeyed_whoever_says_it_and_one_with_an_identity_is_answered(
    join: Join, where: str, signed: bool, identity: object, who: str, obeyed: str
) -> None:
    robot = join()
    robot.says(where, signed, stop=identity)
    robot.says(where, signed, stop=identity)
    assert robot.stops == [(who, obeyed)] * 2
    robot.says("stop/console2", stop="2" * 32)
    answers = sent(robot, "stopped/console2")
    assert (len(answers), answers[0]["from"]) == (1, "net01")
    assert [answers[0][name] for name in ("stop", "closed", "stands", "why")] == ["2" * 32, True, False, "slowing down"]
    others = robot.said(f"stopped/{who}")
    assert {each["stop"] for each in others} == ({ONE} if obeyed else set()), "one without identity has no answer"
    robot.answer = None
    robot.says("stop/console3", stop=ONE)
    assert robot.stops[-1] == ("console3", ONE)


def test_a_console_does_not_obey_its_own_stop_and_without_an_answer_gives_none(join: Join) -> None:
    console = join("console1", console=True)
    console.answer = None
    console.peer.stop_all()
    own = sent(console, "stop/console1")[0]["stop"]
    console.says("stop/console1", stop=own)
    console.says("stop/console2", stop=own)
    assert not console.stops
    console.says("stop/console2", stop=ONE)
    assert console.stops == [("console2", ONE)]
    console.peer.drive("net07", 0.1, 0.0)
    console.pong(0.0, 0.0)
    console.peer.drive("net07", 0.1, 0.0)
    sent(console, "drive/net07")  # it would have gone before
    assert not console.said("stopped/console2")


def test_with_a_share_of_messages_lost_the_others_come_both_ways(join: Join) -> None:
    robot = join(loss=0.3)
    for _ in range(400):
        robot.says("stop/console1", stop=ONE)
        robot.says("state/net07", **STATE)
        robot.says("ping/net01", sent=1)
    # 280 and 196, and five standard deviations: what it tells by itself draws chances, too, whenever that is
    assert all(234 <= len(each) <= 326 for each in (robot.stops, robot.states))
    assert 146 <= len(robot.said("pong/net07")) <= 246, "they are lost on both ways"


# -- commands and clocks


def test_a_command_carries_the_time_of_its_key_by_the_robot_s_clock(join: Join) -> None:
    console = join("console1", console=True)
    console.peer.drive("net07", 0.3, 0.1)
    console.comes("net07")
    console.peer.drive("net07", 0.3, 0.1)
    for there_and_back, ahead in ((1.0, 60.0), (0.5, 50.0), (2.0, 10.0)):
        console.pong(there_and_back, ahead)
    console.peer.drive("net08", 0.3, 0.1)
    console.peer.drive("net07", 0.3, 0.1, age=2.0)
    (first,) = sent(console, "drive/net07")
    assert (first["v"], first["omega"]) == (0.3, 0.1)
    assert first["given"] == (BEGAN - 2.0 + 50.0 - 0.25) * NS_PER_S
    console.peer.drive("net07", 0.0, 0.0)
    assert sent(console, "drive/net07", 2)[1]["given"] == (BEGAN + 50.0 - 0.25) * NS_PER_S
    console.pong(0.25, 1.0 - BEGAN)
    console.peer.drive("net07", 0.0, 0.0, age=5.0)
    assert sent(console, "drive/net07", 3)[2]["given"] == 0, "its computer has just been started"
    assert not console.said("drive/net08")


@pytest.mark.parametrize(
    ("after", "why"), [(-50.0, ""), (0.0, ""), (0.005, ""), (0.02, "given: that is in the future of this computer")]
)
def test_a_command_comes_with_its_time_and_one_from_the_future_does_not(join: Join, after: float, why: str) -> None:
    robot = join()
    now = robot.peer.now
    robot.says("drive/net01", v=0.3, omega=0.1, given=round((now + after) * NS_PER_S))
    assert robot.drives == ([] if why else [("net07", 0.3, 0.1, pytest.approx(now + after, abs=1e-9))])
    assert robot.peer.refused().get("net07", "").startswith(why) and bool(why) == bool(robot.peer.refused())


@pytest.mark.parametrize(
    ("there_and_back", "fine"), [(-0.5, False), (0.0, True), (0.5, True), (10.0, True), (10.5, False)]
)
def test_a_ping_is_answered_and_an_answer_counts_only_to_a_ping_of_the_last_seconds(
    join: Join, there_and_back: float, fine: bool
) -> None:
    robot = join()
    robot.says("ping/net01", sent=123)
    (answer,) = robot.said("pong/net07")
    assert (answer["began"], answer["sent"]) == (123, robot.clock.ns)
    robot.says("state/net07", **STATE)
    robot.pong(there_and_back, 5.0)
    (member,) = robot.peer.members()
    assert member.offset == (pytest.approx(5.0) if fine else None)
    assert robot.peer.refused() == ({} if fine else {"net07": "began: that ping was never sent"})


def test_a_peer_is_pinged_when_it_comes_when_a_command_waits_and_then_seldom(
    join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "PING_PERIOD", 1e6)
    console = join("console1", console=True)
    console.says("state/net08", **{"from": "net08", **STATE})
    console.comes("net07")
    sent(console, "ping/net07")
    console.comes("net07")
    console.peer.listen(0.03)
    pings = len(console.said("ping/net07"))
    assert pings == 1
    console.peer.drive("net07", 0.1, 0.0)
    sent(console, "ping/net07", pings + 1)
    console.pong(0.1, 5.0)
    console.comes("net07", "8")  # it was started again, perhaps with another clock
    sent(console, "ping/net07", pings + 2)
    console.peer.drive("net07", 0.1, 0.0)
    sent(console, "ping/net07", pings + 3)
    assert not console.said("drive/net07") and not console.said("ping/net08"), "nobody is there who could answer"


# -- who is there


def test_a_peer_is_there_from_first_to_last_token_and_forged_ones_say_nothing(join: Join) -> None:
    robot = join()
    for who in ("net01", "net07", "net08", "net09"):
        robot.says(f"state/{who}", **{"from": who, **STATE})
    robot.comes("net07", "1")
    robot.comes("net07", "2")
    robot.comes("net01")
    robot.comes("net08", signature="0" * 32)
    robot.comes("net09", signature=robot.key.signature("alive/net07/7", b""))
    assert robot.alive() == {"net07"}
    robot.goes("net07", "1")
    assert robot.alive() == {"net07"}
    robot.goes("net07", "2")
    assert not robot.alive() and {each.name for each in robot.peer.members()} == {"net07", "net08", "net09"}
    robot.comes("NET10")
    robot.peer.stop_all()
    assert "NET10" not in robot.standing().silent


def test_a_robot_s_own_token_is_signed_and_a_console_has_none(join: Join) -> None:
    robot, console = join(), join("console1", console=True)
    assert robot.session.tokens == [robot.token("net01", robot.peer.id)] and not console.session.tokens
    console.session.hear(robot.session.tokens[0], b"")
    console.peer.stop_all()
    assert console.standing().silent == ("net01",)


def test_who_was_there_before_is_known_at_once(air: Air, join: Join) -> None:
    first = join()
    air.tokens += first.session.tokens
    console = join("console1", console=True)
    console.peer.stop_all()
    assert console.standing().silent == ("net01",)


@pytest.mark.parametrize(
    ("own", "signed", "stays"), [("0", True, False), ("0", False, True), ("9" * 30, True, True), ("", False, True)]
)
def test_a_name_that_an_earlier_robot_has_is_refused_and_nothing_stays_open(
    air: Air, join: Join, own: str, signed: bool, stays: bool
) -> None:
    other = join("net02")
    air.tokens = [other.token("net01", own, None if signed else "0" * 32)] if own else []
    if stays:
        assert join().peer.name == "net01"
        return
    with pytest.raises(ConfigError, match=DOUBLE):
        Peer("net01", fleet=FLEET, clock=air.clock)
    assert air.sessions[-1].closed


@pytest.mark.parametrize(
    ("said", "leaves", "refused"),
    [
        ({"up": 60.0}, True, False),
        ({"up": 0.0, "id": "9" * 30}, False, True),
        ({}, False, False),
        ({"up": "x"}, False, True),
    ],
)
def test_a_robot_leaves_to_an_earlier_one_of_its_name_and_is_not_led_by_the_later(
    join: Join, said: dict[str, Any], leaves: bool, refused: bool
) -> None:
    robot, console = join(), join("console1", console=True)
    robot.clock.spend(4.0)
    robot.says("state/net01", **{**STATE, "from": "net01", "id": robot.peer.id, "up": 60.0})  # an echo of its own
    for where in ("state/net01", "drive/net01"):
        robot.says(where, **{**STATE, "from": "net01", "given": robot.clock.ns, **said})
    assert robot.doubles == [DOUBLE] * 2 * leaves and bool(robot.peer.refused()) == refused
    assert not robot.states and not robot.drives and not robot.peer.heard()
    console.says("state/console1", **{**STATE, "from": "console1", **said})
    assert not console.doubles and not console.peer.refused(), "two consoles may have one name"


def test_a_robot_that_has_been_there_for_half_a_minute_leaves_to_nobody(join: Join) -> None:
    robot = join()
    robot.clock.spend(NEW)
    robot.says("state/net01", **{**STATE, "from": "net01", "up": 1e5})
    assert not robot.doubles
    assert robot.peer.refused() == {"net01": "another robot has this robot's name; choose another with --name"}


def test_of_two_namesakes_that_came_together_the_smaller_id_stays() -> None:
    assert [gives_way(10.0, 10.0 + apart, "2", "1") for apart in (-2.0, -1.0, 0.0, 1.0)] == [False, True, True, True]
    assert [gives_way(10.0, 10.0 + apart, "1", "2") for apart in (-2.0, -1.0, 0.0, 1.0)] == [False, False, False, True]


# -- states and learned rows


def test_what_a_robot_tells_is_shown_with_its_age_and_clock(join: Join) -> None:
    robot = join()
    robot.comes("net07")
    assert robot.peer.members() == () and not robot.peer.heard(), "it has told nothing yet"
    robot.says("state/net07", **STATE, reason="x", driver="hand", silent="net08", stuck="a wall")
    robot.pong(1.0, 7.0)
    robot.pong(0.5, 5.0)
    heard = robot.peer.now
    robot.clock.spend(2.0)
    (member,) = robot.peer.members()
    assert member._replace(hand=None) == Member(
        "net07", True, "x", (1.0, 2.0, 0.5), 0.3, 0.1, "hand", 12.5, pytest.approx(2.0), pytest.approx(5.0), True,
        "net08", "", "a wall",
    )  # fmt: skip
    said = robot.peer.heard()["net07"]
    assert (*said[:5], said.data, said.time) == (1.0, 2.0, 0.5, 0.3, 0.1, (7.0,), heard)
    assert [each["x"] for each in robot.states] == [1.0]
    robot.clock.spend(10.0 * ROBOT_SILENCE)
    assert not robot.peer.members()[0].alive, "its program hangs"


def test_learned_rows_are_those_of_present_robots(join: Join) -> None:
    robot = join()
    robot.says("learned/net07", rows=[1])
    robot.comes("net08")
    assert robot.peer.taught() == {}
    robot.comes("net07")
    message, arrived = robot.peer.taught()["net07"]
    assert message["rows"] == [1] and arrived == robot.peer.now and len(robot.peer.taught()) == 1


def test_of_too_many_peers_the_longest_silent_is_forgotten_and_none_that_is_there(join: Join) -> None:
    robot = join()
    robot.comes("n0")
    for number in range(OTHERS_MAX + 1):
        robot.clock.spend(0.01)
        robot.says("state/x", **{**STATE, "from": f"n{number}"})
        assert len(robot.peer.heard()) == min(number + 1, OTHERS_MAX)
    assert {"n0", "n2", f"n{OTHERS_MAX}"} <= robot.peer.heard().keys() and "n1" not in robot.peer.heard()
    robot.says("state/x", **{**STATE, "from": "n0"})
    assert robot.peer.heard()["n0"].time == robot.peer.now and "n2" in robot.peer.heard(), "the known are heard on"
    for number in range(2, OTHERS_MAX + 1):
        robot.comes(f"n{number}")
    robot.says("state/x", **{**STATE, "from": "late"})
    assert "late" not in robot.peer.heard() and len(robot.peer.heard()) == OTHERS_MAX


def test_what_is_refused_is_told_of_a_limited_number_of_peers(join: Join) -> None:
    robot = join()
    robot.says("state/net07", signed=False, **STATE)
    for number in range(OTHERS_MAX + 5):
        robot.says("state/x", **{"from": f"n{number}", "x": "boom"})
    robot.session.hear(f"{robot.key.space}/state/x", robot.key.signed("state/x", b"{"))
    refused = robot.peer.refused()
    assert len(refused) == OTHERS_MAX and refused["somebody"] == "it is not signed with the fleet's key"
    assert refused["n0"] == "x: it is no number" and not robot.peer.heard() and not robot.states


# -- sending


def test_what_is_urgent_goes_first_and_all_of_it_is_signed_and_says_whose_it_is(join: Join) -> None:
    robot = join()
    robot.clock.spend(2.0)
    robot.peer.tell(STATE)
    robot.peer.teach({"rows": [1]})
    robot.says("stop/console1", stop=ONE)
    (state,), (learned,), (answer,) = (
        sent(robot, each) for each in ("state/net01", "learned/net01", "stopped/console1")
    )
    assert (state["up"], state["x"], learned["rows"]) == (robot.peer.now - robot.peer.began, 1.0, [1])
    for each in (state, learned, answer):
        assert (each["from"], each["id"], each["sent"]) == ("net01", robot.peer.id, robot.clock.ns)
    how = {key.removeprefix(f"{robot.key.space}/"): how for key, _, how in robot.session.put_there}
    assert {key: each["priority"] for key, each in how.items()} == {
        "state/net01": "data", "learned/net01": "data", "stopped/console1": "real time"
    }  # fmt: skip
    assert all(each["express"] and each["congestion_control"] == "drop" for each in how.values())
    robot.clock.spend(1e6)
    robot.peer.tell(STATE)
    assert sent(robot, "state/net01", 2)[1]["up"] == 1e5


def test_of_states_that_wait_the_newest_is_sent_and_no_answer_waits_for_them(join: Join) -> None:
    robot, free, waits = join(), threading.Event(), threading.Event()

    def slow(key: str) -> None:
        if "/state/" in key:
            waits.set()
            assert free.wait(LIMIT)

    robot.air.before = slow
    try:
        robot.peer.tell({"x": 0.0})
        assert waits.wait(LIMIT)
        for number in (1.0, 2.0, 3.0):
            robot.peer.tell({"x": number})
        robot.says("stop/console1", stop=ONE)
        sent(robot, "stopped/console1")
        assert not robot.said("state/net01")
    finally:
        free.set()
    assert [each["x"] for each in sent(robot, "state/net01", 2)] == [0.0, 3.0]


def test_a_peer_that_cannot_send_says_so_unless_it_has_just_been_closed(join: Join) -> None:
    def broken(key: str) -> None:
        del key
        raise ZError("broken")

    robot = join()
    robot.air.before = broken

    def told() -> bool:
        try:
            robot.peer.tell(STATE)
        except ZError:
            return True
        return False

    wait_until(told)
    robot.air.before = lambda key: None
    other = join("net02")

    def closed(key: str) -> None:
        other.peer.close()
        broken(key)

    other.air.before = closed
    other.peer.tell(STATE)
    wait_until(lambda: other.session.closed)
    other.peer.listen(0.0)
    other.peer.tell(STATE)


# -- the stop of all


def answers(console: Alone, who: str = "net07", through: Session | None = None, **more: Any) -> None:
    """Let a robot answer the console's stop."""
    stop = sent(console, "stop/console1")[-1]["stop"]
    text = json.dumps({"from": who, "stop": stop, **more}).encode()
    where = "stopped/console1"
    (through or console.session).hear(f"{console.key.space}/{where}", console.key.signed(where, text))


@pytest.mark.parametrize(
    ("answer", "until"),
    [
        (None, network.ALONE),
        ({"closed": True, "stands": True}, network.LONGER),
        ({"closed": True, "why": "not seen"}, network.STAND_PATIENCE),
        ({"why": "it was armed again"}, network.STOP_FOR),
    ],
)
def test_a_stop_is_said_for_its_time_and_no_longer(join: Join, answer: dict[str, Any] | None, until: float) -> None:
    console = join("console1", console=True)
    saying = console.peer.stop_all()
    console.repeats()
    if answer is not None:
        answers(console, **answer)
        console.repeats()
    console.clock.spend(until - 0.1)
    console.repeats()
    assert saying.is_alive()
    console.clock.spend(0.2)
    saying.join(LIMIT)
    assert not saying.is_alive()
    last = console.peer.standing()
    assert last is not None and last[1] == pytest.approx(until + 0.1)
    assert last[0].stands == (("net07",) if answer and "stands" in answer else ())


def test_a_stop_arrives_in_half_a_second_though_a_third_of_messages_is_lost() -> None:
    assert 0.3 ** int(0.5 / REPEAT) < 1e-12


def test_a_stop_is_said_on_to_a_robot_that_was_armed_again_and_its_time_begins_anew(join: Join) -> None:
    console = join("console1", console=True)
    saying = console.peer.stop_all(["net07"])
    for _ in range(2):
        answers(console, closed=True, stands=True)
        console.repeats()
        answers(console, why="it was armed again")
        console.repeats()
        console.clock.spend(6.0)
        console.repeats()
        assert saying.is_alive() and console.standing() == Standing(others=(("net07", "it was armed again"),))
    answers(console, closed=True)
    console.repeats()
    console.clock.spend(2.0)
    console.repeats()
    answers(console, closed=True, stands=True)
    console.repeats()
    assert saying.is_alive() and console.standing() == Standing(("net07",))
    console.clock.spend(1.1)
    saying.join(LIMIT)
    assert not saying.is_alive()


def test_of_two_stops_of_a_console_the_newer_is_said_and_answered(join: Join) -> None:
    console = join("console1", console=True)
    first = console.peer.stop_all(["net07"])
    answers(console, closed=True, stands=True)
    console.clock.spend(0.5)
    second = console.peer.stop_all(["net07"])
    first.join(LIMIT)
    assert not first.is_alive() and second.is_alive() and console.standing() == Standing(silent=("net07",))
    console.repeats(5)
    assert len({each["stop"] for each in console.said("stop/console1")[-2:]}) == 1
    console.says("stopped/console1", stop=console.said("stop/console1")[0]["stop"], closed=True, stands=True)
    assert console.standing() == Standing(silent=("net07",)), "that was the answer to the earlier stop"


def test_who_is_there_was_heard_lately_or_is_named_has_to_answer(join: Join) -> None:
    console = join("console1", console=True)
    assert console.peer.standing() is None
    console.says("stopped/console1", stop=ONE, closed=True)  # there was no stop
    console.says("state/net01", **{**STATE, "from": "net01"})
    console.clock.spend(network.HEARD_LATELY - 0.5)
    console.says("state/net02", **{**STATE, "from": "net02"})
    console.clock.spend(1.0)
    console.comes("net03")
    console.pong(0.0, 0.0, "net04")
    console.peer.stop_all(["net05"])
    assert console.standing() == Standing(silent=("net02", "net03", "net05"))
    console.comes("net06")
    wait_until(lambda: console.standing() == Standing(silent=("net02", "net03", "net05", "net06")))


def test_a_stop_that_is_not_answered_is_said_through_new_sessions_each_for_its_time(air: Air, join: Join) -> None:
    console = join("console1", console=True)
    saying = console.peer.stop_all(["net07"])
    console.clock.spend(network.UNANSWERED - 0.1)
    console.repeats(5)
    assert len(air.sessions) == 1
    console.clock.spend(0.2)
    wait_until(lambda: len(air.sessions) == 2)
    second = air.sessions[1]
    wait_until(lambda: len(console.said("stop/console1", second)) > 3)
    console.clock.spend(network.ANEW - 0.1)
    console.repeats(5)
    assert len(air.sessions) == 2 and not second.closed and all(each.daemon for each in threads())
    console.clock.spend(0.2)
    wait_until(lambda: second.closed and len(air.sessions) == 3)
    third = air.sessions[2]
    wait_until(lambda: bool(console.said("stop/console1", third)))
    answers(console, through=third, closed=True)
    console.repeats()
    assert console.standing() == Standing(stopped=(("net07", ""),))
    console.clock.spend(network.STAND_PATIENCE - 0.2)
    console.repeats(5)
    assert len(air.sessions) == 3 and saying.is_alive(), "its gate is closed"
    console.clock.spend(0.3)
    saying.join(LIMIT)
    wait_until(lambda: third.closed)


def threads() -> list[threading.Thread]:
    """The threads of peers."""
    return [each for each in threading.enumerate() if each.name.startswith("fleet")]


def test_a_peer_that_is_closed_says_nothing_more_and_waits_for_a_session_that_opens(air: Air, join: Join) -> None:
    console, free, opens = join("console1", console=True), threading.Event(), threading.Event()

    def slow(settings: dict[str, Any]) -> None:
        del settings
        opens.set()
        assert free.wait(LIMIT)

    air.opening = slow
    saying = console.peer.stop_all(["net07"])
    console.clock.spend(1.1)
    assert opens.wait(LIMIT)
    closing = threading.Thread(target=console.peer.close)
    closing.start()
    try:
        saying.join(LIMIT)
        closing.join(0.03)
        assert not saying.is_alive() and closing.is_alive()
    finally:
        free.set()
        closing.join(LIMIT)
    assert {each.name for each in threads()} <= {"fleet pings", "fleet sends"}
    said = len(console.session.put_there)
    console.peer.tell(STATE)
    console.says("ping/console1", sent=1)
    console.peer.stop_all(["net07"]).join(LIMIT)
    assert len(console.session.put_there) == said and console.session.closed and not console.said("x", air.sessions[1])
    assert not air.sessions[1].put_there


def test_a_peer_waits_as_long_as_it_is_told_to(join: Join) -> None:
    console, clock = join("console1", console=True), RealClock()
    before = clock.now_ns()
    console.peer.listen(0.02)
    assert clock.now_ns() - before > 0.015 * NS_PER_S


# -- how it joins


def test_a_peer_on_loopback_takes_the_first_free_port_and_connects_to_the_others(
    air: Air, join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "_free", lambda port: port > PORTS[1])

    def taken(settings: dict[str, Any]) -> None:
        if settings["listen/endpoints"] == [f"tcp/127.0.0.1:{PORTS[2]}"]:
            raise ZError("another process has taken it")

    air.opening = taken
    told = join("console1", console=True).session.settings
    assert told["listen/endpoints"] == [f"tcp/127.0.0.1:{PORTS[3]}"]
    assert told["connect/endpoints"] == [f"tcp/127.0.0.1:{each}" for each in PORTS if each != PORTS[3]]
    wanted = {"mode": "peer", "scouting/multicast/enabled": False, "scouting/gossip/enabled": False}
    patience = {"listen/exit_on_failure": True, "connect/exit_on_failure": False, "connect/timeout_ms": -1}
    assert (wanted | patience | {"listen/timeout_ms": 0}).items() <= told.items()
    assert told["transport/unicast/open_timeout"] < 1000, "a peer that hangs holds up nobody for long"
    assert configuration().of["connect/endpoints"] == [f"tcp/127.0.0.1:{each}" for each in PORTS]
    monkeypatch.setattr(network, "_free", lambda port: False)
    with pytest.raises(ConfigError, match=f"no port free on loopback from {PORTS[0]} to {PORTS[-1]}; end some robots"):
        join("console2", console=True)


def test_a_port_on_which_another_program_listens_is_left_out(join: Join, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "_free", FREE)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            ports = other.getsockname()[1], free.getsockname()[1]
        monkeypatch.setattr(network, "PORTS", ports)
        told = join("console1", console=True).session.settings
    assert told["listen/endpoints"] == [f"tcp/127.0.0.1:{ports[1]}"]


def test_an_interface_that_cannot_be_used_is_refused_by_its_name(air: Air, fleet_s_key: Any) -> None:
    users = fleet_key("", None)
    path = fleet_s_key / "txt1" / "fleet-key"
    seen: list[dict[str, Any]] = []

    def no(settings: dict[str, Any]) -> None:
        seen.append(settings)
        raise ZError("no such interface")

    air.opening = no
    with pytest.raises(ConfigError, match="--fleet eth7: no such interface; check the interface's name"):
        Peer("net01", "eth7", path)
    (told,) = seen
    assert told["listen/endpoints"] == ["tcp/0.0.0.0:0#iface=eth7"] and told["scouting/multicast/interface"] == "eth7"
    assert told["transport/auth/usrpwd"].items() >= {"user": users.fleet, "password": users.password}.items()
    assert told["scouting/multicast/enabled"] and told["scouting/gossip/enabled"]
    for each in ("multicast", "gossip"):
        assert told[f"scouting/{each}/autoconnect_strategy"] == {"peer": {"to_peer": "greater-zid"}}
    assert "connect/endpoints" not in told


def test_without_zenoh_a_fleet_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(MissingExtra, match="a fleet over a network needs the extra 'fleet'"):
        Peer("net01")
