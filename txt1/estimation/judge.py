"""The evidence on a sensor: whether its readings fit, stand still, or miss on one side.

One is believed no longer by readings beyond the gate, the same reading again and again, silence, or no numbers, and
again when its readings have fitted for a while. To whom a miss on one side is to be laid is judged in `fusion`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import hypot, inf, sqrt
from typing import Final, NamedTuple

from txt1.estimation.ekf import Belief, X, Y
from txt1.estimation.measurement import Kind, Measurement

REJECTED_MAX: Final = 2  # readings in a row beyond the gate that cost a sensor its belief
FITS: Final = 0.5  # s for which readings fit before a sensor is believed again,
FITTING: Final = 3  # and at least so many of them
SAME_MAX: Final = 5  # equal readings in a row of a sensor that stands still
SAME_COUNTS: Final = 25  # the same of encoders that turn
MOVING: Final = 0.1  # m/s from which a position that stays the same stands still
MEMORY: Final = 25  # readings over which a sensor's misses are averaged
ONE_SIDED: Final = 0.8  # mean miss, in standard deviations of one, beyond which it is no chance: 5.6 times its own
LEVER: Final = 4.0  # how much further the pose may be off than its sensor's mean miss, which follows late
KEEPS: Final = 5.0  # s for which a sensor of the place keeps its distance from the pose, and is believed again
KEPT: Final = 3.0  # standard deviations of the place by which that may change meanwhile
LARGE: Final = 4.0  # standard deviations; a larger miss counts as this in the average
DRIFTS: Final = "drifts away from the others"


class Trust(NamedTuple):
    """How much a sensor is believed, and why."""

    name: str
    believed: bool
    reason: str  # why not; empty while it is
    used: int  # readings that were taken in
    rejected: int  # readings that were not
    late: int  # readings that were older than the horizon
    surprise: float  # mean of NIS over the number of values: about 1 when its covariance is right
    time: float | None  # of the last reading, s of the run


@dataclass(frozen=True, slots=True)
class Belonging:
    """A sensor's settings."""

    gate: float = 5.0  # Mahalanobis distance beyond which a reading is not believed
    timeout: float = 1.0  # s without a reading after which it is silent
    tells_pose: bool = False  # whether it tells x and y: then the pose is in its frame


@dataclass(slots=True)
class Judge:
    """The evidence on one sensor."""

    name: str
    settings: Belonging
    believed: bool = True
    reason: str = ""
    contradicts: bool = False  # it is believed no longer, though others may be as wrong
    used: int = 0
    rejected: int = 0
    late: int = 0
    surprise: float = 1.0
    time: float | None = None
    since: float = 0.0  # when it was heard last, or began to be waited for
    beyond: int = 0  # readings in a row beyond the gate
    same: int = 0  # readings in a row that were equal
    last: tuple[float, ...] = ()
    heard: float = 0.0  # the last reading of one that contradicts, s of the run
    sigmas: tuple[float, ...] = ()  # of the last reading
    misses: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # mean misses, in standard deviations
    one_sided: float = 0.0  # the largest of these
    distance: tuple[float, float] = (inf, inf)  # from the pose to where one that is not believed has it, m
    kept_since: float = 0.0  # ... and since when, s of the run
    fitting: int = 0  # readings in a row that fitted, of a sensor that is not believed
    fitting_since: float = 0.0

    def trust(self) -> Trust:
        """How much it is believed, and why."""
        return Trust(
            self.name, self.believed, self.reason, self.used, self.rejected, self.late, self.surprise, self.time
        )  # fmt: skip

    def weigh(self, measurement: Measurement, speed: float, nis: float, misses: Sequence[float]) -> str:
        """Weigh a new reading by its NIS and its misses; returns a change of belief in words, or nothing.

        `speed` is that of the wheels, m/s.
        """
        count = len(misses)
        fits = nis <= self.settings.gate**2
        self.sigmas = measurement.sigmas
        self.surprise += (min(nis, 100.0 * count) / count - self.surprise) / MEMORY
        same = measurement.values == self.last
        self.same = self.same + 1 if same else 0
        self.last = measurement.values
        if measurement.kind is Kind.ENCODERS:  # whole counts are often the same, but not for so long
            frozen = self.same >= SAME_COUNTS and any(measurement.values)
        else:
            moving = measurement.kind is not Kind.POSE or abs(speed) > MOVING or not self.believed
            frozen = self.same >= SAME_MAX and moving
        time = measurement.time
        means, one_sided = self.misses, 0.0
        for place, miss in enumerate(misses):
            if not -LARGE <= miss <= LARGE:
                miss = LARGE if miss > 0.0 else -LARGE
            means[place] = mean = means[place] + (miss - means[place]) / MEMORY
            one_sided = max(one_sided, mean, -mean)
        self.one_sided = one_sided
        if not self.believed:
            self.rejected += 1
            if not fits or frozen or (self.reason == DRIFTS and one_sided > 2.0 * ONE_SIDED):
                self.fitting = 0
                return ""
            if self.fitting == 0:
                self.fitting_since = time
            self.fitting += 1
            if self.fitting >= FITTING and time - self.fitting_since >= FITS:
                return self.restore()
            return ""
        if frozen:
            return self.doubt("stands still")
        if not fits:
            self.rejected += 1
            self.beyond += 1
            if self.beyond >= REJECTED_MAX:
                return self.doubt("disagrees with the others")
            return ""
        self.used += 1
        self.beyond = 0
        return ""

    def doubt(self, reason: str) -> str:
        """Believe it no longer; returns that in words if it is news."""
        self.fitting = self.beyond = 0
        self.distance = inf, inf
        self.misses, self.one_sided = [0.0, 0.0, 0.0], 0.0
        news = f"'{self.name}' is not believed any more: {reason}" if self.believed else ""
        self.believed, self.reason = False, reason
        return news

    def restore(self) -> str:
        """Believe it again; returns that in words."""
        self.believed, self.reason, self.fitting, self.surprise = True, "", 0, 1.0
        self.contradicts = False
        return f"'{self.name}' is believed again"

    def offset(self) -> list[float]:
        """How far off x, y and theta may be by its mean misses, m, m, rad; 0 where it has told nothing yet."""
        offset = [LEVER * miss * sigma for miss, sigma in zip(self.misses, self.sigmas, strict=False)]
        return [*offset, 0.0, 0.0, 0.0][:3]

    def keeps_its_distance(self, measurement: Measurement, belief: Belief, residual: Sequence[float]) -> bool:
        """Whether a sensor of the place has been as far from the pose as now for `KEEPS` seconds."""
        if measurement.rows[:2] != (X, Y) or measurement.kind is not Kind.POSE:
            return False
        x, y = self.distance
        sigma = sqrt(belief.covariance[X, X] + belief.covariance[Y, Y] + measurement.sigmas[X] ** 2)
        kept = hypot(residual[X] - x, residual[Y] - y) <= KEPT * sigma
        if not kept or self.same >= SAME_MAX:
            self.distance, self.kept_since = (residual[X], residual[Y]), measurement.time
        return measurement.time - self.kept_since >= KEEPS
