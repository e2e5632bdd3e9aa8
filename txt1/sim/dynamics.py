"""The vehicle's dynamics: motors, steering servos and wheels, integrated exactly where the equations allow.

With the steering at rest everything has a closed form: the speed is an exponential, the path an arc, the wheels' paths
proportional to its length. While a servo turns (42 ms from centre to lock) the motion is cut into pieces of at most
`ramp_step`, each an arc at the piece's mean steering angle, which is second-order accurate. One call therefore costs
two or three arcs instead of twenty steps of a 1 kHz integrator, and is more accurate.

While the tyres hold what is asked of them, they have no state of their own: wheels roll, and all is in balance.

- *Lateral slip.* A tyre pushes sideways by `cornering` times its load times the sine of its slip angle. So the
  reference point (middle of the vehicle, or of the rear axle if only the front axle steers) slides outwards: sin(angle)
  = -v^2 curvature / (g cornering).
- *The friction circle.* The motor demands an acceleration along the car, a = (v_free - loss v) / tau, and the steering
  demands v^2 curvature across it. If the sum of the two vectors exceeds g `grip`, both are scaled down by the same
  factor.
- *Wheels that spin or lock.* What the motor asks for beyond the tyres' hold turns the wheels, which have the share J of
  the car's inertia, at a speed w of their own. A tyre holds a = g `grip` tanh(`stiffness` slip / `grip`) along, with
  slip = (w - v) / max(abs(v), abs(w)), and with the force across at most g `grip` in all. Then dv/dt = a and J d(w -
  v)/dt = (v_free - loss w) / tau - a (`txt1.sim.sliding`). The encoders count w.

Near the circle, pieces are never longer than `ramp_step`; each has the acceleration at its middle.

Plain scalars and tuples only, so that numba can compile it.
"""

from dataclasses import astuple
from math import atan, cos, exp, log, pi, sin, sqrt, tan
from typing import Final, NamedTuple

from txt1.model.kinematics import TWO_PI
from txt1.model.vehicle import STEERING_LIMIT, Geometry
from txt1.sim.parameters import VehicleParameters
from txt1.units import GRAVITY

VERSION: Final = (
    # version of these equations: raised with every change, so that results of other versions are not reused
    3
)
# shares of the tyres' limit: a vehicle that demands less, and is slower, is computed without the circle
CALM_ALONG: Final = 0.62
CALM_ACROSS: Final = 0.5
# largest drag of the floor for this shortcut
DRAG_MAX: Final = 0.2
# share of the ramp step below which the end of a servo's turn gets no piece of its own
SHORT_RAMP: Final = 0.25


# the fields of a `VehicleState` as plain numbers, which are much quicker to make
Motion = tuple[float, float, float, float, float, float, float, float, float]


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
    # speed of the wheels beyond the car's, m/s: 0 while they roll
    spin: float = 0.0


# the parameters of `move`, in the order in which it unpacks them; see `dynamics`
Dynamics = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float,
]  # fmt: skip

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


