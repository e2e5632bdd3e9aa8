"""Peers of a fleet over Zenoh on loopback: names, clocks, stops with messages lost, and who is gone."""

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

import pytest

from txt1.bridges.web.network import Network
from txt1.errors import CommandRefused, ConfigError
from txt1.fleet.network import SIZE, Hooks, Peer, configuration

pytest.importorskip("zenoh", reason="Zenoh is not installed: the extra 'fleet'")

STATE = {"x": 1.0, "y": 2.0, "theta": 0.5, "v": 0.3, "omega": 0.1, "armed": True, "reason": "", "data": [1.0]}


class Team:
    """Peers, and who was stopped and driven."""

    def __init__(self) -> None:
        self.peers: list[Peer] = []
        self.stopped: list[tuple[str, str]] = []
        self.driven: list[tuple[str, float, float]] = []
        self.all_stopped = threading.Event()
        self.waits_for = 0
        self._never = threading.Event()
        self.space = f"test{uuid4().hex}"  # other tests run at the same time

    def join(self, name: str, loss: float = 0.0) -> Peer:
        def stop(who: str) -> None:
            self.stopped.append((name, who))
            if len(self.stopped) >= self.waits_for:
                self.all_stopped.set()

        hooks = Hooks(stop, lambda who, v, omega: self.driven.append((name, v, omega)))
        peer = Peer(name, hooks=hooks, loss=loss, space=self.space)
        self.peers.append(peer)
        return peer

    def until(self, true: Callable[[], object]) -> bool:
        """Whether something comes true within ten seconds."""
        return any(true() or self._never.wait(0.05) for _ in range(200))


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
    assert team.all_stopped.wait(5.0)
    said.join(10.0)
    assert peers[0].answered() == {"net01", "net02", "net03"}
    assert sorted(team.stopped) == [(name, "net00") for name in ("net01", "net02", "net03")]


def test_a_velocity_is_for_one(team: Team) -> None:
    one, _, _ = team.join("net01"), team.join("net02"), team.join("net03")

    def driven() -> bool:
        one.drive("net03", 0.3, -0.1)
        return bool(team.driven)

    assert team.until(driven) and set(team.driven) == {("net03", 0.3, -0.1)}


def test_what_was_learned_is_heard_though_messages_are_lost_unless_it_is_too_long(team: Team) -> None:
    one, two = team.join("net01"), team.join("net02", loss=0.3)

    def heard() -> bool:
        one.teach({"learner": "thesis"})
        return "net01" in two.taught()

    assert team.until(heard)
    for _ in range(5):
        one.teach({"learner": "x" * SIZE})
    before = two.now

    def heard_again() -> bool:
        one.tell(STATE)
        return any(said.time > before for said in two.heard().values())

    assert team.until(heard_again)
    told, _ = two.taught()["net01"]
    assert told["learner"] == "thesis"
    one.close()
    assert team.until(lambda: not two.taught())


def test_beyond_loopback_a_key_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--fleet eth0: beyond loopback all share a key; add --fleet-key FILE"):
        configuration("eth0")
    key = tmp_path / "key"
    with pytest.raises(ConfigError, match="cannot read it"):
        configuration("eth0", key)
    key.write_text("short")
    with pytest.raises(ConfigError, match="16 characters"):
        configuration("eth0", key)
    key.write_text("long enough for a password\n")
    assert configuration("eth0", key) is not None


@pytest.mark.long
def test_a_page_of_the_fleet_shows_all_stops_all_though_messages_are_lost_and_drives_one(team: Team) -> None:
    console, one, two = team.join("console1", 0.3), team.join("net01", 0.3), team.join("net02", 0.3)
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
