"""The vehicle's dynamics: motors, steering servos and wheels, integrated exactly where the equations allow.

With the steering at rest everything has a closed form: the speed is an exponential, the path an arc, the wheels' paths
proportional to its length. While a servo turns (42 ms from centre to lock) the motion is cut into pieces of at most
`ramp_step`, each an arc at the piece's mean steering angle, which is second-order accurate. One call therefore costs
two or three arcs instead of twenty steps of a 1 kHz integrator, and is more accurate.

Tyres have no state of their own; they are always in balance.

- *Lateral slip.* A tyre pushes sideways by `cornering` times its load times the sine of its slip angle. So the
  reference point (middle of the vehicle, or of the rear axle if only the front axle steers) slides outwards: sin(angle)
  = -v^2 curvature / (g cornering).
- *The friction circle.* The motor demands an acceleration along the car, a = (v_free - loss v) / tau, and the steering
  demands v^2 curvature across it. If the sum of the two vectors exceeds g `grip`, both are scaled down by the same
  factor.
- *Wheels that spin or lock.* The motor pushes no more than the tyres hold, so the wheels turn at another speed than the
  car: loss v_wheel = v_free - tau times the car's acceleration. The encoders count this speed.

Near the circle, pieces are never longer than `ramp_step`; each has the acceleration at its middle.

Plain scalars and tuples only, so that numba can compile it.
"""

from dataclasses import astuple
from math import atan, cos, exp, log, pi, sin, sqrt, tan
from typing import Final, NamedTuple

from txt1.model.kinematics import TWO_PI
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sim.parameters import VehicleParameters
from txt1.units import GRAVITY

VERSION: Final = (
    # version of these equations: raised with every change, so that results of other versions are not reused
    2
)
# shares of the tyres' limit: a vehicle that demands less, and is slower, is computed without the circle
CALM_ALONG: Final = 0.62
CALM_ACROSS: Final = 0.5
# largest drag of the floor for this shortcut
DRAG_MAX: Final = 0.2
# share of the ramp step below which the end of a servo's turn gets no piece of its own
SHORT_RAMP: Final = 0.25


Motion = tuple[float, float, float, float, float, float, float, float]
"""The fields of a `VehicleState` as plain numbers, which are much quicker to make."""


class VehicleState(NamedTuple):
    """The vehicle's pose and motion."""

    # of the vehicle's centre in the room, m
    x: float = 0.0
    y: float = 0.0  # m
    # heading, rad in (-pi, pi]
    theta: float = 0.0
    # speed of the centre along its path, m/s
    v: float = 0.0
    # front steering angle, rad, left positive
    phi_front: float = 0.0
    # rear steering angle, rad, left positive
    phi_rear: float = 0.0
    # path rolled by the right encoder wheel, m
    right: float = 0.0
    # path rolled by the left encoder wheel, m
    left: float = 0.0


Dynamics = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float, float, float, float,
    float, float, float, float, float,
]  # fmt: skip
"""The parameters of `move`, in the order in which it unpacks them; see `dynamics`."""

# PWM counts at which the steering is at its stop
LOCK: Final = float(STEERING_MAX)
# longest piece of a motion while a servo turns, s
RAMP_STEP: Final = 0.005


def dynamics(vehicle: VehicleParameters, body: Geometry, ramp_step: float = RAMP_STEP) -> Dynamics:
    """Return the parameters of `move` as plain numbers, which are faster to read than attributes.

    A car with front steering moves like a car with both axles steered and twice its wheelbase, seen from the middle.
    """
    steered = 1.0 if body.steering == "both" else 0.0
    wheelbase, steering_max = 2.0 * body.lever, body.steering_max
    given = astuple(vehicle)[:-2]
    return (
        wheelbase,
        body.track_width,
        steering_max,
        *given,
        ramp_step,
        steered,
        *reckoned(wheelbase, steering_max, vehicle),
    )


def reckoned(wheelbase: float, steering_max: float, p: VehicleParameters) -> tuple[float, float, float, float, float]:
    """Return numbers for `move` that follow from the parameters.

    They are: the tangent of the largest steering angle; the acceleration that the tyres hold, m/s^2; their lateral slip
    for 1 m/s^2 across; and two limits in m/s. A car is far from the limit of its tyres if its speed is below the first,
    and differs from the free speed by less than the second.
    """
    hold, tan_max, resistance = GRAVITY * p.grip, tan(steering_max), p.scrub + DRAG_MAX
    along = CALM_ALONG * hold
    calm_v = min(
        sqrt(CALM_ACROSS * hold * 0.5 * wheelbase / tan_max),
        max(0.0, (along * p.coast_time_constant - p.coast_friction) / (1.0 + resistance)),
    )
    return tan_max, hold, 1.0 / (GRAVITY * p.cornering), calm_v, along * p.speed_time_constant - resistance * calm_v


