"""What a simulated laser costs on a map: 1080 beams over 270 degrees, 25 scans a second, with numba and without.

    python -m benchmarks.beams             # prints the table into docs/maps.md
    python -m benchmarks.beams --without   # a row of JSON for each map, without numba

A scan is what a robot's sensor makes of it: the rays, the motion of the sweep, and the noise. The car goes round in a
circle of 0.3 m about the map's start. Times are the processor's, the median of 50 scans.
"""

import argparse
import json
import subprocess
import sys
import warnings
from math import cos, sin
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np

from rigs import page_parts

PAGE = Path(__file__).parents[1] / "docs" / "maps.md"
RATE = 25.0  # scans a second
BEAMS = 1080
SCANS = 50
RADIUS = 0.3  # of the circle, m


def cost(name: str) -> float:
    """The processor time of a scan in a map, ms."""
    from txt1.config import load
    from txt1.sensors.sim_laser import LaserParameters, SimulatedLaser, standing

    config = load(None, [f"sim.room.map={name}"], {}, {}).config
    parameters = LaserParameters(steps=4 * BEAMS // 3, beams=BEAMS, turn_time=1.0 / RATE, range_max=30.0)
    pose, took = [0.0, 0.0, 0.0], []
    rng = np.random.default_rng(1)
    laser = SimulatedLaser("laser", lambda: (pose[0], pose[1], pose[2]), standing(config), parameters, rng)
    for scan in range(SCANS + 5):
        angle = scan / RATE
        pose[:] = RADIUS * cos(angle), RADIUS * sin(angle), angle
        began = process_time()
        laser.read(scan / RATE)
        took.append(1000.0 * (process_time() - began))
    return median(took[5:])


def costs() -> dict[str, float]:
    """The same in each of our maps."""
    from txt1.maps.files import names

    return {name: cost(name) for name in names()}


def row(name: str, times: list[float]) -> str:
    """A row of the table."""
    return f"| {name} | {' | '.join(f'{each:.2f} ms, {0.1 * RATE * each:.1f} %' for each in times)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--without", action="store_true", help="do as if numba were not installed")
    if parser.parse_args().without:
        sys.modules["numba"] = None  # type: ignore[assignment]
        warnings.simplefilter("ignore", RuntimeWarning)
        print(json.dumps(costs()))
        return
    other = subprocess.run(
        [sys.executable, "-m", "benchmarks.beams", "--without"], capture_output=True, text=True, check=True
    )
    with_numba, without = costs(), json.loads(other.stdout)
    lines = [f"| map | {BEAMS} beams with numba; of a core at {RATE:.0f} Hz | without |", "|---|---|---|"]
    lines += [row(name, [each, without[name]]) for name, each in with_numba.items()]
    slowest = max(without, key=lambda name: without[name])
    shown = [*lines[:2], row(f"{slowest}, the slowest of {len(without)}", [with_numba[slowest], without[slowest]])]
    page_parts.write(PAGE, "beams", "\n".join(shown), "benchmarks.beams")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
