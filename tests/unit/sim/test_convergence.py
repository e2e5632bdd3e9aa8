"""The vehicle's 20 ms steps against a fine integrator of the same equations, written here from the physics."""

from __future__ import annotations

import random
from functools import cache
from itertools import pairwise
from math import asin, atan, cos, hypot, pi, sin, tan, tanh
from typing import NamedTuple

import pytest
from sim_steps import Parameters, advance

from txt1.model.kinematics import wrap_angle
from txt1.sim.dynamics import VehicleState
from txt1.units import GRAVITY

FINE = 0.001
"""Step of the reference, s: fourth order, and never across an instant at which a servo arrives, so exact to 1e-10."""

PLAIN = Parameters(grip=2.0)
SLIPPING = Parameters(grip=2.0, slip=0.1, understeer=0.2)
ICY = Parameters(grip=0.25)
HARD = Parameters(grip=1e9, cornering=1e9)
"""Tyres that hold whatever is asked of them, and never slide: what the closed forms are exact for."""


class Segment(NamedTuple):
    """Inputs held for so many control ticks."""

    ticks: int
    motor: float
    front: float
    rear: float
    drag: float


def drive(seed: int, seconds: float) -> list[Segment]:
    """Random inputs: driving and reversing, coasting, opposite, equal and unequal steering."""
    rng = random.Random(seed)
    segments: list[Segment] = []
    left = round(seconds * 50)
    while left > 0:
        ticks = min(left, rng.randint(1, 30))
        motor = rng.choice((0.0, 0.0, rng.uniform(1000, 6000), rng.uniform(1000, 6000), rng.uniform(-6000, -1000)))
        u = rng.choice((0.0, 18000.0, -18000.0, rng.uniform(-20000, 20000)))
        rear = rng.choice((u, u, -u, rng.uniform(-20000, 20000)))
        segments.append(Segment(ticks, motor, -u, rear, rng.gauss(0.0, 0.03)))
        left -= ticks
    return segments


def simulated(segments: list[Segment], p: Parameters) -> list[VehicleState]:
    """The vehicle's state after every segment, advanced in control ticks of 20 ms."""
    state, states = VehicleState(), []
    for segment in segments:
        for _ in range(segment.ticks):
            state = advance(state, segment.motor, segment.front, segment.rear, 0.02, segment.drag, p)
        states.append(state)
    return states


