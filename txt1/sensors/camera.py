"""A camera: pictures of a V4L2 device or a video file, as JPEG, through PyAV."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from math import inf
from typing import Annotated, Any, Final

import numpy as np
from annotated_types import Ge, Le, MinLen
from numpy.typing import NDArray

from txt1.config.sources import checked
from txt1.errors import HalError, MissingExtra
from txt1.kernel.clock import RealClock, seconds
from txt1.sensors.base import Setup
from txt1.sensors.frame_grabber import Frames
from txt1.sensors.readings import CAMERA_MOUNT, Image, Mount, image_topic
from txt1.units import NotNegative, Positive, PositiveInt

# s without a picture after which the camera is begun again; and until it has begun
PICTURE_PATIENCE: Final = 5.0
START_PATIENCE: Final = 30.0
SILENT: Final = "the camera sends no pictures any more: is it plugged in, and does no other program use it?"
# s between two looks whether a picture has come
PICTURE_CHECK_PERIOD: Final = 0.005

_clock: Final = RealClock()


@dataclass(frozen=True, slots=True)
class VideoOptions:
    """The source of the pictures, and their rate."""

    source: Annotated[str, MinLen(1)] = "/dev/video0"
    """A V4L2 device, a video file, or the address of a stream, such as http://192.168.1.8/video.mjpg."""
    width: PositiveInt = 640
    """Width requested from a device, pixels."""
    height: PositiveInt = 480
    """Height requested from a device, pixels."""
    rate: Positive = 10.0
    """Largest number of pictures a second."""
    quality: Annotated[int, Ge(1), Le(95)] = 75
    """Quality of the JPEG."""
    repeat: bool = False
    """Whether a file starts again at its end."""
    latency: NotNegative = 0.0
    """Time from exposure to arrival, s."""
    mount: Mount = CAMERA_MOUNT
    """x, y, z (m) and yaw (rad) of the camera on the vehicle."""


def jpeg(picture: NDArray[np.uint8], quality: int = 75) -> bytes:
    """Return a picture (height, width, 3) as JPEG; raises MissingExtra without the extra camera."""
    try:
        from PIL import Image as Pillow
    except ImportError:
        raise MissingExtra("pictures as JPEG", "camera") from None
    data = BytesIO()
    Pillow.fromarray(picture).save(data, "JPEG", quality=quality)
    return data.getvalue()


def is_live(source: str) -> bool:
    """Return whether pictures come from a device or a stream, so that their absence is silence."""
    return source.startswith("/dev/") or "://" in source


def pictures(given: VideoOptions, wait: Callable[[float], object]) -> Iterator[Image | None]:
    """Yield the pictures of the source as they come, those of a file at its own pace by `wait`.

    None is a picture that cannot be decoded. Raises HalError, with the remedy.
    """
    try:
        import av
    except ImportError:
        raise MissingExtra("a camera", "camera") from None
    device, live = given.source.startswith("/dev/"), is_live(given.source)
    # a device that does not block: its silence has to be noticed
    options = {"video_size": f"{given.width}x{given.height}", "fflags": "nonblock"} if device else {}
    timeout = (START_PATIENCE, PICTURE_PATIENCE) if live else None
    while True:
        try:
            container = av.open(given.source, format="v4l2" if device else None, options=options, timeout=timeout)
        except (OSError, ValueError, av.FFmpegError) as error:
            # most of PyAV's errors are OSError or ValueError, too; a time-out is neither
            remedy = "is it a video file?"
            if live:
                remedy = "is the camera plugged in, and are you in the group video?" if device else "is the camera on?"
            why = getattr(error, "strerror", None) or error
            raise HalError(f"{given.source}: {why}: {remedy}") from None
        with container:
            if not container.streams.video:
                raise HalError(f"{given.source}: there is no picture in it: is it a video file?")
            last, began = -inf, None
            for frame in _waited_for(container, wait) if live else _decoded(container):
                if frame is None:
                    yield None
                    continue
                time = frame.time if frame.time is not None else last + 1.0 / given.rate
                if time < last + 1.0 / given.rate - 1e-6:
                    continue
                if not live:
                    wait(0.0 if began is None else min(max(time - last, 0.0), 1.0))
                last = began = time
                yield Image(
                    frame.width,
                    frame.height,
                    jpeg(np.asarray(frame.to_ndarray(format="rgb24"), np.uint8), given.quality),
                    given.mount,
                )
        if live:
            raise HalError(f"{given.source} sends no more pictures: is the camera plugged in?")
        if not given.repeat:
            return


def _decoded(container: Any) -> Iterator[Any]:
    """Yield the frames of a video; None for each packet that cannot be decoded: cameras lose transfers."""
    import av

    for packet in container.demux(video=0):
        try:
            yield from packet.decode()
        except av.FFmpegError:
            yield None


def _waited_for(container: Any, wait: Callable[[float], object]) -> Iterator[Any]:
    """Yield the frames of a device or a stream, until the sensor is closed; raises HalError if none comes for long."""
    import av

    last = _clock.now_ns()
    while not wait(0.0):
        try:
            for frame in _decoded(container):
                last = _clock.now_ns()
                yield frame
            return
        except BlockingIOError:
            # no picture yet
            wait(PICTURE_CHECK_PERIOD)
        except av.ExitError:
            # a stream was waited for in vain
            raise HalError(SILENT) from None
        except (OSError, ValueError) as error:
            raise HalError(f"the camera sends no more pictures: {error}: is it plugged in?") from None
        if seconds(_clock.now_ns() - last) > PICTURE_PATIENCE:
            raise HalError(SILENT)


def create(setup: Setup) -> Frames[Image]:
    """Make the driver ``camera``; options: those of `VideoOptions`."""
    given = checked(VideoOptions, setup.options, f"sensors.{setup.name}.options")
    return Frames(image_topic(setup.name), 1.0 / given.rate, lambda wait: pictures(given, wait), given.latency)
