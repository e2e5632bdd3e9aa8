"""An agent goes on learning on the running robot, in real time, while its gate is shut twice a minute.

txt1 board --pty /tmp/board --set sim.room.length=40 --set sim.room.width=40     # one terminal: a simulated vehicle
python examples/learn_on_the_robot.py /tmp/board [MINUTES]                       # another
"""

import sys
from contextlib import suppress

import numpy as np

from txt1 import Robot
from txt1.errors import NotArmed
from txt1.learning.robot_env import RobotEnv

PAUSE, SHUT = 30.0, 2.0 * float((*sys.argv, 10)[2])
shut: list[float] = []


async def prepare(robot: Robot) -> None:
    async def shutter(ticks) -> None:  # type: ignore[no-untyped-def]
        async for now in ticks:
            if not robot.armed:
                # refused as long as the link is lost
                with suppress(NotArmed):
                    robot.arm()
            elif len(shut) < SHUT and now > PAUSE * (len(shut) + 1):
                robot.disarm()
                shut.append(now)

    robot.add_task("shutter", 1.0, shutter)


# an evolution strategy (1 + 1): the steering is a weighted sum of what is seen of the goal
rng, best, most, counted, void = np.random.default_rng(1), np.array([0.0, 1.0, 0.0, 0.0]), -np.inf, 0, 0
settings = [f"serial.port={sys.argv[1]}", "learning.time_limit=12", "safety.v_max=0.6"]
with RobotEnv("pose", settings=settings, hal="serial", arm=True, prepare=prepare) as env:
    while len(shut) < SHUT:
        weights, earned, over, (seen, told) = best + 0.5 * rng.standard_normal(4), 0.0, False, env.reset()
        while not over:
            seen, reward, ended, late, told = env.step(np.array([1.0, np.tanh(seen[:4] @ weights)], np.float32))
            earned, over = earned + reward, ended or late
        void, counted = void + told["void"], counted + (not told["void"])
        if not told["void"] and earned >= most:
            best, most = weights, earned
        print(f"{counted} count, {void} void, {len(shut)} times shut, {env.trial.late} late: {earned:.1f}, {most:.1f}")
