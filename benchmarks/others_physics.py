"""The robot in physics of other people, beside our own: docs/results/others-physics.md.

    python -m benchmarks.others_physics                # all that is not in out/others-physics.jsonl yet, and the page
    python -m benchmarks.others_physics --minutes 10   # no new run after ten minutes; another call goes on

Every vehicle is driven in each physics that models it, by the commands and the API that a user has. A run is a case of
(probe, vehicle, physics, seed); what it shows is kept, and the page is made of what is kept. Speeds and places are the
simulator's true ones.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from hashlib import blake2b
from math import degrees, hypot, pi
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, Final

from benchmarks import seeds, stops
from rigs import page_parts
from txt1 import run
from txt1.config import Config, load
from txt1.errors import HalError, NotArmed, StopNotVerified, TaskFault
from txt1.hal.sim import SimHal
from txt1.model.vehicle import Geometry
from txt1.robot import Robot
from txt1_physics.mjcf import roll_gradient
from txt1_physics.settings import PhysicsSettings

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "results" / "others-physics.md"
CARS: Final = (
    ("txt1", "plain"),
    ("txt1", "mujoco"),
    ("f1tenth", "plain"),
    ("f1tenth", "single-track-drift"),
    ("f1tenth", "multi-body"),
)
ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
IMU: Final = ("sensors.imu.driver=sim_imu",)
FASTEST: Final = {"txt1": 1.5, "f1tenth": 3.0}
STOPS: Final = ("stop", "stale", "task", "encoder", "reversed", "contradicted", "battery")
PROFILES: Final = ("linear-steps", "angular-steps", "circle-fast")
DT: Final = 0.02
TURN: Final = 2.0  # s to either side
HEIGHTS: Final = (0.15, 0.2, 0.25, 0.3, 0.35)  # of the centre of gravity, m
LIFTED: Final = 0.001  # m over the floor: a wheel that hops less on stiff contacts has not lifted
SETTLED: Final = 0.05  # share of a step by which its end value may be off
THESIS: Final = ("car.known=false", "control.linear.kp=11", "control.linear.ki=18", "control.linear.kd=0.25")

Shown = dict[str, Any]


def settings(vehicle: str, physics: str, seed: int, *more: str) -> list[str]:
    """The settings of a case."""
    return [f"vehicle={vehicle}", f"sim.physics={physics}", f"seed={seed}", *more]


def configured(vehicle: str, physics: str, seed: int, *more: str) -> Config:
    """The configuration of a case in an endless room."""
    return load(None, settings(vehicle, physics, seed, *ENDLESS, *more), {}, {}).config


def command(words: str, vehicle: str, physics: str, *more: str) -> subprocess.CompletedProcess[str]:
    """Let a command of txt1 run; a setting in `more` is KEY=VALUE."""
    given = [word for each in (f"sim.physics={physics}", *more) for word in ("--set", each)]
    line = [sys.executable, "-m", "txt1", *shlex.split(words), "--vehicle", vehicle, *given]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)


def wrong(done: subprocess.CompletedProcess[str]) -> Shown:
    """What a command says that fails."""
    return {"failed": (done.stderr.strip().splitlines() or ["?"])[-1], "code": done.returncode}


# -- probes ------------------------------------------------------------------------------------------------------


def cost(vehicle: str, physics: str, seed: int) -> Shown:
    """Processor time of a minute's drive in the command's own process, and what it came to, to the last bit."""
    marks = []
    for _ in range(2):
        trace = blake2b(digest_size=8)

        async def main(trace: Any = trace) -> float:
            async with Robot.open(config=configured(vehicle, physics, seed), arm=True) as robot:
                await robot.load_gains()
                vehicle_now = simulated(robot)
                began = process_time()
                with suppress(NotArmed):
                    for v, omega in ((0.3, 0.2), (0.8, -0.5), (1.2, 0.6), (-0.4, 0.3)):
                        await robot.drive(v, omega, duration=15.0)
                        trace.update(repr(vehicle_now.motion).encode())
                return process_time() - began

        took = run(main(), speed="max")
        marks.append(trace.hexdigest())
    return {"seconds": took, "times": 60.0 / took, "repeats": marks[0] == marks[1]}


def hal(vehicle: str, physics: str, seed: int) -> Shown:
    """``txt1 hal check sim``."""
    done = command("hal check sim --wheels-up", vehicle, physics)
    lines = done.stdout.splitlines()
    failed = [line for line in lines if "FAIL" in line or ": failed" in line]
    passed = sum(": passed" in line or line.endswith(": ok") for line in lines)
    return {"code": done.returncode, "passed": passed, "failed": failed}


def tests(vehicle: str, physics: str, seed: int, *more: str) -> Shown:
    """The thesis's drive tests."""
    shown: Shown = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in PROFILES:
            words = f"experiment {name} --json --no-figure --seed {seed} --out {folder}/{name}"
            done = command(words, vehicle, physics, *ENDLESS, *more)
            try:
                told = json.loads(done.stdout.strip().splitlines()[-1])
            except (IndexError, ValueError):
                shown[name] = wrong(done)
                continue
            steps = told.get("steps", [])
            errors = [abs(each["steady_error"] / (each["after"] - each["before"])) for each in steps]
            shown[name] = {
                "ended": told["stopped_by"],
                "steps": len(steps),
                "settled": settled(steps),
                "rise": median([each["rise"] for each in steps if each["rise"] is not None] or [float("nan")]),
                "off": max(errors, default=None),
                "circle": told.get("circle"),
            }
    return shown


