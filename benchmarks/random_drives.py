"""The filter over drives as a person makes them in the simulator, for every set-up and vehicle."""

from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from math import cos, pi, sin
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import mistakes
from benchmarks.drives import BAND, KINDS
from benchmarks.mistakes import Mistakes
from rigs.human_drive import SLIP_MAX, drive_as_a_person
from txt1.config import load
from txt1.config.sources import vehicle_file
from txt1.estimation.settings import PRESETS, EstimationConfig
from txt1.estimation.task import ESTIMATION_PERIOD, PRIORITY, Estimator
from txt1.estimation.task import wheels as wheels_of
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.robot import Robot

Array = NDArray[np.float64]
Drive = Callable[[Robot], Coroutine[Any, Any, None]]

SETUPS: Final = tuple(name for name, sensors in PRESETS.items() if sensors)
SETTINGS: Final = (
    "sim.room.length=.inf",
    "sim.room.width=.inf",
    "sim.battery.used_1=null",
    "sensors.imu.driver=sim_imu",
    "sensors.gps.driver=sim_gps",
    "sensors.gps.options={slow: 0.0}",
    "sensors.vicon.driver=sim_vicon",
)
SHARE: Final = 3.0  # an error is larger than so many sigma


class Watch:
    """What a set-up's filter told beside the truth."""

    def __init__(self, estimator: Estimator, *, absolute: bool, mistakes: Mistakes = Mistakes()) -> None:  # noqa: B008
        self.estimator, self.mistakes = estimator, mistakes
        self.rows: list[tuple[float, ...]] = []  # time, errors of x, y, theta, NEES, bold, blind
        self.absolute = absolute
        self.start: tuple[float, float, float] | None = None

    def step(self, now: float, robot: Robot) -> None:
        """Take a cycle."""
        true = robot.pose
        assert true is not None
        estimate = self.estimator.step(now, self.mistakes.wheels(wheels_of(robot.runtime)))
        blind = not any(each.believed for each in self.estimator.trusts())
        if self.start is None:
            self.start = true
        if not estimate.located:
            return
        x, y, theta = (0.0, 0.0, 0.0) if self.absolute else self.start
        c, s = cos(theta), sin(theta)
        ex, ey = x + c * estimate.x - s * estimate.y - true[0], y + s * estimate.x + c * estimate.y - true[1]
        et = wrap_angle(theta + estimate.theta - true[2])
        spread = np.reshape(estimate.covariance, (5, 5))[:3, :3]
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        spread = turn @ spread @ turn.T
        error = np.array([ex, ey, et])
        nees = float(error @ np.linalg.solve(spread, error))
        bold = np.hypot(ex, ey) > SHARE * np.sqrt(spread[0, 0] + spread[1, 1])
        self.rows.append((now, ex, ey, et, nees, float(bold), float(blind)))

    def result(self) -> dict[str, float]:
        """Root mean squares (m, degrees) and shares, of the last three quarters."""
        rows = np.array(self.rows)
        if not len(rows):
            return {}
        rows = rows[rows[:, 0] > 0.25 * rows[-1, 0]]
        bold, longest = 0.0, 0.0
        for each in rows[:, 5]:
            bold = (bold + ESTIMATION_PERIOD) * each
            longest = max(longest, bold)
        nees = rows[:, 4]
        return {
            "m": float(np.sqrt(np.mean(rows[:, 1] ** 2 + rows[:, 2] ** 2))),
            "deg": float(np.sqrt(np.mean(rows[:, 3] ** 2))) * 180.0 / pi,
            "largest": float(np.hypot(rows[:, 1], rows[:, 2]).max()),
            "nees": float(nees.mean()),
            "share": float(np.mean((nees > BAND[0]) & (nees < BAND[1]))),
            "in_band": float(BAND[0] < nees.mean() < BAND[1]),
            "bold": longest,
            "blind": float(rows[:, 6].sum()) * ESTIMATION_PERIOD,
        }


async def driven(
    vehicle: str,
    seed: int,
    drive: Drive,
    configs: Mapping[str, EstimationConfig],
    mistaken: Mapping[str, Mistakes] = MappingProxyType({}),
) -> dict[str, Watch]:
    """What the filters of all configurations told on one drive, by geometries with these mistakes."""
    file = vehicle_file(vehicle) if vehicle != "txt1" else None
    config = load(file, [f"seed={seed}", *SETTINGS]).config
    async with Robot.open(config=config, hal="sim") as robot:
        await robot.load_gains()
        watches = {}
        for name, given in configs.items():
            kinds = {each: KINDS[each] for each in given.names if each in KINDS}
            mistakes = mistaken.get(name, Mistakes())
            estimator = Estimator(given, kinds, mistakes.geometry(robot.config.geometry))
            for each in kinds:
                robot.sensors[each].listeners.append(partial(estimator.take, each))
            watches[name] = Watch(estimator, absolute=bool({"gps", "vicon"} & set(given.names)), mistakes=mistakes)

        async def measure(ticks: Ticks) -> None:
            async for now in ticks:
                for watch in watches.values():
                    watch.step(now, robot)

        robot.add_task("measure", ESTIMATION_PERIOD, measure, PRIORITY)
        await drive(robot)
    return watches


def results(vehicle: str, seed: int, drive: Drive, *, exact: bool) -> dict[str, dict[str, float]]:
    """The results of all set-ups on one drive; exact: the filter is told the true geometry, and that it is."""
    mistaken = {name: mistakes.of(PRESETS[name], seed, exact=exact) for name in SETUPS}
    configs = {name: mistakes.told(PRESETS[name], each) for name, each in mistaken.items()}
    made = {name: each for name, each in mistaken.items() if each is not None}
    watches = run(driven(vehicle, seed, drive, configs, made), speed="max")
    return {name: watch.result() for name, watch in watches.items()}


def random(
    vehicle: str, seed: int, seconds: float, slip_max: float = SLIP_MAX, *, exact: bool = False
) -> dict[str, dict[str, float]]:
    """The results of all set-ups on a drive as a person makes it."""

    async def drive(robot: Robot) -> None:
        await drive_as_a_person(robot, seed, seconds, slip_max)

    return results(vehicle, seed, drive, exact=exact)


def from_rest(seed: int) -> dict[str, dict[str, float]]:
    """The results on ten seconds at 1 m/s and 1 rad/s from rest, by the true geometry."""

    async def drive(robot: Robot) -> None:
        await robot.drive(1.0, 1.0, 10.0)

    return results("txt1", seed, drive, exact=True)


def table(found_by_seed: list[dict[str, dict[str, float]]]) -> str:
    """The results of seeds: root mean squares over them, and the largest where a column says so."""
    lines = [
        "| set-up | m rms | degrees rms | largest m | NEES | time in band | runs with NEES in band "
        "| sigma < error / 3 for s | no sensor believed for s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in SETUPS:
        found = [each[name] for each in found_by_seed if each.get(name)]
        if not found:
            continue

        def mean(key: str, found: list[dict[str, float]] = found) -> float:
            return float(np.mean([each[key] for each in found]))

        m, deg = (float(np.sqrt(np.mean([each[key] ** 2 for each in found]))) for key in ("m", "deg"))
        largest, bold, blind = (max(each[key] for each in found) for key in ("largest", "bold", "blind"))
        lines.append(
            f"| {name} | {m:.4f} | {deg:.2f} | {largest:.3f} | {mean('nees'):.2f} | {mean('share'):.2f} "
            f"| {mean('in_band'):.2f} | {bold:.2f} | {blind:.2f} |"
        )
    return "\n".join(lines)
