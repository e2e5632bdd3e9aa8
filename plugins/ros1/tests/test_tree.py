"""Sensors' messages as trees of names and values."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from txt1 import Robot
from txt1.kernel.loop import run
from txt1.sensors.readings import Image, ImuReading, ImuSigma, Mount, Scan, image_topic, imu_topic, scan_topic
from txt1_ros1.tree import SensorFeed, tree


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


def test_ros_is_told_where_each_laser_sits_and_again_when_one_is_moved() -> None:
    settings = [*(f"sensors.{name}.driver=sim_laser" for name in ("laser", "behind")), "obstacle_stop.sensor=laser"]

    async def listen() -> None:
        async with Robot.open("sim", seed=1, settings=[*settings, "sensors.behind.options.mount.x=-0.3"]) as robot:
            feed = SensorFeed(robot.runtime)
            feed.begin()
            await asyncio.sleep(0.5)
            places = {each["child_frame_id"]: each["transform"]["translation"] for each in feed.places()}
            assert places["base_laser_link"]["x"] == 0.1905 and places["base_behind_laser_link"]["x"] == -0.3
            told = {name: made["header"]["frame_id"] for name, _, _, made in feed.take(0.0)}
            assert told == {"scan": "base_laser_link", "behind/scan": "base_behind_laser_link"}
            assert feed.places() == [], "once"
            rear = robot.runtime.sensors["behind"].sensor.topic
            scan = Scan(0.0, 0.1, 0.0, np.ones(3, np.float32), 0.1, 4.0, mount=Mount(-0.2))
            robot.runtime.bus.publish(rear, scan, robot.now)
            assert feed.places()[-1]["transform"]["translation"]["x"] == -0.2
            # a node that starts again is told once more
            feed.begin()
            assert [each["child_frame_id"] for each in feed.places()] == [*places]

    run(listen(), speed="max")
