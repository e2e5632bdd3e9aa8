"""How often a sound car is taken for one that is not seen: ``python -m benchmarks.sound_wheels``, in virtual time.

Simulated cars drive the steps of fig. 4.3, on a good floor, on ice, on patches of ice, and with a wheel that is lifted
now and then. Their wheels spin, lock and turn in the air, and none of them has lost its encoders.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from math import exp
from pathlib import Path
from typing import Any, Final

import numpy as np

from rigs import page_parts
from torture.struck_robot import hardware
from txt1 import run
from txt1.config import Config, load
from txt1.control.limits import LOST
from txt1.errors import NotArmed, Overruled, StopNotVerified
from txt1.hal.base import Hal
from txt1.robot import Robot
from txt1.sim.dynamics import Motion, dynamics, move
from txt1.sim.vehicle import Vehicle

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
DISOBEYED: Final = "a board that does not obey"
KINDS = {
    "sim": ("hal=sim",),
    "ours": ("hal=serial", "serial.port=virtual"),
    "original": ("hal=serial", "serial.port=virtual", "board.habits=original"),
    "vesc": ("hal=vesc", "vehicle=f1tenth", "safety.v_dead_band=0.25"),
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
        return (*after[:3], after[3] or 1e-9, *after[4:6], rolled[0], rolled[1], after[8])


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


async def driven(hal: Hal, config: Config, what: str, seed: int) -> set[str]:
    """Drive steps up and down, and return for what the car was taken: `LOST`, `DISOBEYED`, another reason."""
    rng = np.random.default_rng(seed)
    taken: set[str] = set()
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
                except Overruled:
                    taken.add(DISOBEYED)
                except NotArmed:
                    taken.add(robot.reason)
                    if LOST in taken:
                        break
                    await again(robot)
    return taken


def taken_for(kind: str, what: str, seed: int) -> set[str]:
    """Drive one car, and return for what it was taken."""
    config = load(None, [*ENDLESS, *KINDS[kind], f"seed={seed}", "safety.runaway_speed=20"]).config
    hal, _ = hardware(kind, config, lambda end: end)
    return run(driven(hal, config, what, seed), speed="max")


CASES: Final = (*((kind, "steps") for kind in KINDS), *product(("sim", "ours", "original"), FLOORS))


def main() -> None:
    """Drive, print, and write the page."""
    parser = argparse.ArgumentParser(prog="benchmarks.sound_wheels", description=__doc__)
    parser.add_argument("--drives", type=int, default=72, help="of each car on each floor")
    parser.add_argument("--page", action="store_true", help="write the table to docs/stops.md")
    arguments = parser.parse_args()
    cells = {}
    for case in CASES:
        taken = [taken_for(*case, seed) for seed in range(arguments.drives)]
        cells[case] = f"{sum(LOST in each for each in taken)}, {sum(DISOBEYED in each for each in taken)}"
    floors = ("steps", *FLOORS)
    lines: list[Sequence[str]] = [("hardware", *floors), ["---"] * (1 + len(floors))]
    lines += [(kind, *(cells.get((kind, floor), "") for floor in floors)) for kind in KINDS]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    text = (
        f"{table}\n\nHow many were taken for not seen, and for a board that does not obey; {arguments.drives} drives "
        f"each, {arguments.drives * len(CASES)} in all."
    )
    print(text)
    if arguments.page:
        page_parts.write(Path("docs/stops.md"), "sound wheels", text, "benchmarks.sound_wheels")


if __name__ == "__main__":
    main()
