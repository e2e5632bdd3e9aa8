"""A robot that drives with all its sensors but the cameras, at their rates: in virtual time, and 60 s in real time.

    python -m benchmarks.sensors                # how many times real time, from source
    python -m benchmarks.sensors --realtime     # 60 s: controller cycles that are missed
    python -m benchmarks.sensors --reads        # processor time of each simulated sensor's read, the cameras' too

The sensors are four light sensors, IMU (100 Hz), GPS (5 Hz), tracker (100 Hz) and laser scanner (10 Hz), and with
"fused" the filter over encoders, IMU and tracker besides.
"""

import argparse
from functools import partial
from statistics import median
from time import process_time_ns
from typing import Any, Final, NamedTuple

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.kernel.clock import NS_PER_S, processor_ns, stopwatch_ns
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import REFRESH, Robot
from txt1.sensors.base import Reading, Sensor

LIMIT: Final = 50.0  # times real time
SIMULATED: Final = 60.0  # s
SENSORS: Final = tuple(f"sensors.{name}.driver=sim_{name}" for name in ("light", "imu", "gps", "vicon", "laser"))
CAMERAS: Final = tuple(f"sensors.{name}.driver=sim_{name}" for name in ("camera", "depth"))
READ: Final = 10.0  # s
SETUPS: Final[dict[str, tuple[str, ...]]] = {
    "sensors": SENSORS,
    "fused, preset vicon": (*SENSORS, "estimation.preset=vicon"),
}


class Drive(NamedTuple):
    """What a drive took."""

    wall: float  # s
    processor: float  # s of it, of this process
    cycles: int  # of the controller
    missed: int


async def drive(settings: tuple[str, ...], duration: float) -> Drive:
    """Drive a circle with all sensors."""
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()

        async def circle(ticks: Ticks) -> None:
            async for _ in ticks:
                robot.command(0.5, 0.5)

        robot.add_task("circle", REFRESH, circle)
        robot.runtime.scheduler.end_at(robot.now + duration)
        began, spent = stopwatch_ns(), process_time_ns()
        await robot.runtime.scheduler.ended
        wall, processor = (stopwatch_ns() - began) / NS_PER_S, (process_time_ns() - spent) / NS_PER_S
        controller = robot.runtime.statistics()["controller"]
        return Drive(wall, processor, controller.cycles, controller.misses)


async def reads(settings: tuple[str, ...]) -> dict[str, list[float]]:
    """Return what `read` takes of the loop's processor, ms, by sensor: the times of the calls that have a reading."""
    took: dict[str, list[float]] = {}

    def watch(name: str, sensor: Sensor[Any]) -> None:
        read, mine = sensor.read, took.setdefault(name, [])

        def watched(now: float) -> Reading[Any] | None:
            began = processor_ns()
            reading = read(now)
            spent = processor_ns() - began
            if reading is not None:
                mine.append(1e3 * spent / NS_PER_S)
            return reading

        sensor.read = watched  # type: ignore[method-assign]

    async with Robot.open("sim", seed=1, settings=settings) as robot:
        for name, polled in robot.sensors.items():
            watch(name, polled.sensor)
        await robot.load_gains()
        await robot.drive(0.3, 0.3, READ)
    return took


def main() -> None:
    """Print how fast it is, or how punctual."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--realtime", action="store_true")
    parser.add_argument("--reads", action="store_true")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    if given.realtime:
        for name, settings in SETUPS.items():
            one = run(drive(settings, SIMULATED))
            print(f"{name}: {SIMULATED:g} s in real time, {one.cycles} controller cycles, {one.missed} missed")
        return
    if given.reads:
        took = run(reads((*SENSORS, *CAMERAS)), speed="max")
        rows = [(name, str(len(each)), spread(each, 3)) for name, each in took.items()]
        table(f"Processor time of read, ms, in {READ:g} s", ("", "readings", "median (min .. max)"), rows)
        return
    contestants = {name: partial(simulated, settings) for name, settings in SETUPS.items()}
    rows = []
    for name, drives in interleave(given.rounds, contestants).items():
        walls, spent = [SIMULATED / each.wall for each in drives], [SIMULATED / each.processor for each in drives]
        rows.append((name, spread(walls, 0), spread(spent, 0), f"{LIMIT:.0f}", verdict(median(walls) >= LIMIT)))
    header = "", "by wall time: median", "by processor time", "limit", ""
    table(f"Times real time with all sensors but the cameras, {given.rounds} rounds of {SIMULATED:g} s", header, rows)


def simulated(settings: tuple[str, ...]) -> Drive:
    """Drive in virtual time."""
    return run(drive(settings, SIMULATED), speed="max")


if __name__ == "__main__":
    main()
