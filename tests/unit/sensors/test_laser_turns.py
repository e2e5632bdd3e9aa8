"""Samples of a turning scanner as the beams of a scan: what is near, free, or not known."""

from math import inf, nan

import numpy as np

from txt1.sensors.laser_turns import scan_of_turn
from txt1.sensors.readings import LASER_MOUNT


def test_a_sample_nearer_than_the_scanner_measures_is_no_free_beam() -> None:
    """Beams: a hit; no hit; too near; too near, and the nearer of two hits; too far; too near, and no hit; none."""
    angles = np.array([0.0, 45.0, 90.0, 135.0, 135.0, 135.0, 180.0, 225.0, 225.0])
    mm = np.array([1000.0, 0.0, 40.0, 40.0, 3000.0, 2000.0, 13000.0, 40.0, 0.0])
    scan = scan_of_turn(angles, mm, 8, 0.1, 0.15, 12.0, LASER_MOUNT)
    np.testing.assert_allclose(scan.ranges, [1.0, inf, nan, 2.0, inf, nan, nan, nan])
