"""Turns of laser scanners that tell an angle and a distance for each sample: their samples as beams of a scan."""

from math import inf, nan, tau
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.sensors.readings import Mount, Scan

Numbers = NDArray[np.float64]

# beams of a turn: of one with fewer samples than MANY, and with more
FEW: Final = 360
MANY: Final = 720


def beams_for(samples: int) -> int:
    """Return the number of beams for turns of so many samples."""
    return FEW if samples < MANY else MANY


def scan_of_turn(
    angles: Numbers, mm: Numbers, beams: int, turn: float, range_min: float, range_max: float, mount: Mount
) -> Scan:
    """Return a turn that took `turn` s as a scan, clockwise from straight ahead; each beam has its nearest sample.

    `angles` are in degrees clockwise; `mm` is 0 or less for no hit. Without a hit, or with one beyond range_max (m), a
    beam is free (inf). It is not known (NaN) without a sample, or where the only hit is nearer than range_min.
    """
    beam = np.rint(angles / 360.0 * beams).astype(int) % beams
    near = np.where(mm > 0.0, mm / 1000.0, inf)
    near[near > range_max] = inf
    close = near < range_min
    ranges = np.full(beams, nan)
    np.fmin.at(ranges, beam[~close], near[~close])
    hidden = beam[close]
    ranges[hidden[np.isinf(ranges[hidden])]] = nan
    return Scan(0.0, -tau / beams, turn / beams, ranges.astype(np.float32), range_min, range_max, None, mount, turn)
