"""Mistakes that a person makes who measures a car: the filter is told a geometry that is not the car's.

The car and its sensors stay as they are. What the filter is told of them is drawn by chance: the track width and the
wheelbase within 10 %, the length of a count within 3 % where a sensor tells positions, and the place of such a sensor
within 30 cm, to any side.
"""

from dataclasses import replace
from math import cos, pi, sin
from typing import Final, NamedTuple

import numpy as np

from benchmarks.drives import KINDS
from txt1.estimation.settings import EstimationConfig, FusedConfig
from txt1.estimation.task import Wheels
from txt1.model.vehicle import Geometry

LENGTH: Final = 0.1  # of track width and wheelbase
COUNT: Final = 0.03  # of the length of a count
PLACE: Final = 0.3  # m
# standard deviations of a place (m) and a delay (s) that are exact
EXACT_PLACE: Final = 0.003
EXACT_DELAY: Final = 0.01
POSITIONS: Final = ("gps", "vicon")


class Mistakes(NamedTuple):
    """By what share lengths are told too large, and places (m) too far ahead and to the left."""

    track: float = 0.0
    wheelbase: float = 0.0
    count: float = 0.0
    ahead: float = 0.0
    left: float = 0.0

    def geometry(self, body: Geometry) -> Geometry:
        """Return what the filter is told of a car."""
        return replace(
            body,
            track_width=body.track_width * (1.0 + self.track),
            wheelbase=body.wheelbase * (1.0 + self.wheelbase),
            circumference=body.circumference * (1.0 + self.count),
        )

    def wheels(self, told: Wheels) -> Wheels:
        """Return the odometry that the filter gets by this geometry of the one by the true geometry."""
        v = told.odometry.v * (1.0 + self.count)
        omega = told.odometry.omega * (1.0 + self.count) / (1.0 + self.track)
        return told._replace(odometry=told.odometry._replace(v=v, omega=omega))


def drawn(seed: int, *, absolute: bool) -> Mistakes:
    """Return the mistakes of a seed; `absolute`: a sensor tells positions."""
    rng = np.random.default_rng([seed, 74])
    track, wheelbase = rng.uniform(-LENGTH, LENGTH, 2).tolist()
    count, far, way = float(rng.uniform(-COUNT, COUNT)), float(rng.uniform(0.0, PLACE)), float(rng.uniform(-pi, pi))
    if not absolute:
        return Mistakes(track, wheelbase)
    return Mistakes(track, wheelbase, count, far * cos(way), far * sin(way))


def told(names: tuple[str, ...], mistakes: Mistakes | None) -> EstimationConfig:
    """Return the configuration of a filter of these sensors; None: all is as measured, and the filter is told so."""
    if mistakes is None:
        exact = FusedConfig(lever_sigma=EXACT_PLACE, delay_sigma=EXACT_DELAY)
        return EstimationConfig(
            sensors=names, track_sigma=0.0, settings={name: exact for name in names if name in POSITIONS}
        )
    place = FusedConfig(lever=(mistakes.ahead, mistakes.left))
    return EstimationConfig(sensors=names, settings={name: place for name in names if name in POSITIONS})


def of(names: tuple[str, ...], seed: int, *, exact: bool) -> Mistakes | None:
    """Return the mistakes that a seed makes for a filter of these sensors; None: exact."""
    return None if exact else drawn(seed, absolute=any(name in POSITIONS for name in names if name in KINDS))
