"""Drives like a person's, in simulation: hard starts, full lock, both gears, stops, pushes, slippery floors.

A seed repeats a drive. Each manoeuvre takes 0.3 to 3 s: a speed and a curvature, commanded at once or as a slalom. A
car that steers uses its whole range of curvature; a car whose sides run at two speeds also turns in place. Speeds reach
`safety.v_max`, yaw rates `safety.omega_max`; the gate clips nothing.

The floor's slip changes with each manoeuvre, and a standing car is pushed now and then: it rolls on with the speed of
the push, and its wheels turn.
"""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from math import pi, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from txt1.config import Config
from txt1.robot import Robot
from txt1.sim.dynamics import dynamics
from txt1.sim.vehicle import Vehicle

# s between two commands
CYCLE: Final = 0.05
# s, shortest and longest manoeuvre
SHORTEST: Final = 0.3
LONGEST: Final = 3.0  # s
# s, the period of a slalom
SLALOM: Final = 0.8
# share of the manoeuvres with a stop
STOPS: Final = 0.15
# share of the manoeuvres at full lock
LOCKED: Final = 0.35
# share of the manoeuvres as a slalom
SLALOMS: Final = 0.1
# share of the manoeuvres in which a skid car turns in place
PIVOTS: Final = 0.15
# share of the manoeuvres backwards
REVERSES: Final = 0.3
# share of the stops with a push
PUSHES: Final = 0.3
# m/s that a push adds
PUSH_MAX: Final = 0.6
# share of the wheels' distance
SLIP_MAX: Final = 0.2


class Manoeuvre(NamedTuple):
    """A piece of a drive."""

    seconds: float
    v: float  # m/s
    omega: float  # rad/s
    # whether the yaw rate swings between both signs
    slalom: bool
    # slip on the floor
    slip: float
    # m/s that a push gives the car at half time; 0: no push
    push: float


def manoeuvres(rng: Generator, config: Config, seconds: float, slip_max: float = SLIP_MAX) -> Iterator[Manoeuvre]:
    """Yield the manoeuvres of a drive of `seconds` s, within the car's limits."""
    skids = config.geometry.steering == "skid"
    v_max, omega_max, least = config.safety.v_max, config.safety.omega_max, config.safety.v_dead_band
    sharpest = 1.0 / config.geometry.radius_min
    left = seconds
    while left > 0.0:
        length = min(float(rng.uniform(SHORTEST, LONGEST)), left)
        slip = float(rng.uniform(0.0, slip_max)) if rng.random() < 0.5 else 0.0
        kind = float(rng.random())
        if kind < STOPS:
            push = float(rng.uniform(-PUSH_MAX, PUSH_MAX)) if rng.random() < PUSHES else 0.0
            length = max(length, 1.5) if push else length
            left -= length
            yield Manoeuvre(length, 0.0, 0.0, slalom=False, slip=slip, push=push)
            continue
        left -= length
        if skids and kind < STOPS + PIVOTS:
            yield Manoeuvre(length, 0.0, float(rng.uniform(-omega_max, omega_max)), slalom=False, slip=slip, push=0.0)
            continue
        v = float(rng.uniform(least, v_max))
        if rng.random() < REVERSES:
            v = -v
        share = 1.0 if rng.random() < LOCKED else float(rng.random())
        omega = abs(v) * sharpest * share * (1.0 if rng.random() < 0.5 else -1.0)
        omega = min(max(omega, -omega_max), omega_max)
        yield Manoeuvre(length, v, omega, slalom=bool(rng.random() < SLALOMS), slip=slip, push=0.0)


async def drive_as_a_person(robot: Robot, seed: int, seconds: float, slip_max: float = SLIP_MAX) -> None:
    """Drive a simulated robot for `seconds` s; raises NotArmed if its gate is closed meanwhile."""
    rng = np.random.default_rng([seed, 35])
    vehicle: Vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
    usual = vehicle.parameters.slip
    robot.program.begin()
    try:
        for each in manoeuvres(rng, robot.config, seconds, slip_max):
            slips(vehicle, usual + each.slip)
            cycles = max(1, round(each.seconds / CYCLE))
            for cycle in range(cycles):
                swing = sin(2.0 * pi * cycle * CYCLE / SLALOM) if each.slalom else 1.0
                robot.program.insist(each.v, each.omega * swing)
                if each.push and cycle == cycles // 2:
                    push(vehicle, robot.now, each.push)
                await asyncio.sleep(CYCLE)
    finally:
        slips(vehicle, usual)


def push(vehicle: Vehicle, now: float, speed: float) -> None:
    """Push a coasting vehicle to this speed, m/s."""
    vehicle.advance_to(now)
    state = vehicle.state._replace(v=speed)
    if vehicle.skids:
        # its state has the sides' speeds in the fields of the steering angles
        state = state._replace(phi_front=speed, phi_rear=speed)
    vehicle.state = state


def slips(vehicle: Vehicle, slip: float) -> None:
    """Put a vehicle on a floor on which its driven wheels slip by this share of their distance."""
    vehicle.parameters = replace(vehicle.parameters, slip=slip)
    vehicle.dynamics = dynamics(vehicle.parameters, vehicle.body)
