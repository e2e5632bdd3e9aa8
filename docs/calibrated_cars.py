"""Makes the table in docs/calibrate.md: `python -m docs.calibrated_cars` calibrates 200 simulated cars of each kind.

That takes an hour of a processor. Ended and begun again, it goes on, as its cars are written to out/calibration/.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rigs import page_parts
from txt1.cli import execute
from txt1.config import Config
from txt1.config.sources import vehicles
from txt1.experiments.calibration.simulated_operator import Practised, read_practised

HERE: Final = Path(__file__).parent
TABLES: Final = HERE.parent / "out" / "calibration"
BLIND: Final = ("--set", "geometry.counts_per_rev=0", "--set", "safety.v_dead_band=0.1")


def kinds() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """The kinds in words, their vehicles, and what is set besides."""
    for vehicle in (Config().vehicle, *vehicles()):
        yield f"`{vehicle}`", vehicle, ()
    yield "`rover` without encoders", "rover", BLIND


def row(kind: str, cars: list[Practised]) -> str:
    """A row of the table: the median and the largest of each."""

    def both(values: list[float], factor: float, digits: int) -> str:
        values = sorted(values)
        return f"{factor * values[len(values) // 2]:.{digits}f} / {factor * values[-1]:.{digits}f}"

    verdicts = [car.verdict for car in cars]
    turns = [verdict.turn if verdict.radius is None else verdict.radius for verdict in verdicts]
    cells = (
        kind,
        f"{len(cars)}",
        both([verdict.speed for verdict in verdicts], 100.0, 2),
        both([verdict.drift for verdict in verdicts], 1.0, 3),
        both([turn or 0.0 for turn in turns], 100.0, 2),
        both([car.driving / 60.0 for car in cars], 1.0, 1),
        f"{sum(not car.passes for car in cars)}",
    )
    return f"| {' | '.join(cells)} |"


def table(cars: dict[str, list[Practised]]) -> str:
    """The table of all kinds."""
    head = ("kind", "cars", "speed, %", "straight, degrees/m", "R_min, or turn in place, %", "driving, min", "outside")
    rows = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    return "\n".join(rows + [row(kind, some) for kind, some in cars.items() if some]) + "\n"


def main() -> None:
    """Calibrate, and write the table."""
    parser = argparse.ArgumentParser(prog="docs.calibrated_cars", description=__doc__)
    parser.add_argument("--cars", type=int, default=200, metavar="N", help="so many of each kind, seeds 1 to N; 200")
    count: int = parser.parse_args().cars
    done = {}
    for kind, vehicle, settings in kinds():
        file = TABLES / f"{vehicle}{'-blind' if settings else ''}.csv"
        words = ["calibrate", "--vehicle", vehicle, *settings, "--practice", str(count), "--seed", "1"]
        code = execute([*words, "--write", str(file)])
        if code > 1:
            # 1: a car is outside a limit
            sys.exit(code)
        done[kind] = [car for car in read_practised(file, vehicle) if car.seed <= count]
    page_parts.write(HERE / "calibrate.md", "calibrated_cars", table(done), "docs.calibrated_cars")


if __name__ == "__main__":
    main()
