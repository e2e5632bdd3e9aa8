"""Which gains are no gains for this vehicle: the one place that says so, for files, programs, pages and messages.

A velocity loop that samples every T s drives a vehicle whose speed answers the output with a first-order lag:
y(k+1) = a y(k) + (1-a) K u(k), a = exp(-T / tau), K in mm/s (or mrad/s) per PWM count. With the controller (4.7) the
closed loop's characteristic polynomial at z = -1 has the sign of a stable loop only while

    2 K_P + K_I T + 4 K_D / T < 2 (1 + a) / ((1 - a) K) =: S.

Beyond it the output flips between its limits at every sample, whatever else is chosen. So each gain, the others being
0, ends at K_P = S / 2 (counts per mm/s or mrad/s), K_I = S / T (the same per s) and K_D = S T / 4 (times s). A negative
gain drives away from the set-point. The bound is necessary, not sufficient: gains within it may still swing.

tau and K are the vehicle's parameters, which are assumed until it is calibrated, so `MARGIN` times S is let through.
Steered wheels answer within a sample, a = 0, and K = v / (R_min * 18000 counts) by (2.16); v is the learning robot's
0.3 m/s, so that what is refused swings at a walk, and faster all the more. Sides at two speeds turn with the lag tau
and K = 2/3 of the speed's, over the track width. The thesis's own gains always pass: original boards carry them.
"""

from collections.abc import Sequence
from math import exp, isfinite
from typing import Final, NamedTuple

from txt1.control.pid import Gains
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, GainSet
from txt1.model.vehicle import SIDES, SPEED, STEERING_MAX, Geometry

MARGIN: Final = 2.0  # by which an uncalibrated vehicle may be weaker than its parameters say; chosen
THESIS: Final = LINEAR_GAINS, Gains(*map(max, *(each.gains for each in ANGULAR_GAINS)))
UNITS: Final = (
    Gains("counts per mm/s", "counts per mm", "counts per mm/s^2"),  # type: ignore[arg-type]
    Gains("counts per mrad/s", "counts per mrad", "counts per mrad/s^2"),  # type: ignore[arg-type]
)


class Refused(NamedTuple):
    """A value that is no gain here: where it stands, such as ("angular", 2, "kp"), what it is, and the remedy."""

    place: tuple[str | int, ...]
    value: float
    remedy: str

    def __str__(self) -> str:
        return f"{'.'.join(map(str, self.place))}: {self.value:.10g}: {self.remedy}"


class GainLimits(NamedTuple):
    """The largest gains of the speed loop and of the yaw-rate loop, in the units of `Gains`; the least is 0."""

    linear: Gains
    angular: Gains

    def refused(self, linear: Sequence[float], angular: Sequence[GainSet]) -> Refused | None:
        """The first of these gains that is negative, not finite or too large; None when all are fit to be loaded."""
        wrong = _refused(("linear",), linear, self.linear, UNITS[0])
        for k, (v_max, gains) in enumerate(angular):
            if wrong is None and not isfinite(v_max):
                wrong = Refused(("angular", k, "v_max"), v_max, "give a finite speed, m/s")
            wrong = wrong or _refused(("angular", k), gains, self.angular, UNITS[1])
        return wrong


def _refused(place: tuple[str | int, ...], gains: Sequence[float], most: Gains, units: Gains) -> Refused | None:
    for name, value, limit, unit in zip(Gains._fields, gains, most, units, strict=True):
        if not 0.0 <= value <= limit:
            return Refused((*place, name), value, f"give 0 to {limit:g} {unit}, this vehicle's limit")
    return None


def gain_limits(geometry: Geometry, speed_gain: float, time_constant: float, skid: float, period: float) -> GainLimits:
    """The limits for a vehicle, by this module's equations.

    `speed_gain` is its free speed per count, m/s; `time_constant` that of the driven speed, s; `skid` the factor by
    which sides at two speeds turn it as if it were wider; `period` that of the loops, s.
    """
    lag = exp(-period / time_constant)
    speed = 1000.0 * speed_gain
    if geometry.steering == "skid":
        yaw_lag, yaw = lag, speed * 2.0 / (SIDES * geometry.track_width * skid)
    else:
        yaw_lag, yaw = 0.0, 1000.0 * SPEED / (geometry.radius_min * STEERING_MAX)
    return GainLimits(_most(lag, speed, period, THESIS[0]), _most(yaw_lag, yaw, period, THESIS[1]))


def _most(a: float, k: float, period: float, least: Gains) -> Gains:
    # a lag of years answers to nothing: what its loop could bear is not asked
    s = MARGIN * 2.0 * (1.0 + a) / max((1.0 - a) * k, 1e-9)
    # thousandths, as the wire carries them: what is let through here is let through behind it
    return Gains(
        *(max(round(each, 3), low) for each, low in zip((s / 2.0, s / period, s * period / 4.0), least, strict=True))
    )
