"""Peers of a fleet over Zenoh on loopback: names, clocks, stops with messages lost, and who is gone."""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.patience import LIMIT, S, wait_until
from txt1.errors import CommandRefused, ConfigError
from txt1.fleet import network
from txt1.fleet.key import SIGNATURE, fleet_key
from txt1.fleet.members import NEW
from txt1.fleet.messages import MESSAGE_SIZE, StopAnswer
from txt1.fleet.network import OTHERS_MAX, PORTS, Hooks, Peer, configuration, gives_way, theirs
from txt1.fleet.page import Network
from txt1.fleet.stopping import Standing
from txt1.kernel.clock import NS_PER_S, RealClock

pytest.importorskip("zenoh", reason="Zenoh is not installed: the extra 'fleet'")

STATE = {"x": 1.0, "y": 2.0, "theta": 0.5, "v": 0.3, "omega": 0.1, "armed": True, "reason": "", "data": [1.0]}


class Team:
    """Peers, and who was stopped and driven."""

    def __init__(self) -> None:
        self.peers: list[Peer] = []
        self.stopped: list[tuple[str, str]] = []
        self.armed: set[str] = set()  # those whose gates stay open
        self._obeyed: set[tuple[str, str]] = set()
        self.driven: list[tuple[str, float, float]] = []
        self.given: list[float] = []  # when each of these was, s of the robot's clock
        self.doubles: list[str] = []
        self.all_stopped = threading.Event()
        self.waits_for = 0
        self.began = RealClock().now_ns() / NS_PER_S
        self.fleet = f"test{uuid4().hex}"  # other tests run at the same time

    def join(self, name: str, loss: float = 0.0, console: bool = False, ahead: float = 0.0) -> Peer:
        def stop(who: str, identity: str) -> StopAnswer | None:
            if not identity or (name, identity) not in self._obeyed:
                self._obeyed.add((name, identity))
                self.stopped.append((name, who))
            if len(self.stopped) >= self.waits_for:
                self.all_stopped.set()
            armed = name in self.armed
            return None if console else StopAnswer(not armed, not armed, "it was armed again" * armed)

        def drive(who: str, v: float, omega: float, given: float) -> None:
            self.driven.append((name, v, omega))
            self.given.append(given)

        hooks = Hooks(stop, drive, self.doubles.append)
        peer = Peer(name, hooks=hooks, loss=loss, fleet=self.fleet, console=console, clock=Shifted(ahead))
        self.peers.append(peer)
        return peer

    def until(self, true: Callable[[], object], limit: float = LIMIT) -> bool:
        """Whether something comes true in the end."""
        with suppress(TimeoutError):
            wait_until(true, limit, look=0.05)
            return True
        return False


@pytest.fixture
def team() -> Iterator[Team]:
    team = Team()
    yield team
    for peer in team.peers:
        peer.close()


def test_a_name_is_unique_and_free_again_when_its_robot_has_gone(team: Team) -> None:
    one, two = team.join("net01"), team.join("net02")
    with pytest.raises(ConfigError, match="there is a robot 'net01' in the fleet; choose another with --name"):
        team.join("net01")
    one.close()
    assert team.until(lambda: team.join("net01") is not None) and two.name == "net02"


def test_what_one_tells_the_others_hear_and_who_leaves_is_gone(team: Team) -> None:
    one, two = team.join("net01"), team.join("net02")

    def heard() -> bool:
        one.tell(STATE)
        return bool(two.heard())

    assert team.until(heard)
    said = two.heard()["net01"]
    assert said[:5] == (1.0, 2.0, 0.5, 0.3, 0.1) and said.data == (1.0,) and 0.0 <= two.now - said.time < 5.0
    assert team.until(lambda: two.members()[0].offset is not None)
    offset = two.members()[0].offset
    assert offset is not None and abs(offset) < 0.5, "one computer has one clock"
    assert two.members()[0].alive
    one.close()
    assert team.until(lambda: not two.members()[0].alive)


