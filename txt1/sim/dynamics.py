"""The vehicle's dynamics: motors, steering servos and wheels, integrated exactly where the equations allow.

With the steering at rest everything has a closed form: the speed is an exponential, the path an arc, the wheels' paths
proportional to its length. While a servo turns (42 ms from centre to lock) the motion is cut into pieces of at most
`ramp_step`, each an arc at the piece's mean steering angle, which is second-order accurate. One call therefore costs
two or three arcs instead of twenty steps of a 1 kHz integrator, and is more accurate.

Plain scalars and tuples only, so that numba can compile it.
"""

from dataclasses import astuple
from math import atan, cos, exp, log, pi, sin, sqrt, tan
from typing import Final, NamedTuple

from txt1.model.kinematics import TWO_PI
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sim.parameters import VehicleParameters

SHORT_RAMP: Final = 0.25  # share of the ramp step below which the end of a servo's turn gets no piece of its own


Motion = tuple[float, float, float, float, float, float, float, float]
"""The fields of a `VehicleState` as plain numbers, which cost much less to make."""


class VehicleState(NamedTuple):
    """Where the vehicle is and what it does."""

    x: float = 0.0  # of the vehicle's centre in the room, m
    y: float = 0.0  # m
    theta: float = 0.0  # heading, rad in (-pi, pi]
    v: float = 0.0  # speed of the centre along its path, m/s
    phi_front: float = 0.0  # front steering angle, rad, left positive
    phi_rear: float = 0.0  # rear steering angle, rad, left positive
    right: float = 0.0  # path rolled by the right encoder wheel, m
    left: float = 0.0  # path rolled by the left encoder wheel, m


Dynamics = tuple[float, float, float, float, float, float, float, float, float, float, float, float, float, float]
"""The parameters of `move`, in the order in which it unpacks them; see `dynamics`."""

LOCK: Final = float(STEERING_MAX)  # PWM counts at which the steering is at its stop
RAMP_STEP: Final = 0.005  # longest piece of a motion while a servo turns, s


def dynamics(vehicle: VehicleParameters, body: Geometry, ramp_step: float = RAMP_STEP) -> Dynamics:
    """The parameters of `move` as plain numbers, which are read faster than attributes.

    A car whose front wheels steer moves as one that steers both axles of twice its wheelbase, seen from the middle.
    """
    steered = 1.0 if body.steering == "both" else 0.0
    return 2.0 * body.lever, body.track_width, body.steering_max, *astuple(vehicle)[:-1], ramp_step, steered


