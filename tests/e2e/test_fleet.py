"""A fleet: several simulated robots in one world, from a plan, with one recording and one stop."""

import asyncio
import itertools
import json
import os
import signal
import subprocess
import threading
import time
from contextlib import AsyncExitStack
from io import StringIO
from itertools import pairwise
from math import dist
from pathlib import Path
from uuid import uuid4

import pytest
from blockbuster import BlockBuster
from rich.console import Console

from tests.e2e.conftest import may_block
from tests.patience import LIMIT, TXT1, until
from txt1.bridges.registry import bridge
from txt1.cli import execute
from txt1.cli.operated_robot import RunStart
from txt1.commands import FAULT, OK
from txt1.config import Config, load
from txt1.control.standstill import STILL_SPEED
from txt1.errors import ConfigError
from txt1.fleet.command import line, verdict
from txt1.fleet.fleet import Fleet
from txt1.fleet.key import fleet_key
from txt1.fleet.link import STOPS, STOPS_MAX, FleetLink
from txt1.fleet.members import FLEET, NEW, Member
from txt1.fleet.network import Peer, configuration
from txt1.fleet.plan import FleetPlan, MemberPlan, names, plan_of
from txt1.fleet.screen import screen as fleet_screen
from txt1.fleet.selection import Selection
from txt1.fleet.shared_knowledge import ALL_TOLD, FORGET, LEARNED, learned_of
from txt1.fleet.stopping import Standing
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.learning.agent import Learned
from txt1.record.reader import robots_in
from txt1.record.snapshots import Snapshots
from txt1.robot import Robot
from txt1.tasks.encoder import POSE
from txt1.tasks.fields import EVENTS, VEHICLES
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.screens import render
from txt1.ui.viewer import Viewer

PLAN = """
all: {sim: {room: {length: 10, width: 8}}}
robots:
  txt01: {start: [-2, 0, 0], drive: [0.4, 0.3]}
  txt02: {start: [2, 0, 0], set: {sim.vehicle.slip: 0.05}}
  txt03:
"""


@pytest.fixture(autouse=True)
def what_comes_before_and_after_the_run_may_block(blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "txt1/fleet/plan.py", "plan_of")
    may_block(blocking_calls_fail, "txt1/ui/screens.py", "installed")
    may_block(blocking_calls_fail, "txt1/record/verification.py", "_replay", "_replay_steps", "write", "close")
    may_block(blocking_calls_fail, "txt1/record/recorder.py", "_write", "_close_sinks")
    may_block(blocking_calls_fail, "txt1/record/player.py", "play")


