"""A bridge beside a robot: what it may ask for, and that nothing it does harms the robot. Long form: benchmarks/."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
from io import StringIO
from math import inf
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from time import thread_time
from typing import Any

import pytest
from blockbuster import BlockBuster
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from tests.any_json import JSON
from tests.e2e.conftest import may_block, passing
from tests.examples import examples
from tests.patience import LIMIT, until
from txt1.bridges.registry import BRIDGES, RESTART, RobotEnd, bridge
from txt1.bridges.services import Services
from txt1.config import load
from txt1.errors import ConfigError
from txt1.fleet.link import FleetLink
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.sidecar import Request
from txt1.tasks.fields import WARNINGS, Panel
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import screens
from txt1.ui.summary_line import status_line
from txt1.ui.viewer import Viewer

TARGETS = Path(__file__).parents[1] / "unit" / "sidecar"
ROOT = TARGETS.parents[2]

STALE = 0.25
"""s after which a command of a silent source is stale: the gate's time-out."""

pytestmark = pytest.mark.usefixtures("patient")


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch, blocking_calls_fail: BlockBuster) -> None:
    """The bridges of the tests, by name."""
    may_block(blocking_calls_fail, "tests/e2e/test_bridges.py", "runs")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{TARGETS}")
    for name in ("ask", "drive", "drive_then_hang", "fail", "flood", "leak"):
        monkeypatch.setitem(BRIDGES.table, name, f"beside_targets:{name}")


