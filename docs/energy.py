"""Makes docs/drive-tests/energy.png and the table of docs/energy.md: `python -m docs.energy`, a minute.

The rectangle of the battery run, from a pack that has ten minutes under full load left until none is.
"""

from __future__ import annotations

from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from txt1.config import Config, load
from txt1.experiments.figures import COLOURS, LOOKS
from txt1.experiments.profile import load_profile
from txt1.kernel.loop import run as run_loop
from txt1.kernel.ticks import Ticks
from txt1.model.battery import SAFE_END_MIN
from txt1.navigation import follow, true_pose
from txt1.navigation.pace import pace
from txt1.robot import Robot
from txt1.sim.battery import economical_speed, energy_per_metre, range_left
from txt1.sim.parameters import Batteries

PICTURE: Final = Path(__file__).parent / "drive-tests" / "energy.png"
LEFT: Final = 10.0  # minutes under full load that the pack has left
SPEEDS: Final[tuple[float | str, ...]] = (0.3, 0.5, "energy", "time")
BY_SPEED: Final = "sim.battery.by_speed=true"


class Drive(NamedTuple):
    """A drive until the pack was empty."""

    said: float | str  # the speed that was asked for
    speed: float  # m/s that it means
    minutes: float
    metres: float
    promised: float  # metres that it said were left when it began
    places: np.ndarray  # x and y once a second, m


def drive(said: float | str, *settings: str) -> Drive:
    """Drive the rectangle until no time is left."""
    config = load(None, ["seed=1", f"sim.battery.used_1={SAFE_END_MIN - LEFT}", *settings]).config
    return run_loop(_drive(said, config), speed="max")


async def _drive(said: float | str, config: Config) -> Drive:
    places: list[tuple[float, float]] = []
    promised = 0.0
    waypoints = load_profile("battery-run").waypoints
    assert waypoints is not None
    async with Robot.open("sim", config=config) as robot:
        await robot.load_gains()
        source = true_pose(robot)

        async def watch(ticks: Ticks) -> None:
            nonlocal promised
            async for _ in ticks:
                remaining = robot.battery.remaining
                if remaining is None:
                    continue
                promised = promised or range_left(config.sim.battery, remaining, config.safety.v_max)
                places.append(source.pose()[:2])
                if remaining <= 0.0:
                    robot.stop()

        robot.add_task("watch", 0.2, watch)
        began = robot.now
        try:
            await follow(robot, waypoints.points, laps=float("inf"), speed=said, pose_source=source)
        except Exception as error:
            print(f"{said}: {error}")
        minutes = (robot.now - began) / 60.0
    metres = sum(dist(one, two) for one, two in pairwise(places))
    return Drive(said, pace(said, config), minutes, metres, promised, np.array(places[::5]))


def _outside(each: Drive) -> float:
    """How far outside the rectangle it was at most, m."""
    return float((np.abs(each.places[5:]) - (1.5, 2.0)).max())


def main() -> None:
    """Drive, draw and print."""
    one = Batteries()
    drives = [drive(said, BY_SPEED) for said in SPEEDS]
    thesis = drive(0.5)
    head = ("model", "asked for", "m/s", "min", "m", "said at the start, m", "outside the rectangle at most, m")
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    for model, each in [("full load", thesis), *(("by speed", each) for each in drives)]:
        print(f"| {model} | {each.said} | {each.speed:.2f} | {each.minutes:.1f} | {each.metres:.0f} "
              f"| {each.promised:.0f} | {_outside(each):.2f} |")  # fmt: skip
    figure = Figure(figsize=(9.6, 4.0), dpi=120)
    left, right = figure.subplots(1, 2)
    v = np.linspace(0.15, 1.3, 120)
    for look, (label, model, bend) in zip(
        LOOKS,
        (
            ("straight, the thesis's floor", one, 0.0),
            ("at full lock", one, 1.0),
            ("straight, carpet (1.5)", Batteries(floor=1.5), 0.0),
        ),
        strict=False,
    ):
        costs = [energy_per_metre(model, float(each), bend) for each in v]
        best = economical_speed(model, 1.5, bend)
        left.plot(v, costs, label=label, **look)
        left.plot([best], [energy_per_metre(model, best, bend)], "o", color=look["color"])
    left.set(xlabel="speed, m/s", ylabel="energy, J/m", ylim=(0.0, None), title="Consumption; o: economical speed")
    left.legend()
    names = [f"{each.said} m/s" if isinstance(each.said, float) else f"“{each.said}”" for each in drives]
    bars = right.bar(["full load\n0.5 m/s", *names], [thesis.metres, *(each.metres for each in drives)],
                     color=["0.6", *[COLOURS[0]] * len(drives)])  # fmt: skip
    right.bar_label(bars, [f"{each.metres:.0f} m\n{each.minutes:.1f} min" for each in (thesis, *drives)])
    right.set(ylabel="driven, m", title=f"The rectangle, {LEFT:.0f} min of full load left")
    right.margins(y=0.18)
    figure.tight_layout()
    figure.savefig(PICTURE)


if __name__ == "__main__":
    main()