@pytest.fixture(autouse=True)
def a_key_of_the_test_s_own(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.yaml"
    path.write_text(PLAN)
    return path


async def test_a_plan_says_who_is_where_and_what_is_his_own(plan: Path) -> None:
    async with Fleet.open(plan, seed=3, settings=["sim.room.width=9"]) as fleet:
        one, two, three = fleet.robots.values()
        assert list(fleet.robots) == ["txt01", "txt02", "txt03"]
        assert (fleet.world.room.length, fleet.world.room.width) == (10.0, 9.0)
        assert two.config.sim.vehicle.slip == 0.05 and one.config.sim.vehicle.slip == 0.0
        assert one.pose == (-2.0, 0.0, 0.0) and three.config.seed == 3
        fleet.begin_tasks()
        await asyncio.sleep(2.0)
        assert (one.odometry.v, two.odometry.v) == (pytest.approx(0.4, abs=0.05), 0.0)
        fleet.stop_all()
        assert not any(robot.armed for robot in fleet.robots.values())
        await asyncio.sleep(1.0)
        assert "0 armed, 0 moving" in line(fleet)


async def test_one_stop_reaches_all_from_the_helm_and_the_keys_only_one() -> None:
    async with Fleet.open(3) as fleet:
        helm = Selection(fleet)
        helm.next()
        for _ in range(20):
            helm.hold(0.3, 0.0)
            await asyncio.sleep(0.05)
        assert [robot.odometry.v > 0.1 for robot in fleet.robots.values()] == [False, True, False]
        members = helm.snapshot[FLEET]
        assert [one.driver for one in members] == ["", "keys", ""]
        for name in fleet.robots:
            assert name in str(members)
        assert render(helm.snapshot, Viewer(), 100, 30)
        helm.stop()
        assert [robot.reason for robot in fleet.robots.values()] == ["emergency stop"] * 3
        helm.toggle_esc()
        await asyncio.sleep(0.1)
        assert [robot.runtime.state.power.esc for robot in fleet.robots.values()] == [True, False, True]


def path_of(names: list[str], who: str) -> list[object]:
    starts = {"txt01": (0.0, 0.0, 0.0), "txt02": (0.0, 2.0, 0.0), "txt03": (0.0, -2.0, 1.0)}
    plan = FleetPlan(robots={name: MemberPlan(start=starts[name]) for name in names})

    async def main() -> list[object]:
        seen: list[object] = []
        async with Fleet.open(plan, seed=7) as fleet:
            robot = fleet.robots[who]

            async def look(ticks: Ticks) -> None:
                async for now in ticks:
                    if now < 1.5:  # until then the others have to be waited for
                        continue
                    robot.command(0.4, 0.2)
                    seen.append((now, robot.pose, robot.odometry, robot.battery))

            robot.add_task("look", 0.05, look)
            await asyncio.sleep(3.0 - robot.now)
        return seen

    return run(main(), speed="max")


def test_seeds_repeat_whatever_the_number_and_the_order_of_the_robots() -> None:
    alone = path_of(["txt02"], "txt02")
    assert alone == path_of(["txt01", "txt02"], "txt02") == path_of(["txt03", "txt02", "txt01"], "txt02")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robots: {}", "robots: Dictionary should have at least 1 item"),
        ("robots: {TXT: }", "robots.TXT: String should match pattern"),
        ("robots: {a: {fly: 1}}", "robots.a.fly: Extra inputs are not permitted"),
        ("robots: [", "no valid YAML"),
    ],
)
def test_a_plan_that_is_wrong_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "fleet.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        plan_of(path)
    assert message in str(refused.value) and str(path) in str(refused.value)


def test_a_setting_of_one_robot_that_is_wrong_names_the_robot() -> None:
    plan = FleetPlan(robots={"txt05": MemberPlan(set={"sim.vehicle.slip": "much"})})
    with pytest.raises(ConfigError, match=r"robots.txt05: sim.vehicle.slip"):
        run(_open(plan))


async def _open(plan: FleetPlan) -> None:
    async with Fleet.open(plan):
        pass


