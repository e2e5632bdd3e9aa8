"""The robot's pose by AprilTags (J. Wang, E. Olson, IROS 2016) that hang at known places.

How it works. The sensor has no device: the pictures of a camera among the robot's sensors are passed to it. In a thread
OpenCV finds the tags, and where they are before the camera (T. Collins, A. Bartoli, IJCV 109, 2014). The nearest one
counts. Camera and tags are upright, so the tag's distance, its bearing and the direction in which it faces tell x, y
and theta. A tag may hang upside down. The lens is a pinhole; what it distorts is not corrected.
"""

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from math import atan2, cos, hypot, inf, pi, radians, sin, tan
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from annotated_types import Gt, Lt, MinLen

from txt1.config.sources import checked
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.model.kinematics import wrap_angle
from txt1.runtime import Runtime
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.readings import Image, Mount, TrackerReading, tracker_topic
from txt1.sensors.registry import Impaired
from txt1.units import Positive

DRIVER: Final = "apriltags"
# pixels, standard deviation of a corner; assumed
CORNER: Final = 0.5


@dataclass(frozen=True, slots=True)
class TagOptions:
    """The tags, and the camera that sees them."""

    places: Annotated[Mapping[int, tuple[float, float, float]], MinLen(1)]
    """By number: x, y (m) of the tag's middle, and the direction in which it faces, rad; other tags are ignored."""
    size: Positive
    """Side of the black square, m."""
    field: Annotated[float, Gt(0.0), Lt(180.0)]
    """Horizontal angle of view of the camera's pictures, degrees."""
    camera: str = ""
    """Name of the camera among the sensors; left out: the only one."""
    family: Literal["16h5", "25h9", "36h10", "36h11"] = "36h11"
    """Family of the tags."""


class SeenTag(NamedTuple):
    """A tag as a level camera sees it."""

    tag: int
    # m, of its middle
    ahead: float
    left: float
    # rad, direction in which it faces, from the camera's axis
    faces: float
    # standard deviations of the distance (m) and of `faces`
    sigma_distance: float
    sigma_faces: float


