"""Laps of tracks by the laser: a policy taught on two maps, on four others, beside TinyLidarNet through the same scans.

    python -m benchmarks.teaching laps [--taught NAMES] [--tracks NAMES or .yaml] [--peer FILE.tflite]

The simulated human drives half of the time on each taught map (`benchmarks.teaching.track.Human`). Both contenders have
the same car, the same scans of 1081 beams at 40 Hz, the same safety gate and limits. Each begins its laps at the start
of the centre line, with noise of a seed of its own. A touch of a wall, or 5 s without motion, ends a drive.
"""

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path
from time import perf_counter, process_time, thread_time
from typing import Any, Final

import numpy as np
from numpy.random import default_rng

from benchmarks.teaching.track import BEAMS, V_MAX, Human, Laps, Track, config_of, driven, human_drives, track_of
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.record.options import RecordingAsked
from txt1.robot import Robot
from txt1.sensors.base import Reading
from txt1.sensors.readings import Scan
from txt1.teaching.features import seen
from txt1.teaching.lessons import Ask, drive_in
from txt1.teaching.policy import Policy, load
from txt1.teaching.teach import summary, teach
from txt1.teaching.training import Recipe

DATA: Final = Path("../shared/data/laps")
TRACKS: Final = (str(DATA / "aut.yaml"), str(DATA / "esp.yaml"), "grand-prix", "chicane")
CLIP: Final = 10.0  # m, of TinyLidarNet's ranges


def arguments(parser: ArgumentParser) -> None:
    """Add what the benchmark takes."""
    parser.add_argument("--taught", nargs="+", default=["hairpins", "kart"], help="maps that are taught")
    parser.add_argument("--tracks", nargs="+", default=list(TRACKS), help="maps that are driven")
    parser.add_argument("--minutes", type=float, default=10.0, help="of the human, on all taught maps together")
    parser.add_argument("--laps", type=int, default=20, help="on all tracks together")
    parser.add_argument("--peer", type=Path, default=DATA / "tinylidarnet_m.tflite")
    parser.add_argument("--policy", type=Path, help="a policy that is there already, in place of teaching one")
    parser.add_argument("--kept", type=Path, default=Path("build/teaching"), help="where recordings and policy go")
    parser.add_argument("--seed", type=int, default=0)


def recorded(track: Track, minutes: float, seed: int, folder: Path) -> Path:
    """A recording of the human on a track."""
    file = folder / f"{track.name}-{minutes:g}min-{seed}.mcap"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        human = Human(track, default_rng([38, seed]))

        async def steer(robot: Robot) -> None:
            await human_drives(robot, human)

        asked = {"record": RecordingAsked(file, None, {}, "max")}
        began = process_time()
        found = run(driven(config_of(track, seed), track, 10**6, 60.0 * minutes, steer, asked), speed="max")
        times = 60.0 * minutes / (process_time() - began)
        print(
            f"the human on {track.name}: {len(found.times)} laps, {found.ended}; recorded {times:.0f} times as fast as "
            "it was driven, by the processor's time",
            flush=True,
        )
    return file


def taught(files: list[Path], seed: int, out: Path) -> Policy:
    """A policy of recordings, as `txt1 teach` makes it."""
    drives = [drive_in(file, [Ask("laser")]) for file in files]
    for drive in drives:
        print(*summary(drive), sep="\n")
    began, cpu = perf_counter(), process_time()
    lesson = teach(drives, Recipe(seed=seed), "benchmark")
    results = lesson.policy.card.results
    print(
        f"taught in {perf_counter() - began:.0f} s ({process_time() - cpu:.0f} s of processor): held-out steering rms "
        f"{results['steering_rms']:.4f}, correlation {results['steering_correlation']:.3f}, "
        f"{results['parameters']:.0f} parameters",
        flush=True,
    )
    lesson.policy.save(out)
    return lesson.policy


def by_policy(policy: Policy, config: Any, track: Track, laps: int, limit: float) -> Laps:
    """Laps of a policy."""

    async def nothing(robot: Robot) -> None:
        pass

    return run(driven(config, track, laps, limit, nothing, {"teaching": policy}), speed="max")


