"""Three rounds of take-overs beside the same minutes of plain cloning: contacts and take-overs afterwards.

    python -m benchmarks.teaching takeovers --seeds 20

The human is a tidy one, who seldom shows how to get back to the line; this is where cloning is known to fail. Each seed
teaches a first policy by a minute of the human. Then one contender has three rounds: the policy
drives, and the human takes over as soon as a wall is 0.3 m from the car, and drives it back to the line; the policy
is taught again with that. The other contender has the human drive for the same minutes, and is taught with that. At the
end each drives the same minutes, the human still taking over, so that a drive goes on. A contact puts the car back.

The policy sees by a camera. By the laser, it needs no take-over after that minute on any of our tracks, so nothing is
left to gain.
"""

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.random import default_rng

from benchmarks import seeds
from benchmarks.teaching.track import Human, Track, config_of, human_drives, touches, track_of
from txt1.config import Config
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.record.options import RecordingAsked
from txt1.robot import Robot
from txt1.teaching.lessons import Ask, HumanDrive, drive_in
from txt1.teaching.policy import Policy
from txt1.teaching.teach import teach
from txt1.teaching.training import Recipe

NEAR: Final = 0.3  # m to a wall, at which the human takes over
BACK: Final = (0.3, 0.3)  # m from the line, rad from its direction, at which the human lets go
HAND, AIM = 0.03, 0.05  # deviations of a tidy human's hand (share of full lock) and aim (m)
CAREFUL: Final = 1.0  # m/s, while the human brings the car back
ROUNDS: Final = 3
SEES: Final = {
    "camera": (
        "sensors.camera.driver=sim_camera",
        "sensors.camera.options={width: 80, height: 60, rate: 20, field: 90}",
    ),
    "laser": ("sensors.laser.options={steps: 360, beams: 271, turn_time: 0.05, range_max: 10.0}",),
}
RECIPE: Final = Recipe(members=2, epochs=30, steps=700)


def arguments(parser: ArgumentParser) -> None:
    """Add what the benchmark takes."""
    seeds.arguments(parser, "build/teaching/takeovers.jsonl", 20)
    parser.add_argument("--track", default="kart", help="a map, or a .yaml; default: %(default)s")
    parser.add_argument("--see", default="camera", choices=SEES, help="the policy's sensor; default: %(default)s")
    parser.add_argument("--begin", type=float, default=65.0, help="s of the human for the first policy")
    parser.add_argument("--round", type=float, default=60.0, help="s of each round")
    parser.add_argument("--test", type=float, default=120.0, help="s of the drive at the end")


@dataclass
class Count:
    """What happened in a drive."""

    takeovers: int = 0
    stood: int = 0  # take-overs of a policy that stood
    contacts: int = 0
    metres: float = 0.0
    by_hand: float = 0.0  # s


def clearance(robot: Robot) -> float:
    """From the car's outline to the nearest wall, m."""
    vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
    x, y, theta = vehicle.pose
    body, walls = vehicle.body, vehicle.world.room.walls
    c, s = cos(theta), sin(theta)
    ahead, aside = body.centre + 0.5 * body.length, 0.5 * body.width
    behind = body.centre - 0.5 * body.length
    places = [(u, w) for u in (ahead, body.centre, behind) for w in (-aside, 0.0, aside)]
    return float(min(walls.distance(x + c * u - s * w, y + s * u + c * w) for u, w in places))


async def attended(
    config: Config, track: Track, human: Human, policy: Policy, seconds: float, file: Path | None
) -> Count:
    """Let a policy drive with a human who takes over."""
    found = Count()
    asked: dict[str, Any] = {"teaching": policy}
    if file is not None:
        asked["record"] = RecordingAsked(file, None, {}, "max")
    async with Robot.open(config=config, additions=asked) as robot:
        await robot.load_gains()
        hand = robot.source("gamepad")
        place, holds, last = human.place, False, robot.pose
        stood = robot.now

        async def watch(ticks: Ticks) -> None:
            nonlocal holds, last, stood
            async for now in ticks:
                pose = robot.pose
                assert pose is not None
                assert last is not None
                found.metres += float(np.hypot(pose[0] - last[0], pose[1] - last[1]))
                last = pose
                command = human.command(pose, robot.odometry.v, robot.config.geometry.radius_min)
                near = clearance(robot)
                if touches(robot):
                    found.contacts += 1
                    (x, y), (x2, y2) = place.ahead(0.0), place.ahead(0.3)
                    robot.place(x, y, float(np.arctan2(y2 - y, x2 - x)))
                    last = robot.pose
                    human.forget()
                    continue
                if abs(robot.odometry.v) > 0.1 or robot.driver.name == "gamepad":
                    stood = now
                if not holds and (near < NEAR or now - stood > 1.5):
                    # a policy that stands in doubt has to be driven on, too
                    holds, found.takeovers = True, found.takeovers + 1
                    found.stood += near >= NEAR
                if holds:
                    found.by_hand += human.period
                    # off the line a human is careful
                    slow = min(1.0, CAREFUL / max(command[0], 1e-6))
                    hand.command(slow * command[0], slow * command[1])
                    (x, y), (x2, y2) = place.ahead(0.0), place.ahead(0.3)
                    off = np.hypot(pose[0] - x, pose[1] - y)
                    turned = abs(wrap_angle(pose[2] - float(np.arctan2(y2 - y, x2 - x))))
                    if off < BACK[0] and turned < BACK[1] and near > NEAR:
                        holds = False
                        hand.release()

        robot.add_task("watch", human.period, watch)
        robot.runtime.scheduler.end_at(robot.now + seconds)
        await robot.runtime.scheduler.ended
    return found


