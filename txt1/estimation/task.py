"""The filter on a robot: its sensors, its topics, and its task, which makes an estimate every 20 ms."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from math import copysign, cos, hypot, isfinite, sin, sqrt, tan
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.config.schema import SensorConfig
from txt1.errors import ConfigError
from txt1.estimation.filter import Drift, centred
from txt1.estimation.fusion import GYRO_CLOCK, Fusion
from txt1.estimation.judging import STALE, Belonging, WitnessValues
from txt1.estimation.sensors import (
    KIND_ENCODERS,
    KIND_GYRO,
    KIND_TURN,
    USUAL,
    Measurement,
    plan,
    wanted,
)
from txt1.estimation.settings import EstimationConfig, FusedConfig, Trust
from txt1.kernel.ticks import Ticks
from txt1.model.estimate import Estimate
from txt1.model.odometry import Odometry
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.protocol.messages import CombinedOdometry
from txt1.runtime import Runtime
from txt1.sensors.base import Reading
from txt1.sensors.readings import ImuReading
from txt1.telemetry.topics import Rule, Topic, declare
from txt1.units import new

ESTIMATION_PERIOD: Final = 0.02  # s
# cycles from one vote on the sensors to the next
VOTES: Final = 5
# behind the sensors in the same instant
PRIORITY: Final = -1
ENCODERS: Final = "encoders"
# s for which the encoders are silent and nothing is asked of a robot that stands
REST_TIME: Final = 0.5
# rad/s of the steering; assumed
SERVO_RATE: Final = 7.0
# m/s by which the encoders miss besides their counts: the floor and the tyres; assumed
SPEED_MODEL: Final = 0.004
# rad/s, likewise
YAW_MODEL: Final = 0.015
# m/s by which a robot without encoders misses its speed; assumed
BLIND_SPEED: Final = 0.1
# rad/s, likewise
BLIND_YAW: Final = 0.1
# of both, besides
BLIND_SHARE: Final = 0.15
# s over which wheels and gyro are compared
TURN_TIME: Final = 1.0
# of the gyro in that time, at least
TURN_READINGS: Final = 10
# rad by which the wheels miss it after 1 s besides their counts: the floor; assumed
TURN_NOISE: Final = 0.001
# of a turn by which sides at two speeds differ besides, whose tyres scrub
SKID_SHARE: Final = 0.05
# standard deviation of the track width, as a share of the measured one
TRACK_SIGMA: Final = 0.05
# ... and of the one by which such a car turns
SKID_SIGMA: Final = 0.3
# the same of how it changes in a second: floors
SKID_WALK: Final = 0.02
# rad/s, each reading at 100 Hz; assumed
SIGMA_GYRO: Final = 0.006
ROOT_2: Final = sqrt(2.0)
ROOT_6: Final = sqrt(6.0)
# readings
GYRO_KEPT: Final = 1000
# s, the longest between two of its readings that are integrated
GYRO_GAP_MAX: Final = 0.1
# m/s, the standard deviation up to which the loops are given a speed
V_USABLE: Final = 0.1
# rad/s, likewise
OMEGA_USABLE: Final = 0.3

# of a planar robot in ROS's 6 x 6: x, y, theta; v, omega
_COVARIANCES: Final = [
    (block, 6 * row + column, 5 * own_row + own_column)
    for block, places in (("pose", ((0, 0), (1, 1), (5, 2))), ("twist", ((0, 3), (5, 4))))
    for row, own_row in places
    for column, own_column in places
]


def _message(estimate: Estimate) -> tuple[float, ...]:
    x, y, theta, v, omega, covariance = estimate[:6]
    return x, y, sin(0.5 * theta), cos(0.5 * theta), v, omega, *(covariance[own] for _, _, own in _COVARIANCES)


FILTERED: Final = declare(Topic(
    "/odometry/filtered", Estimate, "m, rad, m/s, rad/s", "nav_msgs/Odometry", Rule.CYCLE,
    "pose and velocities by all sensors together, with covariance",
    {"header": {"frame_id": "map"}, "child_frame_id": "base_footprint"},
    ("pose.pose.position.x", "pose.pose.position.y", "pose.pose.orientation.z", "pose.pose.orientation.w",
     "twist.twist.linear.x", "twist.twist.angular.z",
     *(f"{block}.covariance.{place}" for block, place, _ in _COVARIANCES)),
    _message,
))  # fmt: skip


def _status(trust: Trust) -> dict[str, Any]:
    return {
        "level": 0 if trust.believed else 1,
        "name": trust.name,
        "message": "believed" if trust.believed else trust.reason,
        "values": [{"key": key, "value": str(value)} for key, value in trust._asdict().items() if value is not None],
    }


TRUSTS: Final = declare(Topic[tuple[Trust, ...]](
    "/estimation", tuple[Trust, ...], "", "diagnostic_msgs/DiagnosticArray", Rule.SECOND,
    "the sensors that are fused: whether each is believed, and why not",
    make=lambda trusts: {"status": [_status(trust) for trust in trusts]},
))  # fmt: skip


class Wheels(NamedTuple):
    """The robot's own part of a cycle."""

    odometry: Odometry
    # when the odometry was read, s of the run
    time: float
    # counts on the rear servo since the last cycle, left positive; None where nobody knows
    steering: float | None
    setpoint: float  # m/s


