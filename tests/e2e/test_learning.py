"""Learning to find the light: on the running robot, and from the command line."""

from __future__ import annotations

import asyncio
import csv
import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.e2e.conftest import ENDLESS
from tests.e2e.skilled import skilled
from tests.patience import LIMIT, wait_until
from txt1.cli import execute
from txt1.config import load
from txt1.errors import LightFault, TaskFault
from txt1.hal.registry import create_sim
from txt1.hal.sim import SimHal
from txt1.installing import installs
from txt1.learning import experiment, qtable
from txt1.learning.agent import Agent
from txt1.learning.command.trials import conduct
from txt1.learning.experiment import Plan
from txt1.learning.qtable import StoredTable
from txt1.learning.registry import make
from txt1.learning.task import EPISODES, LearningTask
from txt1.learning.thesis import TABLE_5_3
from txt1.learning.trial import Episode, Phase, Trial, starts, task_of
from txt1.navigation import wheel_pose
from txt1.robot import Robot
from txt1.sensors.light import SimulatedLight
from txt1.sim.lamp import LightSensors, PointLight, SensorFault, noise_for_jitter
from txt1.trials.provenance import code_hash
from txt1.trials.workers import Workers

CONFIG = load().config
SMALL = load(overrides=["learning.boundary=2.5"]).config
SHORT = ("learning.boundary=2.5", "learning.time_limit=20")
"""So that who learns from nothing fails soon."""
BRIEF = load(overrides=SHORT).config


async def with_light(robot: Robot) -> LightSensors:
    """The light sensors that a robot is given, to break."""
    sensors = LightSensors(PointLight(), noise_for_jitter(), np.random.default_rng(2))
    await robot.add_sensor("light", SimulatedLight(lambda pose: sensors.read(*pose), lambda: robot.runtime.look().pose))
    return sensors


async def task_on(robot: Robot, episodes: int = 3, agent: Agent | None = None) -> LearningTask:
    """A learning task at work; its learner finds the light."""
    if "light" not in robot.sensors:
        await with_light(robot)
    trial = Trial(agent or skilled(CONFIG), task_of(SMALL), starts(1, 1, episodes))
    task = LearningTask(robot, trial)
    task.start()
    return task


@pytest.fixture
def clean_processes() -> Iterator[None]:
    """What several processes shared is let go at once, not by a later test's event loop."""
    yield
    gc.collect()


async def until(condition: Callable[[], bool], timeout: float = 60.0) -> None:
    async with asyncio.timeout(timeout):
        while not condition():
            await asyncio.sleep(0.05)


# -- on the robot ------------------------------------------------------------------------------------------------


async def test_the_robot_finds_the_light_by_two_tasks_of_its_own_at_their_rates(robot: Robot) -> None:
    task = await task_on(robot)
    began = robot.now
    await task.ended.wait()
    took = robot.now - began
    cycles = {name: statistics.cycles for name, statistics in robot.runtime.statistics().items()}
    assert cycles["learning"] == pytest.approx(20 * took, abs=2)
    assert cycles["sensor light"] == pytest.approx(62.5 * took, abs=2)
    assert [one.number for one in task.trial.episodes] == [1, 2, 3]
    assert all(one.success and one.time > one.optimal_time for one in task.trial.episodes)
    assert robot.pose is not None
    assert np.hypot(*robot.pose[:2]) < 0.5


async def test_the_thesiss_learner_decides_twice_a_second_and_commands_20_times(robot: Robot) -> None:
    task = await task_on(robot, agent=make("thesis", CONFIG, np.random.default_rng(1)))
    await until(lambda: task.trial.phase is Phase.DRIVE)
    began, changes, last = robot.now, [], None
    received = robot.runtime.state.received
    while robot.now < began + 6.0 and task.trial.phase is Phase.DRIVE:
        command = robot.runtime.state.command
        assert command is not None
        if command[1] != last:
            changes.append(robot.now - began)
            last = command[1]
        await asyncio.sleep(0.05)
    assert len(changes) > 2
    assert all(min(t % 0.5, 0.5 - t % 0.5) < 0.06 for t in changes)
    assert robot.runtime.state.received - received == pytest.approx(20 * (robot.now - began), abs=2)


