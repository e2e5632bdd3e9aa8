"""One odometry of all sensors on the running robot: told, offered to the loops, and a source of poses."""

import asyncio
from collections.abc import AsyncIterator, Iterable
from functools import partial
from math import hypot, nan
from typing import Any

import pytest
from blockbuster import BlockBuster

from benchmarks import sensor_failure
from tests.e2e.conftest import ENDLESS, may_block
from txt1.cli import execute
from txt1.config import load
from txt1.errors import ConfigError, NotCapable
from txt1.estimation.sensors import Measurement
from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import ESTIMATION_PERIOD, FILTERED, PRIORITY, TRUSTS, Estimator, wheels
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.navigation import follow, fused_pose
from txt1.navigation.pose_source import located, places_on_earth
from txt1.robot import Robot
from txt1.sensors.geodesy import UtmGrid
from txt1.sensors.readings import ImuReading, TrackerReading
from txt1.tasks.fields import Source
from txt1.telemetry.snapshot import Snapshot

# on a circle a mount further to the left looks like slip
EXACT = ("estimation.settings.vicon.lever_sigma=0.003",)
SLIPPING = (*ENDLESS, "sim.vehicle.slip=0.05", "sim.vehicle.understeer=0.1")


@pytest.fixture(autouse=True)
def the_grid_is_made_when_it_is_asked_for(blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "txt1/sensors/geodesy.py", "__init__")


async def test_it_is_told_with_covariance_and_with_how_much_each_sensor_is_believed() -> None:
    async with Robot.open("sim", seed=1, settings=(*SLIPPING, "estimation.preset=vicon", *EXACT)) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.3, 5.0)
        estimate, pose = robot.estimate, robot.pose
        assert estimate is not None
        assert pose is not None
        assert hypot(estimate.x - pose[0], estimate.y - pose[1]) < 0.01
        snapshot: Snapshot = robot.snapshot
        assert snapshot[FILTERED] == estimate
        assert [trust.name for trust in snapshot[TRUSTS]] == ["imu", "encoders", "vicon"]
        assert all(trust.believed for trust in snapshot[TRUSTS])
        assert estimate.slip == pytest.approx(1.0 - 1.0 / 1.05, abs=0.02)


async def test_a_car_that_slides_outwards_in_curves_is_told_from_a_mount_that_is_elsewhere() -> None:
    kinds = {"imu": ImuReading, "vicon": TrackerReading}
    settings = (*ENDLESS, "sensors.imu.driver=sim_imu", "sensors.vicon.driver=sim_vicon")
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()
        estimator = Estimator(EstimationConfig(preset="vicon"), kinds, robot.config.geometry)
        for name in kinds:
            robot.sensors[name].listeners.append(partial(estimator.take, name))

        async def step(ticks: Ticks) -> None:
            async for now in ticks:
                estimator.step(now, wheels(robot.runtime))

        robot.add_task("step", ESTIMATION_PERIOD, step, PRIORITY)
        for speed in (0.4, 1.4) * 3:
            await robot.drive(speed, 1.5 * speed, 2.0)
            await robot.drive(speed, -1.5 * speed, 2.0)
        found = estimator.fusion.parameters("vicon")
        sideways = found["sideways"]
        assert sideways.value == pytest.approx(1.0 / (9.81 * robot.config.sim.vehicle.cornering), abs=0.004)
        assert sideways.sigma < 0.003
        assert all(abs(found[name].value) < 0.01 for name in ("x", "y"))


async def test_the_loops_go_by_it_so_a_circle_has_its_radius() -> None:
    settings = (*ENDLESS, "estimation.preset=gyro", "estimation.loops=true")
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.5, 4.0)
        assert robot.runtime.state.control.source is Source.COMBINED
        robot.program.insist(0.5, 0.5)
        places = []
        for _ in range(140):
            robot.program.insist(0.5, 0.5)
            await asyncio.sleep(0.1)
            assert robot.pose is not None
            places.append(robot.pose[:2])
        xs, ys = zip(*places, strict=True)
        radius = 0.25 * (max(xs) - min(xs) + max(ys) - min(ys))
        assert radius == pytest.approx(1.0, rel=0.01)


async def test_a_silent_sensor_is_told_in_the_log_and_driving_goes_on() -> None:
    settings = (*SLIPPING, "estimation.preset=vicon", "estimation.loops=true", "sensors.vicon.driver=sim_vicon")
    settings = (*settings, "sensors.vicon.options.occlusions=[[3.0, 6.0]]")
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.3, 8.0)
        told = [event.text for event in robot.runtime.state.events]
        assert "estimation: 'vicon' is not believed any more: silent" in told
        assert "estimation: 'vicon' is believed again" in told
        assert robot.armed


async def test_waypoints_are_followed_by_the_fused_pose() -> None:
    async with Robot.open("sim", seed=1, settings=(*SLIPPING, "estimation.preset=vicon")) as robot:
        await robot.load_gains()
        await follow(robot, [(2.0, 0.0), (2.0, 2.0)], closed=False, pose_source=fused_pose(robot))
        assert robot.pose is not None
        assert hypot(robot.pose[0] - 2.0, robot.pose[1] - 2.0) < 0.35


