"""The laws of `txt1.fleet` over many seeds, with cars on paper (`benchmarks.cars`), and figures for docs/fleet.md.

``python -m benchmarks.cooperation --figures docs/fleet`` draws; ``--share 0.1`` does a tenth of it. What came out is
kept as it comes (``--kept``), so the same command goes on where it was ended; a run counts while its law is the same.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import hypot
from pathlib import Path
from random import Random
from statistics import mean, stdev
from types import ModuleType
from typing import Any, Final

from benchmarks import cars as paper
from benchmarks.cars import Cars, in_line
from benchmarks.rounds import table
from txt1.experiments.figures import COLOURS, LOOKS
from txt1.fleet import guard, radio, steering
from txt1.fleet.convoy import GAP, GAP_GAIN, HEADWAY, Follower, Leader
from txt1.fleet.coverage import Coverage
from txt1.fleet.plan import names
from txt1.fleet.radio import Pose
from txt1.fleet.rendezvous import Rendezvous
from txt1.fleet.search import FOUND, Search
from txt1.kernel.clock import NS_PER_S, stopwatch_ns

NEAR: Final = 2.0  # m within which robots hear one another in every graph
EDGES_FOR: Final = 0.5  # s that a graph of who hears whom lasts
ROOM: Final = (6.0, 6.0)  # m, of the coverage
HALL: Final = (10.0, 10.0)  # m, of the search
SHIFT: Final = 10.0  # h of coverage by cars that begin somewhere else each time


def apart(random: Random, count: int, half: float) -> list[Pose]:
    """So many random poses in a square, 1.2 m from one another at least; m and rad."""
    poses: list[Pose] = []
    while len(poses) < count:
        x, y, theta = random.uniform(-half, half), random.uniform(-half, half), random.uniform(-3.1, 3.1)
        if all(hypot(x - other[0], y - other[1]) >= 1.2 for other in poses):
            poses.append((x, y, theta))
    return poses


def amplification(omega: float, gain: float = GAP_GAIN, headway: float = HEADWAY, tau: float = 0.35) -> float:
    """abs(G) at a frequency in rad/s: by how much a spacing error grows from one robot to the next."""
    s = 1j * omega
    return abs((s + gain) / (tau * s * s + (1.0 + gain * headway) * s + gain))


def convoy(seed: int, leader_lost: bool = False) -> tuple[list[float], int, float]:
    """The spread of each follower's spacing error (m), contacts, and the fastest robot's speed at the end (m/s)."""
    random, team = Random(seed), names(10)
    radius, swing = random.choice([0.0, 6.0, 8.0]), random.uniform(0.05, 0.2)
    course: dict[str, Any] = {"radius": radius, "swing": swing, "period": random.uniform(6.0, 30.0)}
    laws = {name: Follower(team[at - 1]) if at else Leader(speed=0.5, **course) for at, name in enumerate(team)}
    cars = Cars(in_line(team, GAP + random.uniform(0.0, 0.2)), laws)
    errors: list[list[float]] = [[] for _ in team[1:]]
    touched = 0
    for step, time in enumerate(cars.run(60.0)):
        if leader_lost and time >= 40.0 and team[0] not in cars.lost:
            cars.lost.add(team[0])
        if time > 25.0:
            for name, error in zip(team[1:], errors, strict=True):
                error.append(laws[name].spacing - GAP - HEADWAY * cars.said[name].v)  # type: ignore[union-attr,operator]
        if step % 4 == 0:
            touched += len([pair for pair in cars.touching() if team[0] not in pair])
    fastest = max(abs(cars.said[name].v) for name in team[1:])
    return [max(error) - min(error) for error in errors], touched, fastest


def rendezvous(seed: int, limit: float = 1200.0) -> tuple[int, float | None, int]:
    """How many cars, the time until all are in their slots (s; None: not within the limit), and contacts.

    Who hears whom is another random connected graph (a tree) every half second, and whoever is nearer than 2 m.
    """
    random = Random(seed)
    team = names(random.randint(2, 8))
    graphs: dict[int, set[frozenset[str]]] = {}

    def edges(number: int) -> set[frozenset[str]]:
        if number not in graphs:
            own = Random(f"{seed} {number}")
            order = own.sample(team, len(team))
            graphs.clear()
            graphs[number] = {frozenset((order[at], own.choice(order[:at]))) for at in range(1, len(team))}
        return graphs[number]

    def hears(time: float, one: str, other: str) -> bool:
        a, b = cars.said[one], cars.said[other]
        return frozenset((one, other)) in edges(int(time / EDGES_FOR)) or hypot(a.x - b.x, a.y - b.y) < NEAR

    laws = {name: Rendezvous(name, team) for name in team}
    cars = Cars(dict(zip(team, apart(random, len(team), 4.0), strict=True)), laws, hears)
    touched = 0
    for step, time in enumerate(cars.run(limit)):
        touched += len(cars.touching()) if step % 4 == 0 else 0
        middles = [law.middle or (0.0, 0.0) for law in laws.values()]
        agreed = all(hypot(x - middles[0][0], y - middles[0][1]) < 0.01 for x, y in middles)
        apart_all = len({law.slot for law in laws.values()}) == len(team)
        if agreed and apart_all and all(law.parked for law in laws.values()):
            return len(team), time, touched
    return len(team), None, touched


def coverage(seed: int, hours: float = SHIFT, count: int = 4) -> tuple[float, int, float]:
    """The smallest share of the floor visited in any ten minutes, contacts, and the nearest two centres (m)."""
    team = names(count)
    starts = dict(zip(team, apart(Random(seed), count, 2.2), strict=True))
    laws = {name: Coverage(name, team, ROOM) for name in team}
    cars, least, touched, nearest = Cars(starts, laws, room=ROOM), 1.0, 0, 9.0
    for step, time in enumerate(cars.run(3600.0 * hours)):
        if step % 2 == 0:
            nearest = min(nearest, cars.nearest())
            touched += len(cars.touching())
        if step % 400 == 399 and time >= 600.0:
            least = min(least, laws[team[0]].share(time, 600.0))
    return least, touched, nearest


def search(seed: int, count: int, limit: float = 600.0) -> float:
    """S until the first of so many cars, which start in the middle of a hall, is at the light; at most the limit."""
    random, team = Random(seed), names(count)
    while True:
        x, y = random.uniform(-4.3, 4.3), random.uniform(-4.3, 4.3)
        if hypot(x, y) > 3.5:
            break
    starts = {name: (1.2 * (at % 4) - 1.8, 1.2 * (at // 4), random.uniform(-3.1, 3.1)) for at, name in enumerate(team)}
    cars = Cars(starts, {name: Search(name, team, HALL) for name in team}, light=(135.0, x, y), room=HALL)
    for time in cars.run(limit):
        if min(hypot(said.x - x, said.y - y) for said in cars.said.values()) < FOUND:
            return time
    return limit


class Kept:
    """What came out so far, in a file of lines; `minutes` after which no run is begun any more."""

    def __init__(self, file: Path, minutes: float | None) -> None:
        self._file, self._minutes, self._began = file, minutes, stopwatch_ns()
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        self._known = {(row["run"], row["law"], tuple(row["given"])): row["came"] for row in map(json.loads, lines)}

    @property
    def over(self) -> bool:
        """Whether time is over."""
        return self._minutes is not None and stopwatch_ns() - self._began > 60.0 * self._minutes * NS_PER_S

    def each(
        self, run: Callable[..., Any], laws: Sequence[type | ModuleType], given: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """What comes of a run by these laws with each of the arguments, of those begun before time is over."""
        origins = [*laws, guard, steering, radio, paper]
        files = [Path(str(inspect.getsourcefile(one))) for one in origins]
        sources = [inspect.getsource(run).encode(), *(file.read_bytes() for file in files)]
        code = hashlib.sha256(b"".join(sources)).hexdigest()[:12]
        results = []
        for arguments in given:
            key = run.__name__, code, arguments
            if key not in self._known:
                if self.over:
                    continue
                self._known[key] = run(*arguments)
                self._file.parent.mkdir(parents=True, exist_ok=True)
                with self._file.open("a", encoding="utf-8") as rows:
                    row = {"run": key[0], "law": code, "given": arguments, "came": self._known[key]}
                    print(json.dumps(row), file=rows)
            results.append(self._known[key])
        return results


def main() -> None:
    """Print the results, and draw the figures where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="of the seeds and hours")
    parser.add_argument("--figures", type=Path, help="draw into this folder")
    parser.add_argument("--only", choices=("convoy", "rendezvous", "coverage", "search"), help="one law")
    parser.add_argument("--kept", type=Path, default=Path("out/cooperation.jsonl"), help="what came out so far")
    parser.add_argument("--minutes", type=float, help="end after so many; the same command goes on")
    arguments = parser.parse_args()
    share, only, folder = arguments.share, arguments.only, arguments.figures
    kept = Kept(arguments.kept, arguments.minutes)
    if only in (None, "convoy"):
        _convoy(kept, max(2, round(100 * share)), folder)
    if only in (None, "rendezvous"):
        _rendezvous(kept, max(2, round(1000 * share)), folder)
    if only in (None, "coverage"):
        _coverage(kept, max(1, round(100.0 / SHIFT * share)))
    if only in (None, "search"):
        _search(kept, max(3, round(100 * share)), folder)