async def test_a_disarm_voids_the_episode_and_after_the_arm_it_is_done_again(robot: Robot) -> None:
    task = await task_on(robot)
    await until(lambda: len(task.trial.episodes) == 1 and task.trial.phase is Phase.DRIVE)
    start = task.trial.start
    await asyncio.sleep(1.0)
    known = task.trial.agent.memory()
    robot.disarm("somebody was in the way")
    await asyncio.sleep(3.0)
    assert robot.odometry.v == 0.0
    assert len(task.trial.episodes) == 1
    assert task.trial.start == start
    assert task.trial.agent.memory()["visits"] != known["visits"], "what the broken episode taught is forgotten"
    robot.arm()
    await task.ended.wait()
    assert [one.number for one in task.trial.episodes] == [1, 2, 3]
    assert task.trial.voided == 1


class Unliftable(SimHal):
    """A simulated robot that nobody can put down somewhere, like a real one."""

    capabilities = replace(SimHal.capabilities, place=False)


async def test_a_robot_that_cannot_be_placed_drives_to_each_start_and_after_a_disarm_too() -> None:
    made = create_sim(load(overrides=[*ENDLESS, "sim.start=[1.0, 0.5, 0.0]"]).config)
    assert isinstance(made, SimHal)
    async with Robot.open(Unliftable(made.vehicle)) as robot:
        assert await robot.load_gains()
        task = await task_on(robot, 2)
        await until(lambda: task.trial.phase is Phase.DRIVE, 120.0)
        x, y, _ = task.trial.start
        assert robot.pose is not None
        assert np.hypot(robot.pose[0] - x, robot.pose[1] - y) < 0.06
        robot.disarm("somebody was in the way")
        await asyncio.sleep(1.0)
        robot.arm()
        await until(lambda: task.trial.phase is Phase.MOVE)
        await asyncio.sleep(1.0)
        robot.disarm("on the way to the start")
        await asyncio.sleep(1.0)
        robot.arm()
        async with asyncio.timeout(300.0):
            await task.ended.wait()
        assert [one.success for one in task.trial.episodes] == [True, True]


@pytest.mark.parametrize("during", [Phase.REST, Phase.DRIVE])
async def test_keys_void_the_episode_and_it_is_done_again_when_the_robot_is_armed_anew(
    robot: Robot, during: Phase
) -> None:
    task, keys = await task_on(robot), robot.source("keys")
    await until(lambda: len(task.trial.episodes) == 1 and task.trial.phase is during)
    for _ in range(10):
        keys.command(0.2, 0.0)
        await asyncio.sleep(0.05)
    keys.release()
    assert task.overruled == "keys"
    await asyncio.sleep(5.0)
    assert robot.odometry.v == 0.0, "letting go of the keys does not set it off"
    assert (len(task.trial.episodes), task.trial.voided) == (1, 1)
    robot.arm()
    await task.ended.wait()
    assert [one.number for one in task.trial.episodes] == [1, 2, 3]


async def test_keys_on_the_way_to_a_start_hold_the_learner_up_until_armed_anew() -> None:
    made = create_sim(load(overrides=[*ENDLESS, "sim.start=[1.0, 0.5, 0.0]"]).config)
    assert isinstance(made, SimHal)
    async with Robot.open(Unliftable(made.vehicle)) as robot:
        assert await robot.load_gains()
        task, keys = await task_on(robot, 1), robot.source("keys")
        await until(lambda: robot.odometry.v != 0.0)
        keys.command(-0.2, 0.0)
        await asyncio.sleep(0.01)
        keys.release()
        await asyncio.sleep(5.0)
        assert robot.odometry.v == 0.0
        assert task.overruled == "keys"
        robot.arm()
        async with asyncio.timeout(300.0):
            await task.ended.wait()
        assert [one.success for one in task.trial.episodes] == [True]


async def test_odometry_serves_for_goal_and_boundary() -> None:
    async with Robot.open("sim", seed=1, settings=[*ENDLESS, "learning.pose=odometry"]) as robot:
        assert await robot.load_gains()
        task = await task_on(robot)
        await task.ended.wait()
        assert robot.pose is not None
        assert all(one.success for one in task.trial.episodes)
        assert np.hypot(*robot.pose[:2]) == pytest.approx(0.48, abs=0.1)


