"""Teach by driving, in one program: a hand drives round a simulated track, then the policy drives."""

import asyncio
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from txt1 import Robot, run
from txt1.record.options import RecordingAsked
from txt1.teaching.teach import Ask, Recipe, drive_in, teach

TRACK = ("sim.room.map=oval", "sensors.laser.driver=sim_laser", "sim.battery.used_1=null")
NOISE = np.random.default_rng(1)


def hand(ranges):
    """Steer to where there is more room; a person does better."""
    left, right = np.minimum(ranges, 4.0)[len(ranges) // 2 :].mean(), np.minimum(ranges, 4.0)[: len(ranges) // 2].mean()
    return 0.8, 1.2 * (left - right) + 0.1 * NOISE.standard_normal()


async def lesson(file, seconds=120.0):
    async with Robot.open(settings=TRACK, additions={"record": RecordingAsked(file, None, {}, "max")}) as robot:
        await robot.load_gains()
        gamepad = robot.source("gamepad")
        while robot.now < seconds:
            if scan := robot.sensor("laser"):
                gamepad.command(*hand(scan.value.ranges))
            await asyncio.sleep(0.05)


async def drives(policy, seconds=30.0):
    async with Robot.open(settings=TRACK, additions={"teaching": policy}) as robot:
        await robot.load_gains()
        await asyncio.sleep(seconds)
        return robot.driver.name, robot.odometry


with TemporaryDirectory() as folder:
    file = Path(folder) / "lesson.mcap"
    run(lesson(file), speed="max")
    policy = teach([drive_in(file, [Ask("laser")])], Recipe(members=2, epochs=10), "today").policy
    print("{} drives: {}".format(*run(drives(policy), speed="max")))
