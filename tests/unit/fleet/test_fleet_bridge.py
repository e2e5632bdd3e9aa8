"""One bridge beside several robots: each request finds its robot, one that names none finds all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from random import Random
from typing import TYPE_CHECKING, Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1 import robot as txt1_robot
from txt1.bridges.registry import Desks, RobotEnd
from txt1.fleet import bridge as fleet_bridge
from txt1.fleet.bridge import ReportedGate
from txt1.fleet.fleet import Fleet
from txt1.fleet.key import FleetKey
from txt1.fleet.link import STOPS as STOPS_TOPIC
from txt1.fleet.link import FleetLink
from txt1.fleet.messages import StopAnswer, stop_of
from txt1.fleet.network import Hooks
from txt1.kernel.loop import run
from txt1.sidecar import Request
from txt1.telemetry.snapshot import Snapshot

if TYPE_CHECKING:
    from txt1.sidecar import Connection


def test_a_request_is_one_robot_s_and_one_without_a_name_is_everybody_s() -> None:
    async def main() -> None:
        async with Fleet.open(3, seed=1) as fleet:
            desks = Desks({name: RobotEnd(robot, "web", {}) for name, robot in fleet.robots.items()})
            desks.request(Request("subscribe", {"topics": ["/odom"], "rate": 10.0}, 0.0))
            for _ in range(20):
                desks.request(Request("drive", {"robot": "txt02", "v": 0.5, "omega": 0.0}, 0.0))
                await asyncio.sleep(0.05)
            speeds = {name: robot.odometry.v for name, robot in fleet.robots.items()}
            assert speeds.pop("txt02") > 0.3 and set(speeds.values()) == {0.0}
            line = desks.telemetry()
            assert line is not None and line.endswith(b"]\n") and line.count(b"\n") == 1
            assert [(each["name"], "/odom" in each["topics"]) for each in json.loads(line)] == [
                ("txt01", True),
                ("txt02", True),
                ("txt03", True),
            ]
            desks.request(Request("drive", {"robot": "txt99", "v": 0.5, "omega": 0.0}, 0.0))
            assert fleet.robots["txt01"].odometry.v == 0.0
            desks.request(Request("stop", {}, 0.0))
            assert all(robot.runtime.gate.stopped for robot in fleet.robots.values())

    run(main(), speed="max")


def test_a_stop_is_answered_by_what_the_robot_reports_of_its_gate_and_nothing_else() -> None:
    now = 0
    gate = ReportedGate(lambda: now)
    assert gate.answer("a") == StopAnswer(False, why="its program is silent")
    gate.reported({"/member": {"armed": True}})
    assert gate.answer("a") == StopAnswer(False, why="it has not obeyed yet")
    gate.reported({"/member": {"armed": False}})
    assert gate.answer("a") == StopAnswer(False, why="it has not obeyed yet"), "it was disarmed for another reason"
    gate.reported({"/member": {"armed": False, "stop": "slowing down"}, "/fleet_stops": ["a"]})
    assert gate.answer("a") == StopAnswer(True, why="slowing down")
    gate.reported({"/member": {"armed": False, "stop": "standing"}, "/fleet_stops": ["a"]})
    assert gate.answer("a") == StopAnswer(True, stands=True)
    gate.reported({"/member": {"armed": False, "stop": "does not stop: ESC off"}, "/fleet_stops": ["a"]})
    assert gate.answer("a") == StopAnswer(True, why="does not stop: ESC off"), "it stood, and moves again"
    gate.reported({"/member": {"armed": True, "stop": "standing"}, "/fleet_stops": ["a", "b"]})
    assert gate.answer("a") == StopAnswer(False, why="it was armed again")
    gate.reported({"/fleet_stops": ["a"]})
    assert not gate.answer("a").closed, "a robot that says nothing of its gate"
    gate.reported({"/member": {"armed": False, "stop": "standing"}, "/fleet_stops": ["a"]})
    now += 600_000_000
    assert gate.answer("a") == StopAnswer(False, why="its program is silent")


class Robot:
    """The robot's end of a bridge's line: what the bridge asked for, and telemetry as often as the bridge looks."""

    def __init__(self, topics: dict[str, object]) -> None:
        self.asked: list[tuple[str, dict[str, Any]]] = []
        self.topics = topics
        self.look: Callable[[], None] = lambda: None
        self.looks = 0

    def request(self, name: str, /, **fields: Any) -> None:
        self.asked.append((name, fields))

    def receive(self, timeout: float = 0.0) -> dict[str, Any]:
        del timeout
        self.looks += 1
        self.look()
        if self.looks > 5:
            raise EOFError
        return {"topics": self.topics}

    def of(self, name: str) -> list[dict[str, Any]]:
        return [fields for asked, fields in self.asked if asked == name]


class Others:
    """A peer without a network: what it is told of others is for the test to say."""

    now = 100.0

    def __init__(self, name: str, interface: str, key: object, hooks: Hooks, loss: float, fleet: str) -> None:
        del name, interface, key, loss, fleet
        type(self).hooks = hooks

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *_: {} if name in ("heard", "refused", "taught") else () if name == "members" else None


def bridged(monkeypatch: pytest.MonkeyPatch, say: Callable[[Hooks], None]) -> tuple[Robot, int]:
    """A bridge to a robot, and its exit code, while others say something at its third look."""
    robot = Robot({"/member": {"armed": False, "stop": "standing"}, "/fleet_stops": ["a"]})
    robot.look = lambda: say(Others.hooks) if robot.looks == 3 else None
    monkeypatch.setattr(fleet_bridge, "Peer", Others)
    try:
        fleet_bridge.main(cast("Connection", robot), "txt01")
    except EOFError:
        return robot, 0
    except SystemExit as ended:
        return robot, int(ended.code or 0)
    raise AssertionError("it ended")


def test_a_velocity_is_passed_on_with_its_age_since_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, _ = bridged(monkeypatch, lambda hooks: hooks.drive("console1", 0.3, 0.1, 97.5))
    assert robot.of("drive") == [{"v": 0.3, "omega": 0.1, "age": 2.5, "held": True}]


def test_a_flood_of_velocities_and_stops_leaves_the_stops_and_the_newest_velocities(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def flood(hooks: Hooks) -> None:
        assert hooks.stop("console1", "b") == StopAnswer(False, why="it has not obeyed yet")
        for number in range(1000):
            hooks.drive("net07", 1.0, 0.0, float(number))

    robot, _ = bridged(monkeypatch, flood)
    assert robot.of("stop") == [{"who": "console1", "stop": "b"}]
    assert [each["age"] for each in robot.of("drive")] == [100.0 - number for number in range(980, 1000)]


def test_a_flood_of_stops_without_identity_is_one_request_to_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    def flood(hooks: Hooks) -> None:
        for _ in range(1000):
            hooks.stop("console1", "")

    robot, _ = bridged(monkeypatch, flood)
    assert robot.of("stop") == [{"who": "console1", "stop": ""}]


def test_an_echo_of_a_stop_that_was_obeyed_is_not_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    answers: list[object] = []
    robot, _ = bridged(monkeypatch, lambda hooks: answers.append(hooks.stop("console1", "a")))
    assert not robot.of("stop") and answers == [StopAnswer(True, stands=True)]


def test_a_double_ends_the_bridge_as_failed_and_the_robot_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, code = bridged(monkeypatch, lambda hooks: hooks.double("name: there is a robot 'txt01'"))
    assert robot.of("refused") == [{"reason": "name: there is a robot 'txt01'"}] and code == 1


IDENTITIES = st.integers(0, 30).map(lambda number: f"{number:032x}") | st.just("")
STOPS = st.lists(
    st.tuples(
        IDENTITIES,
        st.sampled_from(["obey", "arm", "late", "lost"]),
        st.none() | st.integers() | st.text(max_size=5) | st.lists(st.integers(), max_size=2),
    ),
    max_size=60,
)


@settings(max_examples=examples(60), deadline=None)
@given(STOPS, st.randoms(use_true_random=False))
def test_whatever_was_said_before_a_new_stop_closes_the_gate_of_who_hears_it(
    said: list[tuple[str, str, object]], rng: Random
) -> None:
    """In any order, of any age, repeated, forged: and whoever answers that its gate is closed has a closed gate."""

    async def main() -> None:
        async with txt1_robot.Robot.open() as robot:
            link = FleetLink(robot)
            gate = ReportedGate(lambda: 0)
            end = RobotEnd(robot, "fleet", link.requests)
            key = FleetKey("a password of the test")

            def report() -> None:
                stops = Snapshot.take(robot.runtime.bus, robot.now, "", ["/fleet_stops"]).get(STOPS_TOPIC)
                gate.reported({"/member": {"armed": robot.armed}, "/fleet_stops": stops})

            def hear(payload: bytes) -> StopAnswer:
                text = key.opened("stop/console1", payload)
                identity = "" if text is None else stop_of(text)
                if identity not in gate.obeyed:
                    end.request(Request("stop", {"who": "somebody", "stop": identity}, 0.0))
                    assert not robot.armed or (identity and identity in link_obeyed(robot))
                report()
                return gate.answer(identity)

            def payload(identity: str, more: object = None, signed: bool = True) -> bytes:
                text = json.dumps({"from": "console1", "stop": identity, "number": more, "sent": more}).encode()
                return key.signed("stop/console1", text) if signed else text

            waiting: list[bytes] = []
            for identity, how, more in said:
                message = payload(identity, more, signed=rng.random() < 0.7)
                if how == "arm":
                    robot.arm()
                    report()
                elif how == "late":
                    waiting.append(message)
                elif how == "obey":
                    hear(message)
                if waiting and rng.random() < 0.3:
                    hear(waiting.pop(rng.randrange(len(waiting))))
            robot.arm()
            report()
            answer = hear(payload("f" * 32))
            assert not robot.armed and answer.closed
            robot.arm()
            report()
            assert not hear(payload("f" * 32)).closed and robot.armed, "an echo; its answer is what is"
            hear(payload("e" * 32, signed=False))
            assert not robot.armed, "a forged one stops, too, and nothing else"

    run(main(), speed="max")


def link_obeyed(robot: txt1_robot.Robot) -> tuple[str, ...]:
    return Snapshot.take(robot.runtime.bus, robot.now, "", ["/fleet_stops"]).get(STOPS_TOPIC) or ()
