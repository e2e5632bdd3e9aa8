"""Consumption by speed, turning and floor, and the speeds that save time or energy."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import Config
from txt1.errors import CommandRefused
from txt1.model.vehicle import Geometry
from txt1.navigation.pace import pace
from txt1.sim.battery import economical_speed, energy_per_metre, load, range_left
from txt1.sim.parameters import Batteries, Noise, VehicleParameters
from txt1.sim.room import Room
from txt1.sim.vehicle import Vehicle
from txt1.sim.world import World

shares = st.floats(0.0, 0.5)
batteries = st.builds(Batteries, still=shares, drag=shares, turning=st.floats(0.0, 2.0), floor=st.floats(0.2, 3.0))


def test_half_a_metre_per_second_straight_ahead_is_the_full_load_of_the_thesis() -> None:
    assert load(Batteries(), 0.5) == pytest.approx(1.0)
    assert energy_per_metre(Batteries(), 0.5) == pytest.approx(178.0)


@given(batteries, st.floats(0.05, 1.5), st.floats(-1.0, 1.0))
def test_turning_a_worse_floor_and_the_other_direction_cost_what_they_should(
    one: Batteries, v: float, bend: float
) -> None:
    assert load(one, v, bend) == load(one, -v, -bend) >= load(one, v) > one.idle_load
    assert load(replace(one, floor=1.5 * one.floor), v) > load(one, v)
    assert load(one, 1.01 * v) > load(one, v)


@given(batteries, st.floats(0.1, 1.5), st.floats(0.0, 1.0))
def test_no_speed_costs_less_per_metre_than_the_economical_one(one: Batteries, v_max: float, bend: float) -> None:
    best = energy_per_metre(one, economical_speed(one, v_max, bend), bend)
    assert all(energy_per_metre(one, v, bend) >= best * (1.0 - 1e-9) for v in np.linspace(0.02, v_max, 60))


def test_the_range_is_the_energy_left_over_that_of_a_metre() -> None:
    v = economical_speed(Batteries(), 1.5)
    assert range_left(Batteries(), 600.0, 1.5) == pytest.approx(89.0 * 600.0 / energy_per_metre(Batteries(), v))


@pytest.mark.parametrize("steering", [0, 12000])
def test_a_simulated_robot_draws_by_its_speed_and_its_turning(steering: int) -> None:
    one = Batteries(by_speed=True)
    vehicle = Vehicle(World(Room()), VehicleParameters(), Geometry(), one, Noise(0.0, 0.0), (0.0, 0.0, 0.0), 1)
    vehicle.command(2000, steering, -steering)
    vehicle.advance_to(10.0)
    before, began = vehicle.supply.packs.used_1, vehicle.time
    vehicle.advance_to(70.0)
    assert before is not None
    assert vehicle.supply.packs.used_1 is not None
    bend = np.tan(vehicle.state.phi_front) / Geometry().tan_steering_max
    drawn = (vehicle.supply.packs.used_1 - before) * 60.0 / (vehicle.time - began)
    assert abs(bend) == pytest.approx(steering / 18000.0, abs=0.1)
    assert drawn == pytest.approx(load(one, vehicle.state.v, bend), rel=0.03)


def test_a_drive_saves_time_or_energy_within_the_limits() -> None:
    config = Config()
    assert pace(0.7, config) == 0.7
    assert pace("energy", config) == pytest.approx(economical_speed(config.sim.battery, 1.5))
    assert pace("energy", config) < pace("time", config) <= config.safety.v_max
    slow = config.model_copy(update={"safety": replace(config.safety, v_max=0.6)})
    assert pace("energy", slow) == pace("time", slow) == 0.6
    with pytest.raises(CommandRefused, match="time, energy"):
        pace("money", config)
