"""Wheels that spin are told by the encoders alone: they get faster than any tyre can make the car."""

from math import hypot

import pytest

from txt1 import run
from txt1.config import load
from txt1.estimation.judging import SpinWitness
from txt1.hal.sim import SimHal
from txt1.robot import Robot

PERIOD = 0.02  # s
SPINS = ("car.known=false", "control.linear.kp=11", "control.linear.ki=18", "control.linear.kd=0.25")
"""The TXT-1's speed loop, with which an F1TENTH car spins its wheels, if they are light or the floor is dusty."""


def driven(*more: str) -> tuple[float, float, list[str]]:
    """How far off the filter is after 10 s from standstill, what it says of that (one sigma, m), and what is told."""
    given = ["vehicle=f1tenth", "seed=1", "sim.room.length=.inf", "sim.room.width=.inf", *more]
    config = load(None, [*given, "sensors.imu.driver=sim_imu", "estimation.preset=gyro"], {}, {}).config

    async def main() -> tuple[float, float, list[str]]:
        async with Robot.open(config=config, arm=True) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.4, duration=10.0)
            assert isinstance(robot.hal, SimHal)
            x, y, _ = robot.hal.vehicle.pose
            found = robot.estimate
            told = [each.text for each in robot.runtime.state.events if "spin" in each.text]
            return hypot(found.x - x, found.y - y), hypot(found.sigma(0), found.sigma(1)), told

    return run(main(), speed="max")


@pytest.mark.parametrize("wheels", ["inertia=0.01", "grip=0.8"])
def test_wheels_that_spin_are_told_once_and_the_estimate_says_how_little_it_knows(wheels: str) -> None:
    off, sigma, told = driven(*SPINS, f"sim.vehicle.{wheels}")
    assert len(told) == 1 and "the wheels spin, or an encoder errs" in told[0]
    assert 0.3 < off < 3.0 * sigma


def test_a_car_that_holds_the_floor_is_told_nothing_and_stays_sure() -> None:
    off, sigma, told = driven()
    # of a turn by 4 rad the gyro's scale may have missed 0.07, and slip 5 % of the 2.3 m that it has gone
    assert not told and off < 3.0 * sigma < 0.5


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_only_speeds_that_no_tyre_makes_are_in_doubt(way: float) -> None:
    witness, v = SpinWitness(), 0.0
    for _ in range(100):
        v += way * 10.0 * PERIOD  # the grip of rubber
        assert witness.doubt(v, PERIOD) == (0.0, "")
        if abs(v) >= 3.0:
            break
    beyond, news = witness.doubt(v + way * 2.0, PERIOD)
    assert way * beyond == pytest.approx(1.7) and news
    assert witness.doubt(v + way * 2.0, PERIOD)[1] == "", "once"
    assert witness.doubt(0.0, PERIOD) == (0.0, ""), "at a wall"
    assert witness.doubt(way * 1600.0, PERIOD) == (0.0, ""), "a counter that jumps"
    assert witness.doubt(way * 0.1, PERIOD) == (0.0, "")
