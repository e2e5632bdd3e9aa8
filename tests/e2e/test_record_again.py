"""Guards, the estimate and whatever else reads a sensor work in a replay, with the readings of the recording."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from blockbuster import BlockBuster
from mcap.reader import make_reader
from mcap.writer import Writer

from tests.e2e.conftest import ENDLESS, may_block
from tests.patience import PATIENT
from txt1.cli import execute
from txt1.config import Config, load
from txt1.errors import HalError, NotArmed, RecordingError
from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.hal.base import Capabilities, Inputs
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel.loop import Speed, run
from txt1.model.odometry import Odometry
from txt1.record.cdr import MessageBuffer
from txt1.record.session import recording
from txt1.record.verification import verify
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sensors.base import Reading, reading_topic
from txt1.sensors.registry import DRIVERS

LASER = ("sensors.laser.driver=sim_laser",)
clocks = pytest.mark.parametrize("speed", ["max", pytest.param(None, marks=pytest.mark.long)])
RUN = ("run", "--json", "--speed", "max", "--seed", "1")


@pytest.fixture(autouse=True)
def a_verification_may_block(blocking_calls_fail: BlockBuster) -> None:
    """It reads its recording in the loop: nobody waits for a tick."""
    may_block(blocking_calls_fail, "txt1/record/comparison.py", "write", "close")
    may_block(blocking_calls_fail, "txt1/record/recorder.py", "_write", "_close_sinks")


def recorded(
    path: Path,
    program: Callable[[Robot], Any],
    *settings: str,
    speed: Speed = "max",
    hal: Any = None,
    attach: Callable[[Runtime], None] = lambda runtime: None,
) -> Path:
    """A recording of a user's program."""

    async def main() -> None:
        config = load(None, ("seed=1", *settings)).config
        async with recording(path, config, speed, {}, print) as record:

            def both(runtime: Runtime) -> None:
                record(runtime)
                attach(runtime)

            layer = None if hal is None else hal(config)
            async with Robot.open(layer, config=config, arm=True, attach=both) as robot:
                await robot.load_gains()
                await program(robot)

    run(main(), speed=speed)
    return path


async def drive(robot: Robot) -> None:
    with suppress(NotArmed):
        await robot.drive(0.8, 0.0, 3.0)


async def drive_on(robot: Robot) -> None:
    """Drive, and wait for the end of the run, though a stall of the machine may have disarmed the robot."""
    await drive(robot)
    await asyncio.Future()


def rewritten(
    source: Path,
    target: Path,
    about: Callable[[dict[str, str]], dict[str, str]] = lambda about: about,
    message: Callable[[str, int, bytes], bytes | None] = lambda topic, time, data: data,
) -> Path:
    """A copy with other metadata and other messages; None leaves one out."""
    with source.open("rb") as file, target.open("wb") as copy:
        reader, writer = make_reader(file), Writer(copy)
        writer.start("ros2")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, about(record.metadata) if record.name == "txt1" else record.metadata)
        summary = reader.get_summary()
        assert summary is not None
        for schema in summary.schemas.values():
            writer.register_schema(schema.name, schema.encoding, schema.data)
        for channel in summary.channels.values():
            writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id, channel.metadata)
        for _, channel, each in reader.iter_messages(log_time_order=False):
            data = message(channel.topic, each.log_time, each.data)
            if data is not None:
                writer.add_message(channel.id, each.log_time, data, each.publish_time, each.sequence)
        writer.finish()
    return target


# -- guards and the estimate -------------------------------------------------------------------------------------


