"""The simulated sensors measure what is there."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from math import cos, hypot, inf, pi, sin
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import default_rng

from tests.examples import examples
from txt1.config import load
from txt1.errors import HalError
from txt1.sensors.base import Pose, Setup
from txt1.sensors.depth import PlayerOptions, player
from txt1.sensors.readings import CAMERA_MOUNT, Mount, depth_topic
from txt1.sensors.registry import DRIVERS
from txt1.sensors.sim_camera import SimulatedCamera
from txt1.sensors.sim_gps import GpsErrors, SimulatedGps
from txt1.sensors.sim_imu import ImuErrors, SimulatedImu
from txt1.sensors.sim_laser import LaserParameters, SimulatedLaser
from txt1.sensors.sim_vicon import SimulatedTracker, TrackerErrors
from txt1.sensors.simulated_sensor import Absences
from txt1.sim.obstacles import distance
from txt1.sim.parameters import Box, Post
from txt1.sim.rays import cast, shapes_of, walls_of
from txt1.sim.room import Room
from txt1.sim.view import Camera, Scene, distances, draw
from txt1.units import GRAVITY

SOUND = ImuErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 30.0, 0.0)


class Drive:
    """A vehicle on a circle of radius v / omega: its pose at `time`."""

    def __init__(self, v: float, omega: float) -> None:
        self.v, self.omega, self.time = v, omega, 0.0

    def pose(self) -> Pose:
        radius, turned = self.v / self.omega, self.omega * self.time
        return radius * sin(turned), radius * (1.0 - cos(turned)), turned


def readings(sensor: Any, drive: Drive, seconds: float) -> list[Any]:
    """What the sensor says while the vehicle drives."""
    found = []
    for k in range(round(seconds / sensor.period)):
        drive.time = k * sensor.period
        if (reading := sensor.read(drive.time)) is not None:
            found.append(reading)
    return found


def test_an_imu_on_a_circle_feels_gravity_its_rate_and_the_circle() -> None:
    drive = Drive(0.8, 0.5)
    mount = Mount(-0.1, 0.0, 0.4)
    sensor = SimulatedImu("twin_imu", drive.pose, SOUND, Random(1), mount=mount)
    for time, value in readings(sensor, drive, 5.0):
        assert value.rates == pytest.approx((0.0, 0.0, 0.5), abs=1e-6)
        assert value.acceleration == pytest.approx((0.5 * 0.5 * 0.1, 0.8 * 0.5, GRAVITY), abs=1e-4)
        assert 2.0 * np.arctan2(value.orientation[2], value.orientation[3]) % (2 * pi) == pytest.approx(0.5 * time)


def test_gravity_shows_in_a_tilted_imu() -> None:
    drive = Drive(1e-9, 1e-9)
    sensor = SimulatedImu("twin_imu", drive.pose, SOUND, Random(1), attitude=lambda: (0.1, 0.2))
    value = readings(sensor, drive, 0.1)[-1].value
    expected = (-GRAVITY * sin(0.2), GRAVITY * cos(0.2) * sin(0.1), GRAVITY * cos(0.2) * cos(0.1))
    assert value.acceleration == pytest.approx(expected, abs=1e-6)


def test_bias_stays_and_noise_is_as_configured() -> None:
    drive = Drive(1e-9, 1e-9)
    errors = ImuErrors(rate_walk=0.0)
    for seed in range(3):
        sensor = SimulatedImu("twin_imu", drive.pose, errors, Random(seed))
        omega = np.array([reading.value.rates[2] for reading in readings(sensor, drive, 20.0)])
        assert omega.std() == pytest.approx(errors.rate_noise, rel=0.1)
        assert abs(omega.mean()) < 4.0 * errors.rate_bias


def test_a_gps_has_white_and_slow_errors_and_outages() -> None:
    pytest.importorskip("utm")
    drive = Drive(1e-9, 1e-9)
    errors = GpsErrors(noise=0.5, slow=2.0, slow_time=100.0, outages=((100.0, 130.0),))
    sensor = SimulatedGps("twin_gps", drive.pose, errors, Random(3), Mount())
    found = readings(sensor, drive, 4000.0)
    x = np.array([reading.value.x for reading in found])
    assert np.diff(x).std() == pytest.approx(0.5 * 2**0.5, rel=0.05)  # from one to the next the slow error stays
    assert x.std() == pytest.approx(hypot(0.5, 2.0), rel=0.4)
    assert not [reading for reading in found if 100.0 <= reading.time < 130.0]
    assert found[0].value.latitude == pytest.approx(35.0844, abs=1e-3)


def test_a_tracker_is_occluded_now_and_then() -> None:
    absences = Absences((), 10.0, 0.5, Random(2))
    seen = [not absences.at(0.01 * k) for k in range(1_000_000)]
    assert 1.0 - np.mean(seen) == pytest.approx(0.5 / 10.5, rel=0.15)
    drive = Drive(0.5, 0.5)
    sensor = SimulatedTracker("twin_vicon", drive.pose, TrackerErrors(), Random(1))
    last = readings(sensor, drive, 3.0)[-1].value
    assert (last.x, last.y) == pytest.approx(drive.pose()[:2], abs=0.005)
    assert (last.v, last.omega) == (pytest.approx(0.5, abs=0.3), pytest.approx(0.5, abs=0.6))


coordinate = st.floats(-2.0, 2.0)


@given(coordinate, coordinate, st.floats(-pi, pi), coordinate, coordinate, st.floats(0.05, 0.5))
@settings(max_examples=examples(50))
def test_a_ray_ends_at_the_surface_of_the_nearest_thing(
    x: float, y: float, angle: float, a: float, b: float, size: float
) -> None:
    obstacles = (Post(a, b, size), Box(b, a, size, 0.3, angle))
    shapes = walls_of(Room(5.0, 5.0)) + shapes_of(obstacles)
    if min(distance(each, x, y) for each in obstacles) < 0.01:
        return
    reach = float(cast(x, y, np.array([angle]), shapes)[0])
    px, py = x + reach * cos(angle), y + reach * sin(angle)
    gaps = [*(distance(each, px, py) for each in obstacles), 2.5 - abs(px), 2.5 - abs(py)]
    assert min(map(abs, gaps)) < 1e-6
    for share in np.linspace(0.0, 0.99, 30):  # nothing stands before it
        qx, qy = x + share * reach * cos(angle), y + share * reach * sin(angle)
        assert min(distance(each, qx, qy) for each in obstacles) > -1e-6


def test_a_laser_on_the_move_measures_from_where_each_beam_left() -> None:
    drive = Drive(1.5, 1e-6)
    parameters = LaserParameters(noise=0.0, noise_share=0.0, range_max=30.0, mount=Mount())
    wall = shapes_of((Box(10.0, 0.0, 0.2, 40.0),))
    sensor = SimulatedLaser("twin_laser", drive.pose, wall, parameters, default_rng(1))
    reading = readings(sensor, drive, 0.35)[-1]
    scan = reading.value
    ahead = scan.ranges * np.cos(scan.angles)
    hit = np.isfinite(scan.ranges)
    times = reading.time + scan.time_step * np.arange(len(scan.ranges))
    assert ahead[hit] == pytest.approx(9.9 - 1.5 * times[hit], abs=2e-3)
    assert drive.time - reading.time == pytest.approx(682 / 10240, abs=1e-6)


def test_the_picture_shows_what_the_depth_measures() -> None:
    scene = Scene(walls_of(Room(5.0, 5.0)), shapes_of((Post(1.0, 0.0, 0.2),)), shapes_of(()), (2.0, 1.0))
    camera = Camera(81, 61)
    picture, depth = (see(camera, scene, -1.0, 0.0, 0.4, 0.0) for see in (draw, distances))
    assert depth[30, 40] == pytest.approx(1.8, abs=1e-6)  # the post ahead
    assert depth[30, 0] == pytest.approx(3.5, abs=1e-6)  # the wall behind it, along the axis
    assert depth[60, 40] == pytest.approx(0.4 * camera.focal / 30.0, abs=1e-6)  # the floor
    lamp = round(40 - camera.focal / 3.0)
    assert picture[30, lamp].min() > 200  # the lamp, left of the post
    assert picture[30, 40, 2] > picture[30, 40, 0]  # which is blue


async def test_a_slow_picture_comes_when_it_is_ready_and_its_thread_ends_with_it() -> None:
    may_draw = threading.Event()

    def expose(eye: Pose, others: Sequence[Pose]) -> Any:
        may_draw.wait()
        return eye, others

    drive = Drive(0.8, 0.5)
    camera = SimulatedCamera(depth_topic("drawn"), drive.pose, lambda: [(1.0, 2.0, 3.0)], expose)
    await camera.open()
    assert camera.read(0.0) is None
    drive.time = 1.0
    assert camera.read(0.1) is None  # the loop goes on meanwhile
    may_draw.set()
    reading = await until(lambda: camera.read(0.2))
    assert reading.time == 0.0
    assert reading.value == ((CAMERA_MOUNT.x, CAMERA_MOUNT.y, CAMERA_MOUNT.yaw), ((1.0, 2.0, 3.0),))
    await camera.close()
    assert not [each.name for each in threading.enumerate() if each.name.startswith("txt1 camera")]


# -- cameras and absent hardware ---------------------------------------------------------------------------------


def setup(driver: str, **options: Any) -> Any:
    return DRIVERS.make("driver", driver, Setup("absent_" + driver, options, load().config))


@pytest.mark.parametrize(
    "given",
    [
        ("imu_3dmgx2", {"port": "/dev/ttyUSB77"}),
        ("imu_bno08x_rvc", {"port": "/dev/ttyUSB77"}),
        ("laser_scip", {"port": "/dev/ttyACM77"}),
        ("laser_ld19", {"port": "/dev/ttyUSB77"}),
        ("laser_rplidar", {"port": "/dev/ttyUSB77"}),
        ("gps_gpsd", {"address": "socket://127.0.0.1:9"}),
        ("mocap_vrpn", {"address": "socket://127.0.0.1:9"}),
        ("camera", {"source": "/dev/video77"}),
        ("depth_realsense", {}),
        ("depth_player", {"path": "/nowhere/frames.npy"}),
    ],
    ids=lambda given: given[0],
)
async def test_hardware_that_is_not_there_is_told_in_one_line(given: tuple[str, dict[str, Any]]) -> None:
    needs = {"gps_gpsd": "utm", "camera": "av", "depth_realsense": "pyrealsense2"}
    if given[0] in needs:
        pytest.importorskip(needs[given[0]])
    sensor = setup(given[0], **given[1])
    with pytest.raises(HalError) as caught:
        await sensor.open()
    text = str(caught.value)
    assert "\n" not in text
    assert "?" in text or "takes" in text
    await sensor.close()


async def until(condition: Callable[[], Any]) -> Any:
    for _ in range(500):
        if found := condition():
            return found
        await asyncio.sleep(0.01)
    raise AssertionError("it did not come in 5 s")


async def test_recorded_distances_are_played(tmp_path: Path) -> None:
    frames = np.stack([np.full((4, 6), 1.0 + k) for k in range(3)])
    frames[:, 0, 0] = inf
    np.save(tmp_path / "frames.npy", frames)
    given = {"path": str(tmp_path / "frames.npy"), "rate": 100.0}
    sensor = player(Setup("played", given, load().config))
    assert PlayerOptions(**given).repeat
    await sensor.open()
    begun = asyncio.get_running_loop().time()
    reading = await until(lambda: sensor.read(asyncio.get_running_loop().time() - begun))
    await sensor.close()
    assert np.isnan(reading.value.depths[0, 0])
    assert reading.value.depths[2, 2] in (1.0, 2.0, 3.0)


def write_video(path: Path, codec: str, rate: int, pixels: str, pictures: int) -> None:
    """Write pictures of 64 x 48, each brighter than the one before."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pixels
        for k in range(pictures):
            picture = np.full((48, 64, 3), 8 * k, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


async def test_a_video_file_is_a_camera(tmp_path: Path) -> None:
    path = tmp_path / "drive.mp4"
    write_video(path, "mpeg4", 20, "yuv420p", 20)
    sensor = setup("camera", source=str(path), rate=20.0, repeat=True)
    await sensor.open()
    begun = asyncio.get_running_loop().time()
    image = (await until(lambda: sensor.read(asyncio.get_running_loop().time() - begun))).value
    await sensor.close()
    assert (image.width, image.height) == (64, 48)
    assert image.data.startswith(b"\xff\xd8")