def test_a_stop_of_all_reaches_all_once_with_a_third_of_the_messages_lost(team: Team) -> None:
    peers = [team.join(f"net{number:02d}", loss=0.3) for number in range(4)]
    team.waits_for = 3
    peers[0].listen(0.5)
    said = peers[0].stop_all()
    assert team.all_stopped.wait(LIMIT)
    said.join(LIMIT)
    assert standing(peers[0]) == Standing(("net01", "net02", "net03")) and standing(peers[0]).complete
    assert sorted(team.stopped) == [(name, "net00") for name in ("net01", "net02", "net03")]


def standing(peer: Peer) -> Standing:
    last = peer.standing()
    assert last is not None
    return last[0]


def test_every_stop_is_obeyed_whoever_says_it_and_whatever_was_said_before(team: Team) -> None:
    team.join("net01")
    stranger = Stranger(team.fleet)
    try:
        for number, message in enumerate(
            (
                {"from": "console1", "number": 2**60},
                {"from": "console1", "number": 0},
                {},
                {"stop": "0" * 32},
                b"\xff",
                1,
            )
        ):
            stranger.put("stop/console1", message)
            assert team.until(lambda number=number: len(team.stopped) == 2 * number + 1), message
            stranger.put("stop/console1", message, signed=False)
            assert team.until(lambda number=number: len(team.stopped) == 2 * number + 2), "one that is not signed"
        for number in range(2):
            console = team.join("console1", console=True)
            console.stop_all().join(20.0)
            assert standing(console) == Standing(("net01",))
            assert len(team.stopped) == 13 + number
            console.close()
    finally:
        stranger.close()


def test_who_is_not_stopped_and_who_does_not_answer_is_named(team: Team) -> None:
    console, one, two = team.join("console1", console=True), team.join("net01"), team.join("net02")
    gone, _ = team.join("net03"), team.join("console2", console=True)
    team.armed.add("net02")

    def heard() -> bool:
        for peer in (one, two, gone):
            peer.tell(STATE)
        return len(console.heard()) == 3

    assert team.until(heard)
    gone.close()
    console.stop_all(["net09"])
    expected = Standing(("net01",), (), (("net02", "it was armed again"),), ("net03", "net09"))
    assert team.until(lambda: standing(console) == expected), standing(console)
    assert not expected.complete
    assert str(expected) == "stands: net01; not stopped: net02 (it was armed again); no answer: net03, net09"
    team.armed.clear()
    assert team.until(lambda: standing(console).stands == ("net01", "net02")), "it is said on"


def test_where_no_robot_is_nobody_was_stopped(team: Team) -> None:
    console, _ = team.join("console1", console=True), team.join("console2", console=True)
    console.stop_all().join(20.0)
    assert standing(console) == Standing() and not standing(console).complete
    assert str(standing(console)) == "no robot of the fleet is heard"
    says = "fleet says stop"
    assert team.until(lambda: says not in [each.name for each in threading.enumerate()]), "it is not said for ever"


def test_a_peer_that_hangs_does_not_hold_up_a_stop_of_the_others(team: Team) -> None:
    team.join("net01")
    with socket.socket() as hung:
        for port in PORTS:
            with suppress(OSError):
                hung.bind(("127.0.0.1", port))
                break
        hung.listen()  # and never answers
        console = team.join("console1", console=True)
        began = console.now
        console.stop_all()
        assert team.until(lambda: standing(console) == Standing(("net01",)))
        assert began - team.began < 9.0, "Zenoh would wait for 10 s"


def test_peers_meet_though_one_was_held_up_while_the_other_joined() -> None:
    fleet = f"test{uuid4().hex}"
    program = (
        "import sys, time; from txt1.fleet.network import Peer; peer = Peer('net01', fleet=sys.argv[1])\n"
        "print(flush=True)\n"
        f"while True: peer.tell({STATE}); time.sleep(0.1)"
    )
    held_up = subprocess.Popen([sys.executable, "-c", program, fleet], stdout=subprocess.PIPE)
    assert held_up.stdout is not None
    held_up.stdout.readline()
    held_up.send_signal(signal.SIGSTOP)
    late = Peer("net02", fleet=fleet)
    try:
        held_up.send_signal(signal.SIGCONT)
        wait_until(lambda: "net01" in late.heard())
    finally:
        late.close()
        held_up.kill()
        held_up.communicate()


