"""What the filter tells of each sensor.

It is a module of its own, as snapshots are read back by the types of its fields: a compiled module forgets these.
"""

from typing import NamedTuple


class Trust(NamedTuple):
    """How much a sensor is believed, and why."""

    name: str
    believed: bool
    # why not; empty while it is
    reason: str
    # readings that were taken in
    used: int
    # readings that were not
    rejected: int
    # readings that were older than the horizon
    late: int
    # mean of NIS over the number of values: about 1 when its covariance is right
    surprise: float
    # of the last reading, s of the run
    time: float | None