def settled(steps: list[Shown]) -> int:
    """How many steps of a test come to their set-points and stay there."""
    return sum(
        each["settling"] is not None and abs(each["steady_error"]) <= SETTLED * abs(each["after"] - each["before"])
        for each in steps
    )


def thesis(vehicle: str, physics: str, seed: int) -> Shown:
    """The drive tests of an F1TENTH car with the TXT-1's loops; they are the TXT-1's own anyway."""
    return {} if vehicle == "txt1" else tests(vehicle, physics, seed, *THESIS)


def tuned(vehicle: str, physics: str, seed: int) -> Shown:
    """``txt1 tune``: the gains that it proposes, and what the drive tests with them come to."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "tuned.yaml")
        done = command(f"tune --no-trial --seed {seed} --jobs 1 --write {file}", vehicle, physics, *ENDLESS)
        if done.returncode or not file.exists():
            return wrong(done)
        gains = load(str(file), [], {}, {}).config.control
        words = f"experiment linear-steps --json --no-figure --seed {seed} --out {folder}/steps --config {file}"
        steps = json.loads(command(words, vehicle, physics, *ENDLESS).stdout.strip().splitlines()[-1])["steps"]
    return {"kp": gains.linear.kp, "ki": gains.linear.ki, "settled": settled(steps), "steps": len(steps)}


def practised(vehicle: str, physics: str, seed: int) -> Shown:
    """``txt1 calibrate --practice 2``."""
    done = command(f"calibrate --practice 2 --seed {seed}", vehicle, physics)
    found = re.search(r"(\d+) cars, (?:(\d+) of them not|all)", done.stdout)
    if found is None:
        return wrong(done)
    worst = [line.strip() for line in done.stdout.splitlines() if line.startswith("  ")]
    return {"cars": int(found[1]), "bad": int(found[2] or 0), "worst": worst}


def stopped(vehicle: str, physics: str, seed: int) -> Shown:
    """Cases of `benchmarks.stops` at 0.4 to 1 m/s."""
    shown: Shown = {}
    for case in stops.CASES:
        if case.name in STOPS and case.kind == "sim":
            given = tuple(settings(vehicle, physics, seed, *ENDLESS))
            result = run(stops.once(stops.replace(case, settings=given), seed), speed="max")
            shown[case.name] = result._asdict()
    return shown


def full_speed(vehicle: str, physics: str, seed: int) -> Shown:
    """An emergency stop at full speed, straight on and at full lock."""
    shown: Shown = {}
    for name, omega in (("straight", 0.0), ("lock", 20.0)):

        async def main(omega: float = omega) -> Shown:
            async with Robot.open(config=configured(vehicle, physics, seed), arm=True) as robot:
                await robot.load_gains()
                car = simulated(robot)
                with suppress(NotArmed):
                    await robot.drive(FASTEST[vehicle], omega, duration=3.0 + 0.1 * seed)
                at, fastest, began = car.pose, abs(car.state.v), robot.now
                armed = robot.armed
                robot.stop()
                standing = None
                while robot.now < began + 6.0:
                    await asyncio.sleep(DT)
                    if abs(car.state.v) > stops.STANDING:
                        standing = None
                    elif standing is None:
                        standing = robot.now - began
                way = hypot(car.pose[0] - at[0], car.pose[1] - at[1])
                return {"armed": armed, "fastest": fastest, "standing": standing, "way": way}

        shown[name] = guarded(main)
    return shown


def runaway(vehicle: str, physics: str, seed: int) -> Shown:
    """Set-points that step to full speed and back: whether the gate takes that for a runaway."""

    async def main() -> Shown:
        async with Robot.open(config=configured(vehicle, physics, seed), arm=True) as robot:
            await robot.load_gains()
            for k in range(6):
                try:
                    await robot.drive((-1.0) ** k * FASTEST[vehicle], 0.0, duration=2.0)
                except NotArmed as refusal:
                    return {"disarmed": refusal.reason, "after": robot.now}
            return {"disarmed": None}

    return guarded(main)


def roll_over(vehicle: str, physics: str, seed: int) -> Shown:
    """Twelve seconds of full lock to either side at full speed, without and with the roll-over guard.

    In MuJoCo with several heights of the centre of gravity, which the guard is told, as it is how far the body leans.
    """
    shown: Shown = {}
    for height in HEIGHTS if physics == "mujoco" else (None,):
        tall, known = (), ()
        if height is not None:
            tall = (f"physics.gravity_height={height}",)
            lean = roll_gradient(Geometry(), PhysicsSettings(gravity_height=height))
            known = (f"roll_guard.gravity_height={height}", f"roll_guard.roll_gradient={lean}")
        for name, guard in (("without", ()), ("guard", (*IMU, "roll_guard.enabled=true", *known))):
            given = configured(vehicle, physics, seed, *guard, *tall)
            shown[f"{name} {height or ''}".strip()] = slalom(given, FASTEST[vehicle])
    return shown


def slalom(given: Config, speed: float) -> Shown:
    """A slalom at full lock: how far wheels rise from the floor, for how long, and what ends it."""
    seen = {"height": 0.0, "lifted": 0.0, "roll": 0.0, "way": 0.0, "sideways": 0.0}

    async def main() -> Shown:
        async with Robot.open(config=given, arm=True) as robot:
            await robot.load_gains()
            await asyncio.sleep(0.2)
            car = simulated(robot)
            last = car.pose
            with suppress(NotArmed):
                for step in range(round(12.0 / DT)):
                    robot.program.insist(speed, 20.0 if int(step * DT / TURN) % 2 else -20.0)
                    await asyncio.sleep(DT)
                    way, turned = hypot(car.pose[0] - last[0], car.pose[1] - last[1]), wrapped(car.pose[2] - last[2])
                    seen["way"] += way
                    seen["sideways"] = max(seen["sideways"], way * abs(turned) / DT**2)
                    last = car.pose
                    if car.physics is not None:
                        height = max(car.physics.heights(), default=0.0)
                        seen["height"] = max(seen["height"], height)
                        seen["lifted"] += DT * (height > LIFTED)
                        seen["roll"] = max(seen["roll"], degrees(abs(car.physics.attitude(car.pose)[0])))
            return {**seen, "disarmed": None if robot.armed else robot.reason}

    shown = guarded(main)
    return {**seen, **shown}


def estimated(vehicle: str, physics: str, seed: int) -> Shown:
    """A minute of curves at 0.5 m/s: how far off encoders and the filter with an IMU are at the end."""

    async def main() -> Shown:
        given = configured(vehicle, physics, seed, *IMU, "estimation.preset=gyro")
        async with Robot.open(config=given, arm=True) as robot:
            await robot.load_gains()
            car = simulated(robot)
            for k in range(12):
                await robot.drive(0.5, (-1.0) ** (k // 3) * 0.4, duration=5.0)
            true, odometry, estimate = car.pose, robot.odometry, robot.estimate
            off = [
                {"place": hypot(each.x - true[0], each.y - true[1]), "heading": abs(wrapped(each.theta - true[2]))}
                for each in (odometry, estimate)
            ]
            return {"encoders": off[0], "filter": off[1]}

    return guarded(main)


def learned(vehicle: str, physics: str, seed: int) -> Shown:
    """Five episodes of the learner that measures first, `pilot`, in the thesis's room."""
    with tempfile.TemporaryDirectory() as folder:
        words = f"learn --agent pilot --trials 1 --episodes 5 --jobs 1 --no-pictures --seed {seed} --out {folder}/pilot"
        done = command(words, vehicle, physics)
    found = re.search(r"success ([\d.]+)%, .* mean ([\d.]+) s.* ratio ([\d.]+)", done.stdout)
    return wrong(done) if found is None else {"success": float(found[1]), "mean": float(found[2])}


