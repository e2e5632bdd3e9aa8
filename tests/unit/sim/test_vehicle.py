"""The simulated robot: counters, switches, batteries, walls and noise."""

from __future__ import annotations

import random
from math import cos, hypot, inf, nan, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.model.battery import pack_voltage
from txt1.model.vehicle import Geometry
from txt1.sim.battery import Packs, discharge
from txt1.sim.dynamics import dynamics
from txt1.sim.parameters import Batteries, Faults, Noise, VehicleParameters
from txt1.sim.room import Room, clearance
from txt1.sim.vehicle import Vehicle
from txt1.sim.world import World

QUIET = Noise(0.0, 0.0)
BODY = Geometry()
OPEN, FULL, VEHICLE = Room(), Batteries(), VehicleParameters()


def simulator(
    *,
    room: Room = OPEN,
    batteries: Batteries = FULL,
    noise: Noise = QUIET,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 1,
) -> Vehicle:
    return Vehicle(World(room), VEHICLE, BODY, batteries, noise, start, seed)


def run(sim: Vehicle, seconds: float, step: float = 0.02) -> None:
    start = sim.time
    for k in range(1, round(seconds / step) + 1):
        sim.advance_to(start + k * step)


# -- encoders ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motor", [3000, -3000])
def test_encoders_count_whole_ticks_1600_for_every_0_5125_m(motor: int) -> None:
    sim = simulator()
    assert sim.encoder_counts() == (0, 0)
    sim.command(motor, 0, 0)
    for _ in range(100):
        run(sim, 0.02)
        for counts in sim.encoder_counts():
            assert isinstance(counts, int)
            assert abs(counts - sim.state.x / 0.5125 * 1600) <= 1
    assert abs(sim.encoder_counts()[0]) > 4000


@pytest.mark.parametrize("seed", range(8))
def test_the_counters_start_at_zero_wherever_the_wheels_stand(seed: int) -> None:
    assert simulator(seed=seed).encoder_counts() == (0, 0)


def test_driving_there_and_back_returns_the_counters() -> None:
    sim = simulator()
    sim.command(2000, 0, 0)
    run(sim, 2.0)
    sim.command(-2000, 0, 0)
    while sim.state.x > 0.0:
        run(sim, 0.001, 0.001)
    assert all(abs(counts) <= 3 for counts in sim.encoder_counts())


@pytest.mark.parametrize("broken", ["right_encoder", "left_encoder"])
def test_a_dead_encoder_stands_still_and_the_other_counts(broken: str) -> None:
    sim = simulator()
    sim.command(3000, 0, 0)
    run(sim, 1.0)
    before = sim.encoder_counts()
    sim.faults = Faults(**{broken: True})
    run(sim, 1.0)
    dead, alive = (0, 1) if broken == "right_encoder" else (1, 0)
    assert sim.encoder_counts()[dead] == before[dead]
    assert sim.encoder_counts()[alive] > before[alive] + 1000


# -- power -------------------------------------------------------------------------------------------------------


def test_with_the_esc_off_the_vehicle_coasts_to_a_stop_whatever_the_pwm_says() -> None:
    sim = simulator()
    sim.command(4000, 0, 0)
    run(sim, 2.0)
    assert sim.state.v > 1.0
    sim.esc_on = False
    run(sim, 0.1)
    assert 0.5 < sim.state.v < 1.2
    run(sim, 5.0)
    assert sim.state.v == 0.0
    sim.esc_on = True
    run(sim, 0.1)
    assert sim.state.v > 0.0


def test_without_the_atx_supply_the_counters_stand_still() -> None:
    sim = simulator()
    sim.command(4000, 0, 0)
    run(sim, 1.0)
    before, x = sim.encoder_counts(), sim.state.x
    sim.atx_on = False
    run(sim, 1.0)
    assert sim.encoder_counts() == before
    assert sim.state.x > x + 0.5
    sim.atx_on = True
    run(sim, 1.0)
    assert sim.encoder_counts()[0] > before[0]


