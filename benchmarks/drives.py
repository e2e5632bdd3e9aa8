"""Recorded drives with the truth beside them: what a filter makes of each, and how far off it is.

A drive is a file of NumPy arrays, in SI units, one row a sample:

    truth   t, x, y, theta, v, omega
    wheels  arrival, time, right and left counts so far, steering as a share of full lock, set-point, motor
    imu     arrival, time, yaw rate
    gps     arrival, time, x, y of the antenna, 0.0762 m behind the pose
    vicon   arrival, time, x, y, theta
"""

from collections.abc import Callable, Iterator
from math import cos, pi, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import seeds
from benchmarks.plain_filter import START, PlainFilter, Told
from txt1.estimation.settings import EstimationConfig, FusedConfig
from txt1.estimation.task import ENCODERS, Estimator, Wheels
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import WheelOdometry
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import GPS_MOUNT, FixReading, ImuReading, TrackerReading

Array = NDArray[np.float64]

KINDS: Final[dict[str, type]] = {"imu": ImuReading, "gps": FixReading, "vicon": TrackerReading}
BAND: Final = (0.2158, 9.3484)  # of the chi-square of three numbers: 95 % lie within
FAULTS: Final = ("outliers", "jumps")
BEFORE: Final[dict[str, tuple[tuple[float, float], tuple[float, float]]]] = {
    "gyro-clean-1": ((0.1326, 1.98), (0.0767, 1.30)),
    "gyro-clean-2": ((0.3309, 1.64), (0.2383, 1.43)),
    "gyro-clean-3": ((0.3098, 1.37), (0.0849, 0.44)),
    "gps-clean-1": ((0.1124, 0.93), (0.0905, 0.81)),
    "gps-clean-2": ((0.1316, 0.89), (0.0851, 0.60)),
    "gps-clean-3": ((0.1483, 1.06), (0.1531, 1.04)),
    "gps-outliers3pc-1": ((0.1630, 1.72), (0.1788, 1.86)),
    "gps-outliers3pc-2": ((0.2050, 1.33), (0.2111, 1.59)),
    "gps-outliers3pc-3": ((0.1619, 1.82), (0.1580, 1.17)),
    "gps-10m-jumps-4s-1": ((0.2116, 1.85), (0.2320, 3.49)),
    "gps-10m-jumps-4s-2": ((0.1546, 1.35), (0.1549, 1.97)),
    "gps-10m-jumps-4s-3": ((0.1288, 0.55), (0.2728, 2.43)),
    "mocap-clean-1": ((0.0009, 0.07), (0.0008, 0.05)),
    "mocap-clean-2": ((0.0009, 0.07), (0.0269, 0.47)),
    "mocap-clean-3": ((0.0009, 0.08), (0.0111, 0.32)),
    "mocap-late80-true-stamp-drop-1": ((0.0025, 0.11), (0.0030, 0.10)),
    "mocap-late80-true-stamp-drop-2": ((0.0026, 0.16), (0.0092, 0.25)),
    "mocap-late80-true-stamp-drop-3": ((0.0021, 0.07), (0.0024, 0.08)),
    "mocap-lever-5cm-wrong-1": ((0.0501, 0.07), (1.3457, 31.04)),
    "mocap-lever-5cm-wrong-2": ((0.0501, 0.08), (0.0554, 0.39)),
    "mocap-lever-5cm-wrong-3": ((0.0501, 0.09), (0.0551, 0.51)),
}
"""Position (m) and heading (degrees), rms, of another's plain filter and of version 0.2.0, by drive."""


class Score(NamedTuple):
    """How far off a filter is, over the last three quarters of a drive."""

    position: float  # m, rms
    heading: float  # degrees, rms
    nees: float  # of x, y and theta, mean
    share: float  # of the time, in which NEES is in its 95 % band
    overconfident: float  # s, the longest time with a sigma of less than a third of the error
    sigma: float  # of the position, mean, by the rms error


Drive = dict[str, Array]


def read(file: Path) -> Drive:
    """Read a drive."""
    with np.load(file) as kept:
        return {name: kept[name] for name in kept.files}


def without_faults(drive: Drive, limit: float = 5.0) -> Drive:
    """The drive without the fixes that are farther than `limit` sigma (of 1 m) from the truth."""
    if "gps" not in drive:
        return drive
    truth, gps = drive["truth"], drive["gps"]
    x, y = (np.interp(gps[:, 1], truth[:, 0], truth[:, place]) for place in (1, 2))
    return {**drive, "gps": gps[np.hypot(gps[:, 2] - x, gps[:, 3] - y) < limit]}