def move(
    state: Motion,
    motor: float,
    front: float,
    rear: float,
    dt: float,
    drag: float,
    p: Dynamics,
) -> Motion:
    """The vehicle's state `dt` seconds later.

    Args:
        state: now.
        motor: PWM counts, held for dt; 0 coasts.
        front: front steering, PWM counts, held.
        rear: rear steering, PWM counts, held.
        dt: s.
        drag: additional drag of the floor as a share of the speed, held.
        p: of `dynamics`.

    """
    x, y, theta, v, phi_front, phi_rear, right, left = state
    # one name each: in plain Python looking up an attribute costs as much as the multiplication it is for
    (
        wheelbase,
        track_width,
        steering_max,
        speed_gain,
        dead_band,
        speed_time_constant,
        coast_time_constant,
        coast_friction,
        servo_rate,
        scrub,
        slip,
        understeer,
        ramp_step,
        steered,
    ) = p
    # front = -u, rear = +u turns left (spec: plant)
    if not -LOCK <= front <= LOCK:
        front = LOCK if front > 0.0 else -LOCK
    if not -LOCK <= rear <= LOCK:
        rear = LOCK if rear > 0.0 else -LOCK
    target_front = -steering_max * (front / LOCK)
    target_rear = -steering_max * (rear / LOCK)
    coasting = abs(motor) <= dead_band
    if coasting and v == 0.0 and phi_front == target_front and phi_rear == target_rear:
        return state  # at rest
    if coasting:
        v_free, tau = 0.0, coast_time_constant
    else:
        v_free = speed_gain * (motor - dead_band if motor > 0.0 else motor + dead_band)
        tau = speed_time_constant
    tan_max = tan(steering_max)

    remaining = dt
    while remaining > 0.0:
        # -- steering: the piece ends with the ramp step or when a servo arrives
        if phi_front == target_front and phi_rear == target_rear:
            h = remaining
            mean_front, mean_rear = phi_front, phi_rear
        else:
            gap_front, gap_rear = target_front - phi_front, target_rear - phi_rear
            h = remaining if remaining < ramp_step else ramp_step
            if 0.0 < abs(gap_front) < h * servo_rate:
                h = abs(gap_front) / servo_rate
            if 0.0 < abs(gap_rear) < h * servo_rate:
                h = abs(gap_rear) / servo_rate
            travel = servo_rate * h * (1.0 + 1e-12)  # a servo that arrives with this piece has arrived
            next_front, next_rear = target_front, target_rear
            if abs(gap_front) > travel:
                next_front = phi_front + (travel if gap_front > 0.0 else -travel)
            if abs(gap_rear) > travel:
                next_rear = phi_rear + (travel if gap_rear > 0.0 else -travel)
            mean_front, mean_rear = 0.5 * (phi_front + next_front), 0.5 * (phi_rear + next_rear)
            phi_front, phi_rear = next_front, next_rear
            if h < SHORT_RAMP * ramp_step and phi_front == target_front and phi_rear == target_rear:
                # The end of a turn, too short for a piece of its own: one arc for it and the rest, at the mean angle
                share = h / remaining
                mean_front = phi_front + share * (mean_front - phi_front)
                mean_rear = phi_rear + share * (mean_rear - phi_rear)
                h = remaining

        # -- direction of motion: sideslip of the centre, 0 for opposite angles
        tan_front = tan(mean_front)
        tan_rear = -tan_front if mean_rear == -mean_front else tan(mean_rear)
        if tan_rear == -tan_front:
            beta, cos_beta, sin_beta = 0.0, 1.0, 0.0
        else:
            beta = atan(0.5 * (tan_front + tan_rear))
            cos_beta, sin_beta = cos(beta), sin(beta)

        # -- speed: tau dv/dt = v_target - (1 + drag) v, exactly
        lock = 0.5 * (tan_front - tan_rear) / tan_max
        loss = 1.0 + scrub * lock * lock + drag
        tau_h = tau / loss
        if coasting:
            friction = coast_friction if v > 0.0 else -coast_friction
            v_end = -friction / loss
            # dry friction stops the vehicle, it does not turn it round; without friction it rolls on
            stop = 0.0 if v == 0.0 else tau_h * log(1.0 - v / v_end) if v_end != 0.0 else h + 1.0
            rolling = h if h < stop else stop
            decay = exp(-rolling / tau_h)
            distance = v_end * rolling + (v - v_end) * tau_h * (1.0 - decay)
            v = v_end + (v - v_end) * decay if stop > h else 0.0
        else:
            v_end = v_free / loss
            decay = exp(-h / tau_h)
            distance = v_end * h + (v - v_end) * tau_h * (1.0 - decay)
            v = v_end + (v - v_end) * decay

        if distance != 0.0:
            # -- curvature, thesis (2.12) for opposite angles; understeer by the piece's mean speed
            mean_v = distance / h
            curvature = cos_beta * (tan_front - tan_rear) / (wheelbase * (1.0 + understeer * mean_v * mean_v))
            # -- encoder wheels that are steered roll along their own heading: the hub's velocity projected on it
            if not steered:
                tan_front = 0.0
            cos_front = 1.0 / sqrt(1.0 + tan_front * tan_front)
            sin_front = tan_front * cos_front
            forward = cos_beta * cos_front + (sin_beta + 0.5 * curvature * wheelbase) * sin_front
            apart = 0.5 * curvature * track_width * cos_front
            rolled = distance if coasting else distance * (1.0 + slip)
            right += rolled * (forward + apart)
            left += rolled * (forward - apart)
            # -- the arc, (2.2) integrated over its length
            half = 0.5 * distance * curvature
            chord = distance * (1.0 - half * half / 6.0 if abs(half) < 1e-4 else sin(half) / half)
            direction = theta + beta + half
            x += chord * cos(direction)
            y += chord * sin(direction)
            theta += 2.0 * half
            while theta > pi:
                theta -= TWO_PI
            while theta <= -pi:
                theta += TWO_PI
        remaining -= h
    return x, y, theta, v, phi_front, phi_rear, right, left
