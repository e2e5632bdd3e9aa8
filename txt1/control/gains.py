"""Decides which gains a vehicle can bear: the only place for it, for files, programs, pages and messages.

A velocity loop that samples every T s drives a vehicle whose speed answers the output with a first-order lag:
y(k+1) = a y(k) + (1-a) K u(k), a = exp(-T / tau), K in mm/s (or mrad/s) per PWM count. With the controller (4.7) the
closed loop's characteristic polynomial at z = -1 has the sign of a stable loop only while

    2 K_P + K_I T + 4 K_D / T < 2 (1 + a) / ((1 - a) K) =: S.

Beyond it the output flips between its limits at every sample, whatever the other choices are. So each gain, with the
others at 0, ends at K_P = S / 2 (counts per mm/s or mrad/s), K_I = S / T (the same per s) and K_D = S T / 4 (times s).
A negative gain drives away from the set-point. The bound is necessary, not sufficient: gains within it may still swing.

tau and K are the vehicle's parameters. They are assumed until the vehicle is calibrated, so `WEAKER_FACTOR` times S is
let through. Steered wheels answer within a sample, a = 0, and K = v / (R_min * 18000 counts) by (2.16). Here v is the
learning robot's 0.3 m/s: gains that are refused swing at this speed, and more at higher speeds. Sides at two speeds
turn with the lag tau and K = 2/3 of the speed's, over the track width. The thesis's own gains always pass, as original
boards carry them.
"""

from collections.abc import Sequence
from math import exp
from typing import Final, NamedTuple

from txt1.control.pid import Gains
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, GainSet
from txt1.model.vehicle import LEARNING_SPEED, SIDES, STEERING_MAX, Geometry

# factor for an uncalibrated vehicle that is weaker than its parameters say; chosen
WEAKER_FACTOR: Final = 2.0
# of K_P, K_I and K_D, with mm or mrad
UNITS: Final = ("counts per {}/s", "counts per {}", "counts per {}/s^2")


class GainLimits(NamedTuple):
    """The largest gains of the speed loop and of the yaw-rate loop, in the units of `Gains`; the least is 0."""

    linear: Gains
    angular: Gains

    def refused(self, linear: Sequence[float], angular: Sequence[GainSet]) -> tuple[str, float, str] | None:
        """Return the first gain that is negative, not finite or too large: field, value, remedy; None if all fit."""
        rows = [
            ("linear", linear, self.linear, "mm"),
            *((f"angular.{k}", each.gains, self.angular, "mrad") for k, each in enumerate(angular)),
        ]
        wrong = (
            (f"{loop}.{name}", value, f"give 0 to {most:g} {unit.format(part)}, this vehicle's limit")
            for loop, gains, limits, part in rows
            for name, value, most, unit in zip(Gains._fields, gains, limits, UNITS, strict=True)
            if not 0.0 <= value <= most
        )
        return next(wrong, None)


def gain_limits(geometry: Geometry, speed_gain: float, time_constant: float, skid: float, period: float) -> GainLimits:
    """Return the limits for a vehicle, by this module's equations.

    `speed_gain` is its free speed per count, m/s; `time_constant` that of the driven speed, s; `period` that of the
    loops, s. `skid` is the factor by which sides at two speeds turn the vehicle as if it were wider.
    """
    lag, speed = exp(-period / time_constant), 1000.0 * speed_gain
    yaw = (
        (lag, speed * 2.0 / (SIDES * geometry.track_width * skid))
        if geometry.steering == "skid"
        else (0.0, 1000.0 * LEARNING_SPEED / (geometry.radius_min * STEERING_MAX))
    )
    angular = Gains(*map(max, *(each.gains for each in ANGULAR_GAINS)))
    return GainLimits(_most(lag, speed, period, LINEAR_GAINS), _most(*yaw, period, angular))


def _most(a: float, k: float, period: float, least: Gains) -> Gains:
    # with a time constant of years the output has no effect, so any gain is bearable
    s = WEAKER_FACTOR * 2.0 * (1.0 + a) / max((1.0 - a) * k, 1e-9)
    # thousandths, as on the wire: so gains that pass here also pass on the board
    return Gains(
        *(max(round(each, 3), low) for each, low in zip((s / 2.0, s / period, s * period / 4.0), least, strict=True))
    )