def move(state: Motion, motor: float, front: float, rear: float, dt: float, drag: float, p: Dynamics) -> Motion:
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
    # local names: in plain Python looking up an attribute takes as long as the multiplication
    (
        wheelbase, track, steering_max, speed_gain, dead_band, speed_time_constant, coast_time_constant,
        coast_friction, servo_rate, scrub, slip, understeer, _, _, inertia, stiffness, ramp_step, steered, tan_max,
        hold, sideways, calm_v, calm_pull,
    ) = p  # fmt: skip
    x, y, theta, v, phi_front, phi_rear, right, left, spin = state
    target_front, target_rear = servo_angle(front, steering_max), servo_angle(rear, steering_max)
    coasting = abs(motor) <= dead_band
    if coasting and v == spin == 0.0 and phi_front == target_front and phi_rear == target_rear:
        # at rest
        return state
    tau = coast_time_constant if coasting else speed_time_constant
    v_free = speed_gain * (motor - dead_band if motor > 0.0 else motor + dead_band)
    # whether the wheels roll, and motor and steering demand so little that the tyres certainly hold
    calm = False
    # CPython compares quickly where it branches
    if spin == 0.0 and -calm_v <= v <= calm_v and (coasting or -calm_pull <= v_free - v <= calm_pull):
        calm = True
    remaining = dt
    while remaining > 0.0:
        h, mean_front, mean_rear, phi_front, phi_rear = steer(
            phi_front, phi_rear, target_front, target_rear, remaining, calm, ramp_step, servo_rate
        )
        tan_front = tan(mean_front)
        # the loops steer by opposite angles
        tans, turn, sin_beta, cos_beta = (
            (2.0 * tan_front, 2.0 * tan_front, 0.0, 1.0)
            if mean_rear == -mean_front
            else direction(tan_front, tan(mean_rear))
        )
        # tau dv/dt = v_free - loss v
        lock = 0.5 * tans / tan_max
        loss = 1.0 + scrub * lock * lock + drag
        if coasting:
            # dry friction takes the motor's place
            v_free = -coast_friction if v > 0.0 else coast_friction
        if not calm and (
            spin != 0.0 or asks(v, v_free, tau, loss, turn / wheelbase, h, coasting, hold, understeer) > hold
        ):
            distance, rolled, v, spin, share = slide(
                v, spin, v_free, tau, loss, turn / wheelbase, h, coasting, hold, stiffness, inertia, understeer
            )
            turn *= share
        elif coasting:
            distance, v = coast(v, v_free / loss, tau / loss, h)
            rolled = distance
        else:
            # the speed tends to v_end
            v_end, tau_h = v_free / loss, tau / loss
            decay = exp(-h / tau_h)
            distance, v = v_end * h + (v - v_end) * tau_h * (1.0 - decay), v_end + (v - v_end) * decay
            rolled = distance * (1.0 + slip)
        if distance != 0.0 or rolled != 0.0:
            curvature, sin_slip, cos_slip, along_right, along_left = wheels(
                turn, distance / h, sin_beta, cos_beta, tan_front * steered, wheelbase, track, understeer, sideways
            )
            right += rolled * along_right
            left += rolled * along_left
            x, y, theta = along_arc(x, y, theta, distance, curvature, sin_slip, cos_slip)
        remaining -= h
    return x, y, theta, v, phi_front, phi_rear, right, left, spin


# -- servos ------------------------------------------------------------------------------------------------------


def servo_angle(counts: float, steering_max: float) -> float:
    """Return the steering angle for PWM counts, rad: front = -u, rear = +u turns left."""
    if not -STEERING_LIMIT <= counts <= STEERING_LIMIT:
        counts = STEERING_LIMIT if counts > 0.0 else -STEERING_LIMIT
    return -steering_max * (counts / STEERING_LIMIT)


def steer(
    phi_front: float,
    phi_rear: float,
    target_front: float,
    target_rear: float,
    remaining: float,
    calm: bool,
    ramp_step: float,
    rate: float,
) -> tuple[float, float, float, float, float]:
    """Return the length of the next piece, s, its mean steering angles, and those at its end, front and rear, rad."""
    h = remaining if remaining < ramp_step else ramp_step
    if phi_front == target_front and phi_rear == target_rear:
        return remaining if calm else h, phi_front, phi_rear, phi_front, phi_rear
    gap_front, gap_rear = target_front - phi_front, target_rear - phi_rear
    size = abs(gap_front)
    if (
        calm
        and size < h * rate
        and size / rate < SHORT_RAMP * ramp_step
        and phi_rear == -phi_front
        and target_rear == -target_front
    ):
        # most pieces of a car that drives: as below, for both servos in one go
        mean_front = target_front + size / rate / remaining * (0.5 * (phi_front + target_front) - target_front)
        return remaining, mean_front, -mean_front, target_front, target_rear
    # a servo that arrives within the ramp step ends the piece
    if 0.0 < abs(gap_front) < h * rate:
        h = abs(gap_front) / rate
    if 0.0 < abs(gap_rear) < h * rate:
        h = abs(gap_rear) / rate
    # a servo that arrives with this piece has arrived
    travel = rate * h * (1.0 + 1e-12)
    end_front, end_rear = target_front, target_rear
    if abs(gap_front) > travel:
        end_front = phi_front + (travel if gap_front > 0.0 else -travel)
    if abs(gap_rear) > travel:
        end_rear = phi_rear + (travel if gap_rear > 0.0 else -travel)
    mean_front, mean_rear = 0.5 * (phi_front + end_front), 0.5 * (phi_rear + end_rear)
    if calm and h < SHORT_RAMP * ramp_step and end_front == target_front and end_rear == target_rear:
        # The end of a turn, too short for a piece of its own: one arc for it and the rest, at the mean angle
        share = h / remaining
        mean_front = end_front + share * (mean_front - end_front)
        mean_rear = end_rear + share * (mean_rear - end_rear)
        h = remaining
    return h, mean_front, mean_rear, end_front, end_rear