async def test_a_pose_source_of_the_users_is_asked(robot: Robot) -> None:
    asked = wheel_pose(robot)._replace(read=lambda: (0.0, 0.0, 0.0))
    trial = Trial(make("thesis", CONFIG, np.random.default_rng(1)), task_of(SMALL), starts(1, 1, 2))
    await with_light(robot)
    task = LearningTask(robot, trial, asked)
    task.start()
    await task.ended.wait()
    assert [one.time for one in task.trial.episodes] == [0.0, 0.0], "it says that the robot is at the light already"


@pytest.mark.parametrize(
    ("fault", "what"),
    [(SensorFault.NAN, "no reading"), (SensorFault.DEAD, "dead or covered"), (SensorFault.FROZEN, "frozen")],
)
async def test_a_broken_sensor_stops_the_robot_with_an_error_that_names_it(fault: SensorFault, what: str) -> None:
    with pytest.raises(TaskFault, match=f"light sensor FR.*{what}") as error:
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            assert await robot.load_gains()
            sensors = await with_light(robot)
            task = await task_on(robot)
            await until(lambda: task.trial.phase is Phase.DRIVE)
            await asyncio.sleep(1.0)
            sensors.faults = [SensorFault.NONE, fault, SensorFault.NONE, SensorFault.NONE]
            async with asyncio.timeout(3.0):
                await task.ended.wait()
    assert isinstance(error.value.__cause__, LightFault)
    assert not robot.armed
    assert robot.hal.vehicle.state.v < 0.35  # type: ignore[attr-defined]
    assert robot.hal.outputs.motor == 0  # type: ignore[attr-defined]


# -- txt1 learn --------------------------------------------------------------------------------------------------


def learn(out: Path, *more: str, pictures: bool = False) -> int:
    brief = [word for one in SHORT for word in ("--set", one)]
    if not pictures:
        brief.append("--no-pictures")
    return execute(["learn", "--trials", "2", "--episodes", "4", "--jobs", "1", "--out", str(out), *brief, *more])


def test_learn_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from matplotlib.image import imread  # it takes 0.3 s, for each process that collects the tests

    out = tmp_path / "new" / "directory"
    assert learn(out, "--seed", "3", pictures=True) == 0
    with (out / "learning.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "trial",
        "episode",
        "bearing_rad",
        "heading_rad",
        "time_s",
        "success",
        "optimal_time_s",
        "floor_s",
        "unfit_s",
        "touched",
    ]
    assert [(row["trial"], row["episode"]) for row in rows] == [(t, r) for t in "12" for r in "1234"]
    assert all(float(row["optimal_time_s"]) > 2.0 for row in rows)
    assert all(float(row["time_s"]) > float(row["optimal_time_s"]) for row in rows if row["success"] == "1")
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["episodes"] == 8
    assert metrics["thesis_mean_time_s"] == 7.165
    won = [float(row["time_s"]) for row in rows if row["success"] == "1"]
    assert metrics["last_10"]["failures"] == 8 - len(won) < 8
    assert metrics["last_10"]["mean_time_s"] == pytest.approx(np.mean(won), abs=1e-4)
    assert metrics["last_10"]["mean_regret_s"] > 0.0
    assert qtable.load(out / "qtable.json").about["agent"] == "thesis"
    pictures = {path.name: imread(path) for path in out.glob("*.png")}
    assert set(pictures) == {"times.png", "learning_curve.png", "paths.png", "qtable.png"}
    for name, picture in pictures.items():
        edges = (picture[0], picture[-1], picture[:, 0], picture[:, -1])
        assert all((edge == 1.0).all() for edge in edges), f"something is cut at an edge of {name}"
    assert "last 4 episodes" in capsys.readouterr().out


@pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(one, marks=pytest.mark.long) for one in (signal.SIGTERM, signal.SIGHUP))]
)
def test_an_interrupted_run_carries_on_to_the_very_result_of_an_uninterrupted_one(
    number: signal.Signals, tmp_path: Path
) -> None:
    plan = Plan("thesis", 2, 4, 3, BRIEF)
    whole, ended = conduct(plan, tmp_path / "whole", False, lambda *_: None)
    assert ended is None

    def interrupt(trial: int, one: Episode) -> None:
        if (trial, one.number) == (2, 2):
            os.kill(os.getpid(), number)

    broken, ended = conduct(plan, tmp_path / "broken", False, interrupt)
    assert ended is number
    assert [len(one.episodes) for one in broken] == [4, 2], "all that was learned is kept"
    resumed, ended = conduct(plan, tmp_path / "broken", True, lambda *_: None)
    assert ended is None
    for path, outcomes in ((tmp_path / "whole", whole), (tmp_path / "broken", resumed)):
        experiment.write(plan, path, outcomes)
    for name in ("learning.csv", "qtable.json", "metrics.json"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "broken" / name).read_bytes()