async def alone(config: Config, human: Human, seconds: float, file: Path) -> None:
    """Record the human."""
    asked = {"record": RecordingAsked(file, None, {}, "max")}
    async with Robot.open(config=config, additions=asked) as robot:
        await robot.load_gains()
        await human_drives(robot, human)
        robot.runtime.scheduler.end_at(robot.now + seconds)
        await robot.runtime.scheduler.ended


def taught(drives: list[HumanDrive], seed: int) -> Policy:
    """A policy of recordings."""
    recipe = Recipe(members=RECIPE.members, epochs=RECIPE.epochs, steps=RECIPE.steps, seed=seed)
    return teach(drives, recipe, "benchmark", folds=2).policy


def case(seed: int, given: Namespace) -> dict[str, list[float]]:
    """What came of a seed: of both contenders at the end, and take-overs and contacts of each round."""
    track = track_of(given.track)
    with TemporaryDirectory() as made:
        folder = Path(made)

        def human(number: int) -> Human:
            return Human(track, default_rng([382, seed, number]), hand=HAND, aim=AIM)

        def config(number: int) -> Config:
            return config_of(track, 100 * seed + number, *SEES[given.see])

        def lesson(number: int, seconds: float) -> HumanDrive:
            file = folder / f"{number}.mcap"
            run(alone(config(number), human(number), seconds, file), speed="max")
            return drive_in(file, [Ask(given.see)])

        first = lesson(0, given.begin)
        policy, drives, rounds = taught([first], seed), [first], []
        for number in range(1, ROUNDS + 1):
            file = folder / f"round-{number}.mcap"
            work = attended(config(number), track, human(number), policy, given.round, file)
            rounds.append(run(work, speed="max"))
            if rounds[-1].by_hand > 0.5:
                drives.append(drive_in(file, [Ask(given.see)]))
            policy = taught(drives, seed)
        cloned = taught([first, lesson(10, ROUNDS * given.round)], seed)
        found = {"rounds": [float(each.takeovers + each.contacts) for each in rounds]}
        for name, one in (("take-overs", policy), ("cloning", cloned)):
            count = run(attended(config(20), track, human(20), one, given.test, None), speed="max")
            found[name] = [
                float(count.takeovers),
                float(count.contacts),
                count.metres,
                count.by_hand,
                float(count.stood),
            ]
        print(seed, found, flush=True)
        return found


def main(given: Namespace) -> None:
    """Print the sums, and the interval of their ratio over seeds."""
    cases = [str(seed) for seed in range(given.first, given.first + given.seeds)]
    results = list(seeds.results(given.kept, cases, lambda seed: case(int(seed), given), given.minutes).values())
    sums = {name: np.array([each[name][0] + each[name][1] for each in results]) for name in ("take-overs", "cloning")}
    rng, ratios = default_rng(0), []
    for _ in range(4000):
        drawn = rng.integers(0, len(results), len(results))
        ratios.append(sums["take-overs"][drawn].sum() / max(sums["cloning"][drawn].sum(), 1.0))
    low, high = np.quantile(ratios, (0.025, 0.975))
    for name, label in (("cloning", "plain cloning"), ("take-overs", "three rounds")):
        rows = np.array([each[name] for each in results])
        print(
            f"{label}: {rows[:, 0].sum():.0f} take-overs ({rows[:, 4].sum():.0f} of a policy that stood) and "
            f"{rows[:, 1].sum():.0f} contacts in {rows[:, 2].sum() / 1000.0:.2f} km, {len(rows)} seeds; "
            f"by hand {rows[:, 3].sum():.0f} s; none at all for {(rows[:, :2].sum(1) == 0).sum()} seeds"
        )
    rounds = np.array([each["rounds"] for each in results]).mean(0)
    print("in each round, mean of the seeds: " + ", ".join(f"{each:.2f}" for each in rounds))
    ratio = sums["take-overs"].sum() / max(sums["cloning"].sum(), 1.0)
    print(f"ratio {ratio:.2f}, 95 % interval over seeds {low:.2f} to {high:.2f}")
