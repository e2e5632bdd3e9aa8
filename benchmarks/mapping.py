"""How good maps are: the error of trajectories from logs of other people's robots, beside yag-slam.

    python -m benchmarks.mapping                        # the logs of --data, 20 seeds
    python -m benchmarks.mapping --seeds 2 LOG ...      # any logs in CARMEN's format, plain or gzip

The odometry of these logs was corrected by those who published them. So an error is added, the same one for all: 5 % on
one wheel, and a heading that wanders by 2 degrees a metre. The error of a trajectory (ATE) is the rms of what positions
differ from the reference after the best rigid alignment. Relative errors need no alignment: they are the rms by which
the way between two scans differs from the reference's, from each scan to the next one, and at revisits: between scans
that the reference has within 1 m of each other, with 20 m or more driven in between (Kuemmerle and others, "On
measuring the accuracy of SLAM algorithms", Autonomous Robots 27, 2009; their relations were chosen by hand).

What the mapper tells while it drives is compared, too: the pose of each scan at its time, as seen from the first ones,
and whether its position errs by less than 3 standard deviations of the covariance told. The reference's poses err by
some centimetres and tenths of a degree each, so its frame is that of the median of the first 20.

Times are processor time, those of yag-slam in an environment of its own, with its own settings. Debian's mrpt-apps run
on the first seed where they are installed; neither of them closes loops.
"""

import argparse
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Final, NamedTuple

import numpy as np

from benchmarks import revisits
from benchmarks.peers import mrpt
from rigs.laser_logs import drifted
from rigs.laser_logs import read as read_log
from txt1.errors import Txt1Error
from txt1.mapping import carmen_logs, grid_files
from txt1.mapping.mapper import Mapper
from txt1.mapping.poses import composed, difference, placed, trajectory_error, wrapped
from txt1.maps.grid import OCCUPIED

DATA: Final = Path("/work/shared/data/laser")
NEAR: Final = 1.0
"""m between two scans of a revisit."""
EARLY: Final = 20
"""Scans at the beginning that place the map's frame in the reference's."""
FAR: Final = 20.0
"""m driven between them, at least."""
LOGS: Final = ("intel", "aces", "csail", "freiburg-079")
PEER: Final = Path(__file__).parent / "peers" / "yag.py"
PACKAGES: Final = ("yag-slam=={}", "opencv-python-headless", "msgpack")  # it does not name the latter two


class Result(NamedTuple):
    """What came of a log with a seed."""

    error: float
    """m, NaN where the log has no reference."""
    spent: float
    """Processor time of a scan, s."""
    relative: tuple[float, ...] = ()
    """Relative errors per step, m and rad, and at revisits, m and rad; empty where the log has no reference."""
    told: tuple[float, ...] = ()
    """Share of scans within 3 sigma when they were taken, mean sigma and rms error of the position, m; empty where the
    log has no reference.
    """


def surely_within(
    told: carmen_logs.Array, sigmas: carmen_logs.Array, reference: carmen_logs.Array
) -> tuple[float, ...]:
    """Return the share of poses told whose position is within 3 sigma, the mean sigma, and the rms error, m."""
    frames = composed(reference[:EARLY], difference(told[:EARLY], np.zeros(3)))
    turn = frames[0, 2] + np.median(wrapped(frames[:, 2] - frames[0, 2]))
    turned = placed((0.0, 0.0, turn), told[:, :2])
    off = turned - reference[:, :2]
    errors = np.hypot(*(off - np.median(off[:EARLY], axis=0)).T)
    return float(np.mean(errors < 3.0 * sigmas)), float(sigmas.mean()), float(np.sqrt(np.mean(errors**2)))