@pytest.mark.long
@pytest.mark.usefixtures("clean_processes")
def test_several_processes_come_to_the_same_result_as_one(tmp_path: Path) -> None:
    plan = Plan("thesis", 2, 2, 3, BRIEF)
    seen: list[tuple[int, int]] = []
    for jobs in (1, 2):
        outcomes, ended = conduct(
            plan, tmp_path / str(jobs), False, lambda trial, one: seen.append((trial, one.number)), Workers(jobs)
        )
        assert ended is None
        experiment.write(plan, tmp_path / str(jobs), outcomes)
    assert sorted(seen[:4]) == sorted(seen[4:]) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert (tmp_path / "1" / "learning.csv").read_bytes() == (tmp_path / "2" / "learning.csv").read_bytes()


def test_learn_refuses_what_it_cannot_use_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def learn_one(out: Path, *more: str) -> int:
        return learn(out, "--trials", "1", "--episodes", "1", *more)

    (tmp_path / "file").write_text("")
    assert learn(tmp_path / "file" / "out") == 2
    assert "--out" in capsys.readouterr().err
    done = tmp_path / "done"
    assert learn_one(done) == 0
    assert learn_one(done) == 2
    assert "--resume carries it on" in capsys.readouterr().err
    assert learn_one(done, "--resume", "--seed", "9") == 2
    assert "was begun with seed=0, not 9" in capsys.readouterr().err
    assert learn_one(done, "--resume", "--set", "learning.time_limit=200") == 2
    assert "was begun with learning.time_limit=20.0, not 200.0" in capsys.readouterr().err
    told = (done / "experiment.json").read_text()
    (done / "experiment.json").write_text(told.replace(code_hash(), "0123456789abcdef"))
    assert learn_one(done, "--resume") == 2
    assert "was begun by other code (0123456789abcdef" in capsys.readouterr().err
    (done / "experiment.json").write_text("{}")
    assert learn_one(done, "--resume") == 2
    assert "experiment.json is not this program's" in capsys.readouterr().err
    (done / "experiment.json").unlink()
    assert learn_one(done, "--resume") == 2
    assert "holds trials without their experiment.json" in capsys.readouterr().err
    assert execute(["learn", "--agent", "genius", "--out", str(tmp_path / "x")]) == 2
    assert "there is no learner 'genius'; installed: " in capsys.readouterr().err


def test_the_thesis_learns_in_its_simulation_by_default_beside_its_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = ["learn", "--trials", "1", "--episodes", "1", "--seed", "1", "--no-pictures"]
    for number, (words, noise, filtered, told) in enumerate(
        (([], 0.0, False, True), (["--world", "thesis"], None, True, False))
    ):
        out = tmp_path / str(number)
        assert execute([*short, *words, "--out", str(out)]) == 0
        config = json.loads((out / "metrics.json").read_text())["config"]
        assert (config["sim"]["light"]["noise"], config["learning"]["thesis"]["filtered"]) == (noise, filtered)
        assert ("7.165" in capsys.readouterr().out) is told, "the thesis has no figure for another world"


@pytest.mark.long
def test_a_damaged_trial_is_not_carried_on_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert learn(tmp_path, "--trials", "1") == 0
    trial = tmp_path / "trials" / "0001.json"
    trial.write_text(trial.read_text().replace("true", "false", 1))
    capsys.readouterr()
    assert learn(tmp_path, "--resume") == 1
    assert "altered" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["learn", "--out", "OUT"], ["run", "--json", "--learn", "thesis"]])
def test_without_light_sensors_it_says_what_is_missing(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(tmp_path) if word == "OUT" else word for word in command]
    assert execute([*words, "--hal", "serial", "--port", "virtual", "--speed", "max"]) == 1
    assert "the HAL 'serial' there are none: plug in a Phidgets Interface Kit" in capsys.readouterr().err


