"""Taught by driving: from a recording to a policy that drives, gives way to hands, and stands when it should."""

from __future__ import annotations

import asyncio
import json
import shlex
from dataclasses import replace
from math import atan2, cos, nan, sin
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
import pytest

from benchmarks.teaching.track import Human, Track, track_of
from txt1.cli import execute
from txt1.cli.operated_robot import RunStart
from txt1.errors import ConfigError, RecordingError
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.record.options import RecordingAsked
from txt1.robot import Robot
from txt1.teaching.lessons import Ask, HumanDrive, drive_in, together
from txt1.teaching.policy import Judgement, Policy, load
from txt1.teaching.policy_driver import LOOK, POLICY, STOPPED, Look
from txt1.teaching.teach import summary, teach
from txt1.teaching.training import Recipe

Capture = pytest.CaptureFixture[str]
BEAMS = 121
ROOM = (
    "sim.room.length=6.0",
    "sim.room.width=6.0",
    "sim.start=[1.6, 0.0, 1.57]",
    "sim.battery.used_1=null",
    "sensors.laser.driver=sim_laser",
    f"sensors.laser.options={{steps: 180, beams: {BEAMS}, range_max: 10.0}}",
)
QUICK = Recipe(members=2, dense=(16,), epochs=6, steps=300)


def round_the_room(pose: tuple[float, float, float], aim: float) -> tuple[float, float]:
    """What a human commands who drives round and round, at this radius."""
    x, y, theta = pose
    ahead = atan2(y, x) + 0.45
    gx, gy = aim * cos(ahead) - x, aim * sin(ahead) - y
    left = -sin(theta) * gx + cos(theta) * gy
    return 0.7, 0.7 * min(max(2.0 * left / (gx * gx + gy * gy), -1.7), 1.7)


async def drive(robot: Robot, seconds: float, source: str = "gamepad", seed: int = 1) -> None:
    """Have a hand drive for a while, not always the same way."""
    hand, rng, aim = robot.source(source), np.random.default_rng(seed), 1.7

    async def steer(ticks: Ticks) -> None:
        nonlocal aim
        async for now in ticks:
            if now > seconds:
                if hand.drives:
                    hand.release()
                continue
            aim += 0.1 * (1.7 - aim) + 0.05 * rng.standard_normal()
            assert robot.pose is not None
            hand.command(*round_the_room(robot.pose, aim))

    robot.add_task("hand", 0.05, steer)


def recorded(file: Path, seconds: float, *settings: str, source: str = "gamepad", after: float = 3.0) -> Path:
    """A recording in which somebody drives for a while."""

    async def work() -> None:
        asked = {"record": RecordingAsked(file, None, {}, "max")}
        async with Robot.open("sim", settings=(*ROOM, *settings), seed=1, additions=asked) as robot:
            await robot.load_gains()
            await drive(robot, seconds, source)
            robot.runtime.scheduler.end_at(seconds + after)
            await robot.runtime.scheduler.ended

    run(work(), speed="max")
    return file


