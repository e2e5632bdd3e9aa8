"""Nothing that a node of ROS, a pad or a viewer asks for ends what serves it, or moves what it may not."""

from __future__ import annotations

import asyncio
import gc
import json
from collections.abc import Callable
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs.ros_ends import ROS_ENDS
from tests.any_json import JSON
from tests.e2e.test_bridges import FIELDS as FIELDS_OF_BRIDGES
from tests.examples import examples
from txt1.bridges.registry import RobotEnd
from txt1.bridges.services import Services
from txt1.errors import CommandRefused
from txt1.fleet.link import FleetLink
from txt1.kernel.loop import run
from txt1.record.live_view import velocity
from txt1.robot import Robot
from txt1.sidecar import Request

ENDS: Final[dict[str, Callable[[Robot], RobotEnd]]] = {
    **ROS_ENDS,
    "gamepad": lambda robot: RobotEnd(robot, "gamepad", {}),
}
CALLED: Final = (
    "disarm", "stop", "load_gains", "drive_to", "goal_pose", "initial_pose", "manual", "place", "set", "power",
    "pid_load", "pwm_change", "switched_pwr", "shutdown_computer",
)  # fmt: skip
"""What a node calls for with an answer, but for "arm"."""
ASKED: Final = (
    "begin", "missing", "parent", "cancel", "drive", "steer", "combined", "servos", "release", "request", "stop",
    "disarm", "press", "tell", "subscribe", "nothing",
)  # fmt: skip
NAMES: Final = (
    "v", "omega", "age", "x", "y", "theta", "speed", "angle", "frame", "switch", "on", "values", "linear", "angular",
    "id", "button", "text", "topics", "esc", "front", "rear", "pwm4", "pwm5", "source", "manual", "reason",
)  # fmt: skip
FIELDS = st.dictionaries(st.sampled_from(NAMES), JSON | st.floats(-2.0, 2.0) | st.sampled_from(["esc", "odom", 1, 2]))
CALLS = st.builds(
    lambda number, name, fields: ("call", {"id": number, "name": name, "fields": fields}),
    st.integers(0, 9) | JSON,
    st.sampled_from(CALLED) | JSON,
    FIELDS | JSON,
)
REQUESTS = CALLS | st.tuples(st.sampled_from(ASKED), FIELDS)


@pytest.mark.parametrize("end", ENDS)
@settings(max_examples=examples(24), deadline=None)
@given(asked=st.lists(REQUESTS, max_size=15), armed=st.booleans())
def test_nothing_that_a_bridge_asks_for_ends_it_and_a_stop_is_obeyed_after_it(
    end: str, asked: list[tuple[str, dict[str, Any]]], armed: bool
) -> None:
    async def main() -> None:
        unexpected: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: unexpected.append(context))
        async with Robot.open(hal="sim", seed=1, settings=["safety.auto_arm=never"]) as robot:
            await robot.load_gains()
            desk = ENDS[end](robot)
            if armed:
                robot.arm()
            for name, fields in asked:
                desk.request(Request(name, fields, 0.0))
                await asyncio.sleep(0.05)
                desk.telemetry()
                control = robot.runtime.state.control
                assert armed or not robot.armed, "nobody asked it to arm"
                assert robot.armed or control.outputs.motor == 0
                assert isfinite(control.v) and abs(control.v) <= robot.config.safety.v_max
            desk.request(Request("stop", {"why": [1]}, 0.0))
            assert not robot.armed and robot.runtime.gate.stopped
            desk.let_go()
            gc.collect()
        assert not unexpected

    run(main(), speed="max")


@pytest.mark.parametrize("end", ENDS)
def test_no_request_is_left_out_above(end: str) -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            there = vars(ENDS[end](robot))
            assert set(there["_requests"]) <= {*ASKED, "arm", "call"}
            calls = there.get("_calls")
            assert calls is None or set(vars(calls)["_functions"]) <= {*CALLED, "arm"}

    run(main(), speed="max")


def test_no_request_of_a_page_a_fleet_or_a_learner_is_left_out_of_the_bridges_test() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            services = Services(robot, robot.config, "max", Path("/nowhere"))
            asked = {**vars(RobotEnd(robot, "any", {}))["_requests"], **FleetLink(robot).requests, **services.requests}
            assert set(asked) == set(FIELDS_OF_BRIDGES)
            await services.close()

    run(main(), speed="max")


@settings(max_examples=examples(60), deadline=None)
@given(asked=st.lists(st.tuples(st.floats(), st.floats(), st.floats(-5.0, 5.0)), max_size=10))
def test_whatever_a_viewer_drives_is_inside_the_limits_or_refused(asked: list[tuple[float, float, float]]) -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            robot.arm()
            view, hand = robot.source("view"), robot.config.hand()
            for v, omega, age in asked:
                with suppress(CommandRefused):
                    view.command(*hand.on_the_spot(v, omega), robot.now - age)
                await asyncio.sleep(0.05)
                control, limits = robot.runtime.state.control, robot.config.limits()
                assert abs(control.v) <= limits.v_max and abs(control.omega) <= limits.omega_max
            robot.stop()
            assert robot.hal.outputs[:3] == (0, 0, 0)  # type: ignore[attr-defined]

    run(main(), speed="max")


@settings(max_examples=examples(300), deadline=None)
@given(st.binary(max_size=60) | JSON.map(lambda value: json.dumps(value).encode()))
def test_whatever_a_viewer_publishes_is_a_velocity_or_nothing(data: bytes) -> None:
    found = velocity(data)
    assert found is None or all(isinstance(number, float) for number in found)
