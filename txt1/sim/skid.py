"""The dynamics of a rover whose sides run at two speeds, with the methods of `txt1.sim.dynamics`."""

from math import copysign, exp, inf, log

from txt1.model.kinematics import move_along_arc
from txt1.model.vehicle import PWM_MAX, STEERING_MAX, Geometry, sides
from txt1.sim.dynamics import Motion
from txt1.sim.parameters import VehicleParameters

Side = tuple[float, float]
"""A side's path in a piece of time, m, and its speed at the end, m/s."""


def move(
    state: Motion, motor: float, steering: float, dt: float, drag: float, vehicle: VehicleParameters, body: Geometry
) -> Motion:
    """Return the rover's state `dt` seconds later.

    The fields of the steering angles hold the sides' speeds, right and left.

    Args:
        state: the present state.
        motor: PWM counts of both sides, held.
        steering: counts, left positive: a third of it is added on the right side and subtracted on the left.
        dt: s.
        drag: additional drag of the floor as a share of the speed, held.
        vehicle: parameters of the dynamics.
        body: dimensions.

    """
    x, y, theta, _, v_right, v_left, right, left, _ = state
    counts_right, counts_left = sides(motor, min(max(steering, -STEERING_MAX), STEERING_MAX))
    path_right, v_right = _roll(v_right, counts_right, dt, drag, vehicle)
    path_left, v_left = _roll(v_left, counts_left, dt, drag, vehicle)
    if path_right == path_left == v_right == v_left == 0.0:
        return state if state[3:6] == (0.0, 0.0, 0.0) else (x, y, theta, 0.0, 0.0, 0.0, right, left, 0.0)
    distance, turn = 0.5 * (path_right + path_left), (path_right - path_left) / (body.track_width * vehicle.skid)
    if distance:
        x, y, theta = move_along_arc(x, y, theta, distance, turn / distance, 0.0)
    else:
        theta = move_along_arc(x, y, theta + turn, 0.0, 0.0, 0.0)[2]
    rolled = 1.0 + vehicle.slip
    right, left = right + rolled * path_right, left + rolled * path_left
    return x, y, theta, 0.5 * (v_right + v_left), v_right, v_left, right, left, 0.0


def _roll(v: float, counts: float, dt: float, drag: float, p: VehicleParameters) -> Side:
    """Move a side: tau dv/dt = v_target - (1 + drag) v, exactly; dry friction stops it while it coasts."""
    loss, beyond = 1.0 + drag, min(abs(counts), PWM_MAX) - p.dead_band
    if beyond > 0.0:
        v_end, tau, stop = copysign(p.speed_gain * beyond, counts) / loss, p.speed_time_constant / loss, inf
    else:
        v_end, tau = copysign(p.coast_friction, -v) / loss, p.coast_time_constant / loss
        stop = 0.0 if v == 0.0 else tau * log(1.0 - v / v_end) if v_end else inf
    rolling = min(dt, stop)
    decay = exp(-rolling / tau)
    distance = v_end * rolling + (v - v_end) * tau * (1.0 - decay)
    return distance, v_end + (v - v_end) * decay if stop > dt else 0.0