def finder(given: TagOptions) -> Callable[[Image], list[SeenTag]]:
    """Return a function that finds the tags in a picture; raises MissingExtra without the extra camera."""
    try:
        cv2: Any = import_module("cv2")
        pillow: Any = import_module("PIL.Image")
    except ImportError:
        raise MissingExtra("finding AprilTags", "camera") from None
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_APRILTAG_{given.family}"))
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector, half = cv2.aruco.ArucoDetector(dictionary, settings), 0.5 * given.size
    # as seen from its front, from the upper left corner clockwise; z comes out of it
    square = np.array(((-half, half, 0.0), (half, half, 0.0), (half, -half, 0.0), (-half, -half, 0.0)))

    def find(image: Image) -> list[SeenTag]:
        grey = np.asarray(pillow.open(BytesIO(image.data)).convert("L"))
        focal = 0.5 * image.width / tan(0.5 * radians(given.field))
        model = np.array(
            ((focal, 0.0, 0.5 * (image.width - 1)), (0.0, focal, 0.5 * (image.height - 1)), (0.0, 0.0, 1.0))
        )
        corners, numbers, _ = detector.detectMarkers(grey)
        found = []
        for tag, each in zip(() if numbers is None else numbers.ravel().tolist(), corners, strict=True):
            if tag not in given.places:
                continue
            _, turns, places, _ = cv2.solvePnPGeneric(square, each[0], model, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
            # the first is the one that fits better; x right, y down, z ahead
            out, (x, _, z) = cv2.Rodrigues(turns[0])[0][:, 2], places[0].ravel().tolist()
            spread = CORNER * (x * x + z * z) / (focal * given.size)
            found.append(SeenTag(tag, z, -x, atan2(-out[0], out[2]), spread, spread / given.size))
        return found

    return find


def seen_from(sight: SeenTag, place: Pose, mount: Mount) -> TrackerReading:
    """Return the vehicle's pose at which a camera at `mount` on it sees a tag that hangs at `place`."""
    eye = place[2] - sight.faces
    c, s = cos(eye), sin(eye)
    ahead, left = c * sight.ahead - s * sight.left, s * sight.ahead + c * sight.left
    theta = wrap_angle(eye - mount.yaw)
    x = place[0] - ahead - (cos(theta) * mount.x - sin(theta) * mount.y)
    y = place[1] - left - (sin(theta) * mount.x + cos(theta) * mount.y)
    # an error of the direction moves the camera across the line to the tag
    distance = hypot(ahead, left)
    along, across = sight.sigma_distance / distance, sight.sigma_faces
    return TrackerReading(
        x,
        y,
        0.0,
        (0.0, 0.0, sin(0.5 * theta), cos(0.5 * theta)),
        subject=str(sight.tag),
        mount=Mount(),
        sigma_x=hypot(along * ahead, across * left),
        sigma_y=hypot(along * left, across * ahead),
        sigma_theta=min(sight.sigma_faces, pi),
    )


class TagSensor:
    """Tags as a sensor of the robot's pose; `saw` takes the camera's pictures."""

    period, simulated = 0.02, True

    def __init__(self, name: str, given: TagOptions) -> None:
        self.topic, self.given = tracker_topic(name), given
        # whether a tag was in the newest picture
        self._seen = False
        self.connected = False
        """Whether a camera's pictures come here."""
        self._find = finder(given)
        self._thread: ThreadPoolExecutor | None = None
        self._busy: asyncio.Future[list[SeenTag]] | None = None
        self._news: Reading[TrackerReading] | None = None
        self._last = -inf

    async def open(self) -> None:
        """Start the thread."""
        self._seen, self._news, self._last = False, None, -inf
        self._thread = ThreadPoolExecutor(1, "txt1 tags")

    async def close(self) -> None:
        """End the thread; an unfinished picture is discarded."""
        thread, self._thread = self._thread, None
        if thread is not None:
            await asyncio.to_thread(thread.shutdown)

    def read(self, now: float) -> Reading[TrackerReading] | None:
        """Return the newest pose; None if there is none. Raises HalError if a picture could not be looked at."""
        del now
        if not self.connected:
            raise HalError("tags are found in the pictures of a robot's camera; there is no robot here")
        news, self._news = self._news, None
        if news is None or news.time <= self._last:
            return None
        self._last = news.time
        return news

    def sees(self) -> bool:
        """Return whether a tag was in the newest picture."""
        return self._seen

    def saw(self, reading: Reading[Image]) -> None:
        """Look for tags in a picture, unless the one before is being looked at."""
        if self._thread is None or self._busy is not None:
            return
        self._busy = asyncio.get_running_loop().run_in_executor(self._thread, self._find, reading.value)
        self._busy.add_done_callback(lambda found: self._found(found, reading.time, reading.value.mount))

    def _found(self, found: asyncio.Future[list[SeenTag]], time: float, mount: Mount) -> None:
        self._busy = None
        # a picture that is damaged shows nothing
        sights = [] if found.cancelled() or found.exception() is not None else found.result()
        self._seen = bool(sights)
        if sights:
            nearest = min(sights, key=lambda sight: sight.sigma_distance)
            self._news = Reading(time, seen_from(nearest, self.given.places[nearest.tag], mount))


def create(setup: Setup) -> TagSensor:
    """Make the driver ``apriltags``; options: those of `TagOptions`."""
    return TagSensor(setup.name, checked(TagOptions, setup.options, f"sensors.{setup.name}.options"))


async def prepare(runtime: Runtime, settings: None) -> None:
    """Connect the sensors of tags with their cameras; raises ConfigError if there is none, or not one."""
    del settings
    cameras = [name for name, each in runtime.sensors.items() if each.sensor.topic.type is Image]
    for name, polled in runtime.sensors.items():
        config, sensor = runtime.config.sensors.get(name), polled.sensor
        if config is None or config.driver != DRIVER:
            continue
        if isinstance(sensor, Impaired):
            raise ConfigError(f"sensors.{name}: give delay and drop_out to its camera")
        if not isinstance(sensor, TagSensor):
            # a replay has the recorded poses
            continue
        camera = sensor.given.camera or (cameras[0] if len(cameras) == 1 else "")
        if camera not in cameras:
            there = ", ".join(cameras) or "none"
            raise ConfigError(f"sensors.{name}.options.camera: '{camera}' is no camera; there are: {there}")
        runtime.sensors[camera].listeners.append(sensor.saw)
        sensor.connected = True
        # no tag in sight is no fault of the sensor
        polled.needed = sensor.sees