class Turning(NamedTuple):
    """How far the wheels turned the robot."""

    begin: float  # s of the run
    end: float  # s of the run
    angle: float  # rad
    # whether it stood meanwhile
    still: bool


class Estimator:
    """The filter with its settings: takes readings as they come, and the robot's own part every cycle.

    After an error there is no estimate any more, for the rest of the run, and readings are ignored.

    `kinds` are the types of the sensors' values by name; `geometry` is the vehicle's.
    """

    def __init__(self, config: EstimationConfig, kinds: Mapping[str, type], geometry: Geometry) -> None:
        self.estimate: Estimate | None = None
        """The newest one."""
        self.failure = ""
        """The error that ended it, in one line; empty while it is on."""
        self.settings = {name: config.settings.get(name, FusedConfig()) for name in config.names}
        fields = {name: wanted(kind, self.settings[name]) for name, kind in kinds.items()}
        belongings = {
            name: Belonging(each.gate, each.timeout, {"x", "y"} <= set(fields.get(name, ())))
            for name, each in self.settings.items()
        }
        # encoder wheels that do not steer tell the truth
        self._wheelbase = geometry.wheelbase if geometry.steering == "both" else 0.0
        start = None if config.start is None else (config.start, config.start_sigma)
        skid = geometry.steering == "skid"
        usual = SKID_SIGMA if skid else TRACK_SIGMA
        gyro_scale = max(
            (self.settings[name].scale_sigma for name, kind in kinds.items() if kind is ImuReading), default=0.0
        )
        # without encoders there is no witness of how it rolls
        self._counts = isfinite(geometry.count_length)
        mounts = {
            name: (self.settings[name].lever_sigma, self.settings[name].delay_sigma)
            for name, each in belongings.items()
            if each.tells_pose and self._counts
        }
        self.fusion = Fusion(
            belongings,
            slip_sigma=config.slip,
            start=start,
            gyro_scale=gyro_scale,
            mounts=mounts,
            track_sigma=usual if config.track_sigma is None else config.track_sigma,
            drift=Drift(width=SKID_WALK) if skid else Drift(),
        )
        self.fusion.asked_at = 0.0
        self.through: Callable[[Measurement], Iterable[Measurement]] | None = None
        """Every measurement passes it on its way into the filter; an experiment may let sensors fail there."""
        self._plans = {name: plan(name, kind, self.settings[name]) for name, kind in kinds.items()}
        self._geometry = geometry
        # of it, m, rad and m: they take a while to compute
        self._count_length = geometry.count_length
        self._steering_max, self._lever = geometry.steering_max, geometry.lever
        self._read = 0.0
        # of the steering as it should be, rad, left positive
        self._angle = 0.0
        self._steering: float | None = None
        self._curvature = 0.0
        # s for which it has stood
        self._still = 0.0
        # its times (s) and rates (rad/s)
        self._gyro: deque[tuple[float, float]] = deque(maxlen=GYRO_KEPT)
        self._turning: Turning | None = None
        # which wait for the gyro
        self._compared: deque[Turning] = deque(maxlen=2)
        # what the gyro told since the last cycle, rad/s
        self._turns: list[float] = []
        # what the encoders told with it, m/s and rad/s
        self._wheels: tuple[float, float] | None = None
        self._setpoint = 0.0  # m/s
        self._cycles = 0

    def take(self, name: str, reading: Reading[Any]) -> None:
        """Take a sensor's reading."""
        if self.failure:
            return
        try:
            for measurement in self._plans[name](reading):
                self._give(measurement)
        except Exception as error:
            self.fail(error)

    def fail(self, error: Exception) -> None:
        """Give no estimate from now on, because of this error."""
        self.failure = " ".join(f"{type(error).__name__}: {error}".split())
        self.estimate = None

    def trusts(self) -> tuple[Trust, ...]:
        """How much each sensor is believed; none of them after an error."""
        trusts = self.fusion.trusts()
        if not self.failure:
            return trusts
        reason = f"the estimate is off: {self.failure}"
        return tuple(trust._replace(believed=False, reason=reason) for trust in trusts)

    def _give(self, measurement: Measurement) -> None:
        given = (measurement,) if self.through is None else self.through(measurement)
        for each in given:
            self.fusion.take(each)
            time, _, kind, rows, values, _, _ = each
            if kind is KIND_GYRO:
                (rate,) = values
                if isfinite(rate):
                    if time > self._read - STALE:
                        self._turns.append(rate)
                    if not self._gyro or time > self._gyro[-1][0]:
                        self._gyro.append((time, rate))
            elif kind is KIND_ENCODERS and rows == (0, 1) and isfinite(sum(values)) and time > self._read - STALE:
                self._wheels = values[0], values[1]

    def step(self, now: float, wheels: Wheels) -> Estimate:
        """Return the estimate at `now`; raises ArithmeticError when it is no number any more."""
        dt = wheels.time - self._read
        if dt > 0.0:
            if (wheels.setpoint, wheels.steering) != (self._setpoint, self._steering):
                self.fusion.asked_at = now
            if self._read > 0.0:
                self._take_wheels(wheels, dt)
            self._read = wheels.time
        estimate = self.fusion.step(now)
        x, y, theta, v, omega, covariance, bias, slip, _ = estimate
        if not isfinite(x + y + theta + v + omega + bias + slip + sum(covariance)):
            raise ArithmeticError("the filter's state is not finite")
        self.estimate = estimate
        self._vote(now, dt, bias)
        return estimate

    def _vote(self, now: float, dt: float, bias: float) -> None:
        """Let the witnesses of the yaw rate report, and vote."""
        turns, wheels = self._turns, self._wheels
        if dt > 0.0 and wheels is not None and self._counts:
            gyro = (sum(turns) / len(turns) - bias) / self.fusion.gyro_share if turns else None
            steered = self._steering is not None and self._geometry.steering != "skid"
            # of wheels that do not turn, though they should, the speed is no witness
            steering = (wheels[0] or self._setpoint) * self._curvature if steered else None
            turning = wheels[1] / self.fusion.turn_share
            self.fusion.cycle(new(WitnessValues, (self._read, wheels[0], turning, gyro, steering)), dt)
            # wheels that are not believed tell nothing of the gyro
            if self.fusion.believes(ENCODERS):
                self._compare(dt, wheels[1])
            else:
                self._turning = None
                self._compared.clear()
        turns.clear()
        self._wheels = None
        if not self.fusion.turning:
            self._turning = None
            self._compared.clear()
            self._gyro.clear()
        self._cycles += 1
        if self._cycles % VOTES == 0:
            self.fusion.judge_by_vote()

    def _compare(self, dt: float, omega: float) -> None:
        """Add a cycle to the turn by the wheels, and give it beside the gyro's when it was long enough or it stopped.

        The error of whole counts does not grow with the turn, and the errors of single cycles cancel: over a second
        the wheels tell a gyro's bias three times as well as their yaw rates do. A car that stands does not turn at all.
        """
        turning, now, still = self._turning, self._read, self._still >= REST_TIME
        begin, angle = now - dt, 0.0
        if turning is not None and begin <= turning.end + 0.5 * dt:
            if turning.still is still:
                begin, _, angle, _ = turning
            else:
                self._compared.append(turning)
        self._turning = turning = new(Turning, (begin, now, angle + omega * dt, still))
        if now - begin >= TURN_TIME:
            self._compared.append(turning)
            self._turning = Turning(now, now, 0.0, still)
        while self._compared and self._gyro and self._gyro[-1][0] >= self._compared[0].end:
            self._give_turn(self._compared.popleft())

    def _give_turn(self, turning: Turning) -> None:
        begin, end, angle, still = turning
        near = [each for each in self._gyro if begin - GYRO_GAP_MAX < each[0] < end + GYRO_GAP_MAX]
        if len(near) < TURN_READINGS or end - begin < GYRO_GAP_MAX:
            return
        times, rates = np.array(near).T
        inside = (times > begin) & (times < end)
        if times[0] > begin or times[-1] < end or np.diff(times).max() > GYRO_GAP_MAX:
            return
        at = np.concatenate(((begin,), times[inside], (end,)))
        turning_at = np.interp(at, times, rates)
        by_gyro = float(np.trapezoid(turning_at, at))
        # slip varies with each piece of the turn, to whichever side; a late clock misses what the rate has changed by
        path, swing = float(np.trapezoid(np.abs(turning_at), at)), float(turning_at[-1] - turning_at[0])
        dt = end - begin
        share = SKID_SHARE if self._geometry.steering == "skid" else 0.0
        # infinite without encoders
        counts = self._count_length / (self._geometry.track_width * sqrt(3.0))
        noise = TURN_NOISE * sqrt(dt)
        by_wheels = 0.0 if still else hypot(counts, noise, share * path, GYRO_CLOCK * swing)
        sigma = hypot(by_wheels, SIGMA_GYRO * sqrt(dt * 0.01))
        if isfinite(sigma):
            self.fusion.take(Measurement(end, "", KIND_TURN, (0,), (angle, by_gyro, dt, path), (sigma,)))

    def _take_wheels(self, wheels: Wheels, dt: float) -> None:
        """Take in speed and yaw rate, which are means over the last dt seconds, so of its middle."""
        _, _, _, v, omega = wheels.odometry
        middle = wheels.time - 0.5 * dt
        before, self._setpoint = self._angle, wheels.setpoint
        self._steer(wheels.steering, dt)
        settings = self.settings.get(ENCODERS)
        if settings is None:
            return
        if self._counts:
            known = self._steering is not None
            v, omega = centred(
                v, omega, self._wheelbase, 0.5 * (before + self._angle) if known else None, self.fusion.turn_share
            )
            # a count more or less at both ends of the time: a difference of two uniform errors
            count, track_width = self._count_length / dt / ROOT_6, self._geometry.track_width
            own = hypot(count / ROOT_2, SPEED_MODEL), hypot(count * ROOT_2 / track_width, YAW_MODEL)
        else:
            # no encoders: speed and yaw rate are what was asked for
            own = BLIND_SPEED + BLIND_SHARE * abs(v), BLIND_YAW + BLIND_SHARE * abs(omega)
        rows: tuple[int, ...] = (0, 1)
        values: tuple[float, ...] = (v, omega)
        sigmas: tuple[float, ...] = own
        if settings.sigma:
            sigmas = settings.sigma.get("v", own[0]), settings.sigma.get("omega", own[1])
        if settings.fields is not None:
            rows = tuple(row for row, name in enumerate(("v", "omega")) if name in settings.fields)
            values, sigmas = tuple(values[row] for row in rows), tuple(sigmas[row] for row in rows)
        given = middle - settings.delay, ENCODERS, KIND_ENCODERS, rows, values, sigmas, (0.0, 0.0)
        self._give(new(Measurement, given))
        self._still = self._still + dt if v == 0.0 == omega and wheels.setpoint == 0.0 else 0.0
        if self._still >= REST_TIME:
            self.fusion.rest(middle)

    def _steer(self, steering: float | None, dt: float) -> None:
        """Turn the angle of the steering as servos do in dt seconds, and the curvature with it, (2.12)."""
        before, self._steering = self._steering, steering
        if before is None:
            return
        share, most = before / STEERING_MAX, SERVO_RATE * dt
        turned = self._steering_max * (share if -1.0 < share < 1.0 else copysign(1.0, share)) - self._angle
        self._angle += max(-most, min(turned, most))
        self._curvature = tan(self._angle) / self._lever


