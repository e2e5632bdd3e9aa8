"""The twins of a camera and of a depth camera: pictures drawn from the world, the lamp in it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from math import cos, inf, radians, sin
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from txt1.config.sources import checked
from txt1.errors import MissingExtra
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.readings import CAMERA_MOUNT, DepthImage, Image, depth_topic, image_topic
from txt1.sensors.sim_laser import Others, bodies
from txt1.sensors.twin import true_pose
from txt1.sim.rays import shapes_of, walls_of
from txt1.sim.room import Room
from txt1.sim.view import Camera, Picture, Scene, draw
from txt1.telemetry.topics import Topic
from txt1.units import Positive, PositiveInt

T = TypeVar("T")
Take = Callable[[Picture, Any], T]  # makes a value of a picture and of distances


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """A pinhole camera at the original's place."""

    width: PositiveInt = 160
    """Pixels."""
    height: PositiveInt = 120
    """Pixels."""
    field: Annotated[float, Gt(0.0), Lt(180.0)] = 60.0
    """Horizontal angle of view, degrees."""
    rate: Positive = 10.0
    """Pictures a second."""
    quality: Annotated[int, Ge(1), Le(95)] = 75
    """Of the JPEG."""
    range_min: Positive = 0.5
    """Shortest distance that a depth camera measures, m; a Kinect's."""
    range_max: Annotated[float, Gt(0.0), Le(65.0)] = 4.0
    """Longest distance, m."""


class SimulatedCamera(Generic[T]):
    """A camera on a vehicle whose true pose is `pose`; `take` makes a reading of colours and depths."""

    simulated = True

    def __init__(
        self,
        topic: Topic[T],
        pose: Callable[[], Pose | None],
        scene: Callable[[], Scene],
        camera: Camera,
        take: Take[T],
        rate: float = 10.0,
    ) -> None:
        self.topic, self.period = topic, 1.0 / rate
        self._pose, self._scene, self._camera, self._take = pose, scene, camera, take
        self._last = -inf

    async def open(self) -> None:
        """A new run may begin."""
        self._last = -inf

    async def close(self) -> None:
        """Nothing to let go of."""

    def read(self, now: float) -> Reading[T] | None:
        """The reading at `now`; None: there is none later than the last."""
        pose = self._pose()
        if pose is None or now <= self._last:
            return None
        self._last = now
        x, y, theta = pose
        mount = CAMERA_MOUNT
        x, y = x + mount.x * cos(theta) - mount.y * sin(theta), y + mount.x * sin(theta) + mount.y * cos(theta)
        return Reading(now, self._take(*draw(self._camera, self._scene(), x, y, mount.z, theta + mount.yaw)))


def jpeg(picture: Picture, quality: int = 75) -> bytes:
    """A picture (height, width, 3) as JPEG; MissingExtra without the extra camera."""
    try:
        from PIL import Image as Pillow
    except ImportError:
        raise MissingExtra("pictures as JPEG", "camera") from None
    data = BytesIO()
    Pillow.fromarray(picture).save(data, "JPEG", quality=quality)
    return data.getvalue()


def millimetres(distances: Any, range_min: float, range_max: float) -> bytes:
    """Distances (height, width) in m as `DepthImage.data`."""
    seen = (distances >= range_min) & (distances <= range_max)
    return bytes(np.where(seen, np.round(1000.0 * np.where(seen, distances, 0.0)), 0.0).astype("<u2").tobytes())


def _scene_of(setup: Setup) -> Callable[[], Scene]:
    sim, body = setup.config.sim, setup.config.geometry
    walls, obstacles = walls_of(Room(sim.room.length, sim.room.width)), shapes_of(sim.obstacles)
    others: Others = getattr(setup.hal, "others", tuple)
    return lambda: Scene(walls, obstacles, _bodies(others(), body), sim.room.light)


def _bodies(poses: Sequence[Pose], body: Geometry) -> Any:
    return bodies(poses, body)


def simulated(setup: Setup) -> SimulatedCamera[Image]:
    """The driver ``sim_camera``; options: those of `CameraOptions`."""
    given = checked(CameraOptions, setup.options, f"sensors.{setup.name}.options")
    camera = Camera(given.width, given.height, radians(given.field))
    jpeg(np.zeros((1, 1, 3), np.uint8))  # tells now that the extra is missing

    def take(picture: Picture, distances: Any) -> Image:
        del distances
        return Image(given.width, given.height, jpeg(picture, given.quality))

    return SimulatedCamera(image_topic(setup.name), true_pose(setup), _scene_of(setup), camera, take, given.rate)


def simulated_depth(setup: Setup) -> SimulatedCamera[DepthImage]:
    """The driver ``sim_depth``; options: those of `CameraOptions`."""
    given = checked(CameraOptions, setup.options, f"sensors.{setup.name}.options")
    camera = Camera(given.width, given.height, radians(given.field))

    def take(picture: Picture, distances: Any) -> DepthImage:
        del picture
        data = millimetres(distances, given.range_min, given.range_max)
        return DepthImage(given.width, given.height, data, camera.focal)

    return SimulatedCamera(depth_topic(setup.name), true_pose(setup), _scene_of(setup), camera, take, given.rate)