def events(drive: Drive) -> Iterator[tuple[str, Array]]:
    """Readings and samples of the wheels as they arrive; the wheels come last, as they make a step."""
    order = ("imu", "gps", "vicon", "wheels")
    rows = [(row[0], place, name, row) for place, name in enumerate(order) if name in drive for row in drive[name]]
    for _, _, name, row in sorted(rows, key=lambda each: each[:2]):
        yield name, row


def score(drive: Drive, rows: list[tuple[float, Array, Array]]) -> Score:
    """Score poses: of each the time, (x, y, theta) and its covariance."""
    truth = drive["truth"]
    begin = truth[0, 0] + 0.25 * (truth[-1, 0] - truth[0, 0])
    heading = np.unwrap(truth[:, 3])
    errors, nees, sigmas, over, longest = [], [], [], 0.0, 0.0
    before = None
    for time, pose, spread in rows:
        if time < begin:
            continue
        error = pose - [np.interp(time, truth[:, 0], each) for each in (truth[:, 1], truth[:, 2], heading)]
        error[2] = wrap_angle(error[2])
        errors.append(error)
        nees.append(float(error @ np.linalg.solve(spread, error)))
        sigmas.append(float(np.sqrt(spread[0, 0] + spread[1, 1])))
        bold = np.hypot(*error[:2]) > 3.0 * sigmas[-1]
        over = over + (time - (before or time)) if bold else 0.0
        longest, before = max(longest, over), time
    if not errors:
        return Score(np.inf, np.inf, np.inf, 0.0, np.inf, 0.0)
    found = np.array(errors)
    told = np.array(nees)
    position = float(np.sqrt(np.mean(found[:, 0] ** 2 + found[:, 1] ** 2)))
    return Score(
        position,
        float(np.sqrt(np.mean(found[:, 2] ** 2))) * 180.0 / pi,
        float(told.mean()),
        float(np.mean((told > BAND[0]) & (told < BAND[1]))),
        longest,
        float(np.mean(sigmas)) / position,
    )


def plain(drive: Drive) -> Score:
    """The plain filter's score; it is told the pose of the start."""
    geometry = Geometry()
    x, y, theta = drive["truth"][0, 1:4]
    found = PlainFilter((x, y, theta))
    rows, before = [], None
    for name, row in events(drive):
        if name == "imu":
            found.take(Told(row[1], name, row[2:3]))
        elif name == "gps":
            found.take(Told(row[1], name, row[2:4], GPS_MOUNT.x))
        elif name == "vicon":
            found.take(Told(row[1], name, row[2:5]))
        else:
            if before is not None:
                dt = row[1] - before[1]
                right, left = (row[2:4] - before[2:4]) * geometry.count_length / dt
                found.take(
                    Told(
                        row[1] - 0.5 * dt, name, np.array([0.5 * (right + left), (right - left) / geometry.track_width])
                    )
                )
            before = row
            mean, spread = found.at(row[0])
            rows.append((row[0], mean[:3], spread[:3, :3]))
    return score(drive, rows)


def estimator_for(drive: Drive, geometry: Geometry, *, told: bool = False, exact: bool = True) -> Estimator:
    """The robot's own filter of the sensors that a drive has; told: the pose of the start, as the plain filter is.

    Exact: it is told that geometry, mounts and clocks are as stated.
    """
    kinds = {name: KINDS[name] for name in KINDS if name in drive}
    x, y, theta = drive["truth"][0, 1:4].tolist()
    known: dict[str, Any] = {"start": (x, y, theta), "start_sigma": tuple(START[:3] ** 0.5)} if told else {}
    if exact:
        place = FusedConfig(lever_sigma=0.003, delay_sigma=0.01)
        known |= {"track_sigma": 0.0, "settings": {name: place for name in kinds if name != "imu"}}
    return Estimator(EstimationConfig(sensors=(*kinds, ENCODERS), **known), kinds, geometry)


def reading_of(name: str, row: Array, sigma: float = 1.0) -> Reading[Any]:
    """A sensor's row as its driver's reading; `sigma` is a GPS's, m."""
    if name == "imu":
        return Reading(float(row[1]), ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, float(row[2]))))
    if name == "gps":
        return Reading(float(row[1]), FixReading(0.0, 0.0, float(row[2]), float(row[3]), sigma_x=sigma, sigma_y=sigma))
    half = 0.5 * float(row[4])
    seen = (0.0, 0.0, sin(half), cos(half))
    return Reading(float(row[1]), TrackerReading(float(row[2]), float(row[3]), 0.0, seen))


