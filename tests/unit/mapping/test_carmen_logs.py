"""Logs of lasers: their formats, plain and gzip, and what is wrong with them."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from rigs import laser_logs
from txt1.mapping import carmen_logs
from txt1.mapping.poses import accumulated, composed, difference, trajectory_error

FLASER = "FLASER 4 1.0 2.0 nan 81.9 {x} 0.5 0.1 {x} 0.6 0.2 {time} host {time}\n"
TEXT = "# comment\nODOM 0 0 0 0 0 0 1 host 1\n" + "".join(FLASER.format(x=k, time=k / 10) for k in range(3))
ROBOTLASER = "ROBOTLASER1 0 -1.57 3.14 0.5 80 0.01 0 3 1 2 3 1 0 1 2 0.3 1 2 0.3 0 0 0 0 0 12.5 host 12.5\n"


@pytest.mark.parametrize("packed", [False, True])
def test_carmen(tmp_path, packed):
    file = tmp_path / ("a.log.gz" if packed else "a.log")
    file.write_bytes(gzip.compress(TEXT.encode()) if packed else TEXT.encode())
    log = carmen_logs.read(file)
    assert log.name == "a" and len(log.scans) == 3 and log.longest == 81.9
    assert np.allclose(log.odometry[2], (2.0, 0.6, 0.2)) and np.allclose(log.reference[2], (2.0, 0.5, 0.1))
    first = log.scans[0]
    assert np.allclose(np.degrees(first.angles), (-90, -45, 0, 45))
    points = carmen_logs.points_of(first.ranges, first.angles, log.longest)
    assert np.allclose(points, [(0, -1), (np.sqrt(2), -np.sqrt(2))])


@pytest.mark.parametrize(("told", "last"), [("270.0 1.5 host 1.5", 90 * 0.75), ("360 nohost 0", 90.0)])
def test_the_field_of_view_is_read_where_a_log_tells_it(tmp_path, told, last):
    file = tmp_path / "a.log"
    file.write_text(f"PARAM laser_front_laser_fov {told}\n{TEXT}")
    angles = np.degrees(carmen_logs.read(file).scans[0].angles)
    whole = float(told.split()[0])
    assert np.allclose(angles, -whole / 2 + whole / 4 * np.arange(4)) and angles[-1] == pytest.approx(last)
    file.write_text(f"PARAM laser_front_laser_fov 4.7e2\n{TEXT}")
    with pytest.raises(carmen_logs.LogError, match=r"line 1 .* it is from 0 to 360"):
        carmen_logs.read(file)


def test_a_field_of_view_in_radians_is_no_beam_of_three_degrees(tmp_path):
    file = tmp_path / "a.log"
    file.write_text(f"PARAM laser_front_laser_fov 3.141593 host 1.5\n{TEXT}")
    assert np.allclose(np.degrees(carmen_logs.read(file).scans[0].angles), -90.0 + 45.0 * np.arange(4), atol=1e-3)


def test_robotlaser(tmp_path):
    file = tmp_path / "b.log"
    file.write_text(ROBOTLASER)
    scan = carmen_logs.read(file).scans[0]
    assert scan.time == 12.5 and scan.odometry == (1.0, 2.0, 0.3)
    assert np.allclose(scan.angles, (-1.57, -1.07, -0.57)) and np.allclose(scan.ranges, (1, 2, 3))


def test_the_rover(tmp_path):
    ranges = " ".join(["1000"] * 683)
    rest = " ".join(["0"] * 20)
    file = tmp_path / "c.dat"
    file.write_text("".join(f"{k * 100000} 0 {k * 100} {k * 100} {rest} {ranges}\n" for k in range(20)))
    log = laser_logs.read(file)
    assert log.reference is None and len(log.scans) == 20
    assert log.odometry[-1, 0] > 0.4 and log.scans[5].swept.shape == (683, 3)
    # while the rover drives ahead, later beams leave from farther ahead
    assert (np.diff(log.scans[5].swept[:, 0]) > 0.0).all()


def test_the_rovers_laser_turns_evenly_whenever_its_lines_are_written(tmp_path):
    rest, ranges = " ".join(["0"] * 20), " ".join(["1000"] * 683)
    times = [100_000 * k + (40_000 if k % 5 == 2 else 0) for k in range(40)]  # us; every fifth line is late
    file = tmp_path / "c.dat"
    file.write_text("".join(f"{at} 0 {at // 1000} {at // 1000} {rest} {ranges}\n" for at in times))
    ways = np.diff(laser_logs.read(file).odometry[2:, 0])
    assert ways == pytest.approx(100 * 2.0 * np.pi * laser_logs.WHEEL / laser_logs.TICKS, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"ODOM 0 0 0\n", "no scan"),
        (b"FLASER 5 1 2 3\n", "line 1"),
        (b"FLASER x 1 2 3\n", "line 1"),
        (FLASER.format(x="nan", time=1).encode(), "line 1"),
        (gzip.compress(TEXT.encode(), mtime=0)[:40], "damaged"),
    ],
)
def test_broken_logs_are_named(tmp_path, content, told):
    file = tmp_path / "d.log"
    file.write_bytes(content)
    with pytest.raises(carmen_logs.LogError, match=told) as caught:
        carmen_logs.read(file)
    assert str(file) in str(caught.value)


def test_a_missing_log_is_named(tmp_path):
    with pytest.raises(carmen_logs.LogError, match="No such file"):
        carmen_logs.read(tmp_path / "none.log")


def test_drift_repeats_and_bends():
    poses = np.column_stack((np.linspace(0, 10, 101), np.zeros((101, 2))))
    assert np.array_equal(laser_logs.drifted(poses, 1), laser_logs.drifted(poses, 1))
    straight = laser_logs.drifted(poses, 1, noise=0.0)
    # 5 % of 10 m on one wheel, 0.4 m from the other
    assert np.isclose(np.unwrap(straight[:, 2])[-1], 10 * 0.05 / 0.4)


def test_poses():
    rng = np.random.default_rng(1)
    poses = rng.uniform(-3, 3, (20, 3))
    steps = difference(poses[:-1], poses[1:])
    assert np.allclose(composed(poses[:-1], steps), poses[1:])
    assert np.allclose(accumulated(poses[0], steps), poses)
    moved = composed(np.array([1.0, 2.0, 0.7]), poses)
    assert trajectory_error(moved, poses) < 1e-9
    moved[:, 0] += rng.choice([-0.1, 0.1], 20)
    assert 0.05 < trajectory_error(moved, poses) <= 0.1


def test_trajectory_error_is_that_of_evo():
    metrics = pytest.importorskip("evo.core.metrics")
    trajectory = pytest.importorskip("evo.core.trajectory")
    rng = np.random.default_rng(2)
    one, other = rng.normal(size=(2, 30, 2))
    paths = [
        trajectory.PosePath3D(np.column_stack((each, np.zeros(30))), np.tile([1.0, 0, 0, 0], (30, 1)))
        for each in (one, other)
    ]
    paths[0].align(paths[1])
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((paths[1], paths[0]))
    ours = trajectory_error(np.column_stack((one, np.zeros(30))), np.column_stack((other, np.zeros(30))))
    assert ours >= error.get_statistic(metrics.StatisticsType.rmse) - 1e-9


DATA = Path("/work/shared/data/laser/intel.log.gz")


@pytest.mark.skipif(not DATA.exists(), reason="the logs of other people are not there")
def test_a_log_of_others():
    log = carmen_logs.read(DATA)
    assert len(log.scans) == 910 and log.reference is not None
