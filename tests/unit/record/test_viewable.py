"""What viewers of others get: a copy with scans as points, and where the sensors are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigs.recordings import messages
from tests.golden.test_golden import FOLDER
from txt1.cli import execute
from txt1.commands import USAGE
from txt1.record.command import view

RECORDING = FOLDER / "obstacle.mcap"


def test_a_copy_has_every_message_and_each_scan_as_points_in_the_lasers_frame(tmp_path: Path) -> None:
    clouds = view.viewable(RECORDING, tmp_path / "copy.mcap")
    before, after = messages(RECORDING), messages(tmp_path / "copy.mcap")
    assert {name: len(told) for name, told in before.items()}.items() <= {n: len(t) for n, t in after.items()}.items()
    added = {"/odom/points", "/odom/speeds", "/setpoint/speeds", "/pwm/outputs"}
    added |= {"/markers/room", "/markers/base_footprint"}
    assert after.keys() - before.keys() == {"/tf_static", "/sensors/laser/points"} | added
    scans, told = after["/sensors/laser"], after["/sensors/laser/points"]
    others = sum(len(after[topic]) for topic in added if not topic.endswith(("speeds", "outputs")))
    assert len(scans) == len(told) == clouds - others > 10
    for scan, cloud in zip(scans, told, strict=True):
        assert cloud.header.frame_id == "base_laser_link" and cloud.header.stamp.sec == scan.header.stamp.sec
        ranges = np.asarray(scan.ranges)
        echoes = ranges[np.isfinite(ranges)]
        xyz = np.frombuffer(bytes(cloud.data), np.float32).reshape(cloud.width, 3)
        assert np.hypot(xyz[:, 0], xyz[:, 1]) == pytest.approx(echoes, rel=1e-6) and not xyz[:, 2].any()
    frames = {each.child_frame_id: each.header.frame_id for each in after["/tf_static"][0].transforms}
    assert frames["base_laser_link"] == "base_link" and frames["base_link"] == "base_footprint"


def xy(cloud: Any) -> Any:
    """The points of a cloud in the plane, m."""
    return np.frombuffer(bytes(cloud.data), np.float32).reshape(cloud.width, 3)[:, :2]


def test_a_copy_draws_body_walls_way_and_speeds(tmp_path: Path) -> None:
    view.viewable(RECORDING, tmp_path / "copy.mcap")
    told = messages(tmp_path / "copy.mcap")
    (cube, *_) = told["/markers"][0].markers
    body = told["/markers/base_footprint"][0]
    assert body.header.frame_id == "base_footprint"
    assert np.ptp(xy(body), axis=0) == pytest.approx((cube.scale.x, cube.scale.y), abs=1e-6)
    walls = told["/markers/room"][0]
    assert walls.header.frame_id == "room"
    corners = np.array([(p.x, p.y) for each in told["/markers"][0].markers for p in each.points])
    assert np.abs(xy(walls)).max(axis=0) == pytest.approx(np.abs(corners).max(axis=0), abs=1e-5)
    for one, other in zip(told["/odom"], told["/odom/speeds"], strict=True):
        assert list(other.position) == [one.twist.twist.linear.x, one.twist.twist.angular.z]
    for one, other in zip(told["/setpoint"], told["/setpoint/speeds"], strict=True):
        assert list(other.position) == [one.twist.linear.x, one.twist.angular.z]
    for one, other in zip(told["/pwm"], told["/pwm/outputs"], strict=True):
        assert dict(zip(other.name, other.position, strict=True)).items() >= {"motor": one.motor}.items()
    way = told["/odom/points"][-1]
    last = told["/odom"][-1].pose.pose.position
    assert way.header.frame_id == "odom" and np.hypot(*(xy(way)[-1] - (last.x, last.y))) < 0.2


def test_without_rerun_the_command_says_how_to_get_it_and_what_else_opens_the_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(view, "python_of_rerun", lambda: None)
    assert execute(["log", "view", str(RECORDING)]) == USAGE
    told = capsys.readouterr().err
    assert (
        told.startswith("txt1: there is no Rerun here: ") and "pip install rerun-sdk" in told and told.count("\n") == 1
    )
    assert "foxglove-layout.json" in told
