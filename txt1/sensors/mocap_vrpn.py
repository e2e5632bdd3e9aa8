"""Motion capture through VRPN, as Vicon serves it: poses of a named subject, and its velocities."""

from dataclasses import dataclass
from math import hypot, isfinite
from typing import Annotated, Final, Literal

from annotated_types import Ge, MinLen

from txt1.config.sources import checked
from txt1.sensors import vrpn_protocol
from txt1.sensors.base import Setup
from txt1.sensors.differentiator import Differentiator
from txt1.sensors.readings import TRACKER_MOUNT, Mount, TrackerReading, tracker_topic
from txt1.sensors.stream import Codec, Measured, Streamed
from txt1.units import NotNegative, Positive

# m; Vicon's unit
MILLIMETRE: Final = 0.001

Axes = Literal["z-up", "y-up"]


class VrpnDecoder(Codec[TrackerReading]):
    """Decodes the messages of a VRPN server into poses of a subject.

    `scale` is the server's unit of length, m. `sensor` is the number of the body among those of the subject; None: it
    has one only. `axes` says which of the server's axes points up.
    """

    def __init__(
        self,
        subject: str,
        scale: float = MILLIMETRE,
        mount: Mount = TRACKER_MOUNT,
        sensor: int | None = None,
        axes: Axes = "z-up",
    ) -> None:
        # and no farewell: a VRPN client leaves without a message
        super().__init__(vrpn_protocol.COOKIE)
        self.names = vrpn_protocol.Names()
        """Names of the server's senders (subjects) and types."""
        self._subject, self._scale, self._mount = subject, scale, mount
        self._sensor, self._axes = sensor, axes
        # the subject's sensors that were seen
        self._sensors: set[int] = set()
        self._splitter = vrpn_protocol.Splitter()
        self._differentiator = Differentiator()

    def feed(self, data: bytes) -> list[Measured[TrackerReading]]:
        """Take bytes; return the poses that they complete. Raises HalError if it is no VRPN server of version 7."""
        found = []
        for message in self._splitter.feed(data):
            if self.names.note(message) or self.names.types.get(message.type) != vrpn_protocol.POSE_TYPE:
                continue
            if self.names.senders.get(message.sender) != self._subject:
                continue
            if len(message.body) != vrpn_protocol.POSE.size:
                self.faults += 1
                continue
            number, _, x, y, z, *quaternion = vrpn_protocol.POSE.unpack(message.body)
            if not self._is_meant(number):
                continue
            norm = hypot(*quaternion)
            # an occluded subject may read 0 0 0 0
            if not (isfinite(x + y + z) and isfinite(norm) and norm > 0.5):
                self.faults += 1
                continue
            qx, qy, qz, qw = (each / norm for each in quaternion)
            if self._axes == "y-up":
                # a quarter turn about x
                y, z, qy, qz = -z, y, -qz, qy
            scale = self._scale
            pose = TrackerReading(
                x * scale, y * scale, z * scale, (qx, qy, qz, qw), subject=self._subject, mount=self._mount
            )
            v, omega = self._differentiator.step(message.time, pose.x, pose.y, pose.theta)
            found.append(Measured(pose._replace(v=v, omega=omega), message.time))
        return found

    def _is_meant(self, number: int) -> bool:
        """Return whether this sensor of the subject is the tracked body."""
        self._sensors.add(number)
        wanted = self._sensor == number or (self._sensor is None and len(self._sensors) == 1)
        # the server lives, also if it tells of other bodies only
        self.idle = True
        if not wanted:
            seen = ", ".join(map(str, sorted(self._sensors)))
            self.trouble = f"subject '{self._subject}' has the sensors {seen}: give options.sensor one of these numbers"
        return wanted


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """The server, and the tracked body."""

    address: Annotated[str, MinLen(1)] = f"socket://127.0.0.1:{vrpn_protocol.PORT}"
    """Address of the VRPN server."""
    subject: str | None = None
    """Name of the tracked body; null: the robot's name, or txt01."""
    sensor: Annotated[int, Ge(0)] | None = None
    """Number of the body among those of the subject; null: it has one only."""
    axes: Axes = "z-up"
    """The server's axis that points up: z-up as Vicon's, or y-up as that of OptiTrack's Motive by default."""
    scale: Positive = MILLIMETRE
    """The server's unit of length, m; 1 for servers that send metres."""
    latency: NotNegative = 0.0
    """Time from exposure to sending, s."""
    mount: Mount = TRACKER_MOUNT
    """x, y, z (m) and yaw (rad) of the subject's origin on the vehicle."""


def create(setup: Setup) -> Streamed[TrackerReading]:
    """Make the driver ``mocap_vrpn``; options: those of `TrackerOptions`."""
    given = checked(TrackerOptions, setup.options, f"sensors.{setup.name}.options")
    subject = given.subject or setup.config.name or "txt01"
    return Streamed(
        tracker_topic(setup.name),
        0.01,
        given.address,
        lambda: VrpnDecoder(subject, given.scale, given.mount, given.sensor, given.axes),
        latency=given.latency,
        server="txt1 sensor virtual vicon",
    )
