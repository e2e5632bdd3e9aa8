"""The way to a light by its four raw readings and odometry: a policy beside the pilot that taught it.

    python -m benchmarks.teaching light [--seeds 8] [--noise SHARE ...]

Each seed has a pilot of its own. It learns in 72 episodes, of which the last 60 count, and then drives for ten minutes:
these are the lessons. Its pupil drives from the 60 starts of the pilot, behind the safety gate like any source. A drive
that has not found the light after 30 s counts as 30 s.
"""

import csv
from argparse import ArgumentParser, Namespace
from contextlib import redirect_stdout
from io import StringIO
from math import hypot
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numpy.random import default_rng

from benchmarks import seeds
from txt1.cli import execute
from txt1.config import Config, load
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.learning.trial import Start, ready_to_learn, task_of
from txt1.robot import Robot
from txt1.teaching.lessons import Ask, drive_in
from txt1.teaching.policy import Policy
from txt1.teaching.teach import summary, teach
from txt1.teaching.training import Recipe

LEARNED: Final = 12  # episodes of the pilot that are not counted
LIMIT: Final = 30.0  # s
LOOK: Final = 0.05  # s between two looks for the goal


def arguments(parser: ArgumentParser) -> None:
    """Add what the benchmark takes."""
    seeds.arguments(parser, "build/teaching/light.jsonl", 8)
    parser.add_argument("--minutes-taught", type=float, default=10.0, help="of the pilot's driving")
    parser.add_argument("--starts", type=int, default=60, help="from which both drive, for each seed")
    parser.add_argument("--noise", nargs="+", default=["0.05", "0.1", "0.3"], help="of a reading, as shares of it")


async def found(config: Config, start: Start, policy: Policy) -> float:
    """The time in which a policy brings the robot from a start to the light, s; `LIMIT` if it does not."""
    task = task_of(config)
    placed = config.model_copy(update={"sim": config.sim.model_copy(update={"start": start.pose(task)})})
    async with Robot.open(config=placed, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        scheduler, began, took = robot.runtime.scheduler, robot.now, LIMIT

        async def watch(ticks: Ticks) -> None:
            nonlocal took
            async for now in ticks:
                assert robot.pose is not None
                if hypot(robot.pose[0] - task.light[0], robot.pose[1] - task.light[1]) <= task.goal_radius:
                    took = min(took, now - began)
                    scheduler.end_at(now)

        robot.add_task("watch", LOOK, watch)
        scheduler.end_at(robot.now + LIMIT)
        await scheduler.ended
    return took


def case(name: str, given: Namespace) -> dict[str, list[float]]:
    """Times to the light, s, of the pilot and of its pupil from the same starts; `name` is noise and seed."""
    noise, seed = name.split(" ")
    settings = [
        "sensors.light.driver=sim_light",
        f"sim.light.noise={noise}",
        f"learning.goal_period={LOOK}",
        f"learning.time_limit={LIMIT}",
    ]
    words = [word for each in settings for word in ("--set", each)]
    with TemporaryDirectory() as made:
        folder = Path(made)
        episodes = LEARNED + given.starts
        learn = ["learn", "--agent", "pilot", "--trials", "1", "--episodes", str(episodes), "--jobs", "1"]
        assert execute([*learn, "--no-pictures", "--seed", seed, "--out", str(folder / "pilot"), *words]) == 0
        with (folder / "pilot" / "learning.csv").open() as file:
            rows = list(csv.DictReader(file))[LEARNED:]
        table, lesson = next((folder / "pilot").rglob("qtable*.json")), folder / "lesson.mcap"
        drive = ["run", "--headless", "--json", "--speed", "max", "--policy", str(table), "--seed", seed]
        seconds = str(60.0 * given.minutes_taught)
        with redirect_stdout(StringIO()):
            assert execute([*drive, "--duration", seconds, "--log", str(lesson), *words]) == 0
        drives = [drive_in(lesson, [Ask("light"), Ask("odometry")], also={"learner"}, lag=0.0)]
        print("\n".join(summary(drives[0])), flush=True)
        policy = teach(drives, Recipe(seed=int(seed)), "benchmark").policy
    config = ready_to_learn(load(None, settings).config)
    times = []
    for number, row in enumerate(rows):
        start = Start(float(row["bearing_rad"]), float(row["heading_rad"]))
        one = config.model_copy(update={"seed": 1000 * int(seed) + number})
        times.append(run(found(one, start, policy), speed="max"))
    pilot = [float(row["time_s"]) if row["success"] == "1" else LIMIT for row in rows]
    optimum = [float(row["floor_s"]) for row in rows]
    print(name, np.mean(pilot), np.mean(times), flush=True)
    return {"pilot": pilot, "policy": times, "optimum": optimum}


def main(given: Namespace) -> None:
    """Print the mean times, and the interval of their ratio over seeds."""
    for noise in given.noise:
        cases = [f"{noise} {seed}" for seed in range(given.first, given.first + given.seeds)]
        results = list(seeds.results(given.kept, cases, lambda name: case(name, given), given.minutes).values())
        means = {name: np.array([np.mean(each[name]) for each in results]) for name in results[0]}
        drawn = default_rng(0).integers(0, len(results), (4000, len(results)))
        ratios = means["policy"][drawn].sum(1) / means["pilot"][drawn].sum(1)
        low, high = np.quantile(ratios, (0.025, 0.975))
        late = sum(time >= LIMIT for each in results for time in each["policy"])
        print(
            f"noise {noise}: the pilot {means['pilot'].mean():.2f} s, the policy {means['policy'].mean():.2f} s "
            f"({means['optimum'].mean():.2f} s at best); ratio {means['policy'].sum() / means['pilot'].sum():.2f}, "
            f"95 % interval over {len(results)} seeds {low:.2f} to {high:.2f}; {late} of "
            f"{sum(len(each['policy']) for each in results)} not found"
        )
