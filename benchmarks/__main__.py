"""``python -m benchmarks [NAME ...] [--quick]``: all of them, or those named."""

from __future__ import annotations

import argparse
import os
import platform

from benchmarks import (
    decoder,
    firmware,
    learning_time,
    punctuality,
    recording,
    robots,
    simulation_speed,
    statistics_cost,
)
from txt1.kernel import scheduler

BENCHMARKS = {
    "simulation_speed": simulation_speed.main,
    "robots": robots.main,
    "statistics_cost": statistics_cost.main,
    "punctuality": punctuality.main,
    "decoder": decoder.main,
    "recording": recording.main,
    "firmware": firmware.main,
    "learning_time": learning_time.main,
}


def main() -> None:
    """Run the benchmarks named on the command line, one after the other."""
    parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which to run: {', '.join(BENCHMARKS)}; default all")
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds, to see that it works")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"there is no benchmark '{unknown[0]}', only {', '.join(BENCHMARKS)}")
    load = os.getloadavg()[0]
    form = "from source" if str(scheduler.__file__).endswith(".py") else "compiled"
    python = f"Python {platform.python_version()}, {platform.machine()}"
    print(f"txt1 {form}, {python}, {os.cpu_count()} processors, load {load:.2f}")
    for name in arguments.names or BENCHMARKS:
        BENCHMARKS[name](quick=arguments.quick)


if __name__ == "__main__":
    main()