def ours(
    drive: Drive,
    geometry: Geometry | None = None,
    watch: Callable[[Estimator, Estimate], None] | None = None,
    *,
    told: bool = False,
    exact: bool = True,
    sigma: float = 1.0,
) -> Score:
    """The score of the robot's own filter; `watch` sees each estimate. `told`: it knows the pose at the start.

    `exact`: it is told that all is as stated; `sigma` is the GPS's, m.
    """
    geometry = geometry or Geometry()
    estimator, odometry = estimator_for(drive, geometry, told=told, exact=exact), WheelOdometry(geometry)
    located = told or "gps" in drive or "vicon" in drive
    x, y, theta = (0.0, 0.0, 0.0) if located else drive["truth"][0, 1:4]
    c, s = cos(theta), sin(theta)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rows = []
    for name, row in events(drive):
        if name != "wheels":
            estimator.take(name, reading_of(name, row, sigma))
            continue
        odometry.step((int(row[2]), int(row[3])), float(row[1]))
        wheels = Wheels(odometry.odometry, float(row[1]), float(row[4]) * STEERING_MAX, float(row[5]))
        estimate = estimator.step(float(row[0]), wheels)
        if watch is not None:
            watch(estimator, estimate)
        if not estimate.located:
            continue
        pose = turn @ np.array(estimate[:3]) + np.array([x, y, theta])
        spread = turn @ np.reshape(estimate.covariance, (5, 5))[:3, :3] @ turn.T
        rows.append((float(row[0]), pose, spread))
    return score(drive, rows)


def limit(name: str, other: tuple[float, float], cleaned: tuple[float, float]) -> tuple[float, float]:
    """The largest position and heading that are wanted of a drive, m and degrees.

    1.1 times the lower of the figures before; with a fault 1.15 times those of the plain filter without the faulty
    readings, or of another's with them where these are lower; with a wrong lever arm 0.7 of the lower position.
    """
    known = BEFORE.get(name)
    if any(fault in name for fault in FAULTS):
        usual = known[0] if known else cleaned
        return 1.15 * min(cleaned[0], usual[0]), 1.15 * min(cleaned[1], usual[1])
    lower = tuple(min(pair) for pair in zip(*known, strict=True)) if known else other
    return (0.7 if "lever" in name else 1.1) * lower[0], 1.1 * lower[1]


def _row(file: Path) -> tuple[bool, str]:
    """Whether a drive meets what is wanted, and its row of the table."""
    drive, name = read(file), file.stem
    # what is wrong with the geometry is in the name, and so is RTK, of 3 cm
    exact, sigma = not any(word in name for word in ("track", "lever")), 0.03 if name.startswith("rtk") else 1.0
    mine, knowing = (ours(drive, told=each, exact=exact, sigma=sigma) for each in (False, True))
    other = plain(drive)
    cleaned = plain(without_faults(drive))
    wanted = limit(name, other[:2], cleaned[:2])
    # the table's figures are rounded
    missed, missed_knowing = (
        each.position > wanted[0] + 5e-5 or each.heading > wanted[1] + 5e-3 for each in (mine, knowing)
    )
    known = BEFORE.get(name)
    figures = [f"{m:.4f}, {d:.2f}" for m, d in known] if known else ["", ""]
    return (
        not missed and not missed_knowing,
        f"| {name} | {knowing.position:.4f}, {knowing.heading:.3f} {'**missed**' if missed_knowing else 'met'} "
        f"| {mine.position:.4f}, {mine.heading:.3f} {'**missed**' if missed else 'met'} "
        f"| {wanted[0]:.4f}, {wanted[1]:.3f} "
        f"| {mine.nees:.2f} | {mine.share:.2f} | {mine.sigma:.2f} | {mine.overconfident:.1f} "
        f"| {other.position:.4f}, {other.heading:.2f} | {other.nees:.2f} | {figures[0]} | {figures[1]} |",
    )


def show(folder: Path) -> None:
    """Print the table of a folder's drives; the rows that miss what is wanted come first."""
    seeds.each(sorted(folder.glob("*.npz")), "filtering", _row, _print)


def _print(rows: list[tuple[bool, str]]) -> None:
    print(
        "| drive | told the start: m, degrees rms | not told | at most | NEES | in band | sigma of error "
        "| sigma < error / 3, s | plain filter here | its NEES | plain filter, another's | version 0.2.0 |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for _, line in sorted(rows, key=lambda each: each[0]):
        print(line)
    print(f"{sum(not met for met, _ in rows)} of {len(rows)} rows miss, with or without the start")