def usable(estimate: Estimate) -> bool:
    """Whether the velocity loops may go by this."""
    return estimate.sigma(3) <= V_USABLE and estimate.sigma(4) <= OMEGA_USABLE


async def estimation(
    ticks: Ticks,
    estimator: Estimator,
    wheels: Callable[[], Wheels],
    offer: Callable[[Estimate, float], None] | None,
    tell: Callable[[float, str], None],
) -> None:
    """Make an estimate every tick, and offer its velocities to the loops where they are good enough.

    An error, here or as a reading was taken, is told and ends the estimate, never the run. The loops hear nothing any
    more, so they go by the encoders again.
    """
    changes, off = estimator.fusion.changes, False
    async for now in ticks:
        if off:
            continue
        if not estimator.failure:
            try:
                estimator.step(now, wheels())
            except Exception as error:
                estimator.fail(error)
        if changes:
            for change in changes:
                tell(now, f"estimation: {change}")
            changes.clear()
        estimate = estimator.estimate
        if estimator.failure:
            off = True
            tell(now, f"the estimate is off: {estimator.failure}; the loops go by the encoders")
        elif offer is not None and estimate is not None and usable(estimate):
            offer(estimate, now)


TWINS: Final = {"imu": "sim_imu", "gps": "sim_gps", "vicon": "sim_vicon"}
"""Drivers of the sensors that a simulated robot gets by itself when they are to be fused."""


