"""What ROS's own tools look for in a recording: the sensors' frames, NavSatFix, CameraInfo, and times of day."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from datetime import datetime
from math import sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from rigs.recordings import messages
from txt1.cli import execute
from txt1.commands import OK
from txt1.kernel.clock import NS_PER_S, seconds, wall_ns
from txt1.record.mcap_file import McapFile
from txt1.record.mcap_records import Encoder
from txt1.record.reader import FilePass
from txt1.record.verification import verify
from txt1.sensors.mounts import SensorFrames, mounted
from txt1.sensors.readings import BASE_HEIGHT, DepthImage, Mount, Scan, scan_topic
from txt1.sensors.ros_messages import depth_points
from txt1.tasks.fields import LOG, Event

Capture = pytest.CaptureFixture[str]


def stamp(message: Any) -> int:
    """The time stamp of a message's header, ns."""
    return int(message.header.stamp.sec) * NS_PER_S + int(message.header.stamp.nanosec)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds with a laser, two cameras and a GPS."""
    file = tmp_path_factory.mktemp("drive") / "run.mcap"
    sensors = [f"sensors.{name}.driver=sim_{name}" for name in ("laser", "camera", "depth", "gps")]
    words = ["run", "--headless", "--speed", "max", "--json", "--duration", "2", "--log", str(file)]
    assert execute([*words, *(word for each in sensors for word in ("--set", each))]) == OK
    return file


def test_frames_of_the_sensors_that_are_there_lead_to_the_robots_own(drive: Path) -> None:
    told = messages(drive)
    frames = {each.child_frame_id: each for each in told["/tf_static"][-1].transforms}
    for topic in ("/sensors/laser", "/sensors/camera", "/sensors/depth"):
        frame = told[topic][0].header.frame_id
        while frame != "base_footprint":
            frame = frames[frame].header.frame_id
    assert told["/odom"][0].child_frame_id == "base_footprint"
    laser = frames["base_laser_link"].transform
    assert (laser.translation.x, laser.translation.z) == pytest.approx((0.1905, 0.1435))
    assert "base_imu_link" not in frames


def test_a_laser_that_sits_elsewhere_has_its_frame_there() -> None:
    frames, topic = SensorFrames(), scan_topic("of_the_frames")
    there = Mount(-0.2, 0.1, BASE_HEIGHT + 0.3, 1.5)
    scan = Scan(0.0, 0.1, 0.0, np.ones(3, np.float32), 0.1, 4.0)
    assert frames.see(topic, scan) and not frames.see(topic, scan)
    moved = Scan(0.0, 0.1, 0.0, np.ones(3, np.float32), 0.1, 4.0, mount=there)
    assert frames.see(topic, moved)
    placed = mounted(frames.mounts)["transforms"][1]["transform"]
    assert placed["translation"] == pytest.approx({"x": -0.2, "y": 0.1, "z": 0.3})
    assert placed["rotation"]["z"] == pytest.approx(sin(0.75))


def test_two_sensors_of_a_kind_have_frames_of_their_own(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    named = {"laser": "laser", "rear": "laser", "camera": "camera", "left": "camera"}
    settings = [f"sensors.{name}.driver=sim_{kind}" for name, kind in named.items()]
    settings.append("obstacle_stop.sensor=laser")
    words = ["run", "--headless", "--speed", "max", "--json", "--duration", "1", "--log", str(file)]
    assert execute([*words, *(word for each in settings for word in ("--set", each))]) == OK
    told = messages(file)
    frames = {each.child_frame_id: each.header.frame_id for each in told["/tf_static"][-1].transforms}
    for name, link in (
        ("laser", "base_laser_link"),
        ("rear", "base_rear_laser_link"),
        ("camera", "base_camera_optical_link"),
        ("left", "base_left_camera_optical_link"),
        ("left/camera_info", "base_left_camera_optical_link"),
    ):
        assert told[f"/sensors/{name}"][0].header.frame_id == link and link in frames
    assert frames["base_left_camera_optical_link"] == "base_left_camera_link"
    assert execute(["replay", "--verify", str(file)]) == OK


def test_the_second_laser_is_drawn_where_it_sits() -> None:
    frames, front, rear = SensorFrames(), scan_topic("front_of_two"), scan_topic("rear_of_two")
    scan = Scan(0.0, 0.1, 0.0, np.ones(3, np.float32), 0.1, 4.0)
    assert frames.link(front) == "base_laser_link"
    # whichever is heard first
    assert frames.see(rear, dataclasses.replace(scan, mount=Mount(-0.3, 0.0, BASE_HEIGHT, 3.1))) and frames.see(
        front, scan
    )
    places = {each["child_frame_id"]: each["transform"]["translation"] for each in mounted(frames.mounts)["transforms"]}
    assert places["base_rear_of_two_laser_link"]["x"] == -0.3 and places["base_laser_link"]["x"] == 0.1905
    assert frames.framed(rear, rear).constants == {"header": {"frame_id": "base_rear_of_two_laser_link"}}
    assert frames.framed(front, front) is front


def test_a_gps_has_its_position_as_a_nav_sat_fix(drive: Path) -> None:
    told = messages(drive)
    own, standard = told["/sensors/gps"], told["/sensors/gps/fix"]
    assert len(own) == len(standard) == 10
    for one, other in zip(own, standard, strict=True):
        assert (one.latitude, one.longitude) == (other.latitude, other.longitude)
        assert stamp(one) == stamp(other) and other.header.frame_id == "base_gps_link"
        assert other.position_covariance[0] == pytest.approx(one.sigma_x**2)


def test_a_camera_has_its_model_beside_each_picture(drive: Path) -> None:
    told = messages(drive)
    for name, calibrated in (("camera", False), ("depth", True)):
        pictures, models = told[f"/sensors/{name}"], told[f"/sensors/{name}/camera_info"]
        assert list(map(stamp, pictures)) == list(map(stamp, models))
        assert (models[0].width, models[0].height, models[0].header.frame_id) == (
            160,
            120,
            pictures[0].header.frame_id,
        )
        assert (models[0].k[0] > 100.0) is calibrated


def test_a_depth_camera_has_the_places_that_it_sees(drive: Path) -> None:
    told = messages(drive)
    images, clouds = told["/sensors/depth"], told["/sensors/depth/points"]
    assert list(map(stamp, images)) == list(map(stamp, clouds))
    image, cloud, model = images[3], clouds[3], told["/sensors/depth/camera_info"][3]
    assert (cloud.height, cloud.width, cloud.header.frame_id) == (120, 160, image.header.frame_id)
    assert [(each.name, each.offset, each.datatype) for each in cloud.fields] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    depths = np.frombuffer(bytes(image.data), "<u2").reshape(120, 160)
    places = np.frombuffer(bytes(cloud.data), "<f4").reshape(120, 160, 3)
    assert np.isfinite(places).all(axis=2).tolist() == (depths > 0).tolist(), "NaN where nothing was measured"
    for row, column in ((10, 20), (60, 80), (110, 150)):
        z = depths[row, column] / 1000.0
        assert z > 0.0
        x, y = (column - model.k[2]) / model.k[0] * z, (row - model.k[5]) / model.k[4] * z
        assert places[row, column] == pytest.approx((x, y, z), abs=1e-5)


def test_a_large_picture_has_a_cloud_of_fewer_places() -> None:
    image = DepthImage(640, 480, np.full((480, 640), 2000, "<u2").tobytes(), 500.0)
    cloud = depth_points("/points").make(image)
    assert (cloud["width"], cloud["height"], cloud["row_step"]) == (160, 120, 160 * 12)
    last = np.frombuffer(cloud["data"], "<f4").reshape(120, 160, 3)[-1, -1]
    assert last == pytest.approx(((636 - 319.5) / 250.0, (476 - 239.5) / 250.0, 2.0))


def test_what_others_read_changes_nothing_for_a_verification(drive: Path) -> None:
    found = verify(drive)
    assert found.difference is None and found.compared > 800
    assert {"/tf_static", "/sensors/gps/fix", "/sensors/camera/camera_info"} <= found.uncompared.keys()


@pytest.mark.waits
def test_a_run_on_the_real_clock_has_times_of_day_and_replays_exactly(tmp_path: Path, capsys: Capture) -> None:
    file, before = tmp_path / "run.mcap", wall_ns()
    run = ["run", "--headless", "--duration", "1.5", "--set", "sensors.imu.driver=sim_imu", "--log", str(file)]
    words = [sys.executable, "-m", "txt1", *run]
    subprocess.run(words, check=True, capture_output=True, cwd=Path(__file__).parents[2])
    reading = FilePass(file)
    items = list(reading)
    assert before < items[0].message.log_time <= items[-1].message.log_time < wall_ns()
    assert before < reading.epoch * NS_PER_S
    times = [reading.run_time(item) for item in items if item.name == "/odom"]
    assert 0.0 <= times[0] < 0.1 and times[-1] < 10.0
    first = next(item for item in items if item.name == "/odom")
    assert stamp(messages(file)["/odom"][0]) == first.message.log_time
    found = verify(file)
    assert found.difference is None and found.compared > 100
    # in times of the run
    assert execute(["log", "cat", str(file), "--topic", "/odom", "--from", "0.5", "--to", "0.6"]) == OK
    assert 3 <= capsys.readouterr().out.count("\n") <= 8
    assert execute(["log", "info", str(file)]) == OK
    told = re.search(r"from (-?[\d.]+) s on, a run that began at (\S+)", capsys.readouterr().out)
    assert told is not None and abs(float(told[1])) < 0.1
    assert abs(datetime.fromisoformat(told[2]).timestamp() - seconds(wall_ns())) < 3600.0


def test_each_file_of_a_rotation_has_the_runs_start(tmp_path: Path) -> None:
    for number in range(2):
        encoder = Encoder(1_700_000_000.123457)
        file = McapFile(tmp_path / f"{number}.mcap", {"epoch": "0.0"})
        for time in (0.25, 0.5):
            file.add(encoder.block([(time, LOG, Event(time, "said"))]))
        file.close({})
        reading = FilePass(tmp_path / f"{number}.mcap")
        assert [reading.run_time(item) for item in reading] == [0.25, 0.5]
        assert reading.epoch == 1_700_000_000.123457
        with (tmp_path / f"{number}.mcap").open("rb") as stream:
            names = [record.name for record in make_reader(stream).iter_metadata()]
        assert names.count("txt1.time") == 1