def reference(segments: list[Segment], p: Parameters, fine: float = FINE, *, euler: bool = False) -> list[list[float]]:
    """The same by Runge and Kutta, or by Euler: x, y, theta (not wrapped), v, front, rear, right, left."""
    s = [0.0] * 6  # x, y, theta, v, right, left
    phi = [0.0, 0.0]
    states = []
    for segment in segments:
        targets = [-p.steering_max * max(-1.0, min(1.0, u / 18000)) for u in (segment.front, segment.rear)]
        total = segment.ticks * 0.02
        start = list(phi)
        arrivals = [abs(target - at) / p.servo_rate for target, at in zip(targets, start, strict=True)]
        corners = sorted({0.0, total, *(t for t in arrivals if 0.0 < t < total)})

        def steering(t: float, start=start, targets=targets, arrivals=arrivals) -> list[float]:  # type: ignore[no-untyped-def]
            return [
                target if t >= arrival else at + (target - at) * t / arrival
                for at, target, arrival in zip(start, targets, arrivals, strict=True)
            ]

        def rates(t: float, s: list[float], way: float, segment=segment, steering=steering) -> list[float]:  # type: ignore[no-untyped-def]
            _, _, theta, v, _, _ = s
            front, rear = steering(t)
            # Velocities of the two axles across the vehicle follow their wheels; the centre's is the mean of them.
            across = 0.5 * (tan(front) + tan(rear))
            beta = atan(across)
            bend = cos(beta) * (tan(front) - tan(rear)) / p.wheelbase / (1.0 + p.understeer * v * v)
            lock = 0.5 * (tan(front) - tan(rear)) / tan(p.steering_max)
            resistance = (1.0 + p.scrub * lock**2 + segment.drag) * v
            if abs(segment.motor) > p.dead_band:
                free = p.speed_gain * (abs(segment.motor) - p.dead_band) * (1 if segment.motor > 0 else -1)
                tau, driven = p.speed_time_constant, 1.0 + p.slip
            else:
                free, tau, driven = -p.coast_friction * way, p.coast_time_constant, 1.0
            dv = (free - resistance) / tau
            # Tyres push sideways by their slip angle, which the middle of the vehicle has, too.
            beta += asin(-v * abs(v) * bend / (GRAVITY * p.cornering))
            vx, vy, omega = v * cos(beta), v * sin(beta), v * bend
            ahead, aside = cos(front), sin(front)
            wheel = [
                driven * ((vx - omega * y) * ahead + (vy + omega * 0.5 * p.wheelbase) * aside)
                for y in (-0.5 * p.track_width, 0.5 * p.track_width)
            ]
            return [vx * cos(theta) - vy * sin(theta), vx * sin(theta) + vy * cos(theta), omega, dv, *wheel]

        for begin, end in pairwise(corners):
            steps = max(1, round((end - begin) / fine))
            h = (end - begin) / steps
            for k in range(steps):
                t = begin + k * h
                way = (s[3] > 0.0) - (s[3] < 0.0)  # dry friction is against it, throughout the step
                k1 = rates(t, s, way)
                if euler:
                    after = [a + h * b for a, b in zip(s, k1, strict=True)]
                else:
                    k2 = rates(t + h / 2, [a + h / 2 * b for a, b in zip(s, k1, strict=True)], way)
                    k3 = rates(t + h / 2, [a + h / 2 * b for a, b in zip(s, k2, strict=True)], way)
                    k4 = rates(t + h, [a + h * b for a, b in zip(s, k3, strict=True)], way)
                    slopes = zip(s, k1, k2, k3, k4, strict=True)
                    after = [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in slopes]
                if abs(segment.motor) <= p.dead_band and after[3] * way <= 0.0:
                    after = [*s[:3], 0.0, *s[4:]]  # stopped within the step, at most 2e-7 m from here
                s = after
        phi = steering(total)
        states.append([s[0], s[1], s[2], s[3], *phi, s[4], s[5]])
    return states


class Errors(NamedTuple):
    """Greatest differences over a run: m, rad, m/s, rad, m."""

    position: float
    heading: float
    speed: float
    steering: float
    wheels: float


def errors(states: list[VehicleState], exact: list[list[float]]) -> Errors:
    worst = [0.0] * 5
    for state, (x, y, theta, v, front, rear, right, left) in zip(states, exact, strict=True):
        difference = (
            hypot(state.x - x, state.y - y),
            abs(wrap_angle(state.theta - theta)),
            abs(state.v - v),
            max(abs(state.phi_front - front), abs(state.phi_rear - rear)),
            max(abs(state.right - right), abs(state.left - left)),
        )
        worst = [max(a, b) for a, b in zip(worst, difference, strict=True)]
    return Errors(*worst)


SEEDS = (1, 2, 3)
LIMITS = Errors(position=1e-4, heading=2e-4, speed=3e-5, steering=1e-11, wheels=3e-5)
"""Twice what was measured over 4 s of random driving with the default ramp_step (5 ms)."""


@cache
def exact(seed: int, p: Parameters) -> list[list[float]]:
    return reference(drive(seed, 4.0), p)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("p", [PLAIN, SLIPPING], ids=["plain", "slipping"])
def test_20_ms_steps_agree_with_a_fine_integrator(p: Parameters, seed: int) -> None:
    found = errors(simulated(drive(seed, 4.0), p), exact(seed, p))
    for name, limit in LIMITS._asdict().items():
        assert getattr(found, name) < limit, (name, found)


def test_the_reference_itself_has_converged() -> None:
    coarse, fine = exact(1, HARD), reference(drive(1, 4.0), HARD, FINE / 2)
    assert max(abs(a - b) for one, two in zip(coarse, fine, strict=True) for a, b in zip(one, two, strict=True)) < 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_20_ms_steps_are_more_accurate_than_euler_s_at_1_khz(seed: int) -> None:
    segments = drive(seed, 4.0)
    ours = errors(simulated(segments, PLAIN), exact(seed, PLAIN))
    euler = errors([VehicleState(*row) for row in reference(segments, PLAIN, 0.001, euler=True)], exact(seed, PLAIN))
    assert ours.position < euler.position
    assert ours.heading < euler.heading
    assert ours.speed < euler.speed
    assert ours.wheels < euler.wheels


