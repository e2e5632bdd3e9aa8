"""Drives as a person makes them: within the car's limits, over all of its range, and the same for the same seed."""

from math import hypot

import numpy as np
import pytest

from benchmarks.sensor_failure import Failing
from rigs.human_drive import drive_as_a_person, manoeuvres
from tests.e2e.conftest import ENDLESS
from txt1.config import load
from txt1.estimation.task import Estimator
from txt1.kernel.loop import run
from txt1.robot import Robot

VEHICLES = ("", "f1tenth", "rover", "donkeycar")


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_manoeuvres_use_the_cars_whole_range_and_never_leave_it(vehicle: str) -> None:
    config = load(f"config/vehicles/{vehicle}.yaml" if vehicle else None).config
    pieces = list(manoeuvres(np.random.default_rng(1), config, 600.0))
    v, omega = np.array([(each.v, each.omega) for each in pieces]).T
    assert np.abs(v).max() <= config.safety.v_max
    assert np.abs(omega).max() <= config.safety.omega_max
    assert v.max() > 0.9 * config.safety.v_max
    assert v.min() < -0.8 * config.safety.v_max
    assert any(each.v == 0.0 == each.omega and each.push for each in pieces)
    assert max(each.slip for each in pieces) > 0.18
    if config.geometry.steering == "skid":
        assert any(each.v == 0.0 != each.omega for each in pieces)
    else:
        assert all(abs(each.omega) <= abs(each.v) / config.geometry.radius_min + 1e-9 for each in pieces)
    assert sum(each.seconds for each in pieces) == pytest.approx(600.0, abs=2.0)


def test_a_seed_repeats_a_drive_and_the_gate_lets_all_of_it_pass() -> None:
    async def drive() -> tuple[float, ...]:
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()
            await drive_as_a_person(robot, 7, 8.0)
            assert robot.armed
            assert robot.pose is not None
            return robot.pose

    assert run(drive(), speed="max") == run(drive(), speed="max")


@pytest.mark.parametrize(("seed", "seconds"), [(3, 17.0), (22, 17.0), pytest.param(32, 56.0, marks=pytest.mark.long)])
def test_slip_that_changes_in_a_curve_is_neither_a_frame_that_moves_nor_a_mount(seed: int, seconds: float) -> None:
    async def drive() -> list[str]:
        config = load(None, [f"seed={seed}", *ENDLESS, "estimation.preset=vicon"]).config
        async with Robot.open(config=config, hal="sim") as robot:
            await robot.load_gains()
            await drive_as_a_person(robot, seed, seconds)
            estimator = robot.runtime.part(Estimator)
            assert estimator is not None
            found = estimator.fusion.parameters("vicon")
            assert all(abs(found[name].value) < 0.03 for name in ("x", "y"))
            return [each.text for each in robot.runtime.state.events]

    assert not any("frame moves" in each for each in run(drive(), speed="max"))


@pytest.mark.long
def test_encoders_that_drift_move_no_mount_and_no_frame() -> None:
    async def drive() -> tuple[float, list[str]]:
        config = load(None, ["seed=3", *ENDLESS, "estimation.preset=vicon"]).config
        async with Robot.open(config=config, hal="sim") as robot:
            estimator = robot.runtime.part(Estimator)
            assert estimator is not None
            estimator.through = Failing("encoders", "drifting", lambda: robot.now)
            await robot.load_gains()
            await drive_as_a_person(robot, 3, 44.0)
            estimate, pose = robot.estimate, robot.pose
            assert estimate is not None
            assert pose is not None
            told = [each.text for each in robot.runtime.state.events]
            return hypot(estimate.x - pose[0], estimate.y - pose[1]), told

    off, told = run(drive(), speed="max")
    assert any("'encoders' is not believed" in each for each in told)
    assert not any("frame moves" in each for each in told)
    assert off < 0.01