def by_peer(file: Path, config: Any, track: Track, laps: int, limit: float) -> Laps:
    """Laps of TinyLidarNet: every second beam clipped at 10 m, outputs the steering angle and 0 to 1 for 1 to 8 m/s."""
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(model_path=str(file), num_threads=1)
    interpreter.allocate_tensors()
    given, told = interpreter.get_input_details()[0], interpreter.get_output_details()[0]
    wheelbase, radius = config.geometry.wheelbase, config.geometry.radius_min

    async def steer(robot: Robot) -> None:
        source, asked = robot.source("peer"), [0.0, 0.0]

        def heard(reading: Reading[Scan]) -> None:
            ranges = np.nan_to_num(np.asarray(reading.value.ranges), posinf=CLIP)[::2].clip(0.0, CLIP)
            interpreter.set_tensor(given["index"], ranges.astype(np.float32).reshape(given["shape"]))
            interpreter.invoke()
            angle, share = (float(each) for each in interpreter.get_tensor(told["index"])[0])
            v = min(max(1.0 + 7.0 * share, 0.0), V_MAX)
            curvature = min(max(float(np.tan(angle)) / wheelbase, -1.0 / radius), 1.0 / radius)
            asked[:] = v, v * curvature

        robot.sensors["laser"].listeners.append(heard)

        async def drive(ticks: Ticks) -> None:
            async for _ in ticks:
                source.command(*asked)

        robot.add_task("peer", 0.02, drive)

    return run(driven(config, track, laps, limit, steer), speed="max")


def latency(policy: Policy) -> list[float]:
    """The processor's time for a judgement of a scan of 1081 beams, then the time that passed: median and p99, ms.

    They differ by what else the machine does.
    """
    step = 2.0 * np.pi / 1440
    ranges = default_rng(0).uniform(0.5, 9.0, BEAMS).astype(np.float32)
    scan = Scan(-step * (BEAMS // 2), step, 0.025 / 1440, ranges, 0.02, 10.0)
    sight, times = policy.card.sees[0], []
    for _ in range(5000):
        began = thread_time(), perf_counter()
        policy.judge([seen(sight, scan)])
        times.append((1e3 * (thread_time() - began[0]), 1e3 * (perf_counter() - began[1])))
    return [float(np.percentile(column[500:], q)) for column in np.array(times).T for q in (50, 99)]


def main(given: Namespace) -> None:
    """Teach, drive, print."""
    if given.policy is not None:
        policy = load(given.policy)
    else:
        each = given.minutes / len(given.taught)
        files = [recorded(track_of(name), each, given.seed + n, given.kept) for n, name in enumerate(given.taught)]
        policy = taught(files, given.seed, given.kept / "laps.onnx")
    cpu50, cpu99, p50, p99 = latency(policy)
    print(f"a judgement takes {cpu50:.3f} ms of one core, p99 {cpu99:.3f}; {p50:.3f} and {p99:.3f} ms passed")
    tracks = [track_of(word) for word in given.tracks]
    share = -(-given.laps // len(tracks))
    totals: dict[str, list[float]] = {"policy": [], "TinyLidarNet": []}
    print("| track | length m | contender | laps complete | best lap s | mean lap s | ended | cycles missed |")
    print("|---|---|---|---|---|---|---|---|")
    for track in tracks:
        limit = 20.0 + share * track.length / 0.7
        for name in totals:
            config = config_of(track, 1000 + given.seed)
            if name == "policy":
                laps = by_policy(policy, config, track, share, limit)
            else:
                laps = by_peer(given.peer, config, track, share, limit)
            totals[name] += laps.times
            best, mean = (f"{each:.2f}" for each in (min(laps.times), np.mean(laps.times))) if laps.times else "--"
            print(
                f"| {track.name} | {track.length:.1f} | {name} | {len(laps.times)} of {share} | {best} | {mean} | "
                f"{laps.ended} | {laps.misses} |",
                flush=True,
            )
    print(json.dumps({name: len(times) for name, times in totals.items()}))