def _coverage(kept: Kept, shifts: int) -> None:
    runs = kept.each(coverage, [Coverage], [(seed,) for seed in range(shifts)])
    row = (
        f"{SHIFT * len(runs):g}",
        f"{min(least for least, _, _ in runs):.3f}",
        str(sum(touched for _, touched, _ in runs)),
        f"{min(nearest for *_, nearest in runs):.3f} m",
    )
    heads = ("hours", "least share in 10 min", "contacts", "nearest")
    table(f"Coverage of 6 x 6 m by 4 cars, {len(runs)} times {SHIFT:g} h", heads, [row])


def _convoy(kept: Kept, count: int, folder: Path | None) -> None:
    runs = kept.each(convoy, [Follower], [(seed,) for seed in range(count)])
    lost = kept.each(convoy, [Follower], [(seed, True) for seed in range(count)])
    seeds = len(runs)
    grown = sum(any(b > 1.02 * a + 0.001 for a, b in pairwise(spreads)) for spreads, _, _ in runs)
    rows = [(str(at + 2), f"{1e3 * mean(spreads[at] for spreads, _, _ in runs):.1f} mm") for at in range(9)]
    table(
        f"Convoy of ten, {seeds} seeds: {sum(t for _, t, _ in runs)} contacts, in {grown} an error grew down the line; "
        f"leader lost: {sum(t for _, t, _ in lost)} contacts, fastest at the end {max(v for _, _, v in lost):.3f} m/s",
        ("robot", "mean spread of its spacing error"),
        rows,
    )
    if folder is not None:
        figure, axes = _figure(2)
        places = range(2, 11)
        for number, (spreads, _, _) in enumerate(runs):
            label = "" if number else "each seed"
            axes[0].plot(places, [1e3 * each for each in spreads], color="0.7", linewidth=0.7, label=label)
        means = [1e3 * mean(spreads[at] for spreads, _, _ in runs) for at in range(9)]
        axes[0].plot(places, means, "o-", color=COLOURS[0], label="mean")
        axes[0].legend()
        axes[0].set(
            title=f"Spread of the spacing error, {seeds} seeds", xlabel="robot in the line", ylabel="spread, mm"
        )
        frequencies = [10.0 ** (0.02 * n - 2.0) for n in range(200)]
        for headway, look in zip((0.0, 0.2, 0.8), LOOKS, strict=False):
            gains = [amplification(w, headway=headway) for w in frequencies]
            axes[1].semilogx(frequencies, gains, label=f"headway {headway} s", **look)
        axes[1].axhline(1.0, color="k", linewidth=0.7)
        axes[1].set(title="From one robot to the next", xlabel="frequency, rad/s", ylabel="amplitude, ratio")
        axes[1].legend()
        figure.savefig(folder / "convoy.png", dpi=150)