async def prepare(runtime: Runtime, config: EstimationConfig) -> Estimator | None:
    """Start the filter and connect its sensors; return it, or None if no sensor is fused.

    Raises ConfigError: a sensor is missing, or its quantity cannot be fused.
    """
    if not config.names:
        return None
    await _add_twins(runtime, config)
    kinds = {name: runtime.sensors[name].sensor.topic.type for name in config.names if name != ENCODERS}
    for name, kind in kinds.items():
        if kind not in USUAL:
            raise ConfigError(f"estimation: '{name}' tells {kind.__name__}, which cannot be fused")
    estimator = Estimator(config, kinds, runtime.config.geometry)
    for name in kinds:
        runtime.sensors[name].listeners.append(partial(estimator.take, name))

    def offer(estimate: Estimate, now: float) -> None:
        x, y, theta, v, omega = estimate[:5]
        runtime.put(CombinedOdometry(x, y, theta, v, omega), now)

    task = partial(
        estimation, estimator=estimator, wheels=partial(wheels, runtime),
        offer=offer if config.loops else None, tell=runtime.state.tell,
    )  # fmt: skip
    runtime.estimate = lambda: estimator.estimate
    runtime.bus.offer(FILTERED, runtime.estimate)
    runtime.bus.offer(TRUSTS, estimator.trusts)
    runtime.on_place.append(estimator.fusion.lifted)
    runtime.add_own_task("estimation", PRIORITY, ESTIMATION_PERIOD, task)
    return estimator


def wheels(runtime: Runtime) -> Wheels:
    """The robot's own part of a cycle of the filter."""
    state = runtime.state
    outputs, v = state.control.outputs, state.control.v
    steering = float(outputs.rear) if runtime.hal.capabilities.pwm else None
    return Wheels(state.odometry, state.odometry_time, steering, v)


async def _add_twins(runtime: Runtime, config: EstimationConfig) -> None:
    """Give a simulated robot the simulated sensors that are to be fused and were not configured."""
    absent = [name for name in config.names if name != ENCODERS and name not in runtime.sensors]
    for name in absent:
        if not runtime.hal.capabilities.pose or name not in TWINS:
            raise ConfigError(
                f"estimation: there is no sensor '{name}' to be fused; configure sensors.{name}.driver, or choose "
                "others in estimation.sensors"
            )
    for name in absent:
        await runtime.open_sensor(name, SensorConfig(driver=TWINS[name]))