def simulated(robot: Robot) -> Any:
    """The simulated vehicle."""
    assert isinstance(robot.hal, SimHal)
    return robot.hal.vehicle


def wrapped(angle: float) -> float:
    """An angle within half a turn, rad."""
    return (angle + pi) % (2.0 * pi) - pi


def guarded(main: Callable[[], Any]) -> Shown:
    """What a run shows, or the error that ended it."""
    try:
        shown: Shown = run(main(), speed="max")
    except (TaskFault, HalError, StopNotVerified, NotArmed) as error:
        shown = {"failed": str(error)}
    return shown


PROBES: Final[dict[str, tuple[Callable[[str, str, int], Shown], int]]] = {
    "cost": (cost, 1),
    "hal": (hal, 1),
    "roll_over": (roll_over, 5),
    "full_speed": (full_speed, 10),
    "runaway": (runaway, 10),
    "estimated": (estimated, 5),
    "stopped": (stopped, 5),
    "tests": (tests, 5),
    "thesis": (thesis, 3),
    "tuned": (tuned, 1),
    "learned": (learned, 3),
    "practised": (practised, 1),
}
"""What is looked at, and with how many seeds."""


def case(text: str) -> Shown:
    """What a case shows."""
    probe, vehicle, physics, seed = text.split()
    return PROBES[probe][0](vehicle, physics, int(seed))