@pytest.fixture(scope="module")
def lesson(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 70 s."""
    return recorded(tmp_path_factory.mktemp("teaching") / "lesson.mcap", 70.0)


@pytest.fixture(scope="module")
def taken(lesson: Path) -> HumanDrive:
    """What is taken from it."""
    return drive_in(lesson, [Ask("laser")])


@pytest.fixture(scope="module")
def policy(taken: HumanDrive) -> Policy:
    """A policy that was taught by it."""
    return teach([taken], QUICK, "today", folds=2).policy


@pytest.fixture(scope="module")
def file(policy: Policy, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "room.onnx"
    policy.save(path)
    return path


# -- lessons -----------------------------------------------------------------------------------------------------


def test_what_a_human_drove_is_taken_and_the_rest_left_out_with_its_reason(taken: HumanDrive) -> None:
    found = taken
    assert 66.0 < found.taught.by["gamepad"] < 71.0
    assert found.taught.left_out["nobody drove"] > 1.0
    assert len(found.lessons) == pytest.approx(690, abs=20)
    assert np.abs(found.lessons.commands).max() <= 1.0


@pytest.mark.parametrize(
    ("seconds", "source", "words"),
    [(15.0, "gamepad", r"drives for 1[45] s in it; at least 20 s"), (10.0, "script", "no human drove.*'script' drove")],
)
def test_too_little_or_nobody_is_refused_in_a_line(seconds: float, source: str, words: str, tmp_path: Path) -> None:
    file = recorded(tmp_path / "short.mcap", seconds, source=source, after=0.5)
    with pytest.raises(RecordingError, match=words) as refused:
        together([drive_in(file, [Ask("laser")])])
    assert "\n" not in str(refused.value)


def test_recordings_of_two_cars_or_two_lasers_do_not_go_together(taken: HumanDrive) -> None:
    one = taken
    other = replace(one, taught=replace(one.taught, sha256="other"))
    with pytest.raises(RecordingError, match="another car"):
        together([one, replace(other, radius_min=0.7)])
    sight = replace(one.sights[0], mount=(0.5, 0.0, 0.2, 0.0))
    with pytest.raises(RecordingError, match="sits elsewhere"):
        together([one, replace(other, sights=(sight,))])
    assert len(together([one, other])[1]) == 2 * len(one.lessons)


def test_a_sensor_that_is_not_in_a_recording_is_told_with_those_that_are(lesson: Path) -> None:
    with pytest.raises(RecordingError, match=r"no exact readings of --see camera.*laser"):
        drive_in(lesson, [Ask("camera")])


@pytest.mark.long
def test_teach_writes_a_policy_and_a_report(lesson: Path, tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "track.onnx"
    assert execute(["teach", str(lesson), "-o", str(output), "--see", "laser", "--networks", "1", "--epochs", "1"]) == 0
    told = capsys.readouterr().out
    assert "nobody drove" in told
    assert "held-out blocks: steering rms" in told
    card = load(output).card
    assert card.taught_by[0].file == str(lesson)
    report = tmp_path / "track-report"
    assert {each.name for each in report.iterdir()} == {"README.md", "error.png", "curve.png", "worst.png"}


@pytest.mark.parametrize(
    "words",
    [
        ("--see", "laser", "-o", "a.onnx"),
        ("{file}", "-o", "a.onnx"),
        ("{file}", "--see", "laser"),
        ("{file}", "--see", "nose", "-o", "a.onnx"),
        ("{file}", "--see", "laser,laser", "-o", "a.onnx"),
        ("--from", "{file}", "--more", "{file}", "-o", "a.onnx"),
        ("{file}", "--see", "laser", "-o", "a.onnx", "--seed", "-1"),
        ("{file}", "--see", "laser", "-o", "a.onnx", "--lag", "-0.1"),
    ],
)
def test_words_that_make_no_sense_are_refused(words: tuple[str, ...], lesson: Path, capsys: Capture) -> None:
    try:
        code = execute(["teach", *(word.format(file=lesson) for word in words)])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code in (1, 2)
    assert len(capsys.readouterr().err.strip().splitlines()) <= 30


# -- driving -----------------------------------------------------------------------------------------------------


def test_run_drives_by_a_policy_and_the_log_says_who(file: Path, tmp_path: Path, capsys: Capture) -> None:
    log = tmp_path / "driven.mcap"
    settings = [word for each in ROOM for word in ("--set", each)]
    run_it = ["run", "--headless", "--speed", "max", "--json", "--duration", "5", "--log", str(log)]
    assert execute([*run_it, "--source", str(file), *settings]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["driver"]["name"] == "policy"
    assert told["odometry"]["v"] > 0.3
    with pytest.raises(RecordingError, match="'policy' drove"):
        drive_in(log, [Ask("laser")])


def test_a_source_that_is_no_policy_is_refused(tmp_path: Path, capsys: Capture) -> None:
    bad = tmp_path / "bad.onnx"
    bad.write_bytes(b"nothing")
    assert execute(["run", "--headless", "--speed", "max", "--duration", "1", "--source", str(bad)]) != 0
    assert "bad.onnx" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_a_mistake_in_the_command(capsys: Capture) -> None:
    assert execute(["run", "--headless", "--speed", "max", "--duration", "1", "--source", "nosuch.onnx"]) == 2
    assert "there is no file 'nosuch.onnx'; check the name" in capsys.readouterr().err


async def rolled(robot: Robot, seconds: float) -> list[tuple[str, float]]:
    """Who drives and how fast, ten times a second."""
    found = []
    for _ in range(round(10 * seconds)):
        await asyncio.sleep(0.1)
        found.append((robot.driver.name, robot.odometry.v))
    return found


async def test_a_hand_takes_over_and_letting_go_gives_the_wheel_back(policy: Policy) -> None:
    async with Robot.open("sim", settings=ROOM, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        assert (await rolled(robot, 3.0))[-1][0] == "policy"
        hand = robot.source("gamepad")
        for _ in range(20):
            assert hand.command(0.3, 0.0)
            await asyncio.sleep(0.05)
            assert robot.driver.name == "gamepad"
        hand.release()
        assert (await rolled(robot, 1.0))[-1][0] == "policy"


async def test_a_policy_that_stands_leaves_the_wheel_to_others(policy: Policy, monkeypatch: pytest.MonkeyPatch) -> None:
    async with Robot.open("sim", settings=ROOM, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        assert (await rolled(robot, 3.0))[-1][0] == "policy"
        monkeypatch.setattr(Policy, "judge", lambda policy, values: Judgement(0.0, 0.0, 0.0))
        while not robot.runtime.state.events[-1].text.startswith("the policy stands"):
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.02)
        assert robot.driver.name == "", "at once, and not as its last command grows old"
        assert (await rolled(robot, 2.0))[-1][1] == 0.0
        await robot.drive(0.3, 0.0, 1.0)
        assert robot.odometry.v > 0.2, "a program of the least priority drives meanwhile"


async def test_a_take_over_is_known_as_one_and_counts_more(policy: Policy, tmp_path: Path) -> None:
    log = tmp_path / "takeover.mcap"
    asked = {"teaching": policy, "record": RecordingAsked(log, None, {}, "max")}
    async with Robot.open("sim", settings=ROOM, additions=asked) as robot:
        await robot.load_gains()
        await asyncio.sleep(3.0)
        hand = robot.source("gamepad")
        for _ in range(100):
            assert robot.pose is not None
            hand.command(*round_the_room(robot.pose, 1.7))
            await asyncio.sleep(0.05)
        hand.release()
        await asyncio.sleep(2.0)
    found = await asyncio.to_thread(drive_in, log, [Ask("laser")])
    assert found.taught.takeover == pytest.approx(5.0, abs=0.6)
    assert found.lessons.weights.max() == 4.0
    assert found.lessons.weights.min() == 1.0
    assert found.taught.left_out["'policy' drove"] > 2.0


async def stands(policy: Policy, *settings: str, after: float = 3.0, breaks: object = None) -> tuple[list[str], float]:
    """The event log and the speed after a while, the robot having begun to drive if something breaks then."""
    async with Robot.open("sim", settings=(*ROOM, *settings), additions={"teaching": policy}) as robot:
        await robot.load_gains()
        await asyncio.sleep(2.0)
        if callable(breaks):
            assert robot.odometry.v > 0.2
            breaks(robot)
        await asyncio.sleep(after)
        return [event.text for event in robot.runtime.state.events], abs(robot.odometry.v)


async def test_another_number_of_beams_is_refused(policy: Policy) -> None:
    events, v = await stands(policy, f"sensors.laser.options={{steps: 180, beams: {BEAMS - 2}, range_max: 10.0}}")
    assert v == 0.0
    assert len([text for text in events if "119 beams" in text and "121 beams" in text]) == 1


async def test_outputs_that_are_no_numbers_stop_it_for_good(policy: Policy, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(robot: Robot) -> None:
        monkeypatch.setattr(Policy, "judge", lambda self, seen: Judgement(nan, 0.5, 0.0))

    events, v = await stands(policy, breaks=breaks)
    assert v == 0.0
    assert len([text for text in events if "no numbers" in text]) == 1


async def test_a_sensor_that_freezes_stops_it(policy: Policy) -> None:
    def breaks(robot: Robot) -> None:
        polled = robot.sensors["laser"]
        read, last = polled.sensor.read, polled.last
        polled.sensor.read = lambda now: last._replace(time=now) if read(now) is not None else None  # type: ignore

    events, v = await stands(policy, breaks=breaks)
    assert v == 0.0
    assert any("frozen" in text for text in events)


async def test_a_sensor_that_falls_silent_stops_it(policy: Policy) -> None:
    def breaks(robot: Robot) -> None:
        robot.sensors["laser"].sensor.read = lambda now: None

    events, v = await stands(policy, breaks=breaks)
    assert v == 0.0
    assert any("late" in text for text in events)


@pytest.mark.parametrize("duration", [0.5, 2.0])
@pytest.mark.parametrize("freezes", [False, True])
async def test_after_a_gap_of_its_sensor_it_waits_until_it_is_armed_anew(
    policy: Policy, freezes: bool, duration: float
) -> None:
    async with Robot.open("sim", settings=ROOM, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        await asyncio.sleep(2.0)
        polled = robot.sensors["laser"]
        read, last = polled.sensor.read, polled.last
        assert last is not None

        def broken(now: float) -> Any:
            return last._replace(time=now) if freezes and read(now) is not None else None

        polled.sensor.read = broken  # type: ignore[method-assign]
        await asyncio.sleep(duration)
        polled.sensor.read = read  # type: ignore[method-assign]
        if duration < 1.0:
            assert (await rolled(robot, 1.0))[-1] == ("policy", pytest.approx(0.7, abs=0.3)), "it hardly stopped"
            return
        assert all((name, v) == ("", 0.0) for name, v in (await rolled(robot, 3.0))[5:])
        await armed_anew(robot)


async def test_after_a_guard_s_stop_it_waits_until_it_is_armed_anew(policy: Policy) -> None:
    async with Robot.open("sim", settings=ROOM, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        await asyncio.sleep(2.0)
        robot.runtime.gate.guards.append(lambda v, omega, now: (0.0, 0.0))
        await asyncio.sleep(2.0)
        robot.runtime.gate.guards.pop()
        assert all((name, v) == ("", 0.0) for name, v in await rolled(robot, 3.0))
        await armed_anew(robot)


async def armed_anew(robot: Robot) -> None:
    """The policy has said once for what it waits, and drives when the robot is armed anew."""
    assert [event.text for event in robot.runtime.state.events].count(f"the policy stands: {STOPPED}") == 1
    robot.arm()
    assert (await rolled(robot, 2.0))[-1] == ("policy", pytest.approx(0.7, abs=0.3))


async def test_doubt_slows_it_and_stops_it(policy: Policy, monkeypatch: pytest.MonkeyPatch) -> None:
    card, doubts = policy.card, [0.0]
    monkeypatch.setattr(Policy, "judge", lambda self, seen: Judgement(0.3, 0.4, doubts[0]))
    async with Robot.open("sim", settings=ROOM, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        looks: list[Look] = []
        robot.runtime.bus.subscribe(lambda topic, look, time: looks.append(look), [LOOK])
        speeds = []
        for doubts[0] in (0.0, 0.5 * (card.doubt_slow + card.doubt_stop), 1.1 * card.doubt_stop, 0.0):
            await asyncio.sleep(2.5)
            speeds.append(looks[-1].v)
        assert speeds[1] == pytest.approx(0.5 * speeds[0], rel=0.05)
        assert speeds[2] == 0.0
        assert speeds[3] == pytest.approx(speeds[0])
        assert any("its doubt is too large" in event.text for event in robot.runtime.state.events)


async def test_another_car_is_refused(policy: Policy) -> None:
    with pytest.raises(ConfigError, match="turns within"):
        async with Robot.open("sim", settings=(*ROOM, "geometry.radius_min=0.9"), additions={"teaching": policy}):
            pass


async def test_a_robot_without_the_sensor_is_refused(policy: Policy) -> None:
    with pytest.raises(ConfigError, match="'laser'"):
        async with Robot.open("sim", additions={"teaching": policy}):
            pass


# -- teaching more -----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_policy_is_taught_more_from_its_own_recordings_on(lesson: Path, file: Path, tmp_path: Path) -> None:
    later, output = recorded(tmp_path / "later.mcap", 20.0), tmp_path / "more.onnx"
    few = ["--networks", "1", "--epochs", "2", "--no-report"]
    assert execute(["teach", "--more", str(later), "--from", str(file), "-o", str(output), *few]) == 0
    assert [Path(each.file).name for each in load(output).card.taught_by] == ["lesson.mcap", "later.mcap"]


@pytest.mark.long
def test_a_policy_that_is_taught_more_in_its_place_is_kept(
    lesson: Path, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, few = tmp_path / "track.onnx", ["--networks", "1", "--epochs", "1", "--no-report"]
    copyfile(file, policy)
    monkeypatch.chdir(tmp_path)
    for number, output in ((1, []), (2, ["-o", "track.onnx"])):
        before, later = policy.read_bytes(), recorded(tmp_path / f"later-{number}.mcap", 2.0 + number)
        assert execute(["teach", "--more", str(later), "--from", str(policy), *output, *few]) == 0
        assert (tmp_path / f"track-{number}.onnx").read_bytes() == before != policy.read_bytes()


def test_a_recording_that_breaks_off_is_told(lesson: Path, tmp_path: Path) -> None:
    whole, broken = lesson.read_bytes(), tmp_path / "broken.mcap"
    broken.write_bytes(whole[: len(whole) * 9 // 10])
    assert "breaks off; 'txt1 log recover'" in "\n".join(summary(drive_in(broken, [Ask("laser")])))
    assert "breaks off" not in "\n".join(summary(drive_in(lesson, [Ask("laser")])))


def test_the_same_recording_twice_is_refused(lesson: Path) -> None:
    drive = drive_in(lesson, [Ask("laser")])
    with pytest.raises(RecordingError, match=r"lesson\.mcap: it is the recording .*lesson\.mcap once more"):
        together([drive, drive])


def test_an_output_that_cannot_be_written_is_refused_before_the_training(
    lesson: Path, file: Path, capsys: Capture
) -> None:
    before = file.read_bytes()
    for output, words in ((lesson.parent / "none" / "x.onnx", "there is no folder"), (file, "already; choose another")):
        assert execute(["teach", str(lesson), "-o", str(output), "--see", "laser"]) == 2
        assert words in capsys.readouterr().err
    assert file.read_bytes() == before


def test_a_recording_that_is_gone_or_changed_is_told(policy: Policy, tmp_path: Path, capsys: Capture) -> None:
    gone = replace(policy.card.taught_by[0], file=str(tmp_path / "gone.mcap"))
    other = Policy(replace(policy.card, taught_by=(gone,)), policy.networks)
    other.save(tmp_path / "other.onnx")
    words = ["--more", policy.card.taught_by[0].file, "--from", str(tmp_path / "other.onnx")]
    assert execute(["teach", *words]) != 0
    assert "gone.mcap" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("kind", ["camera", "light", "laser,camera,odometry"])
def test_other_sensors_teach_and_drive_too(kind: str, tmp_path: Path) -> None:
    settings = [f"sensors.{name}.driver=sim_{name}" for name in ("camera", "light")]
    file, asks = recorded(tmp_path / "lesson.mcap", 65.0, *settings), [Ask(each) for each in kind.split(",")]
    found = drive_in(file, asks)  # type: ignore[arg-type]
    assert [sight.kind for sight in found.sights] == kind.split(",")
    assert 60.0 < found.taught.seconds < 66.0
    teach([found], Recipe(members=1, dense=(16,), epochs=3), "today", folds=2).policy.save(tmp_path / "room.onnx")
    policy = load(tmp_path / "room.onnx")

    async def driven() -> tuple[str, float]:
        async with Robot.open("sim", settings=(*ROOM, *settings), additions={"teaching": policy}) as robot:
            await robot.load_gains()
            await asyncio.sleep(3.0)
            return robot.driver.name, robot.odometry.v

    name, v = run(driven(), speed="max")
    assert name == "policy"
    assert v > 0.2


# -- the tutorial ------------------------------------------------------------------------------------------------


BOX = 0.0, 8.0


class Reader:
    """Drives in the middle of the oval, and passes the tutorial's box on the left; takes over from a policy for that.

    After that it takes over only if the policy stands for three seconds.
    """

    def __init__(self, robot: Robot, track: Track, alone: bool, helps: bool) -> None:
        self.robot, self.alone, self.helps = robot, alone, helps
        shift = 0.8 * np.exp(-0.5 * (np.hypot(*(track.line - BOX).T) / 1.1) ** 2)
        line = track.line + shift[:, None] * np.array([0.0, -1.0])
        self.human = Human(track if alone else track._replace(line=line), np.random.default_rng(4), v_max=0.7, look=0.6)
        self.takeovers, self._moved, self._holds = 0, 0.0, False

    def wants(self, now: float, x: float, y: float, theta: float) -> bool:
        """Whether to drive now."""
        if abs(self.robot.odometry.v) > 0.1:
            self._moved = now
        ahead = cos(theta) * (BOX[0] - x) + sin(theta) * (BOX[1] - y)
        near = -1.5 < ahead < 2.2 and abs(y - BOX[1]) < 1.4
        return self.alone or (self.helps and near) or now - self._moved > 3.0 or (self._holds and near)

    async def steer(self, ticks: Ticks) -> None:
        """Drive as a task."""
        hand = self.robot.source("gamepad")
        async for now in ticks:
            assert self.robot.pose is not None
            command = self.human.command(self.robot.pose, self.robot.odometry.v, self.robot.config.geometry.radius_min)
            if wants := self.wants(now, *self.robot.pose):
                hand.command(*command)
                self.takeovers += not self._holds
            elif hand.drives:
                hand.release()
            self._holds = wants


@pytest.mark.long
def test_the_tutorials_lines_teach_a_car_that_needs_fewer_take_overs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Each line of the page, with a simulated hand in place of the reader's.

    Then the first policy drives once more, with a reader who helps no more than in the last line.
    """
    page = Path(__file__).parents[2] / "docs" / "tutorials" / "teach.md"
    lines = [line.strip() for line in page.read_text("utf-8").splitlines() if line.startswith("    txt1 ")]
    monkeypatch.chdir(tmp_path)
    get_ready, readers, track = RunStart.get_ready, list[Reader](), track_of("oval")

    async def with_reader(start: RunStart) -> None:
        await get_ready(start)
        alone = POLICY not in start.robot.runtime.statistics()
        readers.append(Reader(start.robot, track, alone, helps=len(readers) < 2))
        start.robot.add_task("hand", 0.05, readers[-1].steer)

    monkeypatch.setattr(RunStart, "get_ready", with_reader)
    for line in (*lines, lines[-1].replace("track.onnx", "track-1.onnx").replace("third", "fourth")):
        words = shlex.split(line)[1:]
        if words[0] == "run":
            words += ["--headless", "--speed", "max", "--json", "--duration", "130"]
        assert execute(words) == 0, line
    told = capsys.readouterr().out
    _, second, third, first_again = readers
    assert second.takeovers >= 2
    assert third.takeovers < first_again.takeovers
    assert f"{second.takeovers} take-overs from a policy" in told
    assert json.loads(told.splitlines()[-2])["driver"]["name"] == "policy"
    assert {each.name for each in tmp_path.glob("*.onnx")} == {"track.onnx", "track-1.onnx"}
    assert (tmp_path / "track-report" / "worst.png").exists()
