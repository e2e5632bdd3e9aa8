"""Recordings for others: tables of a size that people open, with pictures as files, and counts that agree."""

from __future__ import annotations

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

from txt1.cli import execute
from txt1.commands import OK, USAGE

Capture = pytest.CaptureFixture[str]
SENSORS = ("imu", "laser", "camera", "depth", "gps")


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve seconds with five sensors, two of them cameras."""
    file = tmp_path_factory.mktemp("drive") / "run.mcap"
    sensors = [word for name in SENSORS for word in ("--set", f"sensors.{name}.driver=sim_{name}")]
    run = ("run", "--headless", "--speed", "max", "--seed", "1", "--json", "--duration", "12", "--drive=0.4,0.4")
    assert execute([*run, *sensors, "--log", str(file)]) == OK
    return file


@pytest.fixture(scope="module")
def tables(drive: Path) -> Path:
    """Its CSV files."""
    folder = drive.with_name("csv")
    assert execute(["log", "export", str(drive), "-o", str(folder)]) == OK
    return folder


def rows(file: Path) -> list[dict[str, str]]:
    csv.field_size_limit(sys.maxsize)
    return list(csv.DictReader(file.read_text().splitlines()))


def test_twelve_seconds_with_two_cameras_are_less_than_three_megabytes(tables: Path) -> None:
    assert sum(file.stat().st_size for file in tables.rglob("*") if file.is_file()) < 3_000_000
    names = {file.stem for file in tables.glob("*.csv")}
    assert {"odom", "sensors_laser", "sensors_camera", "rosout"} <= names
    assert not names & {"reports", "input", "steps", "snapshot"}
    assert not names & {"sensors_depth_points", "sensors_gps_fix"}, "other tables have it"
    assert "sensors_depth_camera_info" in names, "the focal length is nowhere else"


def test_pictures_are_files_whose_names_are_in_the_table(tables: Path) -> None:
    for name, mode in (("sensors_camera", "RGB"), ("sensors_depth", "I;16")):
        told = rows(tables / f"{name}.csv")
        assert len(told) == 119 == len({row["data"] for row in told})
        with Image.open(tables / told[50]["data"]) as picture:
            assert (picture.mode, picture.size) == (mode, (160, 120))
            seen = np.asarray(picture)
    # the walls of the room, in mm
    assert 500 < seen[seen > 0].min() < seen.max() < 5000


def test_a_scan_in_a_table_has_the_digits_of_its_32_bits(tables: Path) -> None:
    told = rows(tables / "sensors_laser.csv")[3]["ranges"].strip("[]").replace("Infinity", "inf").split(", ")
    assert len(told) > 600 and all(str(np.float32(each)) == each for each in told)


def test_topics_of_txt1s_own_are_marked_and_exported_by_name(drive: Path, tmp_path: Path, capsys: Capture) -> None:
    assert execute(["log", "info", str(drive)]) == OK
    told = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in told if line.endswith("*")} == {"/reports", "/input", "/snapshot"}
    assert told[-1].startswith("* for txt1's own replay and screens")
    assert execute(["log", "export", str(drive), "--topic", "/input", "-o", str(tmp_path)]) == OK
    assert (tmp_path / "input.csv").exists()


def test_what_other_topics_have_is_marked_and_a_table_of_it_is_asked_for(
    drive: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert execute(["log", "info", str(drive)]) == OK
    told = capsys.readouterr().out.splitlines()
    marked = {line.split()[0] for line in told if line.endswith("+")}
    assert marked == {"/sensors/depth/points", "/sensors/gps/fix"}
    assert told[-2].startswith("+ other topics have its contents, too")
    assert execute(["log", "export", str(drive), "--topic", "/sensors/gps/fix", "-o", str(tmp_path)]) == OK
    assert len(rows(tmp_path / "sensors_gps_fix.csv")) >= 10


def test_one_topic_is_one_file_and_several_are_refused(drive: Path, tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "new" / "odom.csv"
    assert execute(["log", "export", str(drive), "--topic", "/odom", "-o", str(file)]) == OK
    assert file.is_file() and len(rows(file)) == 600
    for topics in ([], ["--topic", "/odom", "--topic", "/pwm"]):
        capsys.readouterr()
        assert execute(["log", "export", str(drive), *topics, "-o", str(tmp_path / "x.csv")]) == USAGE
        told = capsys.readouterr().err
        assert "a single table holds one topic: name it with --topic, or give a folder" in told
    assert not (tmp_path / "x.csv").exists()


def test_parquet_holds_the_same_rows_and_the_pictures(
    drive: Path, tables: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert execute(["log", "export", str(drive), "--parquet", "-o", str(tmp_path / "all")]) == OK
    odometry = parquet.read_table(tmp_path / "all" / "odom.parquet").to_pylist()
    plain = rows(tables / "odom.csv")
    assert [row["pose.pose.position.x"] for row in odometry] == [float(row["pose.pose.position.x"]) for row in plain]
    pictures = parquet.read_table(tmp_path / "all" / "sensors_camera.parquet").to_pylist()
    assert pictures[50]["data"] == (tables / "sensors_camera" / "000050.jpg").read_bytes()
    one = tmp_path / "odom.parquet"
    assert execute(["log", "export", str(drive), "--topic", "/odom", "-o", str(one)]) == OK
    assert parquet.read_table(one).num_rows == 600
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr("txt1.record.command.log.find_spec", lambda name: None)
    capsys.readouterr()
    assert execute(["log", "export", str(drive), "--parquet", "-o", str(tmp_path / "none")]) == USAGE
    assert "--parquet: needs pyarrow: " in capsys.readouterr().err


def test_info_and_verify_count_the_same_messages(drive: Path, capsys: Capture) -> None:
    assert execute(["log", "info", str(drive)]) == OK
    counted = re.search(r"(\d+) messages in", capsys.readouterr().out)
    assert execute(["replay", "--verify", str(drive)]) == OK
    told = capsys.readouterr().out
    compared = re.search(r"no difference in (\d+) of (\d+) messages", told)
    assert counted and compared and compared[2] == counted[1]
    left = [int(number) for number in re.findall(r" (\d+)(?:,|$)", told.splitlines()[1].removeprefix("not compared:"))]
    assert int(compared[1]) + sum(left) == int(compared[2])


def test_ros_plays_latched_topics_as_such(drive: Path) -> None:
    with AnyReader([drive]) as reader:
        offered = {each.topic: each.ext.offered_qos_profiles for each in reader.connections}
    assert {len(profiles) for profiles in offered.values()} == {1}
    for topic, durability in (("/odom", QosDurability.VOLATILE), ("/battery1", QosDurability.TRANSIENT_LOCAL)):
        (profile,) = offered[topic]
        assert (profile.durability, profile.reliability) == (durability, QosReliability.RELIABLE)
        assert profile.lifespan.sec == 9223372036
    with drive.open("rb") as file:
        told = {record.name: record.metadata for record in make_reader(file).iter_metadata()}
    # rosbag2 reads numbers of qualities by this version
    assert json.loads(told["rosbag2"]["serialized_metadata"])["version"] < 9


def without_schemas(path: Path) -> Path:
    """A file of another program, whose channels have no schema."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "another program")
        text = writer.register_channel("/words", "json", 0)
        raw = writer.register_channel("/raw", "protobuf", 0)
        for number in range(3):
            writer.add_message(text, number * 10**8, json.dumps({"number": number}).encode(), number * 10**8)
        writer.add_message(raw, 5, b"\x08\x01", 5)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_channels_without_a_schema_are_listed_and_json_is_read(tmp_path: Path, capsys: Capture) -> None:
    file = str(without_schemas(tmp_path / "theirs.mcap"))
    assert execute(["log", "info", file]) == OK
    told = capsys.readouterr().out
    assert "4 messages" in told
    assert re.search(r"/words +3 .*\(json, without a schema\)", told)
    assert execute(["log", "cat", file, "--topic", "/words"]) == OK
    assert [json.loads(line)["message"] for line in capsys.readouterr().out.splitlines()] == [
        {"number": number} for number in range(3)
    ]
    assert execute(["log", "cat", file]) == 1
    assert "/raw: its messages are encoded as 'protobuf'" in capsys.readouterr().err


def test_topics_whose_names_make_one_file_are_two_files(tmp_path: Path, capsys: Capture) -> None:
    with (tmp_path / "theirs.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("", "another program")
        for time, topic in enumerate(("/a/b", "/a_b")):
            writer.add_message(writer.register_channel(topic, "json", 0), time, b'{"x": 1}', time)
        writer.finish()  # type: ignore[no-untyped-call]
    assert execute(["log", "export", str(tmp_path / "theirs.mcap"), "-o", str(tmp_path / "csv")]) == OK
    assert sorted(file.name for file in (tmp_path / "csv").iterdir()) == ["a_b.csv", "a_b_.csv"]