def test_a_stop_that_a_session_does_not_carry_goes_through_a_new_one(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    team.join("net01")
    console = team.join("console1", console=True)
    old = console._session  # noqa: SLF001

    class OneWay:
        """A session that carries nothing to the others: the defect of two that meet in the same instant."""

        def put(self, *words: object, **named: object) -> None:
            pass

        def __getattr__(self, name: str) -> object:
            return getattr(old, name)

    monkeypatch.setattr(console, "_session", OneWay())
    console.stop_all()
    assert team.until(lambda: standing(console) == Standing(("net01",)))
    assert team.stopped == [("net01", "console1")]


def test_an_answer_that_does_not_say_closed_is_no_stop(team: Team) -> None:
    console, stranger, heard = team.join("console1", console=True), Stranger(team.fleet), []
    try:
        stranger.listen("stop/console1", heard.append)
        console.stop_all(["net01"])
        assert team.until(lambda: heard)
        stop = json.loads(heard[0][SIGNATURE:])["stop"]
        for answer in (
            {"stop": stop},
            {"stop": stop, "closed": 1},
            {"stop": "0" * 32, "closed": True},
            {"closed": True},
        ):
            stranger.put("stopped/console1", {"from": "net01", **answer})
        assert team.until(lambda: standing(console) == Standing(others=(("net01", ""),)))
        stranger.put("stopped/console1", {"from": "net01", "stop": stop, "closed": True, "why": "slowing down"})
        assert team.until(lambda: standing(console) == Standing(stopped=(("net01", "slowing down"),)))
        assert not standing(console).complete and standing(console).closed
        assert str(standing(console)) == "stopped, not seen to stand: net01 (slowing down)"
        stranger.put("stopped/console1", {"from": "net01", "stop": stop, "stands": True})
        assert team.until(lambda: standing(console) == Standing(others=(("net01", ""),))), "its gate is open"
        answer = {"from": "net01", "stop": stop, "closed": True, "stands": True}
        stranger.put("stopped/console1", answer, signed=False)
        assert team.until(lambda: console.refused().get("somebody") == "it is not signed with the fleet's key")
        assert not standing(console).closed
        stranger.put("stopped/console1", answer)
        assert team.until(lambda: standing(console) == Standing(("net01",)))
    finally:
        stranger.close()


def test_a_velocity_is_for_one(team: Team) -> None:
    one, _, _ = team.join("net01"), team.join("net02"), team.join("net03")

    def driven() -> bool:
        one.drive("net03", 0.3, -0.1)
        return bool(team.driven)

    assert team.until(driven) and set(team.driven) == {("net03", 0.3, -0.1)}


class Shifted(RealClock):
    """The clock of another computer, which was started at another time."""

    def __init__(self, by: float) -> None:
        self._by = int(by * NS_PER_S)

    def now_ns(self) -> int:
        return super().now_ns() + self._by


def test_no_velocity_goes_to_a_robot_before_its_clock_is_known(team: Team) -> None:
    """It could not tell a fresh command from an old one."""
    console, stranger, sent = team.join("console1", console=True), Stranger(team.fleet), []
    try:
        stranger.listen("drive/net07", sent.append)

        def heard() -> bool:
            stranger.put("state/net07", {"from": "net07", **STATE})
            return "net07" in console.heard()

        assert team.until(heard)
        for _ in range(100):
            console.drive("net07", 0.1, 0.0)

        def driven() -> bool:
            now = int(console.now * NS_PER_S)
            stranger.put("pong/console1", {"from": "net07", "began": now, "sent": now})
            console.drive("net07", 0.2, 0.0)
            return bool(sent)

        assert team.until(driven)
        assert json.loads(sent[0][SIGNATURE:])["v"] == 0.2
    finally:
        stranger.close()


def test_a_velocity_is_as_old_as_its_key_by_the_robot_s_clock(team: Team) -> None:
    console, robot, stranger = team.join("console1", console=True), team.join("net01", ahead=1e3), Stranger(team.fleet)
    try:
        sent: list[bytes] = []
        stranger.listen("drive/net01", sent.append)

        def driven() -> bool:
            robot.tell(STATE)
            console.drive("net01", 0.3, 0.1, age=2.0)
            return bool(team.given)

        assert team.until(lambda: driven() and sent), "the stranger hears the same"
        assert all(2.0 <= robot.now - time < 500.0 for time in team.given), "never taken for younger than it is"
        later = int((robot.now + 60.0) * NS_PER_S)
        stranger.put("drive/net01", {"from": "console1", "v": 1.0, "omega": 0.0, "given": later})
        assert team.until(lambda: "future" in robot.refused().get("console1", ""))

        def as_old_as_before() -> bool:
            stranger.replay("drive/net01", sent[0])
            return len(set(team.given)) < len(team.given)

        assert team.until(as_old_as_before), "one that is said again is as old as it was"
    finally:
        stranger.close()


@given(st.floats(-1e6, 1e6), st.floats(0.0, 5.0), st.floats(0.0, 5.0))
def test_a_time_by_another_s_clock_is_never_taken_for_later_than_it_is(
    offset: float, there: float, back: float
) -> None:
    """Whatever the ways there and back of the ping took by which the offset was measured."""
    measured = (there + offset) - 0.5 * (there + back)
    assert 100.0 + offset - there - back - 1e-6 <= theirs(100.0, there + back, measured) <= 100.0 + offset + 1e-6


def test_a_stop_is_not_said_for_long_to_a_robot_that_nobody_can_see_stand(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "STAND_PATIENCE", 0.2)
    monkeypatch.setattr(network, "STOP_FOR", 1e6)
    console, stranger, heard = team.join("console1", console=True), Stranger(team.fleet), []
    try:
        stranger.listen("stop/console1", heard.append)
        saying = console.stop_all(["net01"])
        assert team.until(lambda: heard)
        blind = {"from": "net01", "stop": json.loads(heard[0][SIGNATURE:])["stop"], "closed": True, "why": "not seen"}
        stranger.put("stopped/console1", blind)
        saying.join(LIMIT)
        assert not saying.is_alive() and standing(console) == Standing(stopped=(("net01", "not seen"),))
    finally:
        stranger.close()


def test_a_stop_that_is_not_answered_is_said_through_one_session_after_another(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "UNANSWERED", 0.0)
    monkeypatch.setattr(network, "ANEW", 0.5)  # as long as a session takes to open: few at a time, as ports are few
    monkeypatch.setattr(network, "STOP_FOR", LIMIT)
    console, _, put = team.join("console1", console=True), team.join("net01"), Peer.__dict__["_put"]
    sessions: list[object] = []

    def lost(peer: Peer, key: str, message: dict[str, Any], session: object = None) -> None:
        """Lose each stop that goes through one of the first three sessions."""
        if key == "stop/console1":
            sessions.extend([] if session in sessions else [session])
            if sessions.index(session) < 3:
                return
        put(peer, key, message, session)

    monkeypatch.setattr(Peer, "_put", lost)
    console.stop_all(["net01"])
    assert team.until(lambda: standing(console) == Standing(("net01",)))
    assert sessions[0] is None and len(sessions) >= 4


def test_a_peer_obeys_stops_and_goes_on_while_its_own_message_cannot_be_sent(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    console, robot, put = team.join("console1", console=True), team.join("net01"), Peer.__dict__["_put"]
    free = threading.Event()

    def held_up(peer: Peer, key: str, message: dict[str, Any], session: object = None) -> None:
        if peer is robot and key.startswith(("state", "stopped")):
            assert free.wait(3.0 * LIMIT), "held up for longer than the test waits"
        put(peer, key, message, session)

    monkeypatch.setattr(Peer, "_put", held_up)
    try:
        robot.tell(STATE)
        robot.tell(STATE)
        for number in (1, 2):
            console.stop_all(["net01"])
            assert team.until(lambda: len(team.stopped) == number)  # noqa: B023 - it waits here
            assert standing(console) == Standing(silent=("net01",))
    finally:
        free.set()
    assert team.until(lambda: standing(console) == Standing(("net01",)))
    assert team.until(lambda: "net01" in console.heard())


def test_a_stop_that_one_session_does_not_take_is_said_through_another(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "UNANSWERED", 1.0)
    console, robot, put = team.join("console1", console=True), team.join("net01"), Peer.__dict__["_put"]
    assert team.until(lambda: robot.tell(STATE) or "net01" in console.heard())
    free = threading.Event()

    def held_up(peer: Peer, key: str, message: dict[str, Any], session: object = None) -> None:
        if key == "stop/console1" and session is None:
            assert free.wait(3.0 * LIMIT), "held up for longer than the test waits"
        put(peer, key, message, session)

    monkeypatch.setattr(Peer, "_put", held_up)
    try:
        console.stop_all()
        assert standing(console) == Standing(silent=("net01",))
        assert team.until(lambda: standing(console) == Standing(("net01",)))
    finally:
        free.set()


def test_a_clock_is_measured_anew_when_a_robot_is_started_again(team: Team) -> None:
    console, first = team.join("console1", console=True), team.join("net01", ahead=1e3)

    def driven() -> bool:
        console.drive("net01", 0.3, 0.1)
        return bool(team.given)

    assert team.until(driven)
    first.close()
    before = len(team.given)
    second = team.join("net01")

    def driven_again() -> bool:
        console.drive("net01", 0.3, 0.1)
        return len(team.given) > before

    assert team.until(driven_again)
    assert abs(second.now - team.given[before]) < 500.0


def test_fleets_of_other_names_or_other_users_do_not_hear_one_another(team: Team, tmp_path: Path) -> None:
    team.join("net01")
    mine = team.join("console1", console=True)
    key = tmp_path / "key"
    key.touch(mode=0o600)
    key.write_text("the password of another user")
    others = [
        Peer("net01", fleet=f"{team.fleet}x"),
        Peer("net01", fleet=team.fleet, key=key),
        Peer("console1", fleet=team.fleet, key=key, console=True),
    ]
    try:
        mine.stop_all().join(LIMIT)
        assert standing(mine) == Standing(("net01",)) and len(team.stopped) == 1
        third = others[2]
        third.stop_all()
        assert team.until(lambda: standing(third) == Standing(silent=("net01",))), "their own does not answer"
        mine.listen(0.5)
        assert len(team.stopped) == 1, "that is not our fleet's stop"
    finally:
        for each in others:
            each.close()


def test_a_double_that_the_look_has_missed_gives_way_whatever_the_clocks_say(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "NAME_CHECK_TIME", 0.0)  # as on a busy computer
    first = team.join("net01")
    first.began -= 5.0
    first.id = f"9{first.id}"  # its computer's clock is ahead
    second = team.join("net01")

    def refused() -> bool:
        first.tell(STATE)
        second.tell(STATE)
        return bool(team.doubles) and "net01" in first.refused()

    assert team.until(refused)
    assert set(team.doubles) == {"name: there is a robot 'net01' in the fleet; choose another with --name"}
    assert first.refused()["net01"] == "another robot has this robot's name; choose another with --name"
    assert "net01" not in second.refused(), "the second one alone gives way"


def test_nobody_s_word_turns_a_robot_out_that_has_been_there_for_long(team: Team) -> None:
    one, stranger = team.join("net01"), Stranger(team.fleet)
    one.began -= NEW
    try:

        def refused() -> bool:
            stranger.put("state/net01", {"from": "net01", "id": "0", "up": 1e5, **STATE})
            return "net01" in one.refused()

        assert team.until(refused) and not team.doubles
    finally:
        stranger.close()


@pytest.mark.parametrize("late", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("apart", [-3.0, -1.6, -1.4, -0.9, -0.5, 0.0, 0.5, 0.9, 1.4, 1.6, 3.0])
def test_of_two_that_have_one_name_one_leaves_at_least_and_the_first_stays(apart: float, late: float) -> None:
    first, second = 10.0, 10.0 + apart
    for one, two in (("1", "2"), ("2", "1")):
        leaves = gives_way(first, second - late, one, two), gives_way(second, first - late, two, one)
        assert any(leaves)
        if abs(apart) > 2.0:
            assert leaves == (apart > 0.0, apart < 0.0)
    assert not gives_way(10.0, 9.7, "1", "2") and gives_way(10.0, 10.6, "1", "2")
    assert not gives_way(NEW, 1e5, "2", "1"), "nobody's word turns out who has been there for long"


def listening() -> list[str]:
    """The addresses of TCP at which this process listens, in hexadecimal digits, as Linux tells them."""
    own = {os.readlink(file) for file in map(str, Path("/proc/self/fd").iterdir()) if os.path.islink(file)}
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path("/proc/net", name).read_text().splitlines()[1:]]
    return [row[1].partition(":")[0] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own]


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")
def test_on_loopback_it_listens_on_that_address_alone(team: Team) -> None:
    team.join("net01")
    assert set(listening()) == {"0100007F"}


def test_on_an_interface_it_listens_there_alone_and_asks_for_a_password(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zenoh = pytest.importorskip("zenoh")
    path, seen = tmp_path / "key", []
    path.touch(mode=0o600)
    path.write_text("a password for the test\n")
    monkeypatch.chdir(tmp_path)
    real = zenoh.open

    def opened(config: Any) -> Any:
        passwords = json.loads(config.get_json("transport/auth/usrpwd"))
        dictionary = Path(passwords["dictionary_file"])
        about = dictionary.lstat()
        seen.append((stat.S_ISREG(about.st_mode), stat.S_IMODE(about.st_mode), dictionary))
        assert json.loads(config.get_json("listen/endpoints")) == ["tcp/0.0.0.0:0#iface=lo"]
        assert json.loads(config.get_json("scouting/multicast/interface")) == "lo"
        assert dictionary.read_text().startswith(f"{fleet}:") and "a password" not in dictionary.read_text()
        return real(config)

    fleet = f"test{uuid4().hex}"
    old = os.umask(0)
    monkeypatch.setattr(zenoh, "open", opened)
    try:
        one = Peer("net01", "lo", path, fleet=fleet)
    finally:
        os.umask(old)
    try:
        ((regular, mode, dictionary),) = seen
        assert regular and mode == 0o600 and not dictionary.exists()
        assert [each.name for each in tmp_path.iterdir()] == ["key"], "nothing is left beside the key"
    finally:
        one.close()


def test_what_was_learned_is_heard_though_messages_are_lost_unless_it_is_too_long(team: Team) -> None:
    one, two = team.join("net01"), team.join("net02", loss=0.3)

    def heard() -> bool:
        one.teach({"learner": "thesis"})
        return "net01" in two.taught()

    assert team.until(heard)
    for _ in range(5):
        one.teach({"learner": "x" * MESSAGE_SIZE})
    before = two.now

    def heard_again() -> bool:
        one.tell(STATE)
        return any(said.time > before for said in two.heard().values())

    assert team.until(heard_again)
    told, _ = two.taught()["net01"]
    assert told["learner"] == "thesis"
    one.close()
    assert team.until(lambda: not two.taught())


class Stranger:
    """Somebody who puts anything on any of a fleet's Zenoh keys; with its key, or without."""

    def __init__(self, fleet: str) -> None:
        config = configuration()
        config.insert_json5("listen/endpoints", json.dumps(["tcp/127.0.0.1:0"]))
        self._session, self._key = pytest.importorskip("zenoh").open(config), fleet_key("", None, fleet)
        with self._session.declare_publisher(f"{self._key.space}/stop/stranger") as publisher:
            wait_until(lambda: publisher.matching_status.matching)  # until then nobody hears it

    def put(self, key: str, message: object, signed: bool = True) -> None:
        payload = message if isinstance(message, bytes) else json.dumps(message).encode()
        self._session.put(f"{self._key.space}/{key}", self._key.signed(key, payload) if signed else payload)

    def replay(self, key: str, payload: bytes) -> None:
        self._session.put(f"{self._key.space}/{key}", payload)

    def listen(self, key: str, hear: Callable[[bytes], object]) -> None:
        self._session.declare_subscriber(f"{self._key.space}/{key}", lambda sample: hear(bytes(sample.payload)))

    def close(self) -> None:
        self._session.close()


NONSENSE = (
    b"", b"{", b"null", b"[]", b"\xff", b"[" * 5000, {}, {"from": 7}, {"from": "net07"}, {"from": "a/**"},
    {"from": "net07", "sent": "x", "began": [], "x": "boom", "number": [], "v": {}},
    {"from": "net07", "sent": 10**400, "began": 10**400, "x": 10**400, "v": 10**400, "omega": 10**400},
    {"from": "net07", "sent": -1, "began": float("inf"), "v": float("nan"), "omega": 0, "stop": [1], "closed": "x"},
    {"from": "net07", **STATE, "data": "boom"}, {"from": "net07", **STATE, "battery": "full"},
    {"from": "net07", **STATE, "driver": {}}, {"from": "net07", **STATE, "data": [[1]]},
)  # fmt: skip


def test_nothing_that_a_stranger_says_harms_a_peer(team: Team, capfd: pytest.CaptureFixture[str]) -> None:
    one, two, stranger = team.join("net01"), team.join("net02"), Stranger(team.fleet)
    try:

        def refused() -> bool:
            for message in NONSENSE:
                for key in ("state", "learned", "drive", "ping", "pong", "stopped", "stop"):
                    for name in ("net01", "net07"):
                        stranger.put(f"{key}/{name}", message)
                        stranger.put(f"{key}/{name}", message, signed=False)
            # busy peers lose messages
            return team.until(lambda: {"net07", "somebody"} <= one.refused().keys(), S)

        def heard() -> bool:
            two.tell(STATE)
            for number in range(2 * OTHERS_MAX):
                stranger.put("state/x", {"from": f"name{number}", **STATE})
            return team.until(lambda: "net02" in one.heard() and len(one.members()) >= OTHERS_MAX - 2, S)

        assert team.until(refused) and team.until(heard)
        assert one.refused()["net07"] and one.refused()["somebody"] == "it is not signed with the fleet's key"
        assert len(one.heard()) <= OTHERS_MAX and "net07" not in one.heard()
        assert not team.driven, "none of them says when it was given"
        assert capfd.readouterr() == ("", ""), "no traceback of a thread"
    finally:
        stranger.close()


def test_a_name_that_no_other_would_hear_is_refused() -> None:
    with pytest.raises(ConfigError, match="name: 'TXT/01': in a fleet a name has small letters"):
        Peer("TXT/01")


@pytest.mark.long
def test_a_fleet_s_page_shows_all_stops_all_despite_losses_and_drives_one(team: Team) -> None:
    console, one, two = team.join("console1", 0.3, console=True), team.join("net01", 0.3), team.join("net02", 0.3)
    page = Network(console)

    def shown() -> bool:
        one.tell(STATE)
        two.tell(STATE | {"x": 3.0})
        return len(json.loads(page.newest())) == 2

    try:
        assert team.until(shown)
        first, second = json.loads(page.newest())
        assert (first["name"], second["name"]) == ("net01", "net02") == tuple(page.names())
        assert first["topics"]["/vehicles"] == [[3.0, 2.0, 0.5]] and first["topics"]["/mode"]["armed"]
        assert [each["name"] for each in first["topics"]["/fleet"]] == ["net01", "net02"]
        assert team.until(lambda: page.request("drive", robot="net02", v=0.3, omega=0.1, age=0.0) or team.driven)
        assert set(team.driven) == {("net02", 0.3, 0.1)}

        def whose() -> list[str]:
            two.tell(STATE | {"driver": "fleet"})
            page.request("drive", robot="net02", v=0.3, omega=0.1, age=0.0)
            return [each["topics"]["/driver"]["name"] for each in json.loads(page.newest())]

        assert team.until(lambda: whose() == ["", "web"]), "the page that drives says so, and no other 'fleet'"
        page.request("stop")
        assert team.until(lambda: len(team.stopped) == 2)
        assert sorted(team.stopped) == [("net01", "console1"), ("net02", "console1")]
        with pytest.raises(CommandRefused, match="'arm' is done at the robot"):
            page.request("arm", robot="net01")
    finally:
        page.close()