def test_46_minutes_of_driving_follow_the_measured_line() -> None:
    sim = simulator(noise=Noise(drag=0.0, battery=0.01))
    sim.command(3000, 0, 0)
    readings = []
    for minute in range(1, 47):
        run(sim, 60.0, 1.0)
        reading, second = sim.battery_readings()
        readings.append(reading - (12.165769 - 0.033691 * minute))
        assert second == 0.0
        assert not sim.supply.cut_off
    assert max(map(abs, readings)) < 0.04
    assert abs(sum(readings) / len(readings)) < 0.006
    assert 0.004 < (sum(r * r for r in readings) / len(readings)) ** 0.5 < 0.016


@pytest.mark.parametrize(("atx", "share"), [(True, 0.4), (False, 0.1)])
def test_standing_still_discharges_slower_by_the_configured_share(atx: bool, share: float) -> None:
    sim = simulator(batteries=Batteries(idle_load=0.4, standby_load=0.1))
    sim.atx_on = atx
    run(sim, 601.0, 1.0)
    assert sim.supply.packs.used_1 == pytest.approx(10.0 * share, rel=0.005)
    # a motor inside the dead band or behind an open switch draws nothing either
    sim.command(300, 0, 0)
    run(sim, 300.0, 1.0)
    sim.command(4000, 0, 0)
    sim.esc_on = False
    run(sim, 300.0, 1.0)
    assert sim.supply.packs.used_1 == pytest.approx(20.0 * share, rel=0.005)


def test_at_50_minutes_the_cut_off_ends_all_motion() -> None:
    sim = simulator(batteries=Batteries(49.9))
    sim.command(4000, 0, 0)
    run(sim, 4.0)
    assert not sim.supply.cut_off
    assert sim.state.v > 0.8
    run(sim, 6.0)
    assert sim.supply.cut_off
    before = sim.encoder_counts()
    run(sim, 5.0)
    assert sim.state.v == 0.0
    assert sim.encoder_counts() == before
    assert sim.battery_readings()[0] == pytest.approx(9.25)


def test_an_empty_pack_moves_nothing_from_the_start() -> None:
    sim = simulator(batteries=Batteries(60.0))
    assert sim.supply.cut_off
    sim.command(4000, 0, 0)
    run(sim, 1.0)
    assert sim.state.v == 0.0


def test_one_good_pack_of_two_keeps_the_robot_alive() -> None:
    sim = simulator(batteries=Batteries(60.0, 10.0))
    assert not sim.supply.cut_off
    sim.command(4000, 0, 0)
    run(sim, 60.0, 1.0)
    assert sim.supply.packs.used_1 == 60.0
    assert sim.supply.packs.used_2 == pytest.approx(11.0, abs=0.02)


def test_of_two_packs_the_fuller_one_is_drawn_from_first() -> None:
    assert discharge(Packs(10.0, 20.0), 60.0) == Packs(11.0, 20.0)
    assert discharge(Packs(20.0, 10.0), 60.0) == Packs(20.0, 11.0)
    assert discharge(Packs(None, 10.0), 60.0) == Packs(None, 11.0)
    assert discharge(Packs(10.0, None), 60.0) == Packs(11.0, None)
    assert discharge(Packs(None, None), 60.0) == Packs(None, None)


def test_two_packs_equally_full_share_the_load_and_last_twice_as_long() -> None:
    assert discharge(Packs(10.0, 10.0), 60.0) == Packs(10.5, 10.5)
    sim = simulator(batteries=Batteries(2.0, 0.0))
    sim.command(4000, 0, 0)
    run(sim, 600.0, 1.0)
    assert sim.supply.packs.used_1 == pytest.approx(6.0, abs=0.03)
    assert sim.supply.packs.used_2 == pytest.approx(6.0, abs=0.03)


def test_voltages_follow_from_use_and_are_zero_without_a_pack() -> None:
    assert Packs(3.0, None).voltages() == (pack_voltage(3.0), 0.0)
    assert Packs(None, 7.0).voltages() == (0.0, pack_voltage(7.0))
    assert simulator(batteries=Batteries(None, None), noise=Noise()).battery_readings() == (0.0, 0.0)