def test_an_obstacle_stop_replays_exactly(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.mcap"
    words = ["--duration", "6", "--drive", "0.8,0", "--set", LASER[0], "--log", str(path)]
    assert execute([*RUN, *words]) == 0
    assert json.loads(capsys.readouterr().out)["faults"]["slowed_for_obstacle"] > 0
    assert execute(["replay", "--verify", str(path)]) == 0
    verdict = verify(path)
    assert {"/sensors", "/sensors/laser", "/snapshot"} <= verdict.topics.keys()
    assert verdict.left_out == ("/driver", "/reports", "/snapshot /driver", "/tf_static")


def test_another_guard_than_then_is_found_where_it_slows(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", drive, *LASER)

    def careful(about: dict[str, str]) -> dict[str, str]:
        config = json.loads(about["config"])
        config["obstacle_stop"] = {"margin": ObstacleStop().margin + 0.1}
        return about | {"config": json.dumps(config)}

    difference = verify(rewritten(path, tmp_path / "careful.mcap", careful)).difference
    assert difference is not None and difference.time > 1.0


@clocks
def test_the_velocity_loops_go_by_the_filter_again(speed: Speed, tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        with suppress(NotArmed):  # a slow machine misses cycles
            await robot.drive(0.5, 0.5, 1.0)
            robot.place(0.5, 0.5, 1.0)
            await robot.drive(0.4, -0.4, 0.6)

    settings = (*ENDLESS, "estimation.preset=vicon", "estimation.loops=true", "sensors.vicon.driver=sim_vicon")
    settings = (*settings, "sensors.vicon.delay=0.03", "sensors.vicon.drop_out=0.2", "sim.vehicle.slip=0.05")
    verdict = verify(recorded(tmp_path / "run.mcap", program, *settings, speed=speed))
    assert verdict.difference is None
    assert {"/odometry/filtered", "/estimation", "/sensors/imu", "/sensors/vicon"} <= verdict.topics.keys()


def test_a_robot_that_takes_fewer_steps_than_then_is_found_out(tmp_path: Path) -> None:
    def encoders_alone(about: dict[str, str]) -> dict[str, str]:
        config = json.loads(about["config"])
        config["estimation"]["loops"] = False
        return about | {"config": json.dumps(config)}

    path = recorded(tmp_path / "run.mcap", drive, "estimation.preset=gyro", "estimation.loops=true")
    assert verify(path).difference is None
    assert verify(rewritten(path, tmp_path / "other.mcap", encoders_alone)).difference is not None


class Thermometer:
    """A sensor of a stranger's: warms up, and is out of order for a while."""

    simulated = True
    period = 0.05
    topic = reading_topic("inside", float, "degrees Celsius", "warmth")

    async def open(self) -> None:
        pass

    async def close(self) -> None:
        pass

    def read(self, now: float) -> Reading[float] | None:
        if 1.4 <= now < 1.7:
            raise HalError("the thermometer is out of order")
        return Reading(max(0.0, now - 0.01), 20.0 + 5.0 * now)


@pytest.fixture
def thermometer(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(DRIVERS.table, "warmth", lambda setup: Thermometer())  # type: ignore[arg-type]
    return "sensors.inside.driver=warmth"


def cool_down(runtime: Runtime) -> None:
    """A stranger's guard: the hotter, the slower."""

    def guard(v: float, omega: float, now: float) -> tuple[float, float]:
        polled = runtime.sensors["inside"]
        if polled.last is None or polled.reason:
            return 0.0, 0.0
        share = 10.0 / polled.last.value
        return v * share, omega * share

    runtime.guard("cool down", guard)


@clocks
def test_a_guard_of_a_strangers_gets_its_readings_again(speed: Speed, thermometer: str, tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", drive, thermometer, speed=speed, attach=cool_down)
    verdict = verify(path, attach=cool_down)
    assert verdict.difference is None
    assert {"/sensors", "/sensors/inside"} <= verdict.topics.keys()
    without = verify(path).difference
    assert without is not None and without.topic in ("/setpoint", "/pwm", "/gains")


def test_a_sensor_that_nobody_needs_for_a_while_is_left_alone_again(thermometer: str, tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        robot.runtime.sensors["inside"].needed = lambda: robot.now < 2.0 or robot.now > 3.5
        await drive(robot)

    verdict = verify(recorded(tmp_path / "run.mcap", program, thermometer))
    assert verdict.difference is None
    assert 40 < verdict.topics["/sensors/inside"] < 60


# -- hardware ----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_board_over_the_wire_on_the_real_clock_replays_exactly(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.mcap"
    words = ["run", "--json", "--hal", "serial", "--port", "virtual", "--duration", "3.5", "--drive", "0.4,0.4"]
    assert execute([*words, "--log", str(path)]) in (0, 3, 6)  # 3: a slow machine misses cycles
    assert execute(["replay", "--verify", str(path)]) == 0
    assert "no difference in" in capsys.readouterr().out


class Hardware(SimHal):
    """Hardware that computes its odometry itself, in a time of its own, and breaks."""

    name = "hardware"
    capabilities = Capabilities(pose=True, simulated=True)
    reads = 0

    def read(self, now: float) -> Inputs:
        self.reads += 1
        if now > 2.0:
            raise HalError("the plug was pulled")
        return Inputs(odometry=Odometry(v=0.1 * (self.reads // 7 % 3)), odometry_time=now, backlight=0.01 * self.reads)


def hardware(config: Config) -> Hardware:
    return Hardware(create(config).vehicle)  # type: ignore[attr-defined]


def test_hardware_reports_again_what_it_reported_and_fails_as_it_did(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with pytest.raises(Exception, match="the plug was pulled"):
        recorded(path, drive_on, *PATIENT, speed=None, hal=hardware)
    verdict = verify(path)
    assert verdict.difference is None
    assert verdict.compared > 300


# -- several robots ----------------------------------------------------------------------------------------------


def test_robots_that_collide_collide_again(tmp_path: Path, capsys: Any) -> None:
    plan, path = tmp_path / "fleet.yaml", tmp_path / "fleet.mcap"
    plan.write_text("robots:\n  txt01: {start: [0, 0, 0]}\n  txt02: {start: [1.2, 0, 3.14159]}\n")
    words = ["--json", "--speed", "max", "--seed", "1", "--duration", "4", "--drive", "0.5,0", "--log", str(path)]
    assert execute(["fleet", str(plan), *words]) == 3, "both run against something"
    assert verify(path).difference is None
    alone = verify(path, "txt02")
    assert alone.difference is None
    assert 2 * alone.compared == pytest.approx(verify(path).compared, rel=0.05)


# -- other computers, and older recordings -----------------------------------------------------------------------


def elsewhere(about: dict[str, str]) -> dict[str, str]:
    return about | {"processor": "another one"}


@pytest.mark.parametrize(("off", "found"), [(1e-9, False), (1e-3, True)])
def test_numbers_of_another_processor_are_compared_within_a_millionth(
    off: float, found: bool, tmp_path: Path, capsys: Any
) -> None:
    path = recorded(tmp_path / "run.mcap", drive)
    layout = MessageBuffer("geometry_msgs/TwistStamped", {"header": {"frame_id": "base_footprint"}})
    place, _ = layout.places["twist.angular.z"]

    def change(topic: str, time: int, data: bytes) -> bytes:
        if topic != "/setpoint" or time != 2_000_000_000:
            return data
        return data[:place] + struct.pack("<d", off) + data[place + 8 :]

    there = rewritten(path, tmp_path / "there.mcap", elsewhere, change)
    verdict = verify(there)
    assert not verdict.exact
    assert (verdict.difference is not None) is found
    assert execute(["replay", "--verify", str(there)]) == int(found)
    assert "numbers compared within 1e-06: recorded with another processor or library" in capsys.readouterr().out
    here = verify(rewritten(path, tmp_path / "here.mcap", message=change)).difference
    assert here is not None and here.field == "twist.angular.z", "on the same one every bit counts"


def test_an_older_recording_says_what_it_lacks(tmp_path: Path, capsys: Any) -> None:
    def older(about: dict[str, str]) -> dict[str, str]:
        config = json.loads(about["config"])
        config["sensors"] = {"laser": {"driver": "sim_laser"}}
        return about | {"config": json.dumps(config)}

    path = recorded(tmp_path / "run.mcap", drive)
    old = rewritten(path, tmp_path / "old.mcap", older, lambda topic, time, data: None if topic == "/reports" else data)
    assert execute(["replay", "--verify", str(old)]) == 0
    assert "it is older than this version and has no exact readings" in capsys.readouterr().out


def test_a_recording_with_former_names_of_settings_is_run_again(tmp_path: Path) -> None:
    def former(about: dict[str, str]) -> dict[str, str]:
        config = json.loads(about["config"])
        config["learning"] = {"gamma": 0.25}
        return about | {"config": json.dumps(config)}

    path = recorded(tmp_path / "run.mcap", drive)
    assert verify(rewritten(path, tmp_path / "old.mcap", former)).difference is None


def test_a_reading_that_cannot_be_read_any_more_is_named(thermometer: str, tmp_path: Path) -> None:
    def damaged(topic: str, time: int, data: bytes) -> bytes:
        return data.replace(b"\x09\x00\x00\x00d", b"\x09\x00\x00\x00?") if topic == "/reports" else data

    path = recorded(tmp_path / "run.mcap", drive, thermometer)
    with pytest.raises(RecordingError, match=r"/reports: a reading of 'inside' at .* cannot be given again"):
        verify(rewritten(path, tmp_path / "bad.mcap", message=damaged))


def test_what_was_refused_is_refused_again(tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        with pytest.raises(ValueError, match="wall"):
            robot.place(2.4, 0.0, 0.0)
        await robot.drive(0.4, 0.2, 0.5)

    assert verify(recorded(tmp_path / "run.mcap", program)).difference is None