def cases(names: Iterable[str]) -> list[str]:
    """All cases of these probes."""
    return [
        f"{name} {vehicle} {physics} {seed}"
        for name in names
        for vehicle, physics in CARS
        for seed in range(1, PROBES[name][1] + 1)
    ]


# -- the page ----------------------------------------------------------------------------------------------------

Kept = dict[tuple[str, str, str], list[Shown]]
WORDS: Final = {"plain": "ours", "single-track-drift": "drift", "multi-body": "multi-body", "mujoco": "MuJoCo"}


def row(*cells: object) -> str:
    """A row of a table in Markdown."""
    return f"| {' | '.join(map(str, cells))} |"


def head(*cells: str) -> list[str]:
    """The head of a table."""
    return [row(*cells), "|" + "---|" * len(cells)]


def worst(values: Iterable[float | None], digits: int = 2) -> str:
    """Median and worst of some figures."""
    numbers = list(values)
    longest = most(numbers, digits)
    there = [each for each in numbers if each is not None]
    return f"{median(there):.{digits}f} ({longest})" if there and len(there) == len(numbers) else longest


def most(values: Iterable[float | None], digits: int = 2) -> str:
    """The worst of some figures."""
    there = list(values)
    if not there:
        return "-"
    if None in there:
        return f"{sum(each is None for each in there)} of {len(there)} do not"
    return f"{max(each for each in there if each is not None):.{digits}f}"


def failures(runs: list[Shown]) -> str:
    """How many runs ended in an error, for a cell."""
    failed = [each for each in runs if "failed" in each]
    return f"{len(failed)} of {len(runs)} fail" if failed else ""


