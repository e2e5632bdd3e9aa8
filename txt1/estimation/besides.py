"""What the covariance that is told has besides the filter's: the other explanations of what the sensors tell.

The filter follows one hypothesis. Where another one has the pose d away, and is as likely as p, the second moment about
the pose of the first is p d d^T more (Bar-Shalom, Li, Kirubarajan 2001, 1.4.16).
"""

from collections.abc import Iterable, Sequence
from math import cos, exp, sin, sqrt

from txt1.estimation.ekf import XX, YY, Belief
from txt1.estimation.frame import Frame
from txt1.estimation.judge import FORGOTTEN, OTHER, Judge


class Besides:
    """The hypotheses that the filter does not follow."""

    def __init__(self) -> None:
        # m, m, rad by which a jump may be the robot's
        self._carried: tuple[float, float, float] | None = None
        # m, m, rad by which an absolute sensor has overruled dead reckoning
        self._overruled: Sequence[float] = ()
        # m in x and y by which the way may be longer than the car's, as speed and heading may be off
        self._way = 0.0, 0.0

    def missed(self, residual: Sequence[float]) -> None:
        """Note a reading that leapt by this, m, m and rad: the robot may have been carried there."""
        dx, dy, *turn = residual
        self._carried = dx, dy, turn[0] if turn else 0.0

    def overrule(self, before: Belief, after: Belief) -> None:
        """Note that an absolute sensor has overruled dead reckoning, which may be right."""
        so_far = self._overruled or (0.0, 0.0, 0.0)
        pulled = zip(so_far, after.mean, before.mean, strict=False)
        self._overruled = [each + here - there for each, here, there in pulled]

    def fade(self, dt: float) -> None:
        """Forget, in dt seconds, by how much dead reckoning was overruled."""
        if self._overruled:
            fading = exp(-dt / FORGOTTEN)
            self._overruled = [each * fading for each in self._overruled]

    def drive(self, theta: float, speed: float, dt: float) -> None:
        """Note that the speed may have been off by `speed` m/s for dt seconds, so that the pose is off by the way."""
        x, y = self._way
        self._way = x + speed * dt * cos(theta), y + speed * dt * sin(theta)

    def place(self, before: Belief, after: Belief) -> None:
        """Note a position that was taken in: it takes away of the way's error what it takes of the variance."""
        self._carried = None
        x, y = self._way
        if x or y:
            self._way = x * after.triangle[XX] / before.triangle[XX], y * after.triangle[YY] / before.triangle[YY]

    def covariance(
        self, places: Iterable[tuple[Judge, Frame]], doubt: tuple[float, float, float, float]
    ) -> tuple[float, float, float, float]:
        """Variances of x, of x and y, of y (m^2), and of theta (rad^2), that all of them add.

        `places` are the judges of the sensors that tell positions, and their frames; `doubt` is of mounts and clocks.
        """
        xx, xy, yy, tt = 0.0, 0.0, 0.0, 0.0
        others: list[tuple[float, Sequence[float]]] = []
        if self._carried is not None:
            others.append((OTHER, self._carried))
        if self._overruled:
            others.append((OTHER, self._overruled))
        for judge, frame in places:
            if judge.mean_variance[0]:
                others.append((1.0, (*judge.lasting(), 0.0)))
            if any(frame.past):
                x, y, sigma = frame.past
                others.append((1.0, (x, y, 0.0)))
                xx, yy = xx + sigma * sigma, yy + sigma * sigma
            if frame.probability:
                x, y, sigma = frame.pulled
                others.append((frame.probability, (x, y, 0.0)))
                more = frame.probability * sigma * sigma
                xx, yy = xx + more, yy + more
        for chance, (dx, dy, turn) in others:
            xx, xy = xx + chance * dx * dx, xy + chance * dx * dy
            yy, tt = yy + chance * dy * dy, tt + chance * turn * turn
        more_xx, more_xy, more_yy, more_tt = doubt
        way_x, way_y = self._way
        return (
            xx + more_xx + way_x * way_x,
            xy + more_xy + way_x * way_y,
            yy + more_yy + way_y * way_y,
            tt + more_tt,
        )


def bent(variance: float) -> float:
    """The share by which a way is shorter along a heading of this variance, rad^2: the root of its second moment.

    A belief has what goes across the way, as it is linear in the heading. Along it the way is longer than the car's by
    1 - cos of the error: places that are as likely lie on an arc.
    """
    mean, square = 1.0 - exp(-0.5 * variance), 1.0 - exp(-variance)
    return sqrt(mean * mean + 0.5 * square * square)
