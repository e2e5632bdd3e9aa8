"""A mount, a clock or a scale that is stated wrongly: whether the filter tells so, once it can know."""

from collections.abc import Sequence
from functools import partial
from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import mistakes, seeds
from benchmarks.drives import BAND
from benchmarks.mistakes import Mistakes
from benchmarks.random_drives import Watch, driven
from rigs.human_drive import drive_as_a_person
from txt1.estimation.settings import PRESETS, EstimationConfig, FusedConfig
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.robot import Robot

SECONDS: Final = 60.0
GIVEN: Final = 10.0  # s from when it can be known
TURNED: Final = 0.5 * pi  # rad of turns, to both sides together, that show a lever arm or a scale
CHANGED: Final = 1.0  # m/s of changes of the speed that show a clock
CASES: Final[dict[str, tuple[str, dict[str, FusedConfig]]]] = {
    "vicon, all as stated": ("vicon", {}),
    "vicon, mount 5 cm ahead of the truth": ("vicon", {"vicon": FusedConfig(lever=(0.05, 0.0))}),
    "vicon, mount 5 cm to the left": ("vicon", {"vicon": FusedConfig(lever=(0.0, 0.05))}),
    "vicon, clock 30 ms off": ("vicon", {"vicon": FusedConfig(delay=0.03)}),
    "vicon, gyro 3 % off": ("vicon", {"imu": FusedConfig(scale=0.03)}),
    "imu-gps, all as stated": ("imu-gps", {}),
    "imu-gps, mount 30 cm ahead of the truth": ("imu-gps", {"gps": FusedConfig(lever=(0.3, 0.0))}),
    "imu-gps, clock 200 ms off": ("imu-gps", {"gps": FusedConfig(delay=0.2)}),
    "imu-gps, gyro 3 % off": ("imu-gps", {"imu": FusedConfig(scale=0.03)}),
}

Array = NDArray[np.float64]


def observable(track: Array, name: str) -> float:
    """When what is wrong can be known, s: by poses over time (t, x, y, theta), shape (samples, 4)."""
    steps = np.diff(track, axis=0)
    if "clock" in name:
        along = steps[:, 1] * np.cos(track[1:, 3]) + steps[:, 2] * np.sin(track[1:, 3])
        so_far, enough = np.cumsum(np.abs(np.diff(along / steps[:, 0]))), CHANGED
    else:
        so_far, enough = np.cumsum(np.abs([wrap_angle(each) for each in steps[:, 3]])), TURNED
    return float(track[min(int(np.searchsorted(so_far, enough)), len(track) - 1), 0])


def _driven(seed: int, *, exact: bool) -> tuple[Array, dict[str, Watch]]:
    track: list[tuple[float, ...]] = []

    async def drive(robot: Robot) -> None:
        async def follow(ticks: Ticks) -> None:
            async for now in ticks:
                assert robot.pose is not None
                track.append((now, *robot.pose))

        robot.add_task("track", 0.02, follow, -2)
        await drive_as_a_person(robot, seed, SECONDS)

    made = Mistakes() if exact else mistakes.drawn(seed, absolute=True)._replace(ahead=0.0, left=0.0)
    configs = {
        name: EstimationConfig(sensors=PRESETS[setup], settings=settings, track_sigma=0.0 if exact else None)
        for name, (setup, settings) in CASES.items()
    }
    watches = run(driven("txt1", seed, drive, configs, dict.fromkeys(CASES, made)), speed="max")
    return np.array(track), watches


def _inside(nees: Array) -> float:
    return float(np.mean((nees > BAND[0]) & (nees < BAND[1])))


def show(numbers: Sequence[int], *, exact: bool) -> None:
    """Drive, and print of each case what held from `GIVEN` s after it could be known to the end."""
    seeds.each(numbers, "driving", partial(_driven, exact=exact), _print)


def _print(drives: list[tuple[Array, dict[str, Watch]]]) -> None:
    print(f"{len(drives)} drives of {SECONDS:g} s, each from {GIVEN:g} s after what is wrong can be known:\n")
    print("| | m rms | degrees rms | NEES | time in band | runs with NEES in band |")
    print("|---|---|---|---|---|---|")
    for name in CASES:
        found = []
        for track, watches in drives:
            rows = np.array(watches[name].rows)
            found.append(rows[rows[:, 0] > observable(track, name) + GIVEN])
        every = np.concatenate(found)
        runs = np.array([each[:, 4].mean() for each in found])
        position, heading = np.hypot(every[:, 1], every[:, 2]), every[:, 3] * 180.0 / pi
        print(
            f"| {name} | {np.sqrt(np.mean(position**2)):.4f} | {np.sqrt(np.mean(heading**2)):.2f} "
            f"| {every[:, 4].mean():.2f} | {_inside(every[:, 4]):.2f} | {_inside(runs):.2f} |"
        )
