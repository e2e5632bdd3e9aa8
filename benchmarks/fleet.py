"""Fleets of any car by the laws of `txt1.fleet`: who touches whom, and who is stuck.

``python -m benchmarks.fleet`` drives cars on paper (`benchmarks.cars`); ``--robots`` the full simulated robots, which
take some ten times as long. Each run has four cars of one kind, or one of each ("mixed"), a random room and random
starts. What came out is kept as it comes, so the same command goes on where it was ended; ``--minutes`` ends it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
from math import hypot, pi
from pathlib import Path
from random import Random
from typing import Any, Final

from benchmarks.cars import Cars, in_line, shape_of
from benchmarks.cooperation import Kept
from benchmarks.rounds import table
from txt1.fleet import body, convoy, coverage, fleet, rendezvous, search
from txt1.fleet import cooperation as parts
from txt1.fleet.fleet import Fleet
from txt1.fleet.guard import ROBOT_MARGIN, WALL
from txt1.fleet.law import LAWS, make_law
from txt1.fleet.plan import FleetPlan, MemberPlan
from txt1.fleet.radio import Pose
from txt1.kernel.loop import run
from txt1.sim import world
from txt1.sim.dynamics import Motion
from txt1.sim.vehicle import Vehicle

KINDS: Final = ("txt1", "f1tenth", "donkeycar", "rover")
TEAMS: Final = {**{kind: (kind,) * 4 for kind in KINDS}, "mixed": KINDS}
LENGTH: Final = 60.0  # s of each run
STILL: Final = 20.0  # s in which a car comes no further than 0.25 m although its law wants to drive: stuck
NAMES: Final = ("car1", "car2", "car3", "car4")
SOURCES: Final = [body, parts, fleet, convoy, coverage, rendezvous, search]


def scene(
    law: str, team: str, seed: int
) -> tuple[dict[str, str], dict[str, Pose], tuple[float, float], dict[str, Any]]:
    """Return kinds and starts by name, the room (m), and the law's settings."""
    random = Random(f"{law} {team} {seed}")
    kinds = list(TEAMS[team])
    random.shuffle(kinds)
    bodies = [shape_of(kind).body for kind in kinds]
    reach = max(each.reach + abs(each.centre) for each in bodies)
    settings: dict[str, Any] = {"law": law}
    if law == "convoy":
        radius = random.uniform(1.5, 2.5) * max(each.radius for each in bodies)
        settings |= {"radius": radius, "swing": random.uniform(0.0, 0.1), "period": random.uniform(6.0, 30.0)}
        side = 2.0 * (radius + 4.0 * 2.0 * reach + 1.0)
        spacing = 2.0 * reach + convoy.SLACK
        starts = {name: (x + 1.0, y - radius, t) for name, (x, y, t) in in_line(NAMES, spacing).items()}
        return dict(zip(NAMES, kinds, strict=True)), starts, (side, side), settings
    room = random.uniform(6.0, 10.0), random.uniform(6.0, 10.0)
    places: list[Pose] = []
    while len(places) < len(kinds):
        most_x, most_y = (0.5 * side - reach - WALL - 0.1 for side in room)
        x, y = random.uniform(-most_x, most_x), random.uniform(-most_y, most_y)
        if all(hypot(x - a, y - b) > 2.0 * reach + ROBOT_MARGIN + 0.1 for a, b, _ in places):
            places.append((x, y, random.uniform(-pi, pi)))
    return dict(zip(NAMES, kinds, strict=True)), dict(zip(NAMES, places, strict=True)), room, settings


def paper(law: str, team: str, seed: int) -> tuple[int, int]:
    """Return the steps with a contact, and how many cars were stuck at the end."""
    kinds, starts, room, settings = scene(law, team, seed)
    shapes = {name: shape_of(kind) for name, kind in kinds.items()}
    laws = {name: make_law(name, list(NAMES), room, settings, shapes[name].body) for name in NAMES}
    light = (135.0, 0.3 * room[0], 0.3 * room[1])
    cars, touched = Cars(starts, laws, light=light, room=room, shapes=shapes), 0
    moved = {name: (*starts[name][:2], 0.0) for name in NAMES}
    for step, time in enumerate(cars.run(LENGTH)):
        touched += len(cars.touching()) if step % 2 == 0 else 0
        for name, said in cars.said.items():
            x, y, _ = moved[name]
            if name not in cars.wants or hypot(said.x - x, said.y - y) > parts.STUCK_WITHIN:
                moved[name] = said.x, said.y, time
    return touched, sum(LENGTH - since > STILL for *_, since in moved.values())


def robots(law: str, team: str, seed: int) -> tuple[int, int]:
    """Return the same of the full simulated robots; a contact is a vehicle that the world held."""
    kinds, starts, room, settings = scene(law, team, seed)
    light = [0.3 * room[0], 0.3 * room[1]]
    plan = FleetPlan(
        robots={name: MemberPlan(start=starts[name], set={"vehicle": kind}) for name, kind in kinds.items()},
        all={"sim": {"room": {"length": room[0], "width": room[1], "light": light}}},
        cooperate=settings,
    )
    touched, plain = 0, world.halted

    def halted(vehicle: Vehicle, before: Motion, after: Motion) -> Motion:
        nonlocal touched
        touched += 1
        return plain(vehicle, before, after)

    async def drive() -> int:
        async with Fleet.open(plan, seed=seed) as team:
            team.begin_tasks()
            await asyncio.sleep(LENGTH)
            return sum(bool(part.stuck or part.silent) for part in team.cooperations.values())

    world.halted = halted
    try:
        stuck = run(drive(), speed="max")
    finally:
        world.halted = plain
    return touched, stuck


def main() -> None:
    """Print a table of what was driven so far."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", action="store_true", help="the full simulated robots")
    parser.add_argument("--seeds", type=int, default=1000, help="of each car and law")
    parser.add_argument("--law", choices=list(LAWS), help="one law")
    parser.add_argument("--team", choices=list(TEAMS), help="one team")
    parser.add_argument("--kept", type=Path, default=Path("out/fleet.jsonl"), help="what came out so far")
    parser.add_argument("--minutes", type=float, help="end after so many; the same command goes on")
    arguments = parser.parse_args()
    drive = robots if arguments.robots else paper
    kept = Kept(arguments.kept, arguments.minutes)
    cases = [(law, team) for law in LAWS for team in TEAMS]
    cases = [(a, b) for a, b in cases if arguments.law in (None, a) and arguments.team in (None, b)]
    came: dict[tuple[str, str], list[Any]] = {case: [] for case in cases}
    for seed in range(arguments.seeds):  # so that each case has as many wherever it was ended
        if kept.over:
            break
        for case in cases:
            came[case] += kept.each(drive, SOURCES, [(*case, seed)])
    rows = [
        (law, team, str(len(runs)), str(sum(t > 0 for t, _ in runs)), str(sum(s > 0 for _, s in runs)))
        for (law, team), runs in came.items()
    ]
    heads = ("law", "cars", "seeds", "with a contact", "with somebody stuck at the end")
    table(f"{'Robots' if arguments.robots else 'Cars on paper'}, {LENGTH:g} s each", heads, rows)
    print(json.dumps({"contacts": [(a, b, n) for (a, b), runs in came.items() for n, (t, _) in enumerate(runs) if t]}))


if __name__ == "__main__":
    main()
