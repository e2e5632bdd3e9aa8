"""Recordings of simulated runs: what is in them, that they repeat, and what is left of a file that breaks off."""

from __future__ import annotations

import csv
import errno
import json
import os
import re
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from tests.e2e.recordings import spoil_second_chunk
from txt1.cli import execute
from txt1.commands import need
from txt1.errors import MissingExtra
from txt1.installing import installs
from txt1.record import mcap_file, recorder
from txt1.record.mcap_records import Encoder
from txt1.record.reader import FilePass
from txt1.record.recovery import recover

Capture = pytest.CaptureFixture[str]

EVERY_CYCLE = ("/odom", "/setpoint", "/pwm", "/encoders", "/tf", "/pose")
RUN = ("run", "--headless", "--speed", "max", "--json", "--seed", "1")
LINE = ("run", "--hal", "serial", "--port", "virtual", *RUN[1:])


def record(path: Path, *words: str, start: tuple[str, ...] = RUN, code: int = 0) -> Path:
    """A recording of a run."""
    assert execute([*start, *words, "--log", str(path)]) == code
    return path


@pytest.fixture(scope="module")
def minute(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute of a circle."""
    return record(tmp_path_factory.mktemp("minute") / "run.mcap", "--duration", "60", "--drive", "0.4,0.4")


def stream(path: Path) -> list[tuple[str, int, int, bytes]]:
    """Every message in a file, as the mcap library reads it, its checksums compared."""
    with path.open("rb") as file:
        return [
            (channel.topic, message.sequence, message.log_time, message.data)
            for _, channel, message in make_reader(file, validate_crcs=True).iter_messages()
        ]


@cache
def last(path: Path) -> dict[str, Any]:
    """The last message on every topic, decoded by mcap-ros2-support."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return {channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()}


def metadata(path: Path) -> dict[str, dict[str, str]]:
    with path.open("rb") as file:
        return {record.name: record.metadata for record in make_reader(file).iter_metadata()}


# -- what is in it ---------------------------------------------------------------------------------------------


def test_a_minute_has_one_message_per_controller_cycle_for_the_mcap_library(minute: Path) -> None:
    messages = stream(minute)
    counts = Counter(topic for topic, *_ in messages)
    assert {topic: counts[topic] for topic in EVERY_CYCLE} == dict.fromkeys(EVERY_CYCLE, 3000)
    assert counts["/battery1"] == counts["/battery2"] == 60
    assert counts["/snapshot"] == 61  # one more at the end
    assert counts["/cmd_vel"] > 1190
    times = [time for topic, _, time, _ in messages if topic == "/odom"]
    assert times == [cycle * 20_000_000 for cycle in range(3000)]
    with minute.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    named = {
        channel.topic: summary.statistics.channel_message_counts.get(n, 0) for n, channel in summary.channels.items()
    }
    assert named == counts


@pytest.mark.long
def test_a_minute_is_read_by_mcap_ros2_support(minute: Path) -> None:
    messages = last(minute)
    assert messages["/odom"].header.frame_id == "odom"
    assert messages["/odom"].child_frame_id == "base_footprint"
    assert messages["/odom"].twist.twist.linear.x == pytest.approx(0.4, abs=0.05)
    assert messages["/setpoint"].twist.linear.x == 0.4
    assert messages["/tf"].transforms[0].transform.translation.x == messages["/odom"].pose.pose.position.x
    assert 500 < messages["/pwm"].motor < 3000
    assert messages["/gains"].linear_kp == 11.0
    assert messages["/battery1"].voltage == pytest.approx(12.1, abs=0.1)
    assert messages["/battery1"].present is True and messages["/battery2"].present is False
    assert (messages["/mode"].armed, messages["/mode"].reason) == (False, "the run has ended")
    assert [s.name for s in messages["/diagnostics"].status][:3] == ["task telemetry", "task controller", "task serial"]
    assert messages["/rosout"].msg == "disarmed: the run has ended"


def test_body_light_and_walls_are_there_for_views_in_three_dimensions(minute: Path) -> None:
    body, light, walls = last(minute)["/markers"].markers
    assert (body.type, body.header.frame_id, body.scale.x, body.scale.y) == (1, "base_footprint", 0.51, 0.385)
    assert (light.type, light.header.frame_id, light.pose.position.x) == (2, "room", 0.0)
    assert (walls.type, walls.header.frame_id) == (4, "room")
    corners = [(point.x, point.y) for point in walls.points]
    assert corners == [(2.5, 2.5), (-2.5, 2.5), (-2.5, -2.5), (2.5, -2.5), (2.5, 2.5)]
    assert [each.id for each in (body, light, walls)] == [0, 1, 2]


def test_a_minute_is_read_by_rosbags(minute: Path) -> None:
    with AnyReader([minute]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections if c.topic in EVERY_CYCLE} == dict.fromkeys(
            EVERY_CYCLE, 3000
        )
        read = Counter(c.topic for c, _, raw in reader.messages() if reader.deserialize(raw, c.msgtype) is not None)
    assert {topic: read[topic] for topic in EVERY_CYCLE} == dict.fromkeys(EVERY_CYCLE, 3000)


def test_the_metadata_says_what_ran(minute: Path) -> None:
    about = metadata(minute)["txt1"]
    assert (about["seed"], about["hal"], about["clock"], about["epoch"]) == ("1", "sim", "virtual", "0.0")
    plan = json.loads(about["plan"])
    assert (plan["duration"], plan["drive"]) == (60.0, [0.4, 0.4])
    assert "arm" not in plan and "learn" not in plan  # which were not given
    assert json.loads(about["config"])["control"]["linear"]["kp"] == 11.0
    assert {"txt1", "python", "numpy", "mcap", "wall_start"} <= set(about)
    assert about["format"] == "3"
    assert metadata(minute)["txt1.end"] == {"dropped": "0"}


def test_a_seed_gives_the_same_messages_again_and_another_seed_does_not(tmp_path: Path) -> None:
    words = ("--duration", "10", "--drive", "0.4,0.4")
    first = stream(record(tmp_path / "first.mcap", *words))
    assert stream(record(tmp_path / "again.mcap", *words)) == first
    assert stream(record(tmp_path / "other.mcap", *words, "--seed", "2")) != first


def test_a_recorded_run_is_the_run_it_would_be_without(tmp_path: Path, capsys: Capture) -> None:
    words = [*RUN, "--duration", "6", "--drive", "0.4,0.4"]
    assert execute(words) == 0
    alone = json.loads(capsys.readouterr().out)
    record(tmp_path / "run.mcap", *words[len(RUN) :])
    beside = json.loads(capsys.readouterr().out)
    assert {k: alone[k] for k in ("odometry", "battery", "faults")} == {
        k: beside[k] for k in ("odometry", "battery", "faults")
    }


def test_in_real_time_the_loop_makes_the_records_and_a_thread_only_writes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: dict[str, set[int]] = {"take": set(), "add": set()}
    for owner, name in ((Encoder, "take"), (mcap_file.McapFile, "add")):
        monkeypatch.setattr(owner, name, _noting(getattr(owner, name), threads[name]))
    start = ("run", "--headless", "--json", "--seed", "1")
    record(tmp_path / "run.mcap", "--duration", "1.2", start=(*start, "--speed", "20"))
    assert threads["take"] == {threading.get_ident()}
    assert threads["add"].isdisjoint(threads["take"])


def _noting(method: Callable[..., Any], threads: set[int]) -> Callable[..., Any]:
    def call(*given: Any) -> Any:
        threads.add(threading.get_ident())
        return method(*given)

    return call


def test_the_epoch_is_the_configured_one(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", "--duration", "2", "--set", "record.epoch=1000000000")
    assert min(time for _, _, time, _ in stream(path)) == 10**18


def test_the_line_is_recorded_raw_with_its_direction(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", "--duration", "6", start=LINE)
    pieces: dict[str, bytes] = {"in": b"", "out": b""}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, _, message in reader.iter_decoded_messages(topics=["/link"]):
            pieces[message.direction] += bytes(message.data)
    assert pieces["out"].count(b"\xfa\xfb\x04\x67") > 100  # Velocity at 20 Hz
    assert pieces["in"].count(b"\xfa\xfb\x14\x68") > 80  # odometry at 20 Hz


def test_a_recording_is_not_written_over(tmp_path: Path, capsys: Capture) -> None:
    path = record(tmp_path / "run.mcap", "--duration", "1")
    before = path.read_bytes()
    capsys.readouterr()
    assert execute([*RUN, "--duration", "1", "--log", str(path)]) == 2
    assert "there is such a file already; choose another name" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert execute([*RUN, "--duration", "1", "--log", str(tmp_path / "no" / "run.mcap")]) == 2
    assert "cannot make the recording: No such file or directory" in capsys.readouterr().err


@pytest.mark.long
def test_files_rotate_and_lose_nothing(minute: Path, tmp_path: Path) -> None:
    words = ("--duration", "60", "--drive", "0.4,0.4")
    record(tmp_path / "by_time.mcap", *words, "--set", "record.rotate_time=25")
    parts = [tmp_path / name for name in ("by_time.mcap", "by_time.1.mcap", "by_time.2.mcap")]
    assert [len([m for m in stream(part) if m[0] == "/odom"]) for part in parts] == [1250, 1250, 500]
    assert [message for part in parts for message in stream(part)] == stream(minute)
    record(tmp_path / "by_size.mcap", *words, "--set", "record.rotate_size=0.3")
    sizes = [path.stat().st_size for path in tmp_path.glob("by_size*.mcap")]
    assert len(sizes) >= 3 and max(sizes) < 450_000


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_every_compression_holds_the_same_messages(compression: str, tmp_path: Path) -> None:
    words = ("--duration", "3", "--drive", "0.4,0.4")
    path = record(tmp_path / "run.mcap", *words, "--set", f"record.compression={compression}")
    reference = record(tmp_path / "reference.mcap", *words)
    assert stream(path) == stream(reference)


def test_in_virtual_time_a_full_disk_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    fill_disk(monkeypatch, 100_000)
    assert execute([*RUN, "--duration", "60", "--log", str(tmp_path / "run.mcap")]) == 1
    assert "No space left on device; make room on the disk" in capsys.readouterr().err
    monkeypatch.undo()
    assert {item.topic for item in FilePass(tmp_path / "run.mcap")} >= set(EVERY_CYCLE)


def fill_disk(monkeypatch: pytest.MonkeyPatch, room: int) -> None:
    """From `room` bytes on the disk takes half of a write, and then nothing."""
    real, left = os.write, room

    def write(file: int, data: bytes) -> int:
        nonlocal left
        if left <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        left -= len(data)
        return real(file, data if left >= 0 else data[: len(data) // 2])

    class Os:
        def __getattr__(self, name: str) -> Any:
            return write if name == "write" else getattr(os, name)

    monkeypatch.setattr(mcap_file, "os", Os())


# -- what is left of a file that breaks off --------------------------------------------------------------------


def cut(path: Path, target: Path, every: int) -> Iterator[bytes]:
    """The first `every`, 2 `every`, ... bytes of a file, written to another."""
    data = path.read_bytes()
    for length in range(0, len(data), every):
        target.write_bytes(data[:length])
        yield data[:length]


@pytest.mark.parametrize("every", [6000, pytest.param(1000, marks=pytest.mark.long)])
def test_a_file_cut_anywhere_is_recovered_and_nothing_is_invented(
    every: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "BATCH_MAX", 0.5)  # as many chunks as on the real clock
    path = record(tmp_path / "run.mcap", "--duration", "6", "--drive", "0.4,0.4")
    whole = [(message.channel_id, message.sequence, message.log_time, message.data) for message in raw(path)]
    target, counts = tmp_path / "saved.mcap", []
    for _ in cut(path, tmp_path / "cut.mcap", every):
        saved = recover(tmp_path / "cut.mcap", target)
        found = [(m.channel_id, m.sequence, m.log_time, m.data) for m in raw(target)]
        assert found == whole[: len(found)]
        assert (len(found), saved.was_complete, saved.damaged) == (saved.messages, False, 0)
        with target.open("rb") as file:
            assert make_reader(file).get_summary() is not None
        counts.append(len(found))
        target.unlink()
    assert counts == sorted(counts)
    assert counts[0] == 0 and counts[-1] == len(whole)


def test_a_recovered_file_has_each_channel_once_and_each_message_with_both_its_times(tmp_path: Path) -> None:
    path, target = tmp_path / "run.mcap", tmp_path / "saved.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False, enable_data_crcs=False)
        writer.start("txt1")
        schema = writer.register_schema("txt1_msgs/Any", "ros2msg", b"float64 x")
        channels = [writer.register_channel(f"/{name}", "cdr", schema) for name in "ab"]
        again = RecordBuilder()
        Channel(channels[0], "/a", "cdr", {}, schema).write(again)
        for k in range(10):
            writer.add_message(channels[k % 2], 1000 + k, bytes(8), 500 + k, k)
            if k == 5:
                file.write(again.end())  # a channel is told again, as the format allows
        writer.finish()
    assert recover(path, target).messages == 10
    assert [(m.log_time, m.publish_time, m.sequence) for m in raw(target)] == [
        (1000 + k, 500 + k, k) for k in range(10)
    ]
    with target.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert [each.topic for each in summary.channels.values()] == ["/a", "/b"]
    assert [each.name for each in summary.schemas.values()] == ["txt1_msgs/Any"]


def raw(path: Path) -> list[Message]:
    """Every message in the order of the file."""
    return [record for record in FilePass(path).records() if isinstance(record, Message)]


def test_a_chunk_with_a_wrong_byte_is_left_out(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", "--duration", "20", "--drive", "0.4,0.4")
    spoil_second_chunk(path, tmp_path / "bad.mcap")
    saved = recover(tmp_path / "bad.mcap", tmp_path / "saved.mcap")
    assert (saved.damaged, saved.was_complete) == (1, True)
    every, found = {message[1:] for message in stream(path)}, stream(tmp_path / "saved.mcap")
    assert {message[1:] for message in found} < every
    assert len(found) == saved.messages > len(every) / 2


def test_what_is_no_recording_is_said_to_be_none(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "text.mcap").write_text("this is a letter, no recording")
    for words in (["info"], ["cat"], ["export"], ["recover"]):
        assert execute(["log", *words, str(tmp_path / "text.mcap")]) == 1
        assert "no MCAP file, it begins otherwise" in capsys.readouterr().err
        assert execute(["log", *words, str(tmp_path / "none.mcap")]) == 2
        assert "there is no file" in capsys.readouterr().err
    assert not (tmp_path / "text.recovered.mcap").exists()


def test_a_message_that_its_damaged_definition_does_not_fit_is_an_error_in_words(
    tmp_path: Path, capsys: Capture
) -> None:
    path = record(tmp_path / "run.mcap", "--duration", "1")
    path.write_bytes(
        path.read_bytes().replace(b"geometry_msgs/PoseWithCovariance pose", b"geometry_msgs/PoseWithBovariance pose")
    )
    assert execute(["log", "cat", str(path), "--topic", "/odom"]) == 1
    assert "txt1: /odom: a message is not as its definition 'nav_msgs/msg/Odometry'" in capsys.readouterr().err
    assert execute(["log", "cat", str(path), "--topic", "/setpoint"]) == 0


# -- txt1 log --------------------------------------------------------------------------------------------------


def test_log_info_counts_topics_rates_and_gaps(minute: Path, capsys: Capture) -> None:
    assert execute(["log", "info", str(minute)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("complete")
    rows = {words[0]: words[1:] for line in lines if (words := line.split())}
    assert rows["/odom"] == ["3000", "50.00", "0.020", "0", "nav_msgs/msg/Odometry"]
    assert rows["/battery1"][:3] == ["60", "1.00", "1.000"]


def test_log_info_tells_of_what_is_missing(tmp_path: Path, capsys: Capture) -> None:
    path = record(tmp_path / "run.mcap", "--duration", "20")
    spoil_second_chunk(path, tmp_path / "bad.mcap")
    capsys.readouterr()
    assert execute(["log", "info", str(tmp_path / "bad.mcap")]) == 0
    out = capsys.readouterr().out
    assert "1 damaged chunks left out; 'txt1 log recover' makes a complete file of it" in out
    odom = next(line for line in out.splitlines() if line.startswith("/odom"))
    assert odom.split()[1:5] == ["750", "37.49", "5.020", "250"]


def test_log_cat_prints_messages_as_json(minute: Path, capsys: Capture) -> None:
    assert execute(["log", "cat", str(minute), "--topic", "/odom", "--from", "30", "--to", "30.1"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["time"] for line in lines] == [30.0, 30.02, 30.04, 30.06, 30.08, 30.1]
    assert lines[0]["message"]["twist"]["twist"]["linear"]["x"] == pytest.approx(0.4, abs=0.05)
    assert execute(["log", "cat", str(minute), "--topic", "/battery1"]) == 0
    out = capsys.readouterr().out
    assert "NaN" not in out, "that is no JSON"
    assert json.loads(out.splitlines()[0])["message"]["temperature"] is None


def test_log_export_writes_csv(minute: Path, tmp_path: Path, capsys: Capture) -> None:
    words = ["log", "export", str(minute), "--topic", "/setpoint", "--topic", "/pwm", "-o", str(tmp_path / "csv")]
    assert execute(words) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{tmp_path / 'csv' / 'setpoint.csv'}: 3000 rows",
        f"{tmp_path / 'csv' / 'pwm.csv'}: 3000 rows",
    ]
    rows = list(csv.DictReader((tmp_path / "csv" / "setpoint.csv").read_text().splitlines()))
    assert (rows[-1]["time"], rows[-1]["twist.linear.x"], rows[-1]["twist.angular.z"]) == ("59.98", "0.4", "0.4")


def test_log_recover_makes_a_complete_file(minute: Path, tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "cut.mcap").write_bytes(minute.read_bytes()[:400_000])
    assert execute(["log", "info", str(tmp_path / "cut.mcap")]) == 0
    assert "breaks off; 'txt1 log recover' makes a complete file of it" in capsys.readouterr().out
    assert execute(["log", "recover", str(tmp_path / "cut.mcap")]) == 0
    assert "messages, " in capsys.readouterr().out
    assert execute(["log", "info", str(tmp_path / "cut.recovered.mcap")]) == 0
    assert capsys.readouterr().out.splitlines()[0].endswith("complete")
    assert execute(["log", "recover", str(tmp_path / "cut.mcap")]) == 1
    assert "choose another name with -o" in capsys.readouterr().err


def test_a_missing_extra_is_one_line_that_names_it() -> None:
    with pytest.raises(MissingExtra, match=f"recording needs the extra 'record': {re.escape(installs('record'))}"):
        need("recording", "record", "mcap", "no_such_module")


@pytest.mark.parametrize("words", [("log", "info"), ("log", "recover"), ("replay",), ("report",)])
def test_a_command_on_a_recording_names_the_extra_that_it_lacks(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Capture
) -> None:
    monkeypatch.setattr("txt1.commands.find_spec", lambda name: None)
    assert execute([*words, str(tmp_path / "run.mcap")]) == 2
    told = capsys.readouterr().err
    assert told.startswith("txt1: reading a recording needs the extra 'record': ") and told.count("\n") == 1
    assert told.endswith(f"{installs('record')}\n")


def test_numpy_is_not_imported_while_a_recorded_robot_runs(tmp_path: Path) -> None:
    """An import within a tick misses cycles: numpy takes a third of a second on a slow computer."""
    code = """
import sys
from pathlib import Path
from txt1 import Robot, run
from txt1.config import load
from txt1.record.session import recording

async def main():
    config = load(None, ["seed=1"]).config
    before = set()

    async with recording(Path(sys.argv[1]), config, None, {}, print) as record:
        def attach(runtime):
            record(runtime)
            before.update(sys.modules)

        async with Robot.open(config=config, attach=attach) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 0.5)
    assert before
    assert "numpy" not in set(sys.modules) - before

run(main(), speed="max")
"""
    command = [sys.executable, "-c", code, str(tmp_path / "run.mcap")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
