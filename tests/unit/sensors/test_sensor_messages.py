"""Sensors' messages say how sure they are, and how long a sweep takes."""

from __future__ import annotations

import struct
from math import hypot
from random import Random
from typing import Any

import numpy as np
import pytest
from numpy.random import default_rng
from rosbags.typesys import Stores, get_typestore

from tests.unit.sensors.test_codecs import PARAMETERS, SCAN
from txt1.config.sources import checked
from txt1.record.mcap_records import Encoder
from txt1.sensors import laser_ld19, laser_scip
from txt1.sensors.base import Reading
from txt1.sensors.imu_3dmgx2 import ImuDecoder, ImuOptions, checksum
from txt1.sensors.readings import ImuReading, Mount, Scan, imu_topic, scan_topic
from txt1.sensors.sim_imu import ImuErrors, SimulatedImu
from txt1.sensors.sim_laser import LaserParameters, SimulatedLaser
from txt1.sensors.virtual_lasers import turn
from txt1.sim.rays import walls_of
from txt1.sim.room import Room
from txt1.telemetry.messages import schema_name
from txt1.telemetry.topics import Topic

STORE = get_typestore(Stores.ROS2_JAZZY)
LEVEL = ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def message(topic: Topic[Any], value: object) -> Any:
    """A value as another library reads it."""
    ((_, _, data),) = Encoder(0.0).block([(1.0, topic, value)]).messages()
    return STORE.deserialize_cdr(data, schema_name(topic.message))


def test_an_imu_tells_the_variances_of_its_errors() -> None:
    errors = ImuErrors()
    imu = SimulatedImu("imu", lambda: (0.0, 0.0, 0.0), errors, Random(1))
    reading = [imu.read(0.01 * k) for k in range(3)][-1]
    assert reading is not None
    told = message(imu.topic, reading.value)
    rates, acceleration = (
        np.diag(each.reshape(3, 3)) for each in (told.angular_velocity_covariance, told.linear_acceleration_covariance)
    )
    assert rates == pytest.approx([errors.rate_noise**2 + errors.rate_bias**2] * 3)
    assert acceleration == pytest.approx([hypot(errors.noise, errors.bias, errors.vibration) ** 2] * 3)
    assert np.diag(told.orientation_covariance.reshape(3, 3)) == pytest.approx([0.005**2, 0.005**2, 0.035**2])


def test_an_imu_without_an_orientation_tells_that_it_has_none() -> None:
    told = message(imu_topic("imu"), LEVEL._replace(orientation=None))
    assert told.orientation_covariance[0] == -1.0
    assert not told.angular_velocity_covariance.any(), "0: nobody knows it"


def test_a_real_imu_tells_the_sigmas_that_its_option_gives() -> None:
    options = checked(
        ImuOptions, {"sigma": {"rates": 0.1, "acceleration": 0.2, "attitude": 0.3, "heading": 0.4}}, "imu"
    )
    decoder = ImuDecoder(sigma=options.sigma)
    body = b"\xc8" + struct.pack(">15fI", 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, *np.eye(3).ravel(), 0)
    ((reading, _, _),) = decoder.feed(body + checksum(body).to_bytes(2, "big"))
    told = message(imu_topic("imu"), reading)
    assert told.orientation_covariance[8] == pytest.approx(0.16) and told.angular_velocity_covariance[
        4
    ] == pytest.approx(0.01)


def test_a_sweep_lasts_from_its_first_beam_to_the_next_sweeps() -> None:
    scip = laser_scip.ScipDecoder()
    scip.feed(PARAMETERS)
    ld19 = laser_ld19.Ld19Decoder()
    shown = Scan(-np.pi, 2 * np.pi / 450, 0.1 / 450, np.full(450, 2.0, np.float32), 0.02, 12.0)
    scans = [*scip.feed(b"MD0000000201000\n00P\n\n" + SCAN)]
    scans += [each for k in range(4) for each in ld19.feed(turn(Reading(1.0 + 0.1 * k, shown)))]
    assert len(scans) > 2
    for scan, _, _ in scans:
        assert message(scan_topic("laser"), scan).scan_time == pytest.approx(0.1, abs=0.002)


def test_the_simulated_lasers_sweeps_are_a_turn_apart() -> None:
    parameters = LaserParameters()
    laser = SimulatedLaser("laser", lambda: (2.0, 2.0, 0.0), walls_of(Room(4.0, 4.0)), parameters, default_rng(1))
    laser.read(0.0)
    reading = laser.read(parameters.turn_time)
    assert reading is not None
    assert message(laser.topic, reading.value).scan_time == pytest.approx(parameters.turn_time)


@pytest.mark.parametrize(
    ("degrees", "missed", "turns"), [(360, 0, True), (360, 360, True), (316, 0, True), (315, 0, False), (270, 0, False)]
)
def test_a_scan_tells_whether_its_laser_turns_all_round_whatever_it_misses(degrees, missed, turns):
    ranges = np.full(2 * degrees, np.inf, np.float32)
    ranges[: 2 * missed] = np.nan
    for step in (np.pi / 360, -np.pi / 360):
        assert Scan(0.0, step, 0.0, ranges, 0.05, 12.0).all_round == turns


@pytest.mark.parametrize(
    ("missed", "shows"),
    [
        ((), True),
        ((180, 181), False),
        ((180,), True),
        ((180, 182), True),
        ((0, 1, 2), True),
        ((88, 89, 90), True),
        ((91, 92), False),
        ((268, 269), False),
    ],
)
def test_a_scan_tells_whether_it_shows_all_that_is_behind(missed, shows):
    """Degrees from ahead of the vehicle, wherever a turn begins."""
    for begins in (0, 90, 180, 181):
        for way in (1, -1):
            ranges = np.full(360, 2.0, np.float32)
            ranges[[way * (each - begins) % 360 for each in missed]] = np.nan
            scan = Scan(0.0, way * np.pi / 180, 0.0, ranges, 0.05, 12.0, mount=Mount(yaw=begins * np.pi / 180))
            assert scan.shows_behind == shows
