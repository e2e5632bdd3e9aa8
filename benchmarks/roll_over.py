"""How often a slalom on rough ground tips the car, with and without the roll-over guard, and the time that it costs.

    python -m benchmarks.roll_over --seeds 100
    python -m benchmarks.roll_over --seeds 100 --silent --kept out/roll-over-silent.jsonl     # the IMU says nothing

Every run: 10 s of full lock to either side, changed every second. The physics (`sim.dynamics`, `sim.ground`), the
loops (`control.pid`) and the guard (`guards.roll_guard.guard`) are the robot's own, stepped at 50 Hz without its tasks;
speed and yaw rate are the true ones, the roll is the IMU's (0.005 rad of noise). Tipped is a car whose inner wheels
lift once. Runs in which the ground alone is as steep somewhere are counted apart: there no guard helps.
"""

import argparse
from math import pi
from typing import Final, NamedTuple

import numpy as np

from benchmarks import seeds
from txt1.config import load
from txt1.control.limits import SetpointBounds
from txt1.control.pid import VelocityLoops
from txt1.guards.roll_guard.guard import Guard, lean, tipping
from txt1.guards.roll_guard.settings import RollGuard
from txt1.model.vehicle import Geometry
from txt1.sim.dynamics import Motion, VehicleState, dynamics, move
from txt1.sim.ground import Ground
from txt1.sim.parameters import Roughness, VehicleParameters

HEIGHTS: Final = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06)  # m, root mean square
SPEEDS: Final = (0.5, 0.75, 1.0, 1.25, 1.5)  # m/s
DURATION: Final = 10.0  # s
TURN: Final = 1.0  # s to either side
DT: Final = 0.02
NOISE: Final = 0.005  # rad


class Slalom(NamedTuple):
    """The result of a run."""

    tipped: bool
    alone: bool  # it came to where the ground alone does that: a car that stands there tips, too
    way: float  # m driven
    roll: float  # the largest of the ground, rad
    lean: float  # the largest, as a share of the way to lifting wheels


def drive(seed: int, height: float, speed: float, guarded: bool, silent: bool = False) -> Slalom:
    """Drive a slalom."""
    body, given = Geometry(), RollGuard()
    ground = Ground(Roughness(height=height), body, seed)
    rng = np.random.default_rng([seed, 1])
    p, loops = dynamics(VehicleParameters(), body), VelocityLoops(steers=True)
    edge = tipping(body.track_width, given.gravity_height)
    measured: tuple[float | None, float] = (None if silent else 0.0, 0.0)
    guard = Guard(given, body.track_width, body.radius_min, lambda _: measured)
    state: Motion = tuple(VehicleState())
    tipped, way, largest, most = False, 0.0, 0.0, 0.0
    theta = 0.0
    for step in range(round(DURATION / DT)):
        now = step * DT
        v, omega = SetpointBounds(LIMITS).nearest(speed, (1 if int(now / TURN) % 2 else -1) * 10.0)
        if guarded:
            v, omega = guard(v, omega, now)
        speed_now = state[3]
        yaw = (state[2] - theta + pi) % (2.0 * pi) - pi
        theta = state[2]
        motor, steering = loops.step(v, omega, speed_now, yaw / DT, LINEAR, ANGULAR.at(speed_now), DT)
        motor = min(max(motor, -8000.0), 8000.0)
        state = move(state, motor, -steering, steering, DT, float(0.03 * rng.standard_normal()), p)
        roll, _ = ground.attitude(state[:3])
        turning = ((state[2] - theta + pi) % (2.0 * pi) - pi) / DT
        leaning = abs(lean(roll, state[3], turning))
        way += state[3] * DT
        largest, most = max(largest, abs(roll)), max(most, float(np.tan(leaning) / np.tan(edge)))
        tipped = tipped or leaning >= edge
        measured = None if silent else roll + NOISE * float(rng.standard_normal()), state[3] * turning
    return Slalom(tipped, largest >= edge, way, largest, most)


_CONFIG = load(None, [], {}, {}).config
LIMITS: Final = _CONFIG.limits()
LINEAR: Final = _CONFIG.control.linear.gains()
ANGULAR: Final = _CONFIG.control.schedule()


def cell(case: str) -> list[Slalom]:
    """The runs of a seed at a height and a speed, without and with the guard."""
    seed, height, speed, *silent = case.split()
    return [drive(int(seed), float(height), float(speed), guarded, bool(silent)) for guarded in (False, True)]


def tips(runs: list[Slalom]) -> str:
    """How many runs tip in a curve, and how many where a car that stands would, too."""
    alone = sum(each.tipped and each.alone for each in runs)
    return f"{sum(each.tipped for each in runs) - alone}" + (f" + {alone}" if alone else "")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    seeds.arguments(parser, "out/roll-over.jsonl", 100)
    parser.add_argument("--silent", action="store_true", help="the IMU says nothing in all these runs")
    given = parser.parse_args()
    silent = " silent" if given.silent else ""
    print(f"runs of {given.seeds} that tip, without -> with the guard, + by the ground alone; (way lost with it)")
    print("| height rms, largest roll |" + "".join(f" {speed:g} m/s |" for speed in SPEEDS))
    print("|---|" + "---|" * len(SPEEDS))
    for height in HEIGHTS:
        cells, rolls = [], []
        for speed in SPEEDS:
            cases = [f"{seed} {height} {speed}{silent}" for seed in range(given.first, given.first + given.seeds)]
            runs = seeds.results(given.kept, cases, cell, given.minutes)
            without, guarded = ([Slalom(*run[k]) for run in runs.values()] for k in (0, 1))
            lost = 1.0 - sum(each.way for each in guarded) / sum(each.way for each in without)
            cells.append(f" {tips(without)} -> {tips(guarded)} ({lost:.1%}) |")
            rolls += [each.roll for each in without]
        print(f"| {height * 100:g} cm, {np.degrees(np.mean(rolls)):.0f} deg |" + "".join(cells), flush=True)


if __name__ == "__main__":
    main()
