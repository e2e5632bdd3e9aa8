"""Driving without encoders: outputs from a calibration's speed map and from the steering's geometry."""

from bisect import bisect
from math import copysign

from txt1.control.parameters import SpeedMap
from txt1.control.pid import Gains
from txt1.model.vehicle import STEERING_MAX, Geometry, outputs_of


def counts_for(v: float, speed_map: SpeedMap) -> float:
    """Return the motor output for a speed, PWM counts: between two entries of the map, or extrapolated from the last
    two.

    Without an entry in the wanted direction, it is the other direction's with its sign changed; with an empty map, 0.
    """
    if v == 0.0 or not speed_map:
        return 0.0
    way = sorted((abs(u), abs(speed)) for u, speed in speed_map if copysign(speed, v) == speed)
    way = way or sorted((abs(u), abs(speed)) for u, speed in speed_map)
    if len(way) == 1:
        return way[0][0] * v / way[0][1]
    above = bisect([speed for _, speed in way], abs(v), 1, len(way) - 1)
    (u0, v0), (u1, v1) = way[above - 1], way[above]
    return copysign(max(0.0, u0 + (u1 - u0) * (abs(v) - v0) / (v1 - v0)), v)


class OpenLoop:
    """Replaces `txt1.control.pid.VelocityLoops` if nothing is measured."""

    def __init__(self, geometry: Geometry, speed_map: SpeedMap) -> None:
        self._geometry, self._map = geometry, speed_map

    def clear(self) -> None:
        """Do nothing, as it keeps no state."""

    def step(
        self, v: float, omega: float, v_now: float, omega_now: float, linear: Gains, angular: Gains, dt: float
    ) -> tuple[float, float]:
        """Return motor and steering output, counts, for a set-point in m/s and rad/s; for the rest see `VelocityLoops`.

        If wheels steer, an output above 0 turns left, by (2.12) solved for the angle.
        """
        if self._geometry.steering == "skid":
            turn = 0.5 * omega * self._geometry.track_width
            return outputs_of(counts_for(v + turn, self._map), counts_for(v - turn, self._map))
        share = self._geometry.steering_share(omega / v) if v != 0.0 else 0.0
        return counts_for(v, self._map), STEERING_MAX * share