async def test_without_a_filter_there_is_no_fused_pose_and_nothing_is_told() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        assert robot.estimate is None
        assert robot.snapshot.get(FILTERED) is None
        with pytest.raises(NotCapable, match=r"estimation\.preset"):
            fused_pose(robot)


async def test_a_sensor_that_nobody_has_configured_is_named() -> None:
    with pytest.raises(ConfigError, match="no sensor 'sonar'"):
        async with Robot.open("sim", settings=("estimation.sensors=[encoders, sonar]",)):
            pass


@pytest.mark.long
def test_a_failing_sensor_of_the_experiment_is_found_out_and_recovers() -> None:
    config = load(None, ["seed=1", "sim.battery.used_1=null"], {}, {}).config
    outcome = run(sensor_failure.drive(config, "gyro", "imu", "not a number"), speed="max")
    assert outcome.detection < 0.1
    assert outcome.recovery < 1.0
    assert not outcome.disarmed
    assert "| gyro | imu | not a number |" in sensor_failure.table([outcome])


async def test_on_rough_ground_the_guard_slows_a_curve_through_the_gate() -> None:
    rough = (*ENDLESS, "sensors.imu.driver=sim_imu", "sim.ground.height=0.06", "roll_guard.enabled=true")
    async with Robot.open("sim", seed=1, settings=rough) as robot:
        await robot.load_gains()
        robot.program.begin()
        speeds = []
        for _ in range(100):
            robot.program.insist(1.5, 2.5)
            await asyncio.sleep(0.1)
            speeds.append(robot.runtime.state.control.v)
        assert min(speeds[20:]) < 1.2
        assert robot.armed


async def test_places_in_degrees_are_driven_to_on_the_fused_pose() -> None:
    settings = (*ENDLESS, "estimation.preset=imu-gps", "sensors.gps.driver=sim_gps")
    settings = (*settings, "sensors.gps.options={noise: 0.3, slow: 0.0}")
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()
        await asyncio.sleep(0.5)
        goal = UtmGrid(35.0844, -106.6504).earth(6.0, 4.0)  # the simulated room's origin is there
        (place,) = await places_on_earth(robot, "gps", [goal])
        assert place == pytest.approx((6.0, 4.0), abs=0.01)
        source = fused_pose(robot)
        await located(robot, source)
        await follow(robot, [(6.0, 4.0)], closed=False, pose_source=source)
        assert robot.pose is not None
        assert hypot(robot.pose[0] - 6.0, robot.pose[1] - 4.0) < 0.8


# -- an error in the estimate ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("vehicle", "seed"), [("txt1", "1"), ("f1tenth", "5"), ("rover", "3")])
def test_a_fast_circle_with_a_gps_that_is_still_to_be_located_is_driven_to_its_end(vehicle: str, seed: str) -> None:
    words = ["--vehicle", vehicle, "--seed", seed, *(word for each in ENDLESS for word in ("--set", each))]
    words += ["--duration", "20", "--drive", "1.0,1.0", "--set", "estimation.preset=imu-gps"]
    assert execute(["run", "--json", "--speed", "max", *words]) == 0


@pytest.fixture
async def fused() -> AsyncIterator[Robot]:
    """A robot that drives on the fused velocities."""
    settings = (*ENDLESS, "estimation.preset=gyro", "estimation.loops=true")
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.3, 3.0)
        assert robot.runtime.state.control.source is Source.COMBINED
        yield robot


def in_the_filter(estimator: Estimator, now: float) -> None:
    def judge(**_: bool) -> None:
        raise ValueError("a mistake\nin the filter")

    try:
        estimator.fusion.vote.compare = judge  # type: ignore[method-assign]
    except AttributeError:
        pytest.skip("did not run: a compiled method cannot be replaced")


def in_a_reading(estimator: Estimator, now: float) -> None:
    def through(measurement: Measurement) -> Iterable[Measurement]:
        raise TypeError("no such reading")

    estimator.through = through


def in_its_state(estimator: Estimator, now: float) -> None:
    estimator.fusion.sideways = nan, 0.0


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (in_the_filter, "ValueError: a mistake in the filter"),
        (in_a_reading, "TypeError: no such reading"),
        (in_its_state, "ArithmeticError: the filter's state is not finite"),
    ],
)
async def test_an_error_in_the_estimate_is_told_once_and_encoders_drive_on(
    fused: Robot, mistake: Any, words: str
) -> None:
    robot, estimator = fused, fused.runtime.part(Estimator)
    assert estimator is not None
    mistake(estimator, robot.now)
    await robot.drive(0.4, 0.2, 3.0)
    told = [event.text for event in robot.runtime.state.events if "estimate" in event.text]
    assert told == [f"the estimate is off: {words}; the loops go by the encoders"]
    assert robot.estimate is None
    assert fused_pose(robot).read() is None
    snapshot: Snapshot = robot.snapshot
    assert snapshot.get(FILTERED) is None
    assert {trust.reason for trust in snapshot[TRUSTS]} == {f"the estimate is off: {words}"}
    robot.program.insist(0.4, 0.2)
    await asyncio.sleep(0.04)
    assert robot.armed
    assert robot.runtime.state.control.source is Source.ENCODER
    assert robot.odometry.v == pytest.approx(0.4, abs=0.05)