def at_voltage(motor: float, dead_band: float, share: float) -> float:
    """Return the PWM counts that make `share` of the motor's free speed, as a pack with this share of the
    voltage does.
    """
    if abs(motor) <= dead_band:
        return motor
    rest = dead_band if motor > 0.0 else -dead_band
    return rest + (motor - rest) * share


def move(
    state: Motion,
    motor: float,
    front: float,
    rear: float,
    dt: float,
    drag: float,
    p: Dynamics,
) -> Motion:
    """Return the vehicle's state `dt` seconds later.

    Args:
        state: the present state.
        motor: PWM counts, held for dt; 0 coasts.
        front: front steering, PWM counts, held.
        rear: rear steering, PWM counts, held.
        dt: s.
        drag: additional drag of the floor as a share of the speed, held.
        p: parameters from `dynamics`.

    """
    x, y, theta, v, phi_front, phi_rear, right, left = state
    # local names: in plain Python looking up an attribute takes as long as the multiplication
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
        _,
        _,
        ramp_step,
        steered,
        tan_max,
        hold,
        sideways,
        calm_v,
        calm_pull,
    ) = p
    # front = -u, rear = +u turns left
    if not -LOCK <= front <= LOCK:
        front = LOCK if front > 0.0 else -LOCK
    if not -LOCK <= rear <= LOCK:
        rear = LOCK if rear > 0.0 else -LOCK
    target_front = -steering_max * (front / LOCK)
    target_rear = -steering_max * (rear / LOCK)
    coasting = abs(motor) <= dead_band
    if coasting and v == 0.0 and phi_front == target_front and phi_rear == target_rear:
        # at rest
        return state
    if coasting:
        v_free, tau = 0.0, coast_time_constant
    else:
        v_free = speed_gain * (motor - dead_band if motor > 0.0 else motor + dead_band)
        tau = speed_time_constant
    # whether motor and steering demand so little that the tyres certainly hold
    calm = -calm_v <= v <= calm_v and (coasting or -calm_pull <= v_free - v <= calm_pull)

    remaining = dt
    while remaining > 0.0:
        # -- steering: the piece ends with the ramp step or when a servo arrives
        if phi_front == target_front and phi_rear == target_rear:
            h = remaining if calm or remaining < ramp_step else ramp_step
            mean_front, mean_rear = phi_front, phi_rear
        else:
            gap_front, gap_rear = target_front - phi_front, target_rear - phi_rear
            h = remaining if remaining < ramp_step else ramp_step
            if 0.0 < abs(gap_front) < h * servo_rate:
                h = abs(gap_front) / servo_rate
            if 0.0 < abs(gap_rear) < h * servo_rate:
                h = abs(gap_rear) / servo_rate
            # a servo that arrives with this piece has arrived
            travel = servo_rate * h * (1.0 + 1e-12)
            next_front, next_rear = target_front, target_rear
            if abs(gap_front) > travel:
                next_front = phi_front + (travel if gap_front > 0.0 else -travel)
            if abs(gap_rear) > travel:
                next_rear = phi_rear + (travel if gap_rear > 0.0 else -travel)
            mean_front, mean_rear = 0.5 * (phi_front + next_front), 0.5 * (phi_rear + next_rear)
            phi_front, phi_rear = next_front, next_rear
            if calm and h < SHORT_RAMP * ramp_step and phi_front == target_front and phi_rear == target_rear:
                # The end of a turn, too short for a piece of its own: one arc for it and the rest, at the mean angle
                share = h / remaining
                mean_front = phi_front + share * (mean_front - phi_front)
                mean_rear = phi_rear + share * (mean_rear - phi_rear)
                h = remaining

        # -- direction of motion: sideslip of the centre, 0 for opposite angles
        tan_front = tan(mean_front)
        tan_rear = -tan_front if mean_rear == -mean_front else tan(mean_rear)
        if tan_rear == -tan_front:
            cos_beta, sin_beta = 1.0, 0.0
            turn = tans = 2.0 * tan_front
        else:
            beta = atan(0.5 * (tan_front + tan_rear))
            cos_beta, sin_beta = cos(beta), sin(beta)
            tans = tan_front - tan_rear
            turn = cos_beta * tans

        # -- speed: tau dv/dt = v_target - (1 + drag) v, exactly
        lock = 0.5 * tans / tan_max
        loss = 1.0 + scrub * lock * lock + drag
        tau_h = tau / loss
        if calm:
            share = 1.0
        else:
            # -- the share of the demand that the tyres hold: at the beginning, then at the middle of the piece
            bend = turn / wheelbase
            friction = 0.0 if not coasting else coast_friction if v > 0.0 else -coast_friction
            mean_v = v
            for _ in range(2):
                along = (v_free - friction - loss * mean_v) / tau
                across = mean_v * mean_v * bend / (1.0 + understeer * mean_v * mean_v)
                asked = sqrt(along * along + across * across)
                share = hold / asked if asked > hold else 1.0
                mean_v = v + 0.5 * h * share * along
                if share == 1.0 or (coasting and (mean_v > 0.0) != (v > 0.0)):
                    break
        if share < 1.0:
            along *= share
            turn *= share
            stop = -v / along if coasting and v * along < 0.0 else h
            rolling = h if h < stop else stop
            distance = (v + 0.5 * along * rolling) * rolling
            wheels = (v_free - friction - tau * along) / loss
            # a locked wheel does not turn
            rolled = wheels * rolling * (1.0 + slip) if not coasting else wheels * rolling if wheels * v > 0.0 else 0.0
            v = v + along * rolling if stop >= h else 0.0
        elif coasting:
            friction = coast_friction if v > 0.0 else -coast_friction
            v_end = -friction / loss
            # dry friction stops the vehicle but does not reverse it; without friction it rolls on
            stop = 0.0 if v == 0.0 else tau_h * log(1.0 - v / v_end) if v_end != 0.0 else h + 1.0
            rolling = h if h < stop else stop
            decay = exp(-rolling / tau_h)
            distance = rolled = v_end * rolling + (v - v_end) * tau_h * (1.0 - decay)
            v = v_end + (v - v_end) * decay if stop > h else 0.0
        else:
            v_end = v_free / loss
            decay = exp(-h / tau_h)
            distance = v_end * h + (v - v_end) * tau_h * (1.0 - decay)
            rolled = distance * (1.0 + slip)
            v = v_end + (v - v_end) * decay

        if distance != 0.0 or rolled != 0.0:
            # -- curvature, thesis (2.12) for opposite angles; understeer by the piece's mean speed
            if turn == 0.0:
                curvature, sin_slip, cos_slip = 0.0, sin_beta, cos_beta
            else:
                mean_v = distance / h
                square = mean_v * mean_v
                curvature = turn / (wheelbase * (1.0 + understeer * square))
                # -- the reference point slides outwards
                sin_slip = sideways * square * curvature
                if mean_v > 0.0:
                    sin_slip = -sin_slip
                cos_slip = sqrt(1.0 - sin_slip * sin_slip)
                if sin_beta:
                    sin_slip, cos_slip = (
                        sin_beta * cos_slip + cos_beta * sin_slip,
                        cos_beta * cos_slip - sin_beta * sin_slip,
                    )
            # -- steered encoder wheels roll along their own heading: the hub's velocity is projected on it
            if not steered:
                tan_front = 0.0
            cos_front = 1.0 / sqrt(1.0 + tan_front * tan_front)
            sin_front = tan_front * cos_front
            forward = cos_slip * cos_front + (sin_slip + 0.5 * curvature * wheelbase) * sin_front
            apart = 0.5 * curvature * track_width * cos_front
            right += rolled * (forward + apart)
            left += rolled * (forward - apart)
            # -- the arc, (2.2) integrated over its length
            half = 0.5 * distance * curvature
            chord = distance * (1.0 - half * half / 6.0 if abs(half) < 1e-4 else sin(half) / half)
            ahead, aside = chord * cos_slip, chord * sin_slip
            cos_theta, sin_theta = cos(theta + half), sin(theta + half)
            x += ahead * cos_theta - aside * sin_theta
            y += ahead * sin_theta + aside * cos_theta
            theta += 2.0 * half
            while theta > pi:
                theta -= TWO_PI
            while theta <= -pi:
                theta += TWO_PI
        remaining -= h
    return x, y, theta, v, phi_front, phi_rear, right, left
