"""Bags of ROS 1 and 2, written by rosbags: maps of them, their summary, and errors in words."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from rigs.ros_bags import MOUNT, SIDE, bag, poses
from txt1.bags import reader
from txt1.bags.frames import FrameTree
from txt1.bags.reader import Bag, BagError, is_bag
from txt1.cli import execute
from txt1.mapping import bag_drives
from txt1.maps import files


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def ros1(folder: Path) -> Path:
    return bag(folder / "one.bag", "ros1")


@pytest.fixture(scope="module")
def sqlite(folder: Path) -> Path:
    return bag(folder / "two", "sqlite3")


@pytest.fixture(scope="module")
def mcap(folder: Path) -> Path:
    """A single file of ROS 2, without its folder's metadata."""
    (file,) = bag(folder / "three", "mcap", "tf").glob("*.mcap")
    return file


def off_walls(name: Path) -> float:
    """The share of a map's walls that are 10 cm or more off the room's, whose frame is the laser's first pose."""
    grid = files.read(f"{name}.yaml").grid
    rows, columns = np.nonzero(grid.cells == 100)
    x, y = grid.to_room(columns + 1.5, rows + 1.5)
    # the map begins at the laser's first pose on the room's floor
    start = poses(1)[0]
    theta = start[2] + MOUNT[2]
    lx = start[0] + np.cos(start[2]) * MOUNT[0] - np.sin(start[2]) * MOUNT[1]
    ly = start[1] + np.sin(start[2]) * MOUNT[0] + np.cos(start[2]) * MOUNT[1]
    best = 1.0
    for ox, oy, turn in ((lx, ly, theta), (0.0, 0.0, 0.0), start.tolist()):
        u, v = ox + np.cos(turn) * x - np.sin(turn) * y, oy + np.sin(turn) * x + np.cos(turn) * y
        wall = abs(np.maximum(abs(u), abs(v)) - SIDE / 2.0) < 0.1
        box = ((abs(u - 1.0) < 0.1) & (v > 0.5)) | ((abs(v - 0.6) < 0.1) & (u > 0.9))
        best = min(best, float(np.mean(~(wall | box))))
    return best


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_bag_becomes_a_map(kind: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> None:
    file: Path = request.getfixturevalue(kind)
    name = file.parent / f"map-{kind}"
    assert execute(["map", str(file), "-o", str(name)]) == 0
    told = capsys.readouterr().out
    by = "/tf (odom -> base_link)" if kind == "mcap" else "/odom"
    assert f"scans: /scan; odometry: {by}; the laser is at 0.2, 0.05 m, 0.5 rad" in told
    assert off_walls(name) < 0.05


def test_scans_alone_become_a_map(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = bag(folder / "alone.bag", "ros1", "none")
    assert execute(["map", str(file), "-o", str(folder / "alone")]) == 0
    assert "no odometry: the scans alone" in capsys.readouterr().out
    assert off_walls(folder / "alone") < 0.05


def test_topics_can_be_chosen_and_a_wrong_one_is_told_with_those_that_are_there(ros1: Path) -> None:
    drive = bag_drives.read(ros1, "/scan", "/odom")
    assert len(drive.sweeps) > 150 and not drive.alone
    with pytest.raises(BagError, match=r"--scan /front: no topic of sensor_msgs/LaserScan; there are: /scan"):
        bag_drives.read(ros1, "/front")
    with pytest.raises(BagError, match=r"--odometry /wheel_odom: no topic of nav_msgs/Odometry; there are: /odom"):
        bag_drives.read(ros1, None, "/wheel_odom")


def test_a_topic_for_what_is_no_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "room.log"
    log.write_text("FLASER 1 1.0 0 0 0 0 0 0 0 host 0\n")
    assert execute(["map", str(log), "--scan", "/scan"]) == 2
    assert "--scan, --odometry: they name topics of a bag of ROS" in capsys.readouterr().err


def test_log_tells_what_is_in_a_bag(sqlite: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["log", "info", str(sqlite)]) == 0
    told = capsys.readouterr().out
    assert "a bag of ROS 2" in told and "/odom" in told and "sensor_msgs/LaserScan" in told
    assert execute(["log", "cat", str(sqlite), "--topic", "/odom"]) == 0
    first = json.loads(capsys.readouterr().out.splitlines()[0])
    assert first["topic"] == "/odom" and first["message"]["pose"]["pose"]["position"]["y"] == -0.5


@pytest.mark.parametrize("kind", ["ros1", "sqlite"])
def test_a_bag_is_drawn_and_becomes_tables(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    file: Path = request.getfixturevalue(kind)
    assert execute(["report", str(file), "-o", str(tmp_path / "drawn")]) == 0
    assert (tmp_path / "drawn.png").stat().st_size > 10_000 and (tmp_path / "drawn.html").exists()
    assert execute(["log", "export", str(file), "-o", str(tmp_path / "tables")]) == 0
    rows = (tmp_path / "tables" / "odom.csv").read_text("utf-8").splitlines()
    assert len(rows) == 171 and "pose.pose.position.x" in rows[0]


def test_the_tables_of_a_bag_that_is_a_folder_lie_beside_it(
    sqlite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(sqlite, tmp_path / "drive.1")
    before = sorted(each.name for each in folder.iterdir())
    monkeypatch.chdir(folder)
    assert execute(["log", "export", "."]) == 0
    assert (tmp_path / "drive.1-tables" / "odom.csv").exists()
    assert sorted(each.name for each in folder.iterdir()) == before


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
@pytest.mark.parametrize(
    "command",
    [
        ["replay", "--verify"],
        ["teach", "--see", "laser", "-o", "policy.onnx"],
        ["log", "export", "--tub", "tub"],
        ["calibrate", "--sensors"],
    ],
)
def test_what_a_bag_lacks_is_told_in_a_line_before_it_is_unpacked(
    kind: str,
    command: list[str],
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file: Path = request.getfixturevalue(kind)
    monkeypatch.setattr(reader, "as_mcap", lambda path: pytest.fail(f"{path} is unpacked"))
    assert execute([*command, str(file)]) == 1
    told = capsys.readouterr().err.splitlines()
    assert told[-1].startswith(f"txt1: {file}: no configuration in it")
    assert not any("Traceback" in line for line in told)


@pytest.mark.parametrize("name", ["broken.bag", "broken.db3"])
def test_a_file_that_is_no_bag_is_an_error_with_its_name(name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(b"#ROSBAG V2.0\n" + bytes(200))
    with pytest.raises(BagError, match=name), Bag(file) as opened:
        list(opened.messages(["/scan"]))


def test_recordings_of_txt1_and_folders_without_bags_are_no_bags(mcap: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.mcap"
    own.write_bytes(b"\x89MCAP0\r\n\x01" + bytes(8) + b"\x04\0\0\0ros2\x0a\0\0\0txt1 0.2.0")
    assert is_bag(mcap) and not is_bag(own) and not is_bag(tmp_path)


def test_a_laser_upside_down_and_a_chain_of_frames_are_understood() -> None:
    class Any:
        def __init__(self, **values: object) -> None:
            self.__dict__.update(values)

    def step(parent: str, child: str, way: tuple[float, ...], turn: tuple[float, ...]) -> Any:
        transform = Any(
            translation=Any(**dict(zip("xyz", way, strict=True))), rotation=Any(**dict(zip("xyzw", turn, strict=True)))
        )
        return Any(header=Any(frame_id=parent), child_frame_id=child, transform=transform)

    frames = FrameTree()
    quarter = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
    frames.take(
        Any(
            transforms=[
                step("/base_link", "mast", (0.1, 0.0, 0.2), quarter),
                step("mast", "laser", (0.2, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
            ]
        )
    )
    place = frames.place("/laser")
    assert place is not None and place.upside_down
    assert place[:3] == pytest.approx((0.1, 0.2, np.pi / 2.0))
    assert frames.place("camera") is None


def test_the_tutorial_runs_as_it_stands(ros1: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = Path(__file__).parents[3] / "docs" / "tutorials" / "bag.md"
    # a drive in the map goes on until a key
    typed = [
        words for words in re.findall(r"(?m)^    txt1 (.*)$", page.read_text("utf-8")) if not words.startswith("run ")
    ]
    assert len(typed) == 3
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.bag").symlink_to(ros1)
    for words in typed:
        assert execute(shlex.split(words)) == 0
    assert (tmp_path / "room.yaml").exists() and (tmp_path / "front.graph").exists()


@pytest.mark.parametrize("words", [["replay"], ["teach"], ["calibrate", "--sensors"]])
def test_commands_that_have_to_know_the_robot_refuse_a_bag(
    words: list[str], ros1: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute([*words, str(ros1)]) == 1
    assert "no configuration in it: it is a bag of ROS" in capsys.readouterr().err