@pytest.mark.long
def test_one_recording_of_all_is_shown_verified_and_drawn(plan: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log, stem = plan.with_name("fleet.mcap"), plan.with_name("picture")
    words = ["fleet", str(plan), "--json", "--speed", "max", "--duration", "6", "--drive", "0.3,0.4"]
    assert execute([*words, "--log", str(log)]) == 0
    reports = json.loads(capfd.readouterr().out)
    assert list(reports) == robots_in(log) == ["txt01", "txt02", "txt03"]
    assert reports["txt03"]["odometry"]["v"] == pytest.approx(0.3, abs=0.05)
    for name in reports:
        assert execute(["replay", str(log), "--verify", "--robot", name]) == 0
    second, first = Snapshots(log, "txt02").at(5.0), Snapshots(log).at(5.0)
    assert first[POSE] in second[VEHICLES] and second[POSE] not in second[VEHICLES]
    assert execute(["report", str(log), "-o", str(stem)]) == 0
    page = stem.with_suffix(".html").read_text()
    assert "txt03" in page and "Paths" not in page and stem.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    assert execute(["replay", str(log), "--verify", "--robot", "txt09"]) == 1
    assert "robot 'txt09' is not in it; choose one of: txt01, txt02, txt03" in capfd.readouterr().err


def in_line(count: int, **cooperate: object) -> FleetPlan:
    robots = {name: MemberPlan(start=(-1.0 * at, 0.0, 0.0)) for at, name in enumerate(names(count))}
    room = {"length": 60.0, "width": 60.0}
    return FleetPlan(robots=robots, cooperate=cooperate, all={"sim": {"room": room}})


async def test_a_convoy_of_robots_follows_and_stands_when_its_leader_falls_silent() -> None:
    async with Fleet.open(in_line(4, law="convoy", speed=0.4, radius=6.0), seed=2) as fleet:
        fleet.begin_tasks()
        robots = list(fleet.robots.values())
        nearest = 9.0
        for _ in range(100):
            await asyncio.sleep(0.2)
            nearest = min(nearest, *(dist(a.pose[:2], b.pose[:2]) for a, b in pairwise(robots) if a.pose and b.pose))
        assert nearest > 0.7 and all(robot.odometry.v == pytest.approx(0.4, abs=0.05) for robot in robots)
        await robots[0].runtime.stop()
        await asyncio.sleep(6.0)
        assert [abs(robot.odometry.v) for robot in robots[1:]] == [0.0, 0.0, 0.0]
        assert fleet.cooperations["txt02"].silent == "txt01"
        assert any("cooperates no more: txt01 not heard" in event.text for event in robots[1].runtime.state.events)
        assert "waits for txt01" in _text(Selection(fleet).snapshot)


async def test_a_robot_that_its_guard_holds_for_long_says_so_and_the_run_does_not_end_well() -> None:
    plan = FleetPlan(
        robots={"txt01": MemberPlan(start=(1.0, 0.0, 0.0))},
        all={"sim": {"room": {"length": 4, "width": 4}}},
        cooperate={"law": "convoy"},
    )
    async with Fleet.open(plan) as fleet:
        fleet.begin_tasks()
        await asyncio.sleep(30.0)
        robot = fleet.robots["txt01"]
        assert robot.pose is not None and robot.pose[0] < 1.7 and robot.armed
        assert "stuck: a wall" in _text(Selection(fleet).snapshot) and "stuck: a wall" in line(fleet)
        assert verdict(fleet) == (1, "txt01 is stuck; in its way: a wall")
        assert any("in the way: a wall" in event.text for event in robot.runtime.state.events)


async def test_a_robot_of_a_network_that_is_stuck_does_not_end_well() -> None:
    at_wall = ["sim.room.length=4", "sim.room.width=4", "sim.start=[1.0, 0.0, 0.0]", "name=txt01"]
    async with Robot.open(settings=at_wall) as robot:
        await robot.load_gains()
        link = FleetLink(robot)
        robot.unfinished.append(link.unfinished)
        run = RunStart(robot, True)
        assert run.verdict(30.0) == (OK, "")
        link.cooperate("convoy", ["txt01"])
        await asyncio.sleep(30.0)
        assert run.verdict(30.0) == (FAULT, "the robot is stuck; in its way: a wall")


ROVER = load(None, ["vehicle=rover"], {}, {}).config


async def test_who_turns_in_place_or_creeps_is_moving() -> None:
    plan = FleetPlan(
        robots={
            "turns": MemberPlan(start=(-1.0, 0.0, 0.0), drive=(0.0, 0.8)),
            "creeps": MemberPlan(start=(1.0, 0.0, 0.0), drive=(0.04, 0.0)),
            "stands": MemberPlan(start=(1.0, 1.5, 0.0)),
        },
    )
    async with Fleet.open(plan, config=ROVER) as fleet:
        fleet.begin_tasks()
        await asyncio.sleep(3.0)
        assert "3 armed, 2 moving" in line(fleet)


def test_each_robot_of_a_mixed_team_is_a_car_of_its_own() -> None:
    mine = {
        "f": {"vehicle": "f1tenth"},
        "r": {"vehicle": "rover", "safety.v_max": 0.7},
        "t": {"vehicle": "txt1"},
        "d": {},
    }
    plan = FleetPlan(robots={name: MemberPlan(set=each) for name, each in mine.items()})
    configs = plan.configs(load(None, ["vehicle=donkeycar"], {}, {}).config)
    assert configs["f"].geometry == load(None, ["vehicle=f1tenth"], {}, {}).config.geometry
    assert configs["r"].geometry.steering == "skid" and configs["r"].safety.v_max == 0.7
    assert configs["t"].geometry == Config().geometry and configs["t"].control == Config().control
    assert configs["d"].geometry.counts_per_rev == 0
    with pytest.raises(ConfigError, match=r"robots\.a: vehicle: there is none 'tank'"):
        FleetPlan(robots={"a": MemberPlan(set={"vehicle": "tank"})}).configs(Config())


def _text(snapshot: Snapshot) -> str:
    console = Console(file=StringIO(), width=120)
    console.print(fleet_screen(snapshot, Viewer(), 120, 20))
    return str(console.file.getvalue())  # type: ignore[attr-defined]


async def test_robots_search_the_light_together() -> None:
    plan = FleetPlan(
        robots={name: MemberPlan(start=(1.5 * at - 1.5, -2.5, 1.5)) for at, name in enumerate(names(3))},
        all={"sim": {"room": {"length": 8, "width": 8, "light": [2.5, 2.5]}}},
        cooperate={"law": "search"},
    )
    async with Fleet.open(plan, seed=1) as fleet:
        fleet.begin_tasks()
        found = False
        while not found and fleet.now < 120.0:
            await asyncio.sleep(0.5)
            found = any(dist(r.pose[:2], (2.5, 2.5)) < 0.5 for r in fleet.robots.values() if r.pose)
        assert found


async def test_a_robot_that_learns_hears_others_for_a_while_and_tells_once_what_it_refuses() -> None:
    async with Robot.open() as robot:
        link = FleetLink(robot)
        table = Learned("thesis", 3, (1, 0), ((1.0, 2.0), (3.0, 4.0)))
        link.teach(table)
        assert Snapshot.take(robot.runtime.bus, robot.now, "", ["/learned"])[LEARNED] == table
        told = json.loads(json.dumps(table._asdict()))
        link.requests["learned"](who="txt02", learned=told, age=1.0)
        link.requests["learned"](who="txt03", learned=told, age=0.0)
        await asyncio.sleep(FORGET - 0.5)
        assert link.taught() == {"txt03": table}, "txt02 is lost"
        for _ in range(3):
            link.requests["learned"](who="txt03", learned=None, why="has the number nan in row 1")
        assert not link.taught()
        events = [event.text for event in robot.runtime.state.events]
        assert [text for text in events if "refuses" in text] == [
            "refuses what txt03 has learned: it has the number nan in row 1"
        ]


async def test_stops_without_identity_are_each_obeyed_and_the_log_says_so_once() -> None:
    async with Robot.open() as robot:
        link = FleetLink(robot)
        said = lambda: [event.text for event in robot.runtime.state.events].count("stopped by console1")  # noqa: E731
        for count in (1, 2):
            robot.arm()
            for _ in range(50):
                link.requests["stop"](who="console1")
            assert robot.runtime.gate.stopped and said() == count


async def test_who_joins_waits_for_the_others_but_not_for_an_absent_fleet() -> None:
    async with Robot.open() as robot:
        link, alone = FleetLink(robot), FleetLink(robot)
        began = robot.now
        joining = asyncio.ensure_future(link.joined())
        await asyncio.sleep(3.0)
        assert not joining.done()
        link.requests["fleet"](members=[], heard={})
        await joining
        assert robot.now - began == pytest.approx(3.0 + ALL_TOLD, abs=0.1)
        await alone.joined()
        assert robot.now - began < 30.0


async def test_a_robot_new_in_a_fleet_leaves_it_for_a_double_and_an_old_one_goes_on() -> None:
    async with Robot.open() as robot:
        link = FleetLink(robot)
        link.requests["fleet"](members=[], heard={})
        await asyncio.sleep(NEW + 1.0)
        link.requests["refused"](reason="there is a robot 'txt01'")
        assert not link.refused.done()
        told = "the fleet does not let this robot in again; it keeps trying: there is a robot 'txt01'"
        assert told in [event.text for event in robot.runtime.state.events]
        new = FleetLink(robot)
        new.requests["fleet"](members=[], heard={})
        await asyncio.sleep(NEW - 1.0)
        new.requests["refused"](reason="there is a robot 'txt01'")
        with pytest.raises(ConfigError, match="there is a robot 'txt01'"):
            await new.refused


async def test_a_stop_of_all_is_obeyed_once_and_one_without_identity_each_time() -> None:
    async with Robot.open() as robot:
        link = FleetLink(robot)
        stop = link.requests["stop"]
        for identity, again in (("a", True), ("b", True), ("", False), ("", False)):
            robot.arm()
            stop(who="txt02", stop=identity)
            assert robot.reason == "emergency stop"
            robot.arm()
            stop(who="txt02", stop=identity)
            assert robot.armed is again, "its echo does not undo the arming after it"
        assert Snapshot.take(robot.runtime.bus, robot.now, "", ["/fleet_stops"])[STOPS] == ("a", "b")
        for number in range(100):
            stop(who="txt02", stop=f"{number}")
        assert len(Snapshot.take(robot.runtime.bus, robot.now, "", ["/fleet_stops"])[STOPS]) == STOPS_MAX


async def test_log_and_screen_tell_who_has_stopped_and_that_nobody_is_reached() -> None:
    async with Robot.open() as robot:
        link = FleetLink(robot)
        told = robot.runtime.state.events
        link.stop_all()
        assert not robot.armed and told[-1].text.startswith("the fleet is not reached: only this robot was stopped")
        link.requests["fleet"](members=[list(Member("txt02", True))], heard={}, stop="")
        robot.arm()
        link.stop_all()
        assert not told[-1].text.startswith("the fleet is not reached")
        standing = "stopped: txt02; no answer: txt03"
        for _ in range(3):
            link.requests["fleet"](members=[list(Member("txt02", False))], heard={}, stop=standing)
        assert [each.text for each in told].count(f"stop of all: {standing}") == 1
        assert f"stop of all: {standing}" in _text(robot.snapshot)
        link.requests["fleet"](members=[], heard={}, stop="")
        assert "stop of all" not in _text(robot.snapshot)


@pytest.mark.usefixtures("patient")
def test_robot_and_bridge_obey_each_stop_answer_the_truth_and_bear_wrong_input() -> None:
    zenoh = pytest.importorskip("zenoh", reason="Zenoh is not installed: the extra 'fleet'")
    fleet = f"test{uuid4().hex}"
    key = fleet_key("", None, fleet)

    async def main() -> None:
        async with Robot.open(hal="sim", name="net01") as robot, AsyncExitStack() as stack:
            link = FleetLink(robot)
            at_work = bridge(robot, "fleet", {"name": "net01", "fleet": fleet}, link.requests, silence=LIMIT)
            beside = await stack.enter_async_context(at_work)
            console = await asyncio.to_thread(Peer, "console1", fleet=fleet, console=True)
            stack.push_async_callback(asyncio.to_thread, console.close)
            listening = configuration()
            listening.insert_json5("listen/endpoints", json.dumps(["tcp/127.0.0.1:0"]))
            # two, as one of them may carry nothing to the robot: they join as others do
            opened = [await asyncio.to_thread(zenoh.open, listening) for _ in range(2)]
            strangers = itertools.cycle([stack.enter_context(each) for each in opened])

            def says(where: str, message: object) -> None:
                next(strangers).put(f"{key.space}/{where}", key.signed(where, json.dumps(message).encode()))

            standing = lambda: (console.standing() or (None,))[0]  # noqa: E731

            async def told(*expected: Standing) -> None:
                try:
                    await until(lambda: standing() in expected)
                except TimeoutError:
                    events = [event.text for event in robot.runtime.state.events]
                    raise AssertionError(f"{standing()} is none of {expected}: {beside.counts}, {events}") from None

            await until(lambda: "net01" in console.heard())
            console.stop_all()
            await told(Standing(("net01",)))
            assert not robot.armed
            robot.arm()
            await told(Standing(others=(("net01", "it was armed again"),)))
            assert robot.armed
            await robot.load_gains()
            await until(lambda: robot.command(0.5, 0.0) and robot.odometry.v > 0.2)
            console.stop_all()
            slowing = Standing(stopped=(("net01", "slowing down"),))  # for so short a time that it may not be seen
            await told(slowing, Standing(("net01",)))
            assert not robot.armed
            await told(Standing(("net01",)))
            assert abs(robot.odometry.v) <= STILL_SPEED
            robot.arm()
            await until(lambda: says("stop/console1", {"from": "console1", "number": 2**60}) or not robot.armed)
            refusal = "a message of net02 is refused: x: it is no number"
            seen = lambda: any(refusal in event.text for event in robot.runtime.state.events)  # noqa: E731
            await until(lambda: says("state/x", {"from": "net02", "x": "boom"}) or seen())
            robot.arm()
            console.stop_all()
            await told(Standing(("net01",)))
            assert beside.counts["restarts"] == 0

    run(main())


OUTCOMES = (
    (Standing(("txt01", "txt02")), 0, "stands: txt01, txt02"),
    (Standing((), (("txt02", "not seen"),)), 4, "stopped, not seen to stand: txt02 (not seen)"),
    (Standing(("txt01",), (), (("txt02", "it was armed again"),)), 4, "not stopped: txt02 (it was armed again)"),
    (Standing(("txt01",), silent=("txt03",)), 4, "no answer: txt03"),
    (Standing(), 1, "no robot of the fleet is heard"),
)


@pytest.mark.parametrize(("standing", "code", "told"), OUTCOMES)
def test_the_command_that_stops_all_succeeds_only_where_all_have_stopped(
    standing: Standing, code: int, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("zenoh", reason="Zenoh is not installed: the extra 'fleet'")
    expected: list[str] = []

    class Console:
        def __init__(self, name: str, *_: object, fleet: str, console: bool) -> None:
            assert console and name.startswith("console_") and fleet == "txt1"

        def stop_all(self, names: list[str]) -> threading.Thread:
            expected.extend(names)
            said = threading.Thread()
            said.start()
            return said

        def standing(self) -> tuple[Standing, float]:
            return standing, 1.0

        def close(self) -> None:
            pass

    monkeypatch.setattr("txt1.fleet.network.Peer", Console)
    assert execute(["fleet", "--join", "--stop", "txt01,txt03"]) == code
    assert expected == ["txt01", "txt03"]
    assert told in capsys.readouterr().out


@pytest.mark.long
def test_a_robot_learns_together_with_others_on_the_network_of_whom_some_lie(tmp_path: Path) -> None:
    pytest.importorskip("zenoh", reason="Zenoh is not installed: the extra 'fleet'")
    log, own = tmp_path / "run.mcap", f"learner{os.getpid()}"
    words = ["run", "--name", own, "--fleet", "--learn", "thesis", "--share", "1", "--headless", "--log", str(log)]
    told = {"honest1": 1.0, "honest2": 1.2, "liar": -1e8, "noise": float("nan")}
    peers = {f"{name}{os.getpid()}": Peer(f"{name}{os.getpid()}") for name in told}
    heard: list[Learned] = []
    try:
        with subprocess.Popen([*TXT1, *words, "--set", "learning.time_limit=2"], stdout=subprocess.DEVNULL) as robot:
            listener = next(iter(peers.values()))
            # not so many times: messages of other fleets end a wait early
            ends = time.monotonic() + LIMIT
            while time.monotonic() < ends:
                for peer, value in zip(peers.values(), told.values(), strict=True):
                    peer.teach(Learned("thesis", len(heard), (1,) * 8, ((value,) * 3,) * 8)._asdict())
                listener.listen(0.1)
                if own in (taught := listener.taught()):
                    heard.append(learned_of(taught[own][0]))
                    if heard[-1].episodes > 12:
                        break
            robot.send_signal(signal.SIGINT)
    finally:
        for peer in peers.values():
            peer.close()
    assert heard[-1].episodes > 3, "it explores by the episodes of all"
    assert all(abs(value) < 100.0 for row in heard[-1].rows for value in row)
    recorded = Snapshots(log)
    looks = map(recorded.at, range(int(recorded.start), int(recorded.end) + 2))
    events = " ".join({event.text for look in looks for event in look[EVENTS]})
    assert "took over 8 of 8 rows from 3: honest1" in events
    assert f"refuses what noise{os.getpid()} has learned: it has the number nan in row 0" in events


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--learn", "thesis"], "--share: the robot is in no fleet; add --fleet"),
        (["--fleet", "--name", "txt01"], "--share: this robot does not learn; add --learn"),
    ],
)
def test_sharing_needs_a_fleet_and_a_learner_that_can(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if "--fleet" in words:
        pytest.importorskip("zenoh", reason="Zenoh is not installed: the extra 'fleet'")
    assert execute(["run", "--share", "1", *words]) == 2
    assert message in capsys.readouterr().err
