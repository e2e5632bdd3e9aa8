"""A task of your own beside the robot's: it commands a figure of eight, 20 times a second.

python examples/figure_of_eight.py max
"""

import asyncio
import sys
from math import pi

import txt1
from txt1 import Ticks

V, OMEGA = 0.5, 0.5  # m/s, rad/s: circles of 1 m radius
LAP = 2.0 * pi / OMEGA


async def main() -> None:
    async with txt1.Robot.open(seed=1, settings=["sim.room.length=8"]) as robot:
        await robot.load_gains()

        async def eight(ticks: Ticks) -> None:
            async for now in ticks:
                robot.command(V, OMEGA if now % (2.0 * LAP) < LAP else -OMEGA)

        robot.add_task("eight", period=0.05, task=eight)
        for _ in range(6):
            await asyncio.sleep(LAP / 3.0)
            print(f"t={robot.now:5.1f} s  {robot.odometry}")
        print({name: (task.cycles, task.misses) for name, task in robot.runtime.statistics().items()})


if __name__ == "__main__":
    txt1.run(main(), speed="max" if sys.argv[1:] == ["max"] else None)