def relative_errors(poses: carmen_logs.Array, reference: carmen_logs.Array) -> tuple[float, ...]:
    """Return the relative errors per step, m and rad, and at revisits, m and rad; NaN without revisits."""
    steps = np.arange(len(reference) - 1)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(reference[:, :2], axis=0).T))))
    pairs = []
    for k in range(len(reference)):
        before = np.flatnonzero(driven < driven[k] - FAR)
        apart = np.hypot(*(reference[before, :2] - reference[k, :2]).T)
        if len(before) and apart.min() < NEAR:
            pairs.append((before[apart.argmin()], k))
    places = np.array(pairs, np.int64).reshape(-1, 2).T
    found: list[float] = []
    for first, second in ((steps, steps + 1), places):
        off = [
            difference(difference(reference[i], reference[j]), difference(poses[i], poses[j]))
            for i, j in zip(first, second, strict=True)
        ]
        x, y, theta = np.array(off).T if off else np.full((3, 1), np.nan)
        found += [float(np.sqrt(np.mean(x * x + y * y))), float(np.sqrt(np.mean(theta * theta)))]
    return tuple(found)


def ours(log: carmen_logs.Log, odometry: carmen_logs.Array) -> tuple[Result, Mapper]:
    """Map a log."""
    mapper, longest = Mapper(), log.longest
    poses, covariances = [], []
    begin = process_time()
    for scan, pose in zip(log.scans, odometry, strict=True):
        match = mapper.add(scan.time, carmen_logs.points_of(scan.ranges, scan.angles, longest, scan.swept), pose)
        poses.append(match.pose)
        covariances.append(mapper.covariance)
    mapper.finish()
    spent = (process_time() - begin) / len(log.scans)
    result = _result(mapper.poses, log, spent)
    if log.reference is not None:
        sigmas = np.sqrt(np.trace(np.array(covariances)[:, :2, :2], axis1=1, axis2=2))
        result = result._replace(told=surely_within(np.array(poses), sigmas, log.reference))
    return result, mapper


def _result(poses: carmen_logs.Array, log: carmen_logs.Log, spent: float) -> Result:
    relative = () if log.reference is None else relative_errors(poses, log.reference)
    return Result(_error(poses, log), spent, relative)


def _error(poses: carmen_logs.Array, log: carmen_logs.Log) -> float:
    return float("nan") if log.reference is None else trajectory_error(poses, log.reference)


