"""The measurements of an experiment, sample by sample, and their file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import nan
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import ConfigError
from txt1.file_limits import JSON_MAX, read_text

Array = NDArray[np.float64]


class Instant(NamedTuple):
    """The values of an instant."""

    # s of the experiment
    time: float
    # commanded speed, m/s
    set_v: float = 0.0
    # commanded yaw rate, rad/s
    set_omega: float = 0.0
    # measured by the encoders, m/s
    v: float = 0.0
    # measured by the encoders, rad/s
    omega: float = 0.0
    x: float = (
        # the robot's believed place, m: by its odometry, or by the pose source of its waypoints
        0.0
    )
    y: float = 0.0  # m
    theta: float = 0.0  # rad
    # time of the encoders' last reading, s; behind a line, the arrival of their odometry
    read: float = 0.0
    # distance by the encoders until then, backward negative, m
    way: float = 0.0
    # turn by the encoders until then, rad, with whole turns
    turn: float = 0.0
    # mean since the sample before, m/s; NaN, like the values below, if the HAL does not know it
    true_v: float = nan
    true_omega: float = nan  # rad/s
    # place in the room, m
    true_x: float = nan
    true_y: float = nan  # m
    true_theta: float = nan  # rad
    # voltage of the pack in use, V; NaN while unknown
    voltage: float = nan
    # remaining time by this voltage, s; NaN while unknown
    remaining: float = nan


class Recording:
    """The samples of a run as columns, named as in `Instant`."""

    def __init__(self, samples: Iterable[Instant]) -> None:
        rows = [tuple(sample) for sample in samples]
        self.columns = np.array(rows, float).reshape(len(rows), len(Instant._fields)).T

    def __len__(self) -> int:
        return int(self.columns.shape[1])

    def __getitem__(self, name: str) -> Array:
        """Return the column of this name, shape (samples,)."""
        column: Array = self.columns[Instant._fields.index(name)]
        return column

    @property
    def knows_truth(self) -> bool:
        """Whether it contains the true motion, as from a simulation."""
        return len(self) > 0 and not bool(np.isnan(self["true_x"]).all())

    def without_truth(self) -> Recording:
        """Return the same samples as hardware would have given them."""
        copy = Recording(())
        copy.columns = self.columns.copy()
        for name in ("true_v", "true_omega", "true_x", "true_y", "true_theta"):
            copy[name][:] = nan
        return copy

    def path(self) -> tuple[Array, Array]:
        """Return places x and y, the true places if they are known."""
        return (self["true_x"], self["true_y"]) if self.knows_truth else (self["x"], self["y"])


FILE: Final = "samples.csv"


def mean_of(recordings: Sequence[Recording]) -> Recording:
    """Return the mean of runs of a profile with different seeds, sample by sample."""
    length = min(map(len, recordings))
    mean = Recording(())
    mean.columns = np.mean([recording.columns[:, :length] for recording in recordings], axis=0)
    # the same in all runs, so no sum may round them
    for name in ("time", "set_v", "set_omega"):
        mean[name][:] = recordings[0][name][:length]
    return mean


def save(recording: Recording, folder: Path) -> None:
    """Write the samples to a folder as comma-separated values, a column per quantity, SI units."""
    head = ",".join(Instant._fields)
    np.savetxt(folder / FILE, recording.columns.T, "%.6g", ",", "\r\n", head, comments="")


def load(folder: Path) -> Recording:
    """Return the samples in a folder; raises ConfigError: there are none, or the columns differ."""
    file = folder / FILE
    try:
        head, *rows = read_text(file, JSON_MAX).splitlines() or [""]
        if tuple(head.split(",")) != Instant._fields:
            raise ConfigError(f"{file}: its columns are not a run's; give a folder that --out has made")
        return Recording(Instant(*map(float, row.split(","))) for row in rows)
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}; give a folder that an experiment's --out made") from None
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{file}: is damaged ({error}); make the run again") from None
