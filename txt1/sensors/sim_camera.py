"""A simulated camera and depth camera: pictures drawn from the world, with its lamp."""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import cos, inf, radians, sin
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from txt1.config.sources import checked
from txt1.errors import HalError
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.camera import jpeg
from txt1.sensors.readings import CAMERA_MOUNT, DepthImage, Image, depth_topic, image_topic
from txt1.sensors.sim_laser import bodies
from txt1.sensors.simulated_sensor import Others, others_of, true_pose
from txt1.sim.parameters import Box
from txt1.sim.rays import shapes_of, walls_of
from txt1.sim.view import Camera, Scene, distances, draw
from txt1.telemetry.topics import Topic
from txt1.units import Positive, PositiveInt

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """A pinhole camera, at the place of the original's."""

    width: PositiveInt = 160
    """Pixels."""
    height: PositiveInt = 120
    """Pixels."""
    field: Annotated[float, Gt(0.0), Lt(180.0)] = 60.0
    """Horizontal angle of view, degrees."""
    rate: Positive = 10.0
    """Pictures a second."""
    quality: Annotated[int, Ge(1), Le(95)] = 75
    """Quality of the JPEG."""
    range_min: Positive = 0.5
    """Shortest distance that a depth camera measures, m; as of a Kinect."""
    range_max: Annotated[float, Gt(0.0), Le(65.0)] = 4.0
    """Longest distance, m."""


class SimulatedCamera(Generic[T]):
    """A camera on a vehicle whose true pose is `pose`, among other vehicles at the poses `others`.

    Drawing takes longer than the event loop may wait for. So `read` only exposes: it stores the poses, and a thread
    draws. The next `read` returns this picture, with the time of its exposure, and exposes again. Virtual time stands
    still while a thread draws, so each picture is exactly a period old when it arrives, and a run repeats to the last
    bit. In real time a picture that takes longer arrives later, and the next exposure waits for it.

    `expose` draws in the thread. It computes a value from the camera's pose and the other vehicles' poses, and must not
    use anything else that changes.
    """

    simulated = True

    def __init__(
        self,
        topic: Topic[T],
        pose: Callable[[], Pose | None],
        others: Others,
        expose: Callable[[Pose, Sequence[Pose | Box]], T],
        rate: float = 10.0,
    ) -> None:
        self.topic, self.period = topic, 1.0 / rate
        self._pose, self._others, self._expose = pose, others, expose
        self._thread: ThreadPoolExecutor | None = None
        self._exposed = -inf
        self._picture: asyncio.Future[T] | None = None

    async def open(self) -> None:
        """Prepare for a new run."""
        self._exposed, self._picture = -inf, None
        self._thread = ThreadPoolExecutor(1, "txt1 camera")
        # the thread starts now, so that no `read` waits for it
        await asyncio.get_running_loop().run_in_executor(self._thread, int)

    async def close(self) -> None:
        """End the thread; an unfinished picture is discarded."""
        thread, self._thread = self._thread, None
        picture, self._picture = self._picture, None
        if thread is not None:
            # the thread finishes its picture
            await asyncio.to_thread(thread.shutdown)
        if picture is not None:
            await asyncio.wait([picture])
            # otherwise Python warns of an error that was not retrieved
            picture.exception()

    def read(self, now: float) -> Reading[T] | None:
        """Return the picture of the last exposure; None if there is none. Raises HalError if it could not be drawn."""
        drawing = self._picture is not None and not self._picture.done()
        if self._thread is None or drawing or now <= self._exposed:
            return None
        time, picture = self._exposed, self._picture
        pose, self._picture = self._pose(), None
        if pose is not None:
            x, y, theta = pose
            mount = CAMERA_MOUNT
            x, y = x + mount.x * cos(theta) - mount.y * sin(theta), y + mount.x * sin(theta) + mount.y * cos(theta)
            eye = x, y, theta + mount.yaw
            loop = asyncio.get_running_loop()
            self._picture = loop.run_in_executor(self._thread, self._expose, eye, tuple(self._others()))
            self._exposed = now
        if picture is None:
            return None
        try:
            return Reading(time, picture.result())
        except Exception as error:
            raise HalError(f"the picture cannot be drawn: {type(error).__name__}: {error}") from error


def millimetres(distances: Any, range_min: float, range_max: float) -> bytes:
    """Convert distances (height, width) in m to `DepthImage.data`."""
    seen = (distances >= range_min) & (distances <= range_max)
    return bytes(np.where(seen, np.round(1000.0 * np.where(seen, distances, 0.0)), 0.0).astype("<u2").tobytes())


def photograph(given: CameraOptions, camera: Camera, scene: Scene, eye: Pose) -> Image:
    """Return the picture from a pose."""
    x, y, theta = eye
    return Image(given.width, given.height, jpeg(draw(camera, scene, x, y, CAMERA_MOUNT.z, theta), given.quality))


def measure(given: CameraOptions, camera: Camera, scene: Scene, eye: Pose) -> DepthImage:
    """Return the distances from a pose."""
    x, y, theta = eye
    seen = distances(camera, scene, x, y, CAMERA_MOUNT.z, theta)
    return DepthImage(given.width, given.height, millimetres(seen, given.range_min, given.range_max), camera.focal)


def _camera(
    setup: Setup, topic: Topic[T], expose: Callable[[CameraOptions, Camera, Scene, Pose], T]
) -> SimulatedCamera[T]:
    """Return a camera as configured, in the configured room, where only other vehicles and movers move."""
    given = checked(CameraOptions, setup.options, f"sensors.{setup.name}.options")
    sim, body = setup.config.sim, setup.config.geometry
    camera = Camera(given.width, given.height, radians(given.field))
    walls, obstacles = walls_of(sim.room.built()), shapes_of(sim.obstacles)

    def seen(eye: Pose, others: Sequence[Pose | Box]) -> T:
        return expose(given, camera, Scene(walls, obstacles, bodies(others, body), sim.room.light), eye)

    return SimulatedCamera(topic, true_pose(setup), others_of(setup), seen, given.rate)


def simulated(setup: Setup) -> SimulatedCamera[Image]:
    """Make the driver ``sim_camera``; options: those of `CameraOptions`."""
    # reports a missing extra now
    jpeg(np.zeros((1, 1, 3), np.uint8))
    return _camera(setup, image_topic(setup.name), photograph)


def simulated_depth(setup: Setup) -> SimulatedCamera[DepthImage]:
    """Make the driver ``sim_depth``; options: those of `CameraOptions`."""
    return _camera(setup, depth_topic(setup.name), measure)
