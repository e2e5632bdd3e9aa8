"""A recorded simulation replays exactly, and one altered value is found at its tick."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import pytest
from blockbuster import BlockBuster
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory

from tests.e2e.conftest import may_block
from tests.e2e.recordings import spoil_second_chunk
from tests.patience import PATIENT
from txt1.cli import execute
from txt1.config import load
from txt1.control.pid import Gains
from txt1.errors import CommandRefused, TaskFault
from txt1.hal.base import Button
from txt1.kernel.loop import Speed, run
from txt1.kernel.ticks import Ticks
from txt1.protocol.layout import from_numbers, numbers
from txt1.protocol.messages import PidSet, PowerControl, PwmTest, Switch, Velocity
from txt1.record.cdr import MessageBuffer
from txt1.record.reader import FilePass
from txt1.record.session import recording
from txt1.record.verification import verify
from txt1.robot import Robot

RUN = ("run", "--headless", "--speed", "max", "--json", "--seed", "1")


@pytest.fixture(autouse=True)
def a_verification_may_block(blocking_calls_fail: BlockBuster) -> None:
    """It reads its recording in the loop: nobody waits for a tick."""
    may_block(blocking_calls_fail, "txt1/record/verification.py", "_replay", "_replay_steps", "write", "close")
    may_block(blocking_calls_fail, "txt1/record/recorder.py", "_write", "_close_sinks")


def recorded(path: Path, program: Callable[[Robot], Any], *settings: str, speed: Speed = "max") -> Path:
    """A recording of a user's program."""

    async def main() -> None:
        config = load(None, settings if speed else (*PATIENT, *settings)).config
        async with (
            recording(path, config, speed, {}, print) as attach,
            Robot.open(config=config, attach=attach) as robot,
        ):
            await robot.load_gains()
            await program(robot)

    run(main(), speed=speed)
    return path


async def drive_about(robot: Robot) -> None:
    """Everything a program can do to a simulated robot."""
    await robot.drive(0.5, 0.3, 2.0)
    robot.place(1.0, 1.0, 0.5)
    await robot.load_gains(linear=Gains(9.0, 15.0, 0.2))
    await robot.drive(-0.4, 0.2, 1.513)
    robot.disarm("a look around")
    robot.arm()
    await robot.set_manual(True)
    await robot.hold_pwm(1500, 3000, -3000, 100, -100, duration=0.7)
    await robot.set_manual(False)
    robot.servos(500, -500)
    for refused in (lambda: robot.servos(nan, 0), lambda: robot.command(10**400, 0.0)):
        with pytest.raises(CommandRefused):
            refused()
    robot.press(Button.RIGHT)
    robot.combined_odometry(0.0, 0.0, 0.0, 0.1, 0.1)
    robot.switch_power(Switch.ESC, False)
    robot.stop()
    robot.arm()
    robot.tell("that was it")


def altered(
    source: Path, target: Path, topic: str, cycle: int, change: Callable[[bytes], bytes], with_: bytes = b""
) -> Path:
    """A copy in which the first message of a topic from a cycle on, with these bytes in it, is another one."""
    done = False
    with source.open("rb") as file, target.open("wb") as copy:
        reader, writer = make_reader(file), Writer(copy)
        writer.start("ros2")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        summary = reader.get_summary()
        assert summary is not None
        for schema in summary.schemas.values():
            writer.register_schema(schema.name, schema.encoding, schema.data)
        for channel in summary.channels.values():
            writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id, channel.metadata)
        for _, channel, each in reader.iter_messages(log_time_order=False):
            data = each.data
            if channel.topic == topic and each.log_time >= cycle * 20_000_000 and with_ in data and not done:
                done, data = True, change(data)
            writer.add_message(channel.id, each.log_time, data, each.publish_time, each.sequence)
        writer.finish()
    assert done
    return target


def with_number(layout: MessageBuffer, path: str, value: float) -> Callable[[bytes], bytes]:
    """What puts another number into a message of this layout."""
    offset, code = layout.places[path]

    def change(data: bytes) -> bytes:
        packed = struct.pack(f"<{code}", value)
        return data[:offset] + packed + data[offset + len(packed) :]

    return change


