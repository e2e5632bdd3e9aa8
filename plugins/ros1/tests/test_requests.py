"""Requests of the original's services: gains that are none, and PWM by hand."""

import asyncio
import json
from math import inf, nan

import pytest

from txt1 import run
from txt1.model.vehicle import STEERING_MAX
from txt1.robot import Robot
from txt1.sidecar import Request
from txt1_ros1.robot_end import Ros1Desk

TICK = 0.02
ENDLESS = ["sim.room.length=.inf", "sim.room.width=.inf"]


@pytest.mark.parametrize("bad", [-5.0, -1e-3, 99999.0, inf, nan], ids=str)
def test_pid_load_loads_what_is_no_gain_for_nobody(bad: float) -> None:
    async def main() -> None:
        async with Robot.open("sim") as robot:
            before = robot.runtime.state.gains
            sets = [number for v_max, gains in before.angular.sets for number in (v_max, *gains)]
            call = {"id": 1, "name": "pid_load", "fields": {"linear": [bad, *before.linear[1:]], "angular": sets}}
            end = Ros1Desk(robot)
            end.request(Request("call", call, 0.0))
            await asyncio.sleep(0.1)
            ((_, done, why),) = json.loads(end.telemetry() or b"{}")["answers"]
            assert not done and "kp" in why
            assert robot.runtime.state.gains == before

    run(main(), speed="max")


def test_pwm_change_acts_in_manual_mode_only_and_through_the_gate() -> None:
    async def main() -> None:
        async with Robot.open("sim", settings=ENDLESS) as robot:
            end = Ros1Desk(robot)
            asked = {"esc": 24000, "front": -24000, "rear": 24000, "pwm4": 100, "pwm5": 0}

            async def call(number: int) -> list[object]:
                end.request(Request("call", {"id": number, "name": "pwm_change", "fields": asked}, 0.0))
                await asyncio.sleep(2.5 * TICK)
                told = json.loads(end.telemetry() or b"{}")
                return next(answer for answer in told["answers"] if answer[0] == number)

            _, done, why = await call(1)
            assert not done and "needs manual mode" in str(why) and robot.runtime.state.control.outputs[:5] == (0,) * 5
            await robot.set_manual(True)
            assert (await call(2))[1] is True
            motor, front, rear, pwm4, _ = robot.runtime.state.control.outputs[:5]
            assert motor == robot.config.safety.motor_max and pwm4 == 100, "limited by the gate"
            assert front == -STEERING_MAX and rear == STEERING_MAX
            await asyncio.sleep(0.25 + TICK)
            assert robot.runtime.state.control.outputs[:3] == (0, 0, 0), "for a quarter of a second"
            await call(3)
            robot.disarm()
            await asyncio.sleep(TICK)
            assert (await call(4))[1] is True or not robot.armed
            assert robot.runtime.state.control.outputs[:3] == (0, 0, 0), "disarmed, nothing moves it"

    run(main(), speed="max")