def table_of_costs(kept: Kept) -> list[str]:
    """Costs and repetition."""
    lines = head("car", "physics", "times real time", "repeats bit for bit", "`hal check`", "`runaway`: false alarms")
    for car in CARS:
        [drive], [check] = kept.get(("cost", *car), [{}]), kept.get(("hal", *car), [{}])
        alarms = kept.get(("runaway", *car), [])
        told = sum(bool(each.get("disarmed") or "failed" in each) for each in alarms)
        checked = f"{check['passed']} passed, {len(check['failed'])} failed" if check else "-"
        times, repeats = (f"{drive['times']:.0f}", "yes" if drive["repeats"] else "no") if drive else ("-", "-")
        lines.append(row(car[0], WORDS[car[1]], times, repeats, checked, f"{told} of {len(alarms)}"))
    return lines


def table_of_tests(kept: Kept, probe: str = "tests") -> list[str]:
    """The drive tests."""
    titles = "speed steps settled", "rise", "yaw steps settled", "circle 1 m", "laps apart"
    lines = head("car", "physics", *titles)
    for car in CARS:
        runs = [each for each in kept.get((probe, *car), []) if each]
        if not runs:
            continue
        cells = []
        for name in ("linear-steps", "angular-steps"):
            there = [each[name] for each in runs if "failed" not in each[name]]
            cells.append(failures([each[name] for each in runs]) or among([each["settled"] for each in there]))
            if there:
                cells[-1] += f" of {there[0]['steps']}"
            if name == "linear-steps":
                cells.append(among([each["rise"] for each in there], 2) + " s")
        circles = [found for each in runs if (found := each["circle-fast"].get("circle"))]
        apart = [1000.0 * each["lap_to_lap"] for each in circles if each["lap_to_lap"] is not None]
        cells += [among([each["radius"] for each in circles], 3) + " m", among(apart) + " mm" if apart else "-"]
        lines.append(row(car[0], WORDS[car[1]], *cells))
    return lines


def among(values: list[float], digits: int = 0) -> str:
    """The median of some figures, and the range where they differ."""
    if not values:
        return "-"
    least, mean, most = (f"{each:.{digits}f}" for each in (min(values), median(values), max(values)))
    return mean if least == most else f"{mean} ({least} to {most})"


def table_of_stops(kept: Kept) -> list[str]:
    """Stops at full speed, and those of `benchmarks.stops`."""
    lines = head("car", "physics", "full speed, straight: s to stand", "way, m", "at full lock: s", "way, m")
    for car in CARS:
        runs = kept.get(("full_speed", *car), [])
        cells = []
        for name in ("straight", "lock"):
            each = [one[name] for one in runs]
            there = [one for one in each if "failed" not in one]
            cells += [failures(each) or most(one["standing"] for one in there), most(one["way"] for one in there)]
        lines.append(row(car[0], WORDS[car[1]], *cells))
    lines += [
        "",
        *head("event at 0.4 to 1 m/s: s to stand", *(f"{car}, {WORDS[name]}" for car, name in CARS)),
    ]
    for each in stops.CASES:
        if each.name not in STOPS or each.kind != "sim":
            continue
        cells = [most(one[each.name]["standing"] for one in kept.get(("stopped", *car), [])) for car in CARS]
        lines.append(row(each.about, *cells))
    return lines


def table_of_roll_over(kept: Kept) -> list[str]:
    """The slalom."""
    titles = "centre of gravity", "without the guard: wheels rise", "rolled over", "with it: wheels rise", "rolled over"
    lines = head("car", "physics", *titles, "largest v omega", "way lost")
    for car in CARS:
        runs = kept.get(("roll_over", *car), [])
        for height in HEIGHTS if car[1] == "mujoco" else (None,):
            pair = [[one[f"{name} {height or ''}".strip()] for one in runs] for name in ("without", "guard")]
            if not runs:
                continue
            cells: list[str] = []
            for some in pair:
                risen = max(1000.0 * one["height"] for one in some)
                long = max(one["lifted"] for one in some)
                rises = "not" if long == 0.0 else f"{risen:.0f} mm, {long:.1f} s"
                cells += [rises, f"{sum('failed' in one for one in some)} of {len(some)}"]
            if car[1] in ("plain", "single-track-drift"):
                cells = ["unknown"] * 4
            sideways = [f"{median(one['sideways'] for one in some):.1f}" for some in pair]
            lost = 1.0 - sum(one["way"] for one in pair[1]) / sum(one["way"] for one in pair[0])
            over = any("failed" in one for some in pair for one in some)
            tall = f"{height:g} m" if height else "-"
            more = f"{' -> '.join(sideways)} m/s^2", "-" if over else f"{100.0 * lost:.0f} %"
            lines.append(row(car[0], WORDS[car[1]], tall, *cells, *more))
    return lines


