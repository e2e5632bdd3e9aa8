"""AprilTags as landmarks: OpenCV draws their patterns, and a pinhole's rays judge the poses."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Mapping
from functools import cache
from math import cos, hypot, pi, radians, sin
from random import Random
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2", reason="AprilTags need the extra 'camera'")

from tests.examples import some
from tests.unit.tags.drawn_tags import hang
from txt1 import Robot, run
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.model.kinematics import wrap_angle
from txt1.sensors.base import Reading, Sensor
from txt1.sensors.camera import jpeg
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.readings import Image, Mount, TrackerReading
from txt1.sim.view import Camera
from txt1.tags.sensor import TagOptions, TagSensor, finder, seen_from

CAMERA = Camera(480, 360, radians(60.0))
SIZE, HEIGHT = 0.2, 0.2
FRONT = Mount(0.2, 0.0, HEIGHT, 0.0)
PLACES = {5: (2.0, 1.0, 0.5), 7: (-1.0, 3.0, -2.0)}


def photo(
    pose: tuple[float, float, float],
    mount: Mount = FRONT,
    tags: Mapping[int, tuple[float, float, float]] = PLACES,
    upside_down: bool = False,
) -> Image:
    """The picture of a camera at `mount` on a vehicle at a pose, with noise."""
    x, y, theta = pose
    eye = x + cos(theta) * mount.x - sin(theta) * mount.y, y + sin(theta) * mount.x + cos(theta) * mount.y
    grey = np.full((CAMERA.height, CAMERA.width, 3), 140, np.uint8)
    picture = hang(grey, CAMERA, (*eye, mount.z, theta + mount.yaw), tags, SIZE, HEIGHT)
    if upside_down:
        # a camera on its head sees every tag on its head, and left and right exchanged
        picture = picture[::-1, ::-1]
    noise = np.random.default_rng(1).normal(0.0, 4.0, picture.shape)
    return Image(
        CAMERA.width, CAMERA.height, jpeg(np.clip(picture * 0.8 + 20.0 + noise, 0, 255).astype(np.uint8)), mount
    )


def seen(image: Image, places: Mapping[int, tuple[float, float, float]] = PLACES) -> list[TrackerReading]:
    """The poses by the tags of a picture."""
    found = finder(TagOptions(places, SIZE, 60.0))(image)
    return [seen_from(each, places[each.tag], image.mount) for each in found]


def before(tag: tuple[float, float, float], distance: float, aside: float, turned: float) -> tuple[float, float, float]:
    """A pose at a distance before a tag, from its normal by `aside` and turned from the line to it, rad."""
    x, y, faces = tag
    return x + distance * cos(faces + aside), y + distance * sin(faces + aside), faces + aside + pi + turned


@pytest.mark.parametrize(
    "mount", some(FRONT, Mount(0.1, 0.15, HEIGHT, 0.4), rest=[Mount(-0.2, -0.1, 0.3, pi)]), ids=str
)
def test_the_pose_is_the_true_one_within_what_the_sigmas_tell(mount: Mount) -> None:
    random, offs, count = Random(1), [], 0
    for _ in range(8):
        pose = before(
            PLACES[5], random.uniform(0.7, 2.5), random.uniform(-0.9, 0.9), random.uniform(-0.2, 0.2) - mount.yaw
        )
        for told in seen(photo(pose, mount)):
            count += 1
            assert told.sigma_x and told.sigma_y and told.sigma_theta
            off = told.x - pose[0], told.y - pose[1], wrap_angle(told.theta - pose[2])
            offs.append(hypot(*off[:2]))
            assert abs(off[0]) < 3.0 * told.sigma_x and abs(off[1]) < 3.0 * told.sigma_y
            assert abs(off[2]) < 3.0 * told.sigma_theta
    assert count >= 6 and sorted(offs)[len(offs) // 2] < 0.06


def test_near_a_tag_the_pose_is_good_to_2_cm_and_a_degree() -> None:
    pose = before(PLACES[5], 0.7, 0.4, 0.1)
    (told,) = seen(photo(pose))
    assert (told.x, told.y) == pytest.approx(pose[:2], abs=0.02)
    assert wrap_angle(told.theta - pose[2]) == pytest.approx(0.0, abs=radians(1.0))


def test_a_tag_may_hang_upside_down() -> None:
    """A picture turned by half a turn is that of the tag upside down at the other side of the axis."""
    (one,) = finder(TagOptions(PLACES, SIZE, 60.0))(photo(before(PLACES[5], 1.0, 0.3, 0.1)))
    (two,) = finder(TagOptions(PLACES, SIZE, 60.0))(photo(before(PLACES[5], 1.0, 0.3, 0.1), upside_down=True))
    assert two.ahead == pytest.approx(one.ahead, abs=0.02) and two.left == pytest.approx(-one.left, abs=0.02)
    assert wrap_angle(two.faces + one.faces) == pytest.approx(0.0, abs=0.05)


def test_tags_without_a_place_are_ignored_and_the_back_of_a_tag_shows_nothing() -> None:
    pose = before(PLACES[5], 1.0, 0.0, 0.0)
    assert seen(photo(pose)) and not seen(photo(pose), {6: (0.0, 0.0, 0.0)})
    assert not seen(photo(before(PLACES[5], 1.0, pi, 0.0)))


@cache
def near() -> Image:
    """A tag at 1 m."""
    return photo(before(PLACES[5], 1.0, 0.0, 0.0))


class Fed(TagSensor):
    """It gets a picture every 0.1 s; the clock of the run begins when it is opened."""

    def __init__(self) -> None:
        super().__init__("fed_tags", TagOptions(PLACES, SIZE, 60.0))
        self.connected = True

    async def open(self) -> None:
        await super().open()
        self.feeding = asyncio.create_task(self.feed())

    async def close(self) -> None:
        if hasattr(self, "feeding"):
            self.feeding.cancel()
        await super().close()

    async def feed(self) -> None:
        while True:
            await asyncio.sleep(0.1)
            self.saw(Reading(asyncio.get_running_loop().time(), near()))


class TestTags(SensorConformance):
    def make(self) -> Sensor[Any]:
        return Fed()


def test_a_damaged_picture_shows_nothing_and_the_next_one_is_read() -> None:
    async def main() -> None:
        sensor = TagSensor("damaged_tags", TagOptions(PLACES, SIZE, 60.0))
        sensor.connected = True
        await sensor.open()
        found = []
        for k, data in enumerate((near().data, near().data[:500], b"", near().data), 1):
            sensor.saw(Reading(float(k), near()._replace(data=data)))
            await asyncio.sleep(0.1)
            told = sensor.read(float(k))
            found.append(told is not None and told.time == k)
            assert sensor.sees() is found[-1]
        await sensor.close()
        assert found == [True, False, False, True]

    run(main(), speed="max")


TAGS = ("sensors.tags.driver=apriltags", "sensors.tags.options={places: {5: [2, 1, 0.5]}, size: 0.2, field: 60}")
FRONT_CAMERA = "sensors.front.driver=sim_camera"


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ((), "sensors.tags.options.camera: '' is no camera; there are: none"),
        ((FRONT_CAMERA, "sensors.tail.driver=sim_camera"), "there are: front, tail"),
        ((FRONT_CAMERA, "sensors.tags.options.camera=rear"), "'rear' is no camera; there are: front"),
        ((FRONT_CAMERA, "sensors.tags.delay=0.1"), "sensors.tags: give delay and drop_out to its camera"),
        ((FRONT_CAMERA, "sensors.tags.options.size=0"), "sensors.tags.options.size"),
        ((FRONT_CAMERA, "sensors.tags.options.places={}"), "sensors.tags.options.places"),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused_with_what_there_is(settings: tuple[str, ...], told: str) -> None:
    async def main() -> None:
        async with Robot.open("sim", settings=(*TAGS, *settings)):
            pass

    with pytest.raises(ConfigError) as failure:
        run(main(), speed="max")
    assert told in str(failure.value)


def test_without_a_robot_or_opencv_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    given = TagOptions(PLACES, SIZE, 60.0)
    with pytest.raises(HalError, match="there is no robot here"):
        TagSensor("lonely_tags", given).read(0.0)
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingExtra, match="camera"):
        finder(given)