# -- walls -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("theta", "motor"), [(0.0, 4000), (pi / 2, 4000), (0.7, 4000), (pi, -4000), (-2.0, -4000)])
def test_a_wall_stops_the_vehicle_and_lets_it_back_out(theta: float, motor: int) -> None:
    room = Room(3.0, 4.0)
    sim = simulator(room=room, start=(0.0, 0.0, theta))
    sim.command(motor, 0, 0)
    for _ in range(250):
        run(sim, 0.02)
        assert clearance(*sim.state[:3], room, BODY) >= 0.0
    at = sim.state
    assert clearance(*at[:3], room, BODY) < 0.01
    before = sim.encoder_counts()
    run(sim, 1.0)
    assert hypot(sim.state.x - at.x, sim.state.y - at.y) < 0.01
    assert abs(sim.encoder_counts()[0] - before[0]) < 40, "the wheels stand still with the vehicle"
    sim.command(-motor, 0, 0)
    run(sim, 1.0)
    assert clearance(*sim.state[:3], room, BODY) > 0.2


@given(st.integers(0, 10**6))
@settings(max_examples=examples(25))
def test_no_corner_ever_enters_a_wall(seed: int) -> None:
    rng = random.Random(seed)
    room = Room(1.6, 1.2)
    sim = simulator(room=room, start=(0.0, 0.0, rng.uniform(-pi, pi)), noise=Noise(), seed=seed)
    for _ in range(30):
        u = rng.choice((-18000, 0, 18000))
        sim.command(rng.choice((-5000, 5000, 5000, 0)), -u, rng.choice((u, -u)))
        run(sim, 0.2)
        x, y, theta = sim.state[:3]
        for along in (-0.255, 0.255):
            for across in (-0.1925, 0.1925):
                assert abs(x + along * cos(theta) - across * sin(theta)) <= 0.8 + 1e-9
                assert abs(y + along * sin(theta) + across * cos(theta)) <= 0.6 + 1e-9


def test_a_room_without_walls_stops_nobody() -> None:
    sim = simulator()
    sim.command(5000, 0, 0)
    run(sim, 100.0, 0.1)
    assert sim.state.x > 140.0


def test_placing_puts_the_vehicle_down_at_rest() -> None:
    sim = simulator()
    sim.command(4000, 0, 0)
    run(sim, 1.0)
    counts = sim.encoder_counts()
    sim.place(1.0, -2.0, 3 * pi)
    assert sim.state[:4] == (1.0, -2.0, pi, 0.0)
    assert sim.encoder_counts() == counts


@pytest.mark.parametrize("pose", [(2.3, 0.0, 0.0), (0.0, -2.35, 0.0), (2.25, 0.0, pi / 4), (9.0, 9.0, 0.0)])
def test_placing_the_vehicle_into_a_wall_is_refused(pose: tuple[float, float, float]) -> None:
    sim = simulator(room=Room(5.0, 5.0))
    with pytest.raises(ValueError, match="sticks into a wall of the 5 x 5 m room"):
        sim.place(*pose)
    assert sim.state[:3] == (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="sticks into a wall"):
        simulator(room=Room(5.0, 5.0), start=pose)


@pytest.mark.parametrize("pose", [(nan, 0.0, 0.0), (0.0, nan, 0.0), (0.0, 0.0, nan), (inf, 0.0, 0.0), (0.0, 0.0, inf)])
@pytest.mark.parametrize("room", [Room(), Room(5.0, 5.0)])
def test_a_pose_that_is_not_finite_is_refused(pose: tuple[float, float, float], room: Room) -> None:
    with pytest.raises(ValueError, match="finite"):
        simulator(room=room).place(*pose)


def test_clearance_is_that_of_the_nearest_corner() -> None:
    room = Room(5.0, 4.0)
    assert clearance(0.0, 0.0, 0.0, room, BODY) == pytest.approx(2.0 - 0.385 / 2)
    assert clearance(2.0, 0.0, 0.0, room, BODY) == pytest.approx(0.5 - 0.51 / 2)
    assert clearance(2.0, 0.0, pi / 2, room, BODY) == pytest.approx(0.5 - 0.385 / 2)
    assert clearance(0.0, 1.7, pi / 4, room, BODY) == pytest.approx(0.3 - (0.51 + 0.385) / 2 / 2**0.5)


# -- time and noise ----------------------------------------------------------------------------------------------


