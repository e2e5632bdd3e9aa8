"""Makes the pictures and the tables of docs/results/energy.md: `python -m docs.energy`, three minutes.

The rectangle of the battery run, from a pack that has ten minutes under full load left until none is; and the battery
run itself, from a full pack to the safe end, without the model of the consumption and with it.
"""

from __future__ import annotations

from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from txt1.config import Config, load
from txt1.experiments.command.experiment import ENDLESS
from txt1.experiments.command.experiment import drive as experiment
from txt1.experiments.figures import COLOURS, LOOKS
from txt1.experiments.profile import load_profile
from txt1.kernel.loop import run as run_loop
from txt1.kernel.ticks import Ticks
from txt1.model.battery import INTERCEPT_V, SAFE_END_MIN, SLOPE_V_PER_MIN
from txt1.navigation import follow, true_pose
from txt1.navigation.pace import pace
from txt1.robot import Robot
from txt1.sim.battery import economical_speed, energy_per_metre, range_left
from txt1.sim.parameters import Batteries

FIGURES: Final = Path(__file__).parent / "results" / "drive-tests"
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


class Discharge(NamedTuple):
    """A battery run, from a full pack to the safe end."""

    model: str
    speed: float  # m/s that were asked for
    minutes: np.ndarray  # of each sample
    metres: np.ndarray  # driven until then
    volts: np.ndarray


def discharge(model: str, said: float | str, *settings: str) -> Discharge:
    """Drive the battery run at a speed."""
    config = load(None, [*ENDLESS, "seed=1", *settings], {}).config
    profile = load_profile("battery-run")
    assert profile.waypoints is not None
    waypoints = profile.waypoints.model_copy(update={"speed": pace(said, config)})
    outcome, _ = experiment(config, profile.model_copy(update={"waypoints": waypoints}), "max")
    assert outcome is not None
    samples = outcome.recording
    steps = np.hypot(np.diff(samples["true_x"]), np.diff(samples["true_y"]))
    metres = np.concatenate([[0.0], np.cumsum(steps)])
    return Discharge(model, waypoints.speed, samples["time"] / 60.0, metres, samples["voltage"])


def battery_run() -> None:
    """The figure of the battery run (3.13) without the model of the consumption and with it, and its table."""
    runs = [discharge("full load", 0.5), *(discharge("by speed", said, BY_SPEED) for said in (0.5, "energy"))]
    print("| model | m/s | until the safe end, min | m | V/min | V/km |\n" + "|---" * 6 + "|")
    figure = Figure(figsize=(9.6, 4.2), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for each, look in zip(runs, LOOKS, strict=False):
        fell = np.nanmean(each.volts[:50]) - np.nanmean(each.volts[-50:])
        print(
            f"| {each.model} | {each.speed:.2f} | {each.minutes[-1]:.1f} | {each.metres[-1]:.0f} "
            f"| {fell / each.minutes[-1]:.4f} | {1000.0 * fell / each.metres[-1]:.3f} |"
        )
        label = f"{each.model}, {each.speed:.2f} m/s: {each.minutes[-1]:.1f} min, {each.metres[-1]:.0f} m"
        for axes, along in ((left, each.minutes), (right, each.metres)):
            axes.plot(along, each.volts, **look, label=label)
    at = np.array([0.0, SAFE_END_MIN])
    left.plot(at, INTERCEPT_V - SLOPE_V_PER_MIN * at, "k:", lw=1.0, label="the thesis's line (3.13)")
    left.set(xlabel="time, min", ylabel="battery voltage, V", title="The battery run to the safe end, one run each")
    right.set(xlabel="driven, m", title="The same by the way")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    left.margins(y=0.1)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    figure.savefig(FIGURES / "battery-run-energy.png")


def rectangle() -> None:
    """Consumption by speed, and how far the rectangle is driven at each; the table of that."""
    one = Batteries()
    drives = [drive(said, BY_SPEED) for said in SPEEDS]
    thesis = drive(0.5)
    head = (
        "model",
        "speed asked for",
        "m/s",
        "min",
        "m",
        "range shown at the start, m",
        "largest distance from the rectangle, m",
    )
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    for model, each in [("full load", thesis), *(("by speed", each) for each in drives)]:
        print(
            f"| {model} | {each.said} | {each.speed:.2f} | {each.minutes:.1f} | {each.metres:.0f} "
            f"| {each.promised:.0f} | {_outside(each):.2f} |"
        )
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
    bars = right.bar(
        ["full load\n0.5 m/s", *names],
        [thesis.metres, *(each.metres for each in drives)],
        color=["0.6", *[COLOURS[0]] * len(drives)],
    )
    right.bar_label(bars, [f"{each.metres:.0f} m\n{each.minutes:.1f} min" for each in (thesis, *drives)])
    right.set(ylabel="driven, m", title=f"The rectangle, {LEFT:.0f} min of full load left")
    right.margins(y=0.18)
    figure.tight_layout()
    figure.savefig(FIGURES / "energy.png")


def main() -> None:
    """Drive, draw and print."""
    battery_run()
    rectangle()


if __name__ == "__main__":
    main()
