"""A source of pictures that fails is opened again, and a bad picture costs itself."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.patience import LIMIT, until
from tests.unit.sensors.test_twins import setup, write_video
from txt1.errors import HalError
from txt1.sensors.camera import VideoOptions, pictures
from txt1.sensors.frame_grabber import Exposed, Frames, Wait
from txt1.sensors.readings import DepthImage, depth_topic

PICTURE = DepthImage(1, 1, b"\0\0", 1.0)


async def read(sensor: Frames[Any], enough: Callable[[list[Any], list[str]], bool]) -> tuple[list[Any], list[str]]:
    """The readings and the failures of an open sensor, until there are enough."""
    time = asyncio.get_running_loop().time
    began, found, failures = time(), [], []
    while not enough(found, failures):
        assert time() < began + LIMIT
        await asyncio.sleep(0.005)
        try:
            if (reading := sensor.read(time() - began + 1.0)) is not None:
                found.append(reading)
        except HalError as error:
            failures += [str(error)] if str(error) not in failures else []
    return found, failures


async def test_a_source_that_fails_is_opened_again_and_one_at_its_end_is_not() -> None:
    begun = 0

    def begin(wait: Wait) -> Iterator[DepthImage | None]:
        nonlocal begun
        begun += 1
        if begun in (2, 3):
            raise HalError("the camera is unplugged")
        yield PICTURE
        yield None
        wait(0.02)
        if begun == 1:
            raise RuntimeError("a transfer was lost")
        yield PICTURE

    sensor = Frames(depth_topic("failing"), 0.01, begin)
    await sensor.open()
    _, failures = await read(sensor, lambda found, failures: "there are no more pictures" in failures)
    assert failures[0] == "RuntimeError: a transfer was lost"
    assert failures[-1] == "there are no more pictures"
    await asyncio.sleep(0.3)
    assert (begun, sensor.faults) == (4, 2)
    await sensor.close()


async def test_a_source_that_does_not_open_at_first_is_not_tried_again() -> None:
    begun = 0

    def begin(wait: Wait) -> Iterator[DepthImage | None]:
        nonlocal begun
        begun += 1
        raise HalError("no camera")

    sensor = Frames(depth_topic("absent"), 0.01, begin)
    with pytest.raises(HalError, match="no camera"):
        await sensor.open()
    await asyncio.sleep(0.3)
    assert begun == 1
    await sensor.close()


def test_a_picture_that_cannot_be_decoded_costs_itself(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    write_video(path, "mjpeg", 15, "yuvj420p", 30)
    data, places, at = bytearray(path.read_bytes()), [], 0
    while (at := data.find(b"00dc", at)) >= 0:
        if data[at + 8 : at + 10] == b"\xff\xd8":
            places.append(at)
        at += 4
    length = int.from_bytes(data[places[9] + 4 : places[9] + 8], "little")
    # as a lost USB transfer leaves it
    data[places[9] + 8 : places[9] + 8 + length] = bytes(length)
    path.write_bytes(data)
    found = list(pictures(VideoOptions(source=str(path), rate=15.0), lambda seconds: None))
    assert (len([each for each in found if each is not None]), found.count(None)) == (29, 1)
    assert setup("camera", source=str(path))


async def test_a_frame_of_known_age_has_the_time_of_its_exposure() -> None:
    def begin(wait: Wait) -> Iterator[Exposed[DepthImage] | DepthImage]:
        while not wait(0.01):
            yield Exposed(PICTURE, 0.5)

    # the latency is for frames whose age is not known
    sensor = Frames(depth_topic("exposed"), 0.01, begin, latency=0.4)
    await sensor.open()
    now = asyncio.get_running_loop().time
    began = now() - 10.0
    found: list[Any] = []
    await until(lambda: found.append(sensor.read(now() - began)) or found[-1] is not None)
    arrived = now() - began
    assert found[-1].time <= arrived - 0.5
    await sensor.close()
