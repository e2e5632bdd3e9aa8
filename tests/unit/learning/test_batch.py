"""Many robots at once move as the one on the runtime does."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.patience import LIMIT
from txt1.config import load
from txt1.control.parameters import Safety
from txt1.hal.registry import create_sim
from txt1.learning import batch
from txt1.learning.batch import Batch
from txt1.learning.env import EpisodeCar
from txt1.learning.trial import COMMANDS
from txt1.model.vehicle import Geometry
from txt1.sim.lamp import PointLight, illuminances
from txt1.sim.parameters import VehicleParameters
from txt1.sim.random_streams import random_stream

COUNT = 5


def robots(count: int) -> Batch:
    return Batch(count, PointLight(), 0.0, 0.0, VehicleParameters(), Geometry(), Safety())


def held_against_the_runtime(ticks: int = 400) -> float:
    """The largest difference in pose and sensed velocities in random driving by the environment's robots."""
    # the batch has no batteries: its voltage stays
    endless = load(
        overrides=[
            "sim.noise.drag=0",
            "sim.vehicle.voltage=0",
            "sim.room={length: .inf, width: .inf}",
            "sim.start=[1, 0.5, 0.3]",
        ]
    )
    configs = [endless.config.model_copy(update={"seed": seed}) for seed in range(COUNT)]
    cars = [EpisodeCar(create_sim(config), config) for config in configs]
    many = robots(COUNT)
    many.place(np.ones(COUNT, bool), np.tile([1.0, 0.5, 0.3], (COUNT, 1)), np.random.default_rng(0))
    # where the wheels stood
    phases = [random_stream(seed, "encoder phases") for seed in range(COUNT)]
    many.robots[batch.PHASE : batch.PHASE + 2] = np.transpose([[each.random(), each.random()] for each in phases])
    rng, actions = np.random.default_rng(2), np.random.default_rng(3)
    worst = 0.0
    for tick in range(ticks):
        if tick % 25 == 10:
            for i, action in enumerate(actions.integers(0, 3, COUNT)):
                many.commands[i] = COMMANDS[action]
        now = tick * 20 / 1000.0
        for each, command in zip(cars, many.commands.tolist(), strict=True):
            each.control(now, *command)
        many.run(1, rng, sense=False)
        expected = np.array([[*car.pose(now), *car.wheels.odometry[3:]] for car in cars])
        got = np.concatenate([many.poses, many.velocities], axis=1)
        worst = max(worst, float(np.abs(got - expected).max()))
    assert np.abs(many.velocities[:, 0]).min() > 0.2, "they drive"
    return worst


@pytest.mark.long
def test_the_batch_moves_as_the_running_robot_does_to_1e_9() -> None:
    assert held_against_the_runtime() < 1e-9


def test_and_so_it_does_without_numba() -> None:
    without = "import sys; sys.modules['numba'] = None; from tests.unit.learning import test_batch as t; "
    shown = subprocess.run(
        [sys.executable, "-c", without + "print(t.held_against_the_runtime(100))"],
        capture_output=True,
        text=True,
        check=True,
        timeout=LIMIT,
    )
    assert float(shown.stdout) < 1e-9


@pytest.mark.long
def test_its_readings_are_the_lights_through_the_filter() -> None:
    many = robots(2)
    poses = np.array([[1.25, 0.0, 3.0], [0.0, -2.0, 1.0]])
    many.place(np.ones(2, bool), poses, np.random.default_rng(0))
    many.run(5, np.random.default_rng(1))
    for reading, pose in zip(many.readings, poses, strict=True):
        assert reading == pytest.approx(illuminances(*pose, PointLight()))
    many.own[0, batch.NOISE] = 0.3
    many.run(400, np.random.default_rng(1))
    noisy = []
    rng = np.random.default_rng(2)
    for _ in range(500):
        many.run(20, rng)
        noisy.append(many.readings[0, 0] / illuminances(*poses[0], PointLight())[0])
    w = batch.WEIGHT
    assert np.mean(noisy) == pytest.approx(1.0, abs=0.02)
    assert np.std(noisy) == pytest.approx(0.3 * np.sqrt((1 - w) / (1 + w)), rel=0.15)


@pytest.mark.long
def test_its_noise_is_normal_and_each_sensors_own() -> None:
    count, pose = 20_000, np.array([1.25, 0.0, 3.0])
    many = robots(count)
    many.own[0, batch.NOISE] = 0.2
    many.place(np.ones(count, bool), np.tile(pose, (count, 1)), np.random.default_rng(0))
    many.run(1, np.random.default_rng(1))
    # the first sample passes the filter as it is
    drawn = (many.readings / illuminances(*pose, PointLight()) - 1.0) / 0.2
    assert drawn.mean() == pytest.approx(0.0, abs=0.01) and drawn.std() == pytest.approx(1.0, abs=0.01)
    for sigmas, share in ((1.0, 0.6827), (2.0, 0.9545), (3.0, 0.9973)):
        assert (np.abs(drawn) < sigmas).mean() == pytest.approx(share, abs=0.005)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(4)).max() < 0.03


@pytest.mark.long
def test_some_drive_on_as_they_do_among_all_and_the_others_stand() -> None:
    many, all_of_them = robots(3), robots(3)
    for each in (many, all_of_them):
        each.place(np.ones(3, bool), np.array([[0.0, 1.0, 0.3]] * 3), np.random.default_rng(0))
        each.commands[:] = 0.3, 0.2
    before = many.robots.copy()
    some = np.array([True, False, True])
    many.run(20, np.random.default_rng(1), which=some)
    all_of_them.run(20, np.random.default_rng(1))
    assert (many.robots[:, some] == all_of_them.robots[:, some]).all()
    assert (many.robots[:, 1] == before[:, 1]).all()
