"""A simulated GPS: white noise, a slow error as from satellites and atmosphere, and outages; all assumed."""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, exp, hypot, inf, sin, sqrt
from random import Random

from txt1.config.sources import checked
from txt1.model.kinematics import wrap_angle
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.geodesy import UtmGrid
from txt1.sensors.readings import GPS_MOUNT, FixReading, Mount, fix_topic
from txt1.sensors.simulated_sensor import Absences, SimulatedSensor, random_of, true_pose
from txt1.units import NotNegative, Positive

# m/s: below this speed it has no direction
TRACK_SPEED_MIN = 0.1


@dataclass(frozen=True, slots=True)
class GpsErrors:
    """The errors of a GPS, and the place of its room on the earth."""

    noise: NotNegative = 1.0
    """Standard deviation of x and of y in each reading, m."""
    slow: NotNegative = 1.0
    """Standard deviation of the slow error of x and of y, m."""
    slow_time: Positive = 60.0
    """Time in which the slow error changes, s."""
    speed_noise: NotNegative = 0.05
    """Standard deviation of each component of the velocity, m/s."""
    outages: tuple[tuple[float, float], ...] = ()
    """Beginnings and ends of outages, s of the run."""
    outage_every: NotNegative = 0.0
    """Mean time between two random outages, s; 0 is never."""
    outage_length: Positive = 5.0
    """Mean length of a random outage, s."""
    datum: tuple[float, float] = (35.0844, -106.6504)
    """Latitude and longitude of the room's origin, degrees; x is east and y is north on the grid."""


class SimulatedGps(SimulatedSensor[FixReading]):
    """A GPS on a vehicle whose true pose is `pose`."""

    def __init__(
        self,
        name: str,
        pose: Callable[[], Pose | None],
        errors: GpsErrors,
        rng: Random,
        mount: Mount = GPS_MOUNT,
    ) -> None:
        super().__init__(fix_topic(name), 0.2, pose)
        self._errors, self._rng, self._mount = errors, rng, mount
        self._grid = UtmGrid(*errors.datum)
        self._slow = [errors.slow * rng.gauss(), errors.slow * rng.gauss()]
        self._outages = Absences(errors.outages, errors.outage_every, errors.outage_length, rng)
        # the last place, m
        self._place = 0.0, 0.0

    def see(self, pose: Pose, now: float, before: float) -> Reading[FixReading] | None:
        """Return the fix at `now`; None in an outage."""
        errors, (x0, y0), dt = self._errors, self._place, now - before
        # place of the antenna, and its velocity since the last reading
        x, y = pose[0] + self._mount.x * cos(pose[2]), pose[1] + self._mount.x * sin(pose[2])
        self._place = x, y
        one, two, three, four, five, six = (self._rng.gauss() for _ in range(6))
        decay = exp(-dt / errors.slow_time)
        step = errors.slow * sqrt(1.0 - decay * decay)
        self._slow = [decay * self._slow[0] + step * one, decay * self._slow[1] + step * two]
        if self._outages.at(now):
            return None
        vx, vy = (x - x0) / dt + errors.speed_noise * three, (y - y0) / dt + errors.speed_noise * four
        x, y = x + self._slow[0] + errors.noise * five, y + self._slow[1] + errors.noise * six
        v = hypot(vx, vy) if dt < inf else None
        theta = wrap_angle(atan2(vy, vx)) if v is not None and v > TRACK_SPEED_MIN else None
        sigma = hypot(errors.noise, errors.slow)
        return Reading(
            now,
            FixReading(
                *self._grid.earth(x, y),
                x,
                y,
                None,
                theta,
                v,
                2,
                sigma,
                sigma,
                None if theta is None or v is None else errors.speed_noise / v,
                errors.speed_noise,
                None,
                self._mount,
            ),
        )


def simulated(setup: Setup) -> SimulatedGps:
    """Make the driver ``sim_gps``; options: those of `GpsErrors`."""
    errors = checked(GpsErrors, setup.options, f"sensors.{setup.name}.options")
    return SimulatedGps(setup.name, true_pose(setup), errors, random_of(setup))
