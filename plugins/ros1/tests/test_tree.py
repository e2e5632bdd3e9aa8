"""Sensors' messages as trees of names and values."""

from __future__ import annotations

import numpy as np
import pytest

from txt1.sensors.readings import Image, ImuReading, ImuSigma, Scan, image_topic, imu_topic, scan_topic
from txt1_ros1.tree import tree


def test_numbers_stand_where_their_paths_say() -> None:
    reading = ImuReading((0.0, 0.0, 9.81), (0.1, 0.2, 0.3), sigma=ImuSigma(0.1, 0.2, 0.3, 0.4))
    told = tree(imu_topic("imu"), reading)
    assert told["header"]["frame_id"] == "base_imu_link"
    assert told["angular_velocity"] == {"x": 0.1, "y": 0.2, "z": 0.3}
    assert told["angular_velocity_covariance"] == pytest.approx({"0": 0.01, "4": 0.01, "8": 0.01})
    assert told["orientation_covariance"]["0"] == -1.0, "it has none"
    assert imu_topic("imu").constants.keys() == {"header"}, "constants are not written to"


def test_messages_of_fields_are_trees_already_and_bytes_are_text() -> None:
    scan = Scan(-1.0, 0.5, 0.01, np.full(5, 2.0, np.float32), 0.02, 12.0)
    told = tree(scan_topic("laser"), scan)
    assert told["ranges"] == [2.0] * 5
    assert told["header"] == {"frame_id": "base_laser_link"}
    picture = tree(image_topic("camera"), Image(1, 1, b"\xff\xd8"))
    assert (picture["format"], picture["data"]) == ("jpeg", {"base64": "/9g="})