def manoeuvre(sim: Vehicle, extra_period: float | None = None) -> list[tuple[float, ...]]:
    """Ten seconds of varied driving in 20 ms ticks, and, when asked, in further steps in between."""
    instants = {(k + 1) / 50: True for k in range(500)}
    if extra_period is not None:
        for k in range(1, round(10 / extra_period)):
            instants.setdefault(k * extra_period, False)
    log = []
    for at in sorted(instants):
        sim.advance_to(at)
        if instants[at]:
            tick = round(at * 50)
            log.append((*sim.state, *sim.encoder_counts(), *sim.battery_readings(), sim.drag))
            u = (0, 9000, 18000, -18000, -5000)[tick // 25 % 5]
            sim.command((3000, 4000, 0, -3000)[tick // 60 % 4], -u, u)
    return log


def test_the_same_seed_repeats_bit_for_bit_and_another_one_differs() -> None:
    one, same, other = (manoeuvre(simulator(noise=Noise(), seed=seed)) for seed in (7, 7, 8))
    assert one == same
    assert all(a != b for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("extra_period", [0.016, 0.001, 0.007])
def test_the_result_does_not_depend_on_how_the_time_is_cut_up(extra_period: float) -> None:
    one, two = simulator(noise=Noise()), simulator(noise=Noise())
    one.dynamics = two.dynamics = dynamics(VEHICLE, BODY, ramp_step=0.0002)
    plain, cut = manoeuvre(one), manoeuvre(two, extra_period)
    for one, two in zip(plain, cut, strict=True):
        assert one[:8] == pytest.approx(two[:8], abs=5e-6)
        assert one[8:10] == pytest.approx(two[8:10], abs=1)
        assert one[10:12] == pytest.approx(two[10:12], abs=1e-6)
        assert one[12] == two[12], "the same noise at the same time"


@pytest.mark.parametrize("extra_period", [0.016, 0.007])
def test_with_the_usual_ramp_step_cutting_time_up_costs_less_than_0_1_mm(
    extra_period: float,
) -> None:
    plain = manoeuvre(simulator(noise=Noise()))
    cut = manoeuvre(simulator(noise=Noise()), extra_period)
    assert max(hypot(one[0] - two[0], one[1] - two[1]) for one, two in zip(plain, cut, strict=True)) < 1e-4


def test_ticks_of_20_ms_are_one_step_each() -> None:
    # ... also where k * 0.02 and k / 50 are different floats: no slivers
    sim = simulator(noise=Noise())
    for k in range(1, 3001):
        sim.advance_to(k * 20_000_000 / 1e9)
        assert sim.time == sim.piece_ends == k / 50


def test_the_past_changes_nothing() -> None:
    sim = simulator(noise=Noise())
    sim.command(4000, 0, 0)
    sim.advance_to(1.0)
    state = sim.state
    sim.advance_to(1.0)
    sim.advance_to(0.5)
    assert (sim.state, sim.time) == (state, 1.0)


def test_drag_noise_has_its_standard_deviation_and_no_bias() -> None:
    sim, drags = simulator(noise=Noise(drag=0.03, battery=0.0)), []
    for k in range(1, 5001):
        sim.advance_to(k / 50)
        drags.append(sim.drag)
    assert len(set(drags)) == 5000
    assert abs(sum(drags) / 5000) < 4 * 0.03 / 5000**0.5
    assert (sum(d * d for d in drags) / 5000) ** 0.5 == pytest.approx(0.03, rel=0.05)
    for lag in (1, 2, 50):
        together = sum(a * b for a, b in zip(drags[lag:], drags, strict=False)) / 5000
        assert abs(together) < 4 * 0.03**2 / 5000**0.5, "it is white"


def test_a_battery_reading_is_valid_for_a_second_however_often_it_is_read() -> None:
    often, seldom = (simulator(noise=Noise(), seed=3) for _ in range(2))
    seen = []
    for k in range(1, 500):
        often.advance_to(k / 50)
        seen.append(often.battery_readings())
    seldom.advance_to(499 / 50)
    assert seldom.battery_readings() == seen[-1]
    assert len(set(seen)) >= 10


def test_quiet_sensors_tell_the_truth() -> None:
    sim = simulator(batteries=Batteries(5.0, 6.0))
    assert sim.battery_readings() == (pack_voltage(5.0), pack_voltage(6.0))


def test_python_finds_a_vehicles_attributes_quickly() -> None:
    # CPython keeps up to 29 attributes in an object itself, and more in a dict: each of them is found slower then
    assert len(vars(simulator())) <= 29
