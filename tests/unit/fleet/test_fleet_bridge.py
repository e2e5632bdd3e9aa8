"""One bridge beside several robots: each request finds its robot, one that names none finds all."""

from __future__ import annotations

import asyncio
import json

from txt1.bridges.registry import Desks, RobotEnd
from txt1.fleet.bridge import ReportedGate
from txt1.fleet.fleet import Fleet
from txt1.fleet.messages import StopAnswer
from txt1.kernel.loop import run
from txt1.sidecar import Request


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
                ("txt01", True), ("txt02", True), ("txt03", True),
            ]  # fmt: skip
            desks.request(Request("drive", {"robot": "txt99", "v": 0.5, "omega": 0.0}, 0.0))
            assert fleet.robots["txt01"].odometry.v == 0.0
            desks.request(Request("stop", {}, 0.0))
            assert all(robot.runtime.gate.stopped for robot in fleet.robots.values())

    run(main(), speed="max")


def test_a_stop_is_answered_by_what_the_robot_reports_of_its_gate_and_nothing_else() -> None:
    now = 0
    gate = ReportedGate(lambda: now)
    assert gate.answer("a") == StopAnswer(False, "its program is silent")
    gate.reported({"/member": {"armed": True}})
    assert gate.answer("a") == StopAnswer(False, "it has not obeyed yet")
    gate.reported({"/member": {"armed": False}})
    assert gate.answer("a") == StopAnswer(False, "it has not obeyed yet"), "it was disarmed for another reason"
    gate.reported({"/member": {"armed": False}, "/fleet_stops": ["a"]})
    assert gate.answer("a") == StopAnswer(True)
    gate.reported({"/member": {"armed": True}, "/fleet_stops": ["a", "b"]})
    assert gate.answer("a") == StopAnswer(False, "it was armed again")
    gate.reported({"/fleet_stops": ["a"]})
    assert not gate.answer("a").closed, "a robot that says nothing of its gate"
    gate.reported({"/member": {"armed": False}, "/fleet_stops": ["a"]})
    now += 600_000_000
    assert gate.answer("a") == StopAnswer(False, "its program is silent")
