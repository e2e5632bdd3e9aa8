"""Wheels of a sound car that spin or lock, or are in the air, are not taken for dead encoders."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import product
from math import exp
from typing import Any

import numpy as np
import pytest

from tests.e2e.conftest import ENDLESS
from torture.struck_robot import hardware
from txt1 import run
from txt1.config import Config, load
from txt1.errors import NotArmed, StopNotVerified
from txt1.hal.base import Hal
from txt1.robot import Robot
from txt1.sim.dynamics import Motion, dynamics, move
from txt1.sim.vehicle import Vehicle

KINDS = {
    "sim": ("hal=sim",),
    "ours": ("hal=serial", "serial.port=virtual"),
    "original": ("hal=serial", "serial.port=virtual", "board.habits=original"),
    "vesc": ("hal=vesc", "vehicle=f1tenth"),
    "waveshare": ("hal=waveshare", "vehicle=rover"),
}
FLOORS = ("ice", "patches of ice", "a lifted wheel")
STEPS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""m/s: the set-points of fig. 4.3, forwards and backwards."""
FREE = (0.03, 0.15)
"""s: shortest and longest time constant of wheels that carry nothing."""
PIECE = 0.02
"""s for which a floor, or a wheel in the air, stays as it is."""


def changing(vehicle: Vehicle, at: Callable[[int, Motion, Motion, float, float], Motion], grips: np.ndarray) -> None:
    """Give the car a floor whose grip is drawn anew every half second, and whatever `at` makes of its wheels."""
    body, parameters = vehicle.body, vehicle.parameters
    floors = [dynamics(replace(parameters, grip=float(grip)), body) for grip in grips]

    def moved(before: Motion, motor: float, front: float, rear: float, dt: float, drag: float) -> Motion:
        k = int(vehicle.time / PIECE)
        after = move(before, motor, front, rear, dt, drag, floors[k // 25 % len(floors)])
        return at(k, before, after, free_speed(vehicle, motor), dt)

    vehicle.physics = moved


def free_speed(vehicle: Vehicle, motor: float) -> float:
    """The speed of wheels that carry nothing, m/s."""
    p = vehicle.parameters
    return (
        0.0 if abs(motor) <= p.dead_band else p.speed_gain * (motor - p.dead_band if motor > 0 else motor + p.dead_band)
    )


class InTheAir:
    """Lifts wheels for pieces of time: they turn as the motor likes, without load, and touch down again."""

    def __init__(self, rng: np.random.Generator, right: bool, left: bool) -> None:
        self._sides, self._free = (right, left), float(rng.uniform(*FREE))
        self._up = rng.random(4000) < 0.04
        self._lasts = rng.integers(2, 30, 4000)
        self._until = -1
        self._speeds = [0.0, 0.0]

    def __call__(self, k: int, before: Motion, after: Motion, free: float, dt: float) -> Motion:
        """The motion with the lifted wheels' paths."""
        if k > self._until and self._up[k % 4000]:
            self._until = k + int(self._lasts[k % 4000])
        rolled = [after[6], after[7]]
        for side, lifted in enumerate(self._sides):
            ground = (after[6 + side] - before[6 + side]) / dt
            if lifted and k <= self._until:
                self._speeds[side] = free + (self._speeds[side] - free) * exp(-dt / self._free)
                rolled[side] = before[6 + side] + self._speeds[side] * dt
            else:
                self._speeds[side] = ground
        # a car that stands is not asked how its wheels turn
        return (*after[:3], after[3] or 1e-9, *after[4:6], rolled[0], rolled[1])


def on_the_floor(k: int, before: Motion, after: Motion, free: float, dt: float) -> Motion:
    """Leave the wheels as the floor makes them."""
    return after


def vehicle_of(robot: Robot) -> Vehicle:
    """The simulated vehicle, of the simulation or of a board."""
    hal: Any = robot.hal
    vehicle: Vehicle = hal.vehicle if robot.config.hal == "sim" else hal.port.board.vehicle
    return vehicle


async def again(robot: Robot) -> None:
    """Wait until a robot that was disarmed for another reason may be armed."""
    for _ in range(400):
        await asyncio.sleep(0.05)
        with suppress(NotArmed):
            robot.arm()
            return


async def driven(hal: Hal, config: Config, what: str, seed: int) -> str:
    """Drive steps up and down, and return why the robot was disarmed; "" if it was not."""
    rng = np.random.default_rng(seed)
    reason = ""
    with suppress(StopNotVerified):
        async with Robot.open(hal, config=config, arm=True) as robot:
            await robot.load_gains()
            match what:
                case "ice":
                    changing(vehicle_of(robot), on_the_floor, rng.uniform(0.03, 0.3, 40))
                case "patches of ice":
                    changing(vehicle_of(robot), on_the_floor, rng.choice((0.05, 0.1, 1.05), 40))
                case "a lifted wheel":
                    changing(vehicle_of(robot), InTheAir(rng, *rng.permutation((True, False))), np.array((1.0489,)))
            for v in rng.permutation((*STEPS, *(-each for each in STEPS)))[:8]:
                try:
                    await robot.drive(float(v), 0.0, float(rng.uniform(0.4, 1.5)))
                except NotArmed:
                    reason = robot.reason
                    if "not seen" in reason:
                        break
                    await again(robot)
    return reason


def reason_of(kind: str, what: str, seed: int) -> str:
    """Drive one car, and return why it was disarmed last; "" if it was not."""
    config = load(None, [*ENDLESS, *KINDS[kind], f"seed={seed}", "safety.runaway_speed=20"]).config
    hal, _ = hardware(kind, config, lambda end: end)
    return run(driven(hal, config, what, seed), speed="max")


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "what"),
    [*((kind, "steps") for kind in KINDS), *product(("sim", "ours", "original"), FLOORS)],
)
def test_no_sound_car_is_lost_sight_of_in_a_thousand_drives(kind: str, what: str) -> None:
    reasons = [reason_of(kind, what, seed) for seed in range(72)]
    assert not [(seed, reason) for seed, reason in enumerate(reasons) if "not seen" in reason]