def direction(tan_front: float, tan_rear: float) -> tuple[float, float, float, float]:
    """Return numbers of the motion that the tangents of the steering angles demand.

    They are: the difference of both tangents; the curvature times the wheelbase; sine and cosine of beta, the sideslip
    of the centre, which is 0 for opposite angles.
    """
    beta = atan(0.5 * (tan_front + tan_rear))
    sin_beta, cos_beta = sin(beta), cos(beta)
    tans = tan_front - tan_rear
    return tans, cos_beta * tans, sin_beta, cos_beta


# -- speed -------------------------------------------------------------------------------------------------------


def asks(
    v: float,
    v_free: float,
    tau: float,
    loss: float,
    bend: float,
    h: float,
    coasting: bool,
    hold: float,
    understeer: float,
) -> float:
    """Return the acceleration that motor and steering ask of tyres that roll, m/s^2, in all directions together: at the
    beginning of a piece; if the tyres hold it, at its middle.
    """
    asked, mean_v = 0.0, v
    for _ in range(2):
        along = (v_free - loss * mean_v) / tau
        across = mean_v * mean_v * bend / (1.0 + understeer * mean_v * mean_v)
        asked = sqrt(along * along + across * across)
        mean_v = v + 0.5 * h * along
        if asked > hold or (coasting and (mean_v > 0.0) != (v > 0.0)):
            break
    return asked


def slide(
    v: float,
    spin: float,
    v_free: float,
    tau: float,
    loss: float,
    bend: float,
    h: float,
    coasting: bool,
    hold: float,
    stiffness: float,
    inertia: float,
    understeer: float,
) -> tuple[float, float, float, float, float]:
    """Do as `txt1.sim.sliding.slide`, which is loaded when wheels slip for the first time."""
    from txt1.sim.sliding import slide

    return slide(v, spin, v_free, tau, loss, bend, h, coasting, hold, stiffness, inertia, understeer)


def coast(v: float, v_end: float, tau: float, h: float) -> tuple[float, float]:
    """Return the distance and the speed after h s without a motor, m and m/s.

    Dry friction, which pulls towards `v_end`, stops the vehicle but does not reverse it; without friction it rolls on.
    """
    stop = h + 1.0
    if v == 0.0:
        stop = 0.0
    elif v_end != 0.0:
        stop = tau * log(1.0 - v / v_end)
    rolling = h if h < stop else stop
    decay = exp(-rolling / tau)
    distance = v_end * rolling + (v - v_end) * tau * (1.0 - decay)
    return distance, v_end + (v - v_end) * decay if stop > h else 0.0


# -- path --------------------------------------------------------------------------------------------------------


def wheels(
    turn: float,
    v: float,
    sin_beta: float,
    cos_beta: float,
    tan_front: float,
    wheelbase: float,
    track: float,
    understeer: float,
    sideways: float,
) -> tuple[float, float, float, float, float]:
    """Return the curvature, 1/m, by (2.12) for opposite angles, with understeer; sine and cosine of the angle at which
    the reference point moves, as it slides outwards; and the paths of the right and left encoder wheel as shares of the
    vehicle's.

    Steered wheels roll along their own heading: the hub's velocity is projected on it.
    """
    curvature, sin_slip, cos_slip = 0.0, sin_beta, cos_beta
    if turn != 0.0:
        square = v * v
        curvature = turn / (wheelbase * (1.0 + understeer * square))
        sin_slip = sideways * square * curvature
        if v > 0.0:
            sin_slip = -sin_slip
        cos_slip = sqrt(1.0 - sin_slip * sin_slip)
        if sin_beta:
            sin_slip, cos_slip = sin_beta * cos_slip + cos_beta * sin_slip, cos_beta * cos_slip - sin_beta * sin_slip
    cos_front = 1.0 / sqrt(1.0 + tan_front * tan_front)
    sin_front = tan_front * cos_front
    forward = cos_slip * cos_front + (sin_slip + 0.5 * curvature * wheelbase) * sin_front
    apart = 0.5 * curvature * track * cos_front
    return curvature, sin_slip, cos_slip, forward + apart, forward - apart


def along_arc(
    x: float, y: float, theta: float, distance: float, curvature: float, sin_slip: float, cos_slip: float
) -> tuple[float, float, float]:
    """Return the pose after an arc, (2.2) integrated over its length; m and rad."""
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
    return x, y, theta
