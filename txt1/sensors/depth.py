"""Depth cameras: an Intel RealSense through pyrealsense2, and a player of recorded frames."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import radians, tan
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Lt, MinLen

from txt1.config.sources import checked
from txt1.errors import HalError, MissingExtra
from txt1.sensors.base import Setup
from txt1.sensors.frame_grabber import Frames
from txt1.sensors.readings import CAMERA_MOUNT, DepthImage, Mount, depth_topic
from txt1.units import NotNegative, Positive, PositiveInt

# s to wait for a frame
PATIENCE_MS = 5000


@dataclass(frozen=True, slots=True)
class RealSenseOptions:
    """The camera, and the rate and size of its frames."""

    serial_number: str = ""
    """Serial number of the camera; empty: the only connected camera."""
    width: PositiveInt = 640
    """Pixels."""
    height: PositiveInt = 480
    """Pixels."""
    rate: PositiveInt = 30
    """Frames a second, one of the camera's rates."""
    latency: NotNegative = 0.0
    """Time from exposure to arrival, s."""
    mount: Mount = CAMERA_MOUNT
    """x, y, z (m) and yaw (rad) of the camera on the vehicle."""


def realsense_frames(given: RealSenseOptions) -> Iterator[DepthImage]:
    """Yield the frames of a RealSense as they come. Raises HalError, with the remedy."""
    try:
        import pyrealsense2 as rs
    except ImportError:
        raise MissingExtra("a depth camera", "camera") from None
    # starting without a camera would wait 15 s
    if not len(rs.context().query_devices()):
        raise HalError("no RealSense camera is found: is it plugged in, and are librealsense's udev rules installed?")
    pipeline, wanted = rs.pipeline(), rs.config()
    if given.serial_number:
        wanted.enable_device(given.serial_number)
    wanted.enable_stream(rs.stream.depth, given.width, given.height, rs.format.z16, given.rate)
    try:
        profile = pipeline.start(wanted)
    except RuntimeError as error:
        raise HalError(
            f"RealSense camera {given.serial_number or '(any)'}: {error}: is it plugged into a USB 3 port, has it "
            f"{given.width} x {given.height} at {given.rate} Hz, and are librealsense's udev rules installed?"
        ) from None
    try:
        unit = profile.get_device().first_depth_sensor().get_depth_scale() * 1000.0  # mm
        focal = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics().fx
        while True:
            frame = pipeline.wait_for_frames(PATIENCE_MS).get_depth_frame()
            if frame:
                raw: Any = np.asanyarray(frame.get_data())
                mm = raw if abs(unit - 1.0) < 1e-6 else np.minimum(np.round(raw * unit), 65535)
                data = bytes(mm.astype("<u2").tobytes())
                yield DepthImage(frame.get_width(), frame.get_height(), data, float(focal), given.mount)
    except RuntimeError as error:
        raise HalError(f"the RealSense camera sends no more frames: {error}") from None
    finally:
        pipeline.stop()


@dataclass(frozen=True, slots=True)
class PlayerOptions:
    """Recorded frames and their camera."""

    path: Annotated[str, MinLen(1)]
    """A numpy file (.npy) of distances, (frames, height, width): mm as uint16, or m as floats."""
    rate: Positive = 10.0
    """Frames a second."""
    field: Annotated[float, Gt(0.0), Lt(180.0)] = 60.0
    """Horizontal angle of view, degrees."""
    repeat: bool = True
    """Whether the file starts again at its end."""
    mount: Mount = CAMERA_MOUNT
    """x, y, z (m) and yaw (rad) of the camera on the vehicle."""


def played_frames(given: PlayerOptions, wait: Callable[[float], object]) -> Iterator[DepthImage]:
    """Yield the frames of a file at their rate, kept by `wait`. Raises HalError if the file is wrong."""
    try:
        frames = np.load(Path(given.path), mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError) as error:
        raise HalError(f"{given.path}: {error}: it takes a numpy file (.npy) of distances") from None
    if frames.ndim != 3 or frames.dtype.kind not in "uf" or not frames.size:
        raise HalError(
            f"{given.path}: {frames.dtype} of shape {frames.shape}: it takes numbers, (frames, height, width)"
        )
    height, width = frames.shape[1:]
    focal = 0.5 * width / tan(radians(0.5 * given.field))
    while True:
        for frame in frames:
            mm = frame if frames.dtype.kind == "u" else np.round(np.nan_to_num(frame, posinf=0.0) * 1000.0)
            data = bytes(np.clip(mm, 0, 65535).astype("<u2").tobytes())
            yield DepthImage(width, height, data, focal, given.mount)
            wait(1.0 / given.rate)
        if not given.repeat:
            return


def realsense(setup: Setup) -> Frames[DepthImage]:
    """Make the driver ``depth_realsense``; options: those of `RealSenseOptions`."""
    given = checked(RealSenseOptions, setup.options, f"sensors.{setup.name}.options")
    return Frames(depth_topic(setup.name), 1.0 / given.rate, lambda _: realsense_frames(given), given.latency)


def player(setup: Setup) -> Frames[DepthImage]:
    """Make the driver ``depth_player``; options: those of `PlayerOptions`."""
    given = checked(PlayerOptions, setup.options, f"sensors.{setup.name}.options")
    return Frames(depth_topic(setup.name), 1.0 / given.rate, lambda wait: played_frames(given, wait))