def test_phidgets_without_their_driver_name_the_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "Phidget22.Devices.VoltageRatioInput", None)
    words = ["run", "--json", "--duration", "1", "--set", "sensors.light.driver=phidgets_light"]
    assert execute(words) == 2
    assert installs("devices") in capsys.readouterr().err


def test_without_matplotlib_everything_but_the_pictures_is_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    assert learn(tmp_path, "--trials", "1", "--episodes", "1", pictures=True) == 0
    assert installs("plots") in capsys.readouterr().err
    assert (tmp_path / "metrics.json").exists()
    assert not list(tmp_path.glob("*.png"))


# -- txt1 run ----------------------------------------------------------------------------------------------------


def run(*words: str) -> int:
    return execute(["run", "--speed", "max", "--duration", "30", "--seed", "4", "--json", *words])


@pytest.fixture
def table_5_3(tmp_path: Path) -> Path:
    """The thesis's own table in a file."""
    path = tmp_path / "qtable.json"
    qtable.save(path, StoredTable(np.array(TABLE_5_3), {"agent": "thesis"}))
    return path


def test_run_shows_the_learning_among_the_tasks(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--learn", "thesis") == 0
    tasks = json.loads(capsys.readouterr().out)["tasks"]
    assert tasks["learning"]["cycles"] > 500
    assert tasks["sensor light"]["cycles"] > 1600
    assert EPISODES > 30 / 2.5, "enough for anybody who watches"


def test_run_drives_by_a_stored_table(table_5_3: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--policy", str(table_5_3)) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["tasks"]["learning"]["misses"] == 0
    assert np.hypot(report["odometry"]["x"], report["odometry"]["y"]) > 0.3, "it has moved"
    assert report["armed"]


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda text: text[: len(text) // 2], "is cut off"),
        (lambda text: text.replace("0.9494", "9.9494"), "was altered"),
        (lambda text: text.replace("1.4476", "NaN"), "is no finite number"),
        (lambda _: "", "is cut off"),
    ],
)
def test_a_spoilt_table_is_not_driven_by(
    table_5_3: Path, spoil: Callable[[str], str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    table_5_3.write_text(spoil(table_5_3.read_text()))
    assert run("--policy", str(table_5_3)) == 1
    captured = capsys.readouterr()
    assert problem in captured.err
    assert captured.out == ""


@pytest.mark.parametrize(
    ("values", "agent", "problem"),
    [
        (np.zeros((4, 3)), "thesis", "4 states where 8 are needed"),
        (np.zeros((8, 2)), "thesis", "2 actions where 3 are needed"),
        (np.zeros((8, 3)), "genius", "was learned by 'genius'"),
    ],
)
def test_a_table_that_does_not_fit_its_agent_is_not_driven_by(
    values: np.ndarray, agent: str, problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "qtable.json"
    qtable.save(path, StoredTable(values, {"agent": agent}))
    assert run("--policy", str(path)) == 1
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize("agent", ["thesis", "locator"])
def test_what_was_learned_drives_to_the_light(agent: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert learn(tmp_path, "--trials", "1", "--episodes", "2", "--agent", agent) == 0
    capsys.readouterr()
    assert run("--policy", str(tmp_path / "qtable.json")) == 0
    assert json.loads(capsys.readouterr().out)["armed"]


# -- how it ends -------------------------------------------------------------------------------------------------


def process(out: Path, *more: str) -> subprocess.Popen[str]:
    """`txt1 learn` as a process in a group of its own, as a terminal starts it."""
    words = ["learn", "--world", "thesis", "--trials", "9", "--episodes", "6", "--seed", "3", "--out", str(out), *more]
    return subprocess.Popen(
        [sys.executable, "-m", "txt1", *words],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        text=True,
    )


PROCESS = Plan("thesis", 9, 6, 3, load(options={"seed": 3}).config)
"""What it does."""


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> list[list[Episode]]:
    """What comes of it when nobody interrupts it."""
    outcomes, _ = conduct(PROCESS, tmp_path_factory.mktemp("whole"), False, lambda *_: None)
    return [one.episodes for one in outcomes]


def resumed(out: Path) -> list[list[Episode]]:
    """What comes of it when it is carried on."""
    outcomes, ended = conduct(PROCESS, out, True, lambda *_: None)
    assert ended is None
    return [one.episodes for one in outcomes]


@pytest.mark.long  # its processes begin, and all is done twice
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_signal_to_all_its_processes_ends_it_by_its_number_and_nothing_is_lost(
    number: signal.Signals, jobs: str, tmp_path: Path, uninterrupted: list[list[Episode]]
) -> None:
    out = tmp_path / "out"
    learner = process(out, "--jobs", jobs)
    if jobs == "1":
        wait_until((out / "trials" / "0001.json").exists)
    else:
        wait_until((out / "experiment.json").exists)
        time.sleep(0.5)  # its processes are being born
    os.killpg(learner.pid, number)  # to all of them, as the terminal and `timeout` do
    _, said = learner.communicate(timeout=LIMIT)
    assert "Traceback" not in said, said
    assert learner.returncode == 128 + number
    assert "--resume carries on" in said
    assert resumed(out) == uninterrupted


@pytest.mark.long
def test_completed_trials_survive_the_program_s_death_and_its_processes_do_not(
    tmp_path: Path, uninterrupted: list[list[Episode]]
) -> None:
    out = tmp_path / "out"
    learner = process(out, "--jobs", "2")
    wait_until(lambda: list((out / "trials").glob("*.json")))
    learner.kill()
    learner.communicate(timeout=LIMIT)  # returns when the last process has closed standard error
    wait_until(lambda: not alive(learner.pid))
    assert resumed(out) == uninterrupted


def alive(group: int) -> bool:
    """Whether there is a process of this group."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.usefixtures("clean_processes")
@pytest.mark.parametrize(
    "more",
    [
        ("--jobs", "1"),
        pytest.param(("--jobs", "2"), marks=pytest.mark.long),
        ("--jobs", "1", "--set", "serial.rearm=true"),
    ],
)
def test_a_disarm_ends_it_as_nobody_is_there_to_arm_again(
    more: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert learn(tmp_path, *more, "--set", "sim.faults.left_encoder=true") == 3
    assert "the robot was stopped: runaway" in capsys.readouterr().err


def test_a_robot_that_does_not_arm_by_itself_is_to_be_armed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    never = ("--trials", "1", "--episodes", "1", "--set", "safety.auto_arm=never")
    assert learn(tmp_path, *never) == 2
    assert "add --arm" in capsys.readouterr().err
    assert learn(tmp_path, *never, "--arm") == 0


def test_what_was_learned_before_a_fault_is_kept_and_carried_on_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Fitful(LightSensors):
        def __init__(self, *given: object, **named: object) -> None:
            super().__init__(*given, **named)  # type: ignore[arg-type]
            began.append(self)

    def fail(trial: int, one: Episode) -> None:
        if len(began) == 1 and one.number == 2:
            began[0].faults = [SensorFault.NAN] * 4

    began: list[LightSensors] = []
    monkeypatch.setattr("txt1.sensors.light.LightSensors", Fitful)
    real = load().config
    plan = Plan("thesis", 1, 4, 3, real)
    monkeypatch.setattr(Plan, "simulated", False)  # as on a real robot: what was done cannot be done again
    broken, ended = conduct(plan, tmp_path, False, fail)
    assert isinstance(ended, TaskFault)
    assert [len(one.episodes) for one in broken] == [2]
    resumed, ended = conduct(plan, tmp_path, True, lambda *_: None)
    assert ended is None
    assert resumed[0].episodes[:2] == broken[0].episodes
    assert len(resumed[0].episodes) == 4
    assert resumed[0].memory["episode"] == 4
    assert resumed[0].paths[1] == broken[0].paths[1]
    assert resumed[0].voided == 1


@pytest.mark.parametrize(
    ("setting", "agent"),
    [
        ("learning.options.period=1", "thesis"),
        ("learning.thesis.gamma=0.9", "pilot"),
    ],
)
def test_a_setting_of_another_learner_is_refused(
    setting: str, agent: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert learn(tmp_path / "out", "--agent", agent, "--set", setting) == 2
    told = f"--set {setting.partition('=')[0]}: the learner '{agent}' does not read it"
    assert told in capsys.readouterr().err
    assert execute(["run", "--headless", "--speed", "max", "--duration", "1", "--learn", agent, "--set", setting]) == 2
    assert told in capsys.readouterr().err