@pytest.mark.parametrize("hal", [("--hal", "sim"), ("--hal", "serial", "--port", "virtual")])
def test_a_recorded_simulation_replays_exactly(hal: tuple[str, ...], tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.mcap"
    assert execute([*RUN, *hal, "--duration", "20.01", "--drive", "0.4,0.4", "--log", str(path)]) == 0
    capsys.readouterr()
    assert execute(["replay", "--verify", str(path)]) == 0
    assert "no difference in" in capsys.readouterr().out


def test_a_program_that_does_everything_replays_exactly(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", drive_about, "seed=3", "record.epoch=1763700000.25")
    verdict = verify(path)
    assert verdict.difference is None
    assert verdict.compared > 500


def test_a_run_that_the_safety_gate_ended_replays_exactly(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    assert execute([*RUN, "--duration", "12", "--drive", "0.5,0", "--log", str(path)]) == 3  # into the wall
    assert verify(path).difference is None


def test_a_run_in_which_the_robot_learns_replays_exactly(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    assert execute([*RUN, "--duration", "20", "--learn", "thesis", "--log", str(path)]) in (0, 3)
    assert verify(path).difference is None


def test_a_recording_that_breaks_off_replays_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    assert execute([*RUN, "--duration", "20", "--drive", "0.4,0.4", "--log", str(path)]) == 0
    path.write_bytes(path.read_bytes()[:200_000])
    verdict = verify(path)
    assert verdict.difference is None
    assert verdict.compared > 500


def test_one_altered_gain_is_found_at_its_tick(tmp_path: Path, capsys: Any) -> None:
    async def program(robot: Robot) -> None:
        await robot.drive(0.5, 0.3, 2.0)
        await robot.load_gains(linear=Gains(9.0, 15.0, 0.2))
        await robot.drive(0.5, 0.3, 2.0)

    path = recorded(tmp_path / "run.mcap", program)
    assert verify(path).difference is None
    loaded = [item for item in inputs(path) if item.kind == "PidSet"][-1]
    time = loaded.header.stamp.sec + loaded.header.stamp.nanosec / 1e9
    cycle = int(time / 0.02) + 1
    layout = MessageBuffer("txt1_msgs/Input", {"kind": "PidSet", "values": [0.0] * len(loaded.values)})
    change = with_number(layout, "values.0", 9.001)
    bad = altered(path, tmp_path / "bad.mcap", "/input", int(time / 0.02), change, b"PidSet")
    difference = verify(bad).difference
    assert difference is not None
    assert (difference.cycle, difference.topic, difference.field) == (cycle, "/gains", "linear_kp")
    assert (difference.recorded, difference.replayed) == (9.0, 9.001)
    assert execute(["replay", "--verify", str(bad)]) == 1
    out = capsys.readouterr().out
    assert f"first difference in cycle {cycle} " in out and "/gains linear_kp was 9.0, now it is 9.001" in out


def inputs(path: Path) -> list[Any]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics=["/input"])]


def test_an_altered_output_is_found_at_its_tick(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    assert execute([*RUN, "--duration", "5", "--drive", "0.4,0.4", "--log", str(path)]) == 0
    layout = MessageBuffer("txt1_msgs/Pwm", {"header": {"frame_id": "base_footprint"}})
    bad = altered(path, tmp_path / "bad.mcap", "/pwm", 123, with_number(layout, "motor", 1))
    difference = verify(bad).difference
    assert difference is not None
    assert (difference.cycle, difference.topic, difference.field, difference.recorded) == (123, "/pwm", "motor", 1)


@pytest.mark.usefixtures("patient")
def test_a_program_that_does_everything_on_the_real_clock_replays_exactly(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", drive_about, "seed=3", "record.epoch=1763700000.25", speed=None)
    verdict = verify(path)
    assert verdict.difference is None
    assert verdict.compared > 500


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_a_late_run_on_the_real_clock_replays_exactly(tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        async def stall(ticks: Ticks) -> None:
            async for _ in ticks:
                until = time.perf_counter() + 0.07  # three cycles of the controller pass
                while time.perf_counter() < until:
                    pass

        robot.add_task("stall", 0.4, stall)
        await robot.drive(0.5, 0.3, 2.0)
        assert robot.runtime.statistics()["controller"].misses > 3

    path = recorded(tmp_path / "run.mcap", program, speed=None)
    assert verify(path).difference is None


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_a_recording_on_the_real_clock_that_breaks_off_replays_as_far_as_it_goes(tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        await robot.drive(0.4, 0.4, 3.0)

    path = recorded(tmp_path / "run.mcap", program, speed=None)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    verdict = verify(path)
    assert verdict.difference is None
    assert verdict.compared > 500


@pytest.mark.long
@pytest.mark.usefixtures("patient")
def test_one_altered_gain_on_the_real_clock_is_found_at_its_tick(tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        await robot.drive(0.5, 0.3, 1.5)
        await robot.load_gains(linear=Gains(9.0, 15.0, 0.2))
        await robot.drive(0.5, 0.3, 0.5)

    path = recorded(tmp_path / "run.mcap", program, speed=None)
    assert verify(path).difference is None
    loaded = [item for item in inputs(path) if item.kind == "PidSet"][-1]
    time = loaded.header.stamp.sec + loaded.header.stamp.nanosec / 1e9
    reading = FilePass(path)
    # time stamps are times of day
    began = next(item.time - reading.run_time(item) for item in reading)
    layout = MessageBuffer("txt1_msgs/Input", {"kind": "PidSet", "values": [0.0] * len(loaded.values)})
    change = with_number(layout, "values.0", 9.001)
    bad = altered(path, tmp_path / "bad.mcap", "/input", int(time / 0.02), change, b"PidSet")
    difference = verify(bad).difference
    assert difference is not None
    assert difference.cycle - int((time - began) / 0.02) in (0, 1)
    assert (difference.topic, difference.field) == ("/gains", "linear_kp")
    assert (difference.recorded, difference.replayed) == (9.0, 9.001)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("clock", ["max", None])
def test_a_run_that_an_error_of_the_users_ended_replays_exactly(clock: Speed, tmp_path: Path) -> None:
    async def program(robot: Robot) -> None:
        async def fail(ticks: Ticks) -> None:
            async for now in ticks:
                if now > 1.0:
                    raise ArithmeticError("a mistake in the program")

        robot.add_task("mine", 0.05, fail)
        await robot.drive(0.5, 0.3, 2.0)

    with pytest.raises(TaskFault, match="a mistake in the program"):
        recorded(tmp_path / "run.mcap", program, speed=clock)
    assert verify(tmp_path / "run.mcap").difference is None


def test_on_the_real_clock_a_board_cannot_be_verified(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.mcap"
    words = ("board", "--tcp", "0")
    assert execute([*words, "--json", "--duration", "0.3", "--log", str(path)]) in (0, 3)
    assert execute(["replay", "--verify", str(path)]) == 1
    assert "a board, and hardware in recordings of older versions, has a time of its own" in capsys.readouterr().err


def test_of_a_recording_in_parts_the_first_is_verified(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.mcap"
    words = ["--duration", "20", "--drive", "0.4,0.4", "--set", "record.rotate_time=10"]
    assert execute([*RUN, *words, "--log", str(path)]) == 0
    assert verify(path).difference is None
    assert execute(["replay", "--verify", str(tmp_path / "run.1.mcap")]) == 1
    assert "a later part of a recording; only the first begins where the run does" in capsys.readouterr().err


def test_a_recording_of_which_nothing_is_left_is_not_called_the_same(tmp_path: Path, capsys: Any) -> None:
    whole, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    assert execute([*RUN, "--duration", "3", "--drive", "0.4,0.4", "--log", str(whole)]) == 0
    cut.write_bytes(whole.read_bytes()[:20_000])  # the head, and a part of the first chunk
    assert execute(["replay", "--verify", str(cut)]) == 1
    out, err = capsys.readouterr()
    assert "no difference" not in out
    assert "nothing can be compared" in err


def test_a_recording_with_a_gap_is_not_verified(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "run.mcap"
    assert execute([*RUN, "--duration", "20", "--log", str(path)]) == 0
    spoil_second_chunk(path, path)
    assert execute(["replay", "--verify", str(path)]) == 1
    assert "messages are missing in the middle" in capsys.readouterr().err


def test_what_is_no_recording_of_a_run_cannot_be_verified(tmp_path: Path, capsys: Any) -> None:
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    assert execute(["replay", "--verify", str(tmp_path / "other.mcap")]) == 1
    assert "no configuration in it" in capsys.readouterr().err


def test_messages_are_the_same_after_a_recording() -> None:
    for each in (
        Velocity(0.5, -0.25),
        PwmTest(1, -2, 3, -4, 5),
        PowerControl(Switch.ESC, False),
        PidSet((1.0, 2.0, 3.0), ((0.1, 4.0, 5.0, 6.0), (0.2, 7.0, 8.0, 9.0))),
    ):
        assert from_numbers(type(each).__name__, numbers(each)) == each


def test_the_metadata_can_be_run_again(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", drive_about, "sim.room.length=.inf")
    with path.open("rb") as file:
        about = next(make_reader(file).iter_metadata()).metadata
    assert json.loads(about["config"])["sim"]["room"]["length"] == float("inf")
    assert verify(path).difference is None
