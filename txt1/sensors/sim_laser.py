"""A simulated laser scanner: rays cast at walls, obstacles and other robots while the vehicle drives on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, tau
from typing import Any

import numpy as np
from numpy.random import Generator

from txt1.config.schema import Config
from txt1.config.sources import checked
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sensors.readings import LASER_MOUNT, Mount, Scan, scan_topic
from txt1.sensors.simulated_sensor import Others, SimulatedSensor, others_of, random_of, true_pose
from txt1.sim.obstacles import outline
from txt1.sim.parameters import Box
from txt1.sim.rays import Shapes, cast, edges_of, shapes_of, walls_of
from txt1.units import NotNegative, Positive, PositiveInt, Share


@dataclass(frozen=True, slots=True)
class LaserParameters:
    """A scanner that turns anticlockwise; by default a Hokuyo URG-04LX as in the thesis."""

    steps: PositiveInt = 1024
    """Beams of a whole turn."""
    beams: PositiveInt = 682
    """Beams that are measured, half of them on either side: 240 degrees."""
    turn_time: Positive = 0.1
    """Time of a turn, s."""
    range_min: NotNegative = 0.02
    """Shortest range, m."""
    range_max: Positive = 4.0
    """Longest range, m."""
    noise: NotNegative = 0.01
    """Standard deviation of ranges up to 1 m, m; assumed."""
    noise_share: Share = 0.01
    """Standard deviation of longer ranges, as a share of the range; assumed."""
    mount: Mount = LASER_MOUNT
    """The place of the scanner, and the angle of its own 0 degrees."""


def standing(config: Config) -> Shapes:
    """Return the shapes of all standing things in the configured room."""
    return walls_of(config.sim.room.built()) + shapes_of(config.sim.obstacles)


def bodies(others: Sequence[Pose | Box], body: Geometry) -> Shapes:
    """Return the outlines of vehicles at poses, and of moving boxes."""
    boxes = (each if isinstance(each, Box) else Box(*each[:2], body.length, body.width, each[2]) for each in others)
    return edges_of(map(outline, boxes))


class SimulatedLaser(SimulatedSensor[Scan]):
    """A scanner on a vehicle with the true pose `pose`, among fixed shapes and other vehicles at the poses `others`.

    A sweep starts at the pose of the last sweep's end and ends at the present pose. Each beam starts from a pose
    between the two.
    """

    def __init__(
        self,
        name: str,
        pose: Callable[[], Pose | None],
        shapes: Shapes,
        parameters: LaserParameters,
        rng: Generator,
        others: Others = tuple,
        body: Geometry = Geometry(),  # noqa: B008 - immutable
    ) -> None:
        super().__init__(scan_topic(name), parameters.turn_time, pose)
        self._others, self._shapes, self._body = others, shapes, body
        self._parameters, self._rng = parameters, rng
        beams = min(parameters.beams, parameters.steps)
        self._step = tau / parameters.steps
        self._angles = self._step * (np.arange(beams) - beams // 2)
        self._time_step = parameters.turn_time / parameters.steps
        # the pose at the end of the last sweep
        self._old = 0.0, 0.0, 0.0

    def see(self, pose: Pose, now: float, before: float) -> Reading[Scan] | None:
        """Return the sweep that ends at `now`."""
        old, self._old = self._old, pose
        # the first sweep begins
        if before == -inf:
            return None
        first = max(now - self._time_step * len(self._angles), before)
        ranges = self._measured(old, pose, before, now, first)
        p = self._parameters
        scan = Scan(
            float(self._angles[0]),
            self._step,
            self._time_step,
            ranges,
            p.range_min,
            p.range_max,
            None,
            self._parameters.mount,
            p.turn_time,
        )
        return Reading(first, scan)

    def _measured(self, old: Pose, new: Pose, then: float, now: float, first: float) -> Any:
        """Return ranges, m, with noise; inf if nothing is in range."""
        p, mount, angles = self._parameters, self._parameters.mount, self._angles
        shapes = self._shapes
        if others := self._others():
            shapes += bodies(others, self._body)
        share = np.linspace((first - then) / (now - then), 1.0, len(angles))
        x, y = old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1])
        theta = old[2] + share * wrap_angle(new[2] - old[2])
        c, s = np.cos(theta), np.sin(theta)
        x, y = x + mount.x * c - mount.y * s, y + mount.x * s + mount.y * c
        ranges = cast(x, y, theta + mount.yaw + angles, shapes)
        hit = ranges < inf
        sigma = np.maximum(p.noise, p.noise_share * ranges[hit])
        ranges[hit] += sigma * self._rng.standard_normal(len(sigma))
        ranges[(ranges < p.range_min) | (ranges > p.range_max)] = inf
        return ranges.astype(np.float32)


def simulated(setup: Setup) -> SimulatedLaser:
    """Make the driver ``sim_laser``; options: those of `LaserParameters`."""
    parameters = checked(LaserParameters, setup.options, f"sensors.{setup.name}.options")
    shapes, body = standing(setup.config), setup.config.geometry
    rng = np.random.default_rng(random_of(setup).getrandbits(128))
    return SimulatedLaser(setup.name, true_pose(setup), shapes, parameters, rng, others_of(setup), body)