def environment(version: str) -> Path | None:
    """Return the Python that has yag-slam, which is installed on the first call; None: it cannot be."""
    folder = Path("build") / f"yag-slam-{version}"
    python = folder / "bin" / "python"
    if (folder / "ready").exists():
        return python
    packages = [each.format(version) for each in PACKAGES]
    for command in ([sys.executable, "-m", "venv", folder], [python, "-m", "pip", "--quiet", "install", *packages]):
        try:
            subprocess.run(command, check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            told = (getattr(error, "stderr", "") or str(error)).strip().splitlines()
            print(f"yag-slam {version} could not be installed, so it did not run: {told[-1] if told else error}")
            return None
    (folder / "ready").touch()
    return python


def yag(python: Path, log: carmen_logs.Log, odometry: carmen_logs.Array) -> Result | None:
    """Have yag-slam map a log; None: it failed, which is told."""
    if any(scan.ranges.shape != log.scans[0].ranges.shape for scan in log.scans):
        print(f"{log.name}: yag-slam takes no scans whose number of beams changes, so it did not run")
        return None
    angles = log.scans[0].angles
    with TemporaryDirectory() as folder:
        given, found = Path(folder, "in.npz"), Path(folder, "out.npz")
        np.savez(
            given,
            ranges=np.array([scan.ranges for scan in log.scans]),
            start=angles[0],
            step=angles[1] - angles[0],
            longest=log.longest,
            odometry=odometry,
        )
        done = subprocess.run([python, PEER, given, found], capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"{log.name}: yag-slam failed: {(done.stderr.strip().splitlines() or ['no word'])[-1]}")
            return None
        result = np.load(found)
        return _result(result["poses"], log, float(result["spent"]) / len(log.scans))


def told(log: carmen_logs.Log, seeds: int, python: Path | None, picture: Path | None) -> list[list[Result]]:
    """Map a log with each seed, print its row, and return our results and theirs."""
    wheels, mine, theirs = [], [], []
    for seed in range(seeds):
        odometry = drifted(log.odometry, seed) if log.reference is not None else log.odometry
        wheels.append(_error(odometry, log))
        result, mapper = ours(log, odometry)
        mine.append(result)
        if python is not None and (other := yag(python, log, odometry)) is not None:
            theirs.append(other)
        if picture is not None and seed == 0:
            picture.mkdir(parents=True, exist_ok=True)
            draw(mapper, odometry, picture / log.name)
        if log.reference is None:
            break
    cells = [log.name, str(len(log.scans)), str(len(mine)), f"{np.mean(wheels):.2f}"]
    for results in (mine, theirs):
        errors, times = np.array([each.error for each in results]), [each.spent for each in results]
        cells += (
            [f"{errors.mean():.3f}", f"{errors.max():.3f}", f"{np.mean(times) * 1e3:.1f}"] if results else ["-"] * 3
        )
    print("| " + " | ".join(cells) + " |", flush=True)
    return [mine, theirs]


def relative_cells(results: list[Result]) -> list[str]:
    """Return the means of relative errors over seeds as cells of a table: per step, and at revisits."""
    each = [result.relative for result in results if result.relative]
    if not each:
        return ["-", "-"]
    a, b, c, d = np.mean(each, axis=0)
    return [f"{1e3 * m:.1f}, {np.degrees(turn):.2f}" for m, turn in ((a, b), (c, d))]


def draw(mapper: Mapper, odometry: carmen_logs.Array, name: Path) -> None:
    """Write the map as NAME.pgm, NAME.svg and NAME.yaml, and beside it the map by wheels alone as NAME.png."""
    from matplotlib.figure import Figure

    clouds = [key.cloud for key in mapper.keys]
    grid = grid_files.grid_of(clouds, mapper.graph.poses, mapper.loops)
    grid_files.save(grid, name, [("#d04010", mapper.poses)])
    figure = Figure(figsize=(7.5, 4.6), layout="constrained")
    axes = figure.subplots(1, 2)
    maps = ("by the wheels alone", revisits.by_wheels(mapper, odometry)), ("matched, loops closed", mapper.graph.poses)
    for each, (title, poses) in zip(axes, maps, strict=True):
        walls = grid_files.grid_of(clouds, poses, mapper.loops)
        rows, columns = np.nonzero(walls.cells >= OCCUPIED // 2)
        x, y = ((cells + 0.5) * walls.resolution for cells in (columns, rows))
        x, y = x + walls.origin[0], y + walls.origin[1]
        each.scatter(x, y, s=0.8, marker="s", linewidths=0, color="black", label="walls")
        each.plot(*poses[:, :2].T, color="#d04010", linewidth=1.0, label="the laser's way")
        each.set(title=title, xlabel="x, m", ylabel="y, m", aspect="equal")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=4)
    figure.savefig(name.with_name(f"{name.name}.png"), dpi=110)


def show_revisits(log: carmen_logs.Log) -> None:
    """Print how well the map of a log fits at places passed twice, by our map and by the wheels alone."""
    _, mapper = ours(log, log.odometry)
    wheels = revisits.by_wheels(mapper, log.odometry)
    for name, poses in (("map", mapper.graph.poses), ("wheels alone", wheels)):
        found = revisits.offsets(mapper, poses)
        apart = sorted(found.values())
        if not apart:
            print(f"- {log.name}, {name}: no place passed twice")
            continue
        worst = max(found, key=lambda each: found[each])
        print(
            f"- {log.name}, {name}: {len(apart)} revisits, worst {apart[-1]:.3f} m (keyframe {worst}), "
            f"median {apart[len(apart) // 2]:.3f} m, {sum(each <= 0.05 for each in apart)} within 5 cm",
            flush=True,
        )


def beside(log: carmen_logs.Log) -> None:
    """Have Debian's programs map a log with the first seed, and print what comes of it."""
    odometry = drifted(log.odometry, 0) if log.reference is not None else log.odometry
    for program in mrpt.PROGRAMS:
        found = mrpt.mapped(program, log, odometry)
        told = found.told
        if found.poses is not None:
            told = f"ATE {_error(found.poses, log):.2f} m, {found.spent * 1e3:.1f} ms a scan"
        print(f"- {program}, {log.name}, seed 0: {told}", flush=True)


def sure(rows: dict[str, list[list[Result]]]) -> None:
    """Print what the covariance told is worth, losses first."""
    lines = []
    for name, (mine, _) in rows.items():
        each = [result.told for result in mine if result.told]
        if each:
            share, sigma, error = np.mean(each, axis=0)
            holds = share >= 0.97 and sigma <= 3.0 * error
            line = f"within 3 sigma in {100.0 * share:.0f} % (at least 97); sigma {sigma:.3f} m, error {error:.3f} m"
            lines.append((holds, f"{name}: {line} (sigma at most 3 times that)"))
    print("\nThe pose told while driving:\n")
    for holds, line in sorted(lines, key=lambda each: each[0]):
        print(f"- {'holds' if holds else 'DOES NOT HOLD'}: {line}")


def verdict(rows: dict[str, list[list[Result]]]) -> None:
    """Print what holds of the aims and what does not, losses first."""
    both = {name: row for name, row in rows.items() if row[1] and np.isfinite(row[0][0].error)}
    if not both:
        print("\nNothing to compare with.")
        return
    means = {name: [np.mean([each.error for each in side]) for side in row] for name, row in both.items()}
    times = {name: [np.mean([each.spent for each in side]) for side in row] for name, row in both.items()}
    mine, theirs = np.mean(list(means.values()), axis=0)
    lines = [(mine <= theirs, f"mean ATE over the logs: {mine:.3f} m, yag-slam's {theirs:.3f} m")]
    for name in both:
        (error, other), (spent, taken) = means[name], times[name]
        lines.append((error <= 1.3 * other, f"{name}: ATE {error / other:.2f} times yag-slam's (at most 1.3)"))
        lines.append(
            (spent <= 0.65 * taken, f"{name}: processor time {spent / taken:.2f} of yag-slam's (at most 0.65)")
        )
    share = np.mean([spent / taken for spent, taken in times.values()])
    lines.append((share <= 0.5, f"processor time in the mean over the logs: {share:.2f} of yag-slam's (at most 0.5)"))
    print()
    for holds, line in sorted(lines, key=lambda each: each[0]):
        print(f"- {'holds' if holds else 'DOES NOT HOLD'}: {line}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run on the command line's logs."""
    parser = argparse.ArgumentParser(prog="benchmarks.mapping", description=__doc__.split("\n\n")[0])
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="CARMEN logs, plain or gzip, or the rover's")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the logs taken without any named")
    parser.add_argument("--seeds", type=int, default=20, help="of the error added to odometry (default 20)")
    parser.add_argument("--yag", default="0.2.5", metavar="VERSION", help="of yag-slam (default 0.2.5); none: without")
    parser.add_argument(
        "--pictures", type=Path, metavar="FOLDER", help="write the maps of the first seed there, and pictures"
    )
    given = parser.parse_args(arguments)
    files = given.logs or [given.data / f"{name}.log.gz" for name in LOGS]
    python = None if given.yag == "none" else environment(given.yag)
    rows: dict[str, list[list[Result]]] = {}
    try:
        read = [read_log(file) for file in files]
    except Txt1Error as error:
        print(error, file=sys.stderr)
        return 1
    # compiled before anything is timed
    first = read[0]._replace(scans=read[0].scans[:60])
    ours(first, first.odometry)
    print(f"ATE in m over seeds, processor time in ms a scan; yag-slam {given.yag}\n")
    print("| log | scans | seeds | ATE of wheels | ATE | worst | ms | yag-slam's ATE | worst | ms |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for log in read:
        rows[log.name] = told(log, given.seeds, python, given.pictures)
    print("\nRelative errors in mm and degrees, per step and at revisits:\n")
    print("| log | step | at revisits | yag-slam's step | at revisits |")
    print("|---|---|---|---|---|")
    for name, row in rows.items():
        print("| " + " | ".join([name, *(cell for side in row for cell in relative_cells(side))]) + " |")
    sure(rows)
    verdict(rows)
    # kilobytes
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"- {'holds' if memory < 500.0 else 'DOES NOT HOLD'}: {memory:.0f} MB at most (less than 500)")
    print("\nPlaces passed twice, without an error added:")
    for log in read:
        show_revisits(log)
    print("\nDebian's mrpt-apps:")
    for log in read:
        beside(log)
    return 0


if __name__ == "__main__":
    sys.exit(main())