def table_of_the_rest(kept: Kept) -> list[str]:
    """Estimation, tuning, calibration, learning."""
    titles = "encoders off after 30 m", "filter off", "`tune`: kp, ki", "steps settled", "`calibrate --practice 2`"
    lines = head("car", "physics", *titles, "`learn --agent pilot`")
    for car in CARS:
        runs = kept.get(("estimated", *car), [])
        cells = [
            worst((one[name]["place"] for one in runs if name in one), 3) + " m" if runs else "-"
            for name in ("encoders", "filter")
        ]
        [tune] = kept.get(("tuned", *car), [{}])
        [practice] = kept.get(("practised", *car), [{}])
        learning = kept.get(("learned", *car), [])
        cells += (
            [f"{tune['kp']:.1f}, {tune['ki']:.1f}", f"{tune['settled']} of {tune['steps']}"]
            if "kp" in tune
            else ["-", "-"]
        )
        good = f"{practice['cars'] - practice['bad']} of {practice['cars']} good" if "cars" in practice else "-"
        cells.append(practice.get("failed") or good)
        found = [f"{one['success']:.0f} %, {one['mean']:.1f} s" for one in learning if "success" in one]
        cells.append("; ".join(found) or failures(learning) or "-")
        lines.append(row(car[0], WORDS[car[1]], *cells))
    return lines


def table_of_campaigns(kept: Kept) -> list[str]:
    """Runs of the campaign that are kept."""
    lines = head("physics", "car", "runs of 20 s", "violations", "cycles in motion")
    for vehicle, physics in CARS:
        file = ROOT / "out" / "torture" / f"campaign-{physics}.jsonl"
        if physics == "plain" or not file.exists():
            continue
        # the last of each seed: a run is done again when the code has changed
        rows = list({each["seed"]: each for each in map(json.loads, file.read_text().splitlines())}.values())
        moving, cycles = sum(each["moving"] for each in rows), sum(each["cycles"] for each in rows)
        broken = sum(bool(each["broken"]) for each in rows)
        lines.append(row(WORDS[physics], vehicle, len(rows), broken, f"{100.0 * moving / max(1, cycles):.0f} %"))
    return lines


TABLES: Final[dict[str, Callable[[Kept], list[str]]]] = {
    "costs": table_of_costs,
    "roll-over": table_of_roll_over,
    "stops": table_of_stops,
    "campaigns": table_of_campaigns,
    "drive tests": table_of_tests,
    "rest": table_of_the_rest,
}
ON_THE_PAGE: Final = ("roll-over", "stops")


def write(results: dict[str, Shown]) -> None:
    """Put tables into the page, between the lines that name them, and print the others; without runs none is made."""
    kept: Kept = {}
    for text, shown in results.items():
        probe, vehicle, physics, _ = text.split()
        kept.setdefault((probe, vehicle, physics), []).append(shown)
    for name, table in TABLES.items():
        if (lines := table(kept)) == table({}):
            continue
        if name in ON_THE_PAGE:
            page_parts.write(PAGE, name, "\n".join(lines), "benchmarks.others_physics")
        else:
            print("", name, *lines, sep="\n")


def main() -> None:
    """Run what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("probes", nargs="*", metavar="PROBE", help=f"of {', '.join(PROBES)}; default: all")
    parser.add_argument("--kept", type=Path, default=ROOT / "out" / "others-physics.jsonl", help="results so far")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="time after which no new run is begun")
    given = parser.parse_args()
    seeds.results(given.kept, cases(given.probes or PROBES), case, given.minutes)
    write(seeds.results(given.kept, cases(PROBES), case, -1.0))


if __name__ == "__main__":
    main()