def runs(process: int) -> bool:
    """Whether a process has neither ended nor been stopped."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "TXZ"
    except OSError:
        return False


def said(lines: list[dict[str, Any]]) -> list[str]:
    """The texts of all events."""
    return [event["value"]["text"] for line in lines for event in line.get("events", ())]


def standing(robot: Robot) -> bool:
    return robot.runtime.state.control.v == 0.0


def test_it_sees_the_topics_it_asked_for_and_drives_under_its_own_name() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            seen: list[dict[str, Any]] = []
            async with bridge(robot, "ask", {"topics": ["/odom", "/rosout"]}, {"seen": lambda line: seen.append(line)}):
                await until(lambda: len(seen) >= 3 and robot.driver.name == "ask" and not standing(robot))
                robot.tell("hello")
                await until(lambda: "hello" in said(seen))
            assert robot.driver.name != "ask", "the wheel is free when the bridge has gone"
            assert set(seen[-1]["topics"]) == {"/odom"}
            assert seen[0]["name"] == "sim" and seen[0]["version"] == 1

    run(main())


def test_a_sensor_that_it_named_has_its_newest_reading_among_the_topics() -> None:
    async def main() -> None:
        config = load(overrides=["sensors.imu.driver=sim_imu"]).config
        async with Robot.open(config=config) as robot:
            seen: list[dict[str, Any]] = []
            topics = ["/odom", "/sensors/imu"]
            async with bridge(robot, "ask", {"topics": topics}, {"seen": lambda line: seen.append(line)}):
                await until(lambda: any("/sensors/imu" in line["topics"] for line in seen))
            line = next(line for line in reversed(seen) if "/sensors/imu" in line["topics"])
            readings = [event["value"] for event in line.get("events", ()) if event["topic"] == "/sensors/imu"]
            assert set(line["topics"]) == set(topics)
            assert not readings or line["topics"]["/sensors/imu"] == readings[-1]

    run(main())


def test_the_name_must_be_that_of_an_installed_bridge() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            with pytest.raises(ConfigError, match="did you mean 'flood'"):
                async with bridge(robot, "floot"):
                    pass

    run(main())


def test_what_it_asks_wrongly_is_counted_and_told_once() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            asked = [
                ["drive", {"v": "fast", "omega": 0.0}],
                ["drive", {"v": 1.0}],
                ["drive", {"v": float("nan"), "omega": 0.0}],
                ["fly", {}],
                ["press", {"button": "eject"}],
                ["subscribe", {"rate": 0}],
                ["subscribe", {"topics": ["/odm"]}],
                ["subscribe", {"topics": ["/odom"], "seldom": ["/of_nothing_known"]}],
                ["fly", {}],
                ["tell", {"text": "done"}],
            ]
            told = lambda: [event.text for event in robot.runtime.state.events]  # noqa: E731
            async with bridge(robot, "ask", {"asked": asked}):
                await until(lambda: "bridge 'ask': done" in told())
            text = "\n".join(told())
            for part in (
                "v: 'fast' is no number",
                "missing a required argument",
                "must be a finite",
                "no request 'fly'",
                "'eject' is none",
                "rate: 0 Hz",
                "this robot has no '/odm'; did you mean '/odom'?",
                "this robot has no '/of_nothing_known'; there are /",
            ):
                assert part in text
            assert robot.armed

    run(main())


@pytest.mark.parametrize(
    "what", ["hangs", *(pytest.param(each, marks=pytest.mark.long) for each in ("is stopped", "is killed"))]
)
def test_the_commands_of_a_silent_bridge_go_stale_in_time(what: str) -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            passed = passing(robot.runtime)
            async with bridge(robot, "drive_then_hang" if what == "hangs" else "drive", silence=None) as beside:
                await until(lambda: passed)
                silent = inf
                if what != "hangs":
                    process = beside.pid
                    assert process is not None
                    os.kill(process, signal.SIGSTOP if what == "is stopped" else signal.SIGKILL)
                    await until(lambda: not runs(process))
                    silent = robot.now
                await until(lambda: robot.now > passed[-1].given + 2.0 * STALE and standing(robot))
                assert robot.armed
                assert max(each.time - each.given for each in passed) <= STALE + 1e-6
                assert max(each.given for each in passed) <= silent

    run(main())


def test_a_bridge_that_ended_is_told_on_every_screen_and_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # a process that a slow machine ends late is not killed, and ends with a code of its own
    monkeypatch.setattr("txt1.sidecar.END_PATIENCE", LIMIT)

    async def main() -> Snapshot:
        async with Robot.open(hal="sim", seed=1) as robot:
            assert WARNINGS.name not in str(robot.snapshot.encode())
            async with bridge(robot, "fail", restart=RESTART._replace(pause=0.01, longest=0.02)) as beside:
                await until(lambda: beside.counts["restarts"] > 4)
                await until(lambda: beside.trouble)
                snapshot = robot.snapshot
            assert "bridge 'fail'" not in str(robot.snapshot.get(WARNINGS)), "nobody asks for it any more"
            told = sum("bridge 'fail' ended with 3" in event.text for event in robot.runtime.state.events)
            assert told == 1 + (beside.counts["restarts"] >= 10), "the first time and the tenth"
            return snapshot

    snapshot = run(main())
    for at, name in enumerate(screens.installed()):
        seen = text_of(snapshot.replaced({MODE: Mode(panel=Panel(screen=at))}))
        assert "bridge 'fail' ended with 3 and is started again in" in seen, name
    assert "bridge 'fail' ended with 3 and is started again in" in status_line(snapshot)


def text_of(snapshot: Snapshot) -> str:
    console = Console(file=StringIO(), width=100, height=30)
    console.print(screens.render(snapshot, Viewer(), 100, 30))
    return str(console.file.getvalue())  # type: ignore[attr-defined]


NUMBERS = st.lists(st.floats() | JSON, min_size=2, max_size=4)
FIELDS = {
    "go": {"points": st.lists(NUMBERS, max_size=3) | JSON, "speed": st.floats() | JSON},
    "here": {"points": st.lists(NUMBERS, max_size=3) | JSON},
    "hold": {"age": st.floats() | JSON},
    "gains": {"linear": NUMBERS | JSON, "angular": st.lists(NUMBERS, max_size=3) | JSON},
    "drive": {"v": st.floats() | JSON, "omega": st.floats() | JSON, "age": st.floats() | JSON},
    "subscribe": {"topics": JSON, "rate": st.floats() | JSON, "seldom": JSON},
    "press": {"button": JSON}, "tell": {"text": JSON}, "disarm": {"reason": JSON}, "halt": {}, "arm": {},
    "request": {}, "release": {}, "record": {"on": st.just(False)}, "fleet": {"members": JSON, "heard": JSON},
    "learned": {"who": JSON, "learned": JSON, "age": JSON, "why": JSON}, "stop": {"who": JSON, "stop": st.text()},
    "refused": {"reason": JSON},
}  # fmt: skip
REQUESTS = st.sampled_from(sorted(FIELDS)).flatmap(
    lambda name: st.tuples(
        st.just(name), st.fixed_dictionaries({}, optional=FIELDS[name]) | st.dictionaries(st.text(max_size=5), JSON)
    )
)


@pytest.mark.long  # tests/unit/test_every_request.py has a bridge of each kind
@settings(max_examples=examples(15), deadline=None)
@given(st.lists(REQUESTS, max_size=20))
def test_nothing_that_a_bridge_asks_for_raises_and_what_is_right_is_done_after_it(
    asked: list[tuple[str, dict[str, object]]],
) -> None:
    async def main() -> None:
        unexpected: list[object] = []
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda loop, context: unexpected.append(context))
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            services = Services(robot, robot.config, "max", Path("/nowhere"))
            desk = RobotEnd(robot, "ask", {**FleetLink(robot).requests, **services.requests})
            for name, fields in asked:
                desk.request(Request(name, fields, 0.0))
                await asyncio.sleep(0.05)
                assert desk.telemetry() is not None or name
            robot.arm()
            desk.request(Request("halt", {}, 0.0))
            for _ in range(20):
                desk.request(Request("drive", {"v": 0.4, "omega": 0.0}, 0.0))
                await asyncio.sleep(0.05)
            assert robot.runtime.state.control.v == 0.4
            desk.request(Request("stop", {"why": [asked]}, 0.0))
            assert not robot.armed, "a stop is a stop, whatever else its message says"
            await services.close()
            gc.collect()
        assert not unexpected

    run(main(), speed="max")


def test_gains_of_401_digits_are_refused_in_one_line() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            services = Services(robot, robot.config, "max", Path("/nowhere"))
            desk = RobotEnd(robot, "web", services.requests)
            desk.request(Request("gains", {"linear": [10**400, 1, 1], "angular": [[1.5, 4, 5, 6]]}, 0.0))
            assert robot.runtime.state.events[-1].text == (
                "bridge 'web': speed: kp must be a finite number, not an integer of 1329 bits"
            )
            await services.close()

    run(main(), speed="max")


def test_a_mistake_of_ours_in_a_request_is_told_and_the_bridge_lives_on() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:

            def broken() -> None:
                raise ZeroDivisionError("of ours")

            asked = [["broken", {}], ["tell", {"text": "here"}]]
            told = lambda: [event.text for event in robot.runtime.state.events]  # noqa: E731
            async with bridge(robot, "ask", {"asked": asked}, {"broken": broken}) as beside:
                await until(lambda: "bridge 'ask': here" in told())
                assert beside.counts["restarts"] == 0
            assert "bridge 'ask': request 'broken' failed: ZeroDivisionError: of ours" in told()

    run(main())


def test_a_flood_of_messages_costs_little_time_and_the_keys_still_drive() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            async with bridge(robot, "flood") as beside:
                await until(lambda: not standing(robot))
                keys = robot.source("keys")

                def driven_by_keys() -> bool:
                    keys.command(0.3, 0.0)
                    return robot.driver.name == "keys" and robot.runtime.state.control.v == 0.3

                began, busy = robot.now, thread_time()
                while robot.now < began + 1.0 or beside.counts["dropped"] < 10_000:
                    await asyncio.sleep(0.05)
                    await until(driven_by_keys)
                assert thread_time() - busy < 0.5 * (robot.now - began)
                assert beside.counts["taken"] < 20 * 20 * (robot.now + 1.0)

    run(main())


@pytest.mark.long
def test_a_leak_is_the_leaking_process_s_own_affair() -> None:
    async def main() -> None:
        async with Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            leaked: list[int] = []
            before = getrusage(RUSAGE_SELF).ru_maxrss
            more = {"leaked": lambda bytes: leaked.append(bytes)}
            async with bridge(robot, "leak", {"total": 200 << 20, "rate": 400 << 20}, more):
                await until(lambda: leaked and leaked[-1] >= 200 << 20)
                await until(lambda: not standing(robot))
                assert getrusage(RUSAGE_SELF).ru_maxrss - before < 50 << 10  # KiB

    run(main())
