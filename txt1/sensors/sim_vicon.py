"""A simulated motion capture system, with small noise and occlusions."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, inf, sin
from random import Random

from txt1.config.sources import checked
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.differentiator import Differentiator
from txt1.sensors.readings import TRACKER_MOUNT, Mount, TrackerReading, tracker_topic
from txt1.sensors.simulated_sensor import Absences, SimulatedSensor, random_of, true_pose
from txt1.units import NotNegative, Positive


@dataclass(frozen=True, slots=True)
class TrackerErrors:
    """The errors of a tracker; assumed."""

    noise: NotNegative = 0.001
    """Standard deviation of a coordinate, m."""
    angle_noise: NotNegative = 0.002
    """Standard deviation of the heading, rad."""
    occlusions: tuple[tuple[float, float], ...] = ()
    """Beginnings and ends of occlusions, s of the run."""
    occlusion_every: NotNegative = 0.0
    """Mean time between two random occlusions, s; 0 is never."""
    occlusion_length: Positive = 0.5
    """Mean length of a random occlusion, s."""


class SimulatedTracker(SimulatedSensor[TrackerReading]):
    """A tracker that sees a vehicle whose true pose is `pose`."""

    def __init__(
        self,
        name: str,
        pose: Callable[[], Pose | None],
        errors: TrackerErrors,
        rng: Random,
        subject: str = "",
        mount: Mount = TRACKER_MOUNT,
    ) -> None:
        super().__init__(tracker_topic(name), 0.01, pose)
        self._errors, self._rng, self._subject, self._mount = errors, rng, subject, mount
        self._occlusions = Absences(errors.occlusions, errors.occlusion_every, errors.occlusion_length, rng)
        self._differentiator = Differentiator()

    def see(self, pose: Pose, now: float, before: float) -> Reading[TrackerReading] | None:
        """Return the pose at `now`; None during an occlusion."""
        errors, draw = self._errors, self._rng.gauss
        if before == -inf:
            self._differentiator = Differentiator()
        noise, mount = errors.noise, self._mount
        x, y, z = pose[0] + noise * draw(), pose[1] + noise * draw(), mount.z + noise * draw()
        theta = pose[2] + errors.angle_noise * draw()
        if self._occlusions.at(now):
            return None
        v, omega = self._differentiator.step(now, x, y, theta)
        seen = (0.0, 0.0, sin(0.5 * theta), cos(0.5 * theta))
        return Reading(now, TrackerReading(x, y, z, seen, v, omega, self._subject, mount))


def simulated(setup: Setup) -> SimulatedTracker:
    """Make the driver ``sim_vicon``; options: those of `TrackerErrors`."""
    errors = checked(TrackerErrors, setup.options, f"sensors.{setup.name}.options")
    return SimulatedTracker(setup.name, true_pose(setup), errors, random_of(setup), setup.config.name)