@pytest.mark.parametrize("seed", SEEDS)
def test_halving_the_ramp_step_quarters_the_error(seed: int) -> None:
    def error(ramp_step: float) -> Errors:
        return errors(simulated(drive(seed, 4.0), HARD._replace(ramp_step=ramp_step)), exact(seed, HARD))

    for coarse in (0.005, 0.0025):
        for name in ("position", "heading", "wheels"):
            ratio = getattr(error(coarse), name) / getattr(error(coarse / 2), name)
            assert 3.4 < ratio < 4.6, (name, coarse, ratio)


@pytest.mark.parametrize(("motor", "v"), [(6000.0, 0.0), (-6000.0, 1.0)])
def test_wheels_that_slip_agree_with_a_fine_integrator_of_both_speeds(motor: float, v: float) -> None:
    state, p = VehicleState(v=v), ICY._replace(scrub=0.0)
    fine, wheel, way, rolled, hold = 1e-5, v, 0.0, 0.0, GRAVITY * ICY.grip
    free = p.speed_gain * (motor - p.dead_band if motor > 0.0 else motor + p.dead_band)
    for _ in range(15):
        state = advance(state, motor, 0.0, 0.0, 0.02, 0.0, p)
        for _ in range(2000):
            slip = (wheel - v) / max(abs(v), abs(wheel), 0.05)
            along = hold * tanh(p.stiffness * slip / p.grip)
            # the motor's acceleration is of the whole car, the tyres' of what does not turn
            turns = ((free - wheel) / p.speed_time_constant - (1.0 - p.inertia) * along) / p.inertia
            v, wheel = v + fine * along, wheel + fine * turns
            way, rolled = way + fine * v, rolled + fine * wheel
        assert state.v == pytest.approx(v, abs=0.005)
        assert state.v + state.spin == pytest.approx(wheel, abs=0.03)
        assert (state.x, state.right) == pytest.approx((way, rolled), abs=0.003)


@pytest.mark.parametrize("motor", [0.0, 4000.0, -4000.0])
@pytest.mark.parametrize(("front", "rear"), [(0.0, 0.0), (-18000.0, 18000.0), (-9000.0, -3000.0)])
def test_with_the_steering_at_rest_a_step_is_exact_however_it_is_split(motor: float, front: float, rear: float) -> None:
    p = HARD._replace(coast_friction=0.4)  # stops within some of the steps
    state = VehicleState(1.0, 2.0, 3.0, 0.3, -p.steering_max * front / 18000, -p.steering_max * rear / 18000, 4.0, 5.0)
    for dt in (0.02, 0.3, 2.0):
        whole = advance(state, motor, front, rear, dt, 0.02, p)
        for share in (0.5, 0.1, 0.77):
            parts = advance(state, motor, front, rear, share * dt, 0.02, p)
            parts = advance(parts, motor, front, rear, (1 - share) * dt, 0.02, p)
            assert parts == pytest.approx(whole, abs=1e-9)
            assert -pi < whole.theta <= pi


def test_splitting_a_step_of_a_turning_servo_costs_only_the_integration_error() -> None:
    state = VehicleState(v=1.0)
    whole = advance(state, 4000.0, -18000.0, 18000.0, 0.02, 0.0, PLAIN)
    parts = advance(state, 4000.0, -18000.0, 18000.0, 0.013, 0.0, PLAIN)
    parts = advance(parts, 4000.0, -18000.0, 18000.0, 0.007, 0.0, PLAIN)
    assert parts == pytest.approx(whole, abs=2e-5)
    assert parts != whole


if __name__ == "__main__":
    for parameters in (PLAIN, SLIPPING):
        for seed in SEEDS:
            segments = drive(seed, 4.0)
            euler = [VehicleState(*row) for row in reference(segments, parameters, 0.001, euler=True)]
            print(seed, "euler 1 kHz", *(f"{e:.1e}" for e in errors(euler, exact(seed, parameters))))
            for step in (0.010, 0.005, 0.0025, 0.001):
                q = parameters._replace(ramp_step=step)
                print(seed, step, *(f"{e:.1e}" for e in errors(simulated(segments, q), exact(seed, parameters))))