def _rendezvous(kept: Kept, seeds: int, folder: Path | None) -> None:
    runs = kept.each(rendezvous, [Rendezvous], [(seed,) for seed in range(seeds)])
    times = [time for _, time, _ in runs if time is not None]
    row = (
        str(len(runs)),
        str(len(times)),
        f"{mean(times):.1f} s",
        f"{max(times):.1f} s",
        str(sum(t > 0 for *_, t in runs)),
    )
    heads = ("graphs", "converged", "mean", "longest", "runs with contact")
    table("Rendezvous of 2 to 8 cars over random switching graphs", heads, [row])
    if folder is not None:
        figure, axes = _figure(1)
        for count, look in zip(range(2, 9), LOOKS, strict=True):
            own = sorted(time for n, time, _ in runs if n == count and time is not None)
            axes[0].plot(own, [(at + 1) / len(own) for at in range(len(own))], label=f"{count} cars", **look)
        axes[0].set(xlabel="time until all are in their slots, s", ylabel="share of the runs that got there")
        axes[0].set_title(f"Rendezvous over switching graphs, {len(runs)} runs", fontsize="medium")
        axes[0].legend()
        figure.savefig(folder / "rendezvous.png", dpi=150)


def _search(kept: Kept, seeds: int, folder: Path | None) -> None:
    times = {
        count: kept.each(search, [Search, Coverage], [(seed, count) for seed in range(seeds)]) for count in (1, 2, 4, 8)
    }
    half = {count: 1.96 * stdev(each) / len(each) ** 0.5 for count, each in times.items()}
    rows = [(str(n), f"{mean(each):.1f} s", f"+-{half[n]:.1f} s", f"{max(each):.0f} s") for n, each in times.items()]
    heads = ("robots", "mean time to the light", "95 %", "longest")
    table(f"Light search in a hall of 10 x 10 m, {seeds} seeds", heads, rows)
    if folder is not None:
        figure, axes = _figure(1)
        means = [mean(each) for each in times.values()]
        axes[0].errorbar(list(times), means, list(half.values()), fmt="o-", capsize=4, color=COLOURS[0])
        axes[0].set(xlabel="robots", ylabel="time to the light, s", ylim=(0.0, None))
        axes[0].set_title(f"Light search: mean of {seeds} seeds, with 95 %", fontsize="medium")
        figure.savefig(folder / "search.png", dpi=150)


def _figure(count: int):  # type: ignore[no-untyped-def]
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0 * count, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, count, squeeze=False)[0]
    for each in axes:
        each.grid(visible=True, alpha=0.3)
    return figure, axes


if __name__ == "__main__":
    main()
