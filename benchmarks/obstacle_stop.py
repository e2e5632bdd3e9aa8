"""Whether a robot that is driven at random touches anything, its laser late by 0.1 s and the obstacle stop at work.

    python -m benchmarks.obstacle_stop --seeds 1000

Every seed is a world: a room of 5 x 5 m with up to six posts and boxes, and 5 s in it at any speed and on any arc.
"""

import argparse
from math import inf
from typing import NamedTuple

from numpy.random import Generator, default_rng

from benchmarks import seeds
from txt1.config import Config, load
from txt1.control.limits import Fault
from txt1.errors import ConfigError
from txt1.hal.registry import create as create_hal
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import yaw_rate_max
from txt1.robot import Robot
from txt1.sim.obstacles import gap
from txt1.sim.room import clearance

LATE = ("sensors.laser.driver=sim_laser", "sensors.laser.delay=0.1")


class Drive(NamedTuple):
    """A drive through a world."""

    nearest: float  # least distance of the body to anything, m; 0 is a contact
    fastest: float  # m/s
    slowed: int  # cycles in which the obstacle stop has lowered the speed


def random_world(rng: Generator) -> Config:
    """A room of 5 x 5 m with up to six posts and boxes, and a start that is 0.15 m from anything."""
    obstacles = []
    for _ in range(rng.integers(1, 7)):
        x, y = rng.uniform(-2.3, 2.3, 2).round(3).tolist()
        if rng.random() < 0.5:
            obstacles.append(f"{{kind: post, x: {x}, y: {y}, radius: {rng.uniform(0.03, 0.3):.3f}}}")
        else:
            length, width, theta = rng.uniform(0.05, 1.0), rng.uniform(0.05, 0.5), rng.uniform(-3.0, 3.0)
            obstacles.append(
                f"{{kind: box, x: {x}, y: {y}, length: {length:.3f}, width: {width:.3f}, theta: {theta:.3f}}}"
            )
    seed = int(rng.integers(1 << 30))
    config = load(None, [*LATE, f"seed={seed}", f"sim.obstacles=[{', '.join(obstacles)}]"], {}).config
    while True:
        pose = (*rng.uniform(-2.0, 2.0, 2).tolist(), float(rng.uniform(-3.1, 3.1)))
        there = config.model_copy(update={"sim": config.sim.model_copy(update={"start": pose})})
        try:
            hal = create_hal(there)
        except ConfigError:
            continue
        if hal.world.in_the_way(hal.vehicle, *pose, 0.15) is None:  # type: ignore[attr-defined]
            return there


async def drive(seed: int, duration: float = 5.0) -> Drive:
    """Drive at random through the world of a seed."""
    rng = default_rng([15, seed])
    config = random_world(rng)
    nearest, fastest = inf, 0.0
    async with Robot.open(config=config) as robot:
        await robot.load_gains()
        vehicle = robot.hal.vehicle  # type: ignore[attr-defined]

        async def wander(ticks: Ticks) -> None:
            nonlocal nearest, fastest
            ends = 0.0
            async for now in ticks:
                if now >= ends:
                    v = float(rng.uniform(0.2, 1.5))
                    omega = float(rng.uniform(-1.0, 1.0)) * yaw_rate_max(v, config.geometry.radius_min)
                    ends = now + float(rng.uniform(0.5, 3.0))
                robot.command(v, omega)
                body = vehicle.outline(vehicle.pose)
                gaps = [gap(body, each) for each in config.sim.obstacles]
                nearest = min(nearest, *gaps, clearance(*vehicle.pose, vehicle.world.room, vehicle.body))
                fastest = max(fastest, vehicle.motion[3])

        robot.add_task("wander", 0.02, wander)
        robot.runtime.scheduler.end_at(robot.now + duration)
        await robot.runtime.scheduler.ended
        return Drive(float(nearest), float(fastest), robot.faults[Fault.OBSTACLE])


def main() -> None:
    """Print how many drives touch anything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    seeds.arguments(parser, "out/obstacle-stop.jsonl", 1000)
    given = parser.parse_args()
    cases = [str(seed) for seed in range(given.first, given.first + given.seeds)]
    found = seeds.results(given.kept, cases, lambda seed: run(drive(int(seed)), speed="max"), given.minutes)
    drives = [Drive(*each) for each in found.values()]
    contacts = [seed for seed, each in zip(found, drives, strict=True) if each.nearest <= 0.0]
    print(
        f"{len(drives)} worlds: {len(contacts)} contacts {' '.join(contacts)}; nearest "
        f"{min(each.nearest for each in drives):.3f} m, fastest {max(each.fastest for each in drives):.2f} m/s, "
        f"slowed in {sum(each.slowed > 0 for each in drives)}"
    )


if __name__ == "__main__":
    main()
