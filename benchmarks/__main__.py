"""``python -m benchmarks [NAME ...] [--quick]``: all of them, or those named."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from importlib.metadata import version
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Final

from benchmarks import (
    decoder,
    estimation,
    firmware,
    learning_time,
    punctuality,
    recording,
    robots,
    simulation_speed,
    statistics_cost,
    stops,
)
from txt1 import __version__
from txt1.kernel import scheduler

PEERS: Final = ("pymavlink", "gymnasium", "numba", "numpy", "mcap", "pydantic")

BENCHMARKS = {
    "simulation_speed": simulation_speed.main,
    "robots": robots.main,
    "statistics_cost": statistics_cost.main,
    "punctuality": punctuality.main,
    "decoder": decoder.main,
    "recording": recording.main,
    "firmware": firmware.main,
    "estimation": estimation.main,
    "learning_time": learning_time.main,
    "stops": stops.main,
}


def main() -> None:
    """Run the benchmarks named on the command line, one after the other."""
    parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which to run: {', '.join(BENCHMARKS)}; default all")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write what is printed to this file, too")
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds, to see that it works")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"there is no benchmark '{unknown[0]}', only {', '.join(BENCHMARKS)}")
    with nullcontext() if arguments.out is None else copied(arguments.out):
        print("\n".join(machine()))
        for name in arguments.names or BENCHMARKS:
            BENCHMARKS[name](quick=arguments.quick)


def machine() -> Iterator[str]:
    """What was measured, with which versions, and on which machine."""
    form = "from source" if str(scheduler.__file__).endswith(".py") else "compiled"
    yield f"version {__version__} {form}, Python {platform.python_version()}, Linux {platform.release()}"
    told = Path("/proc/cpuinfo").read_text(encoding="utf-8") if sys.platform == "linux" else ""
    models = {line.partition(": ")[2] for line in told.splitlines() if line.startswith("model name")}
    processor = ", ".join(models) or platform.machine()
    yield f"{os.cpu_count()} processors: {processor}; load {os.getloadavg()[0]:.2f} at the start"
    installed = [name for name in PEERS if find_spec(name)]
    yield "with " + ", ".join(f"{name} {version(name)}" for name in installed)


@contextmanager
def copied(path: Path) -> Iterator[None]:
    """Write all that is printed to a file, too, when it is complete."""
    printed, screen = StringIO(), sys.stdout

    class Both(StringIO):
        def write(self, text: str) -> int:
            screen.write(text)
            return printed.write(text)

        def flush(self) -> None:
            screen.flush()

    with redirect_stdout(Both()):
        yield
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(printed.getvalue(), encoding="utf-8")


if __name__ == "__main__":
    main()
