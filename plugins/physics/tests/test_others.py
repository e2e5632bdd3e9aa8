"""Vehicles of other people under the simulated robot."""

import asyncio
from math import cos, nan, pi, sin

import pytest

from txt1 import run
from txt1.config import Config, load
from txt1.errors import ConfigError, TaskFault
from txt1.experiments.calibration.simulated_operator import smallest_circle
from txt1.hal.registry import PHYSICS, create_sim
from txt1.model.vehicle import Geometry
from txt1.robot import Robot
from txt1.sim.dynamics import Motion
from txt1.sim.world import World
from txt1_physics.foreign import Foreign, MotorDrive
from txt1_physics.mjcf import roll_gradient
from txt1_physics.settings import PhysicsSettings

CARS = {"single-track-drift": "f1tenth", "multi-body": "f1tenth", "mujoco": "txt1"}
AT_REST: Motion = (0.0,) * 9
LEFT = (-9000.0, 9000.0)
# the compilers of commonroad's models take a quarter of a minute where nothing is kept yet
EACH = [
    pytest.param("single-track-drift", marks=pytest.mark.long),
    pytest.param("multi-body", marks=pytest.mark.long),
    "mujoco",
]


def config(physics: str, *settings: str) -> Config:
    endless = "sim.room.length=.inf", "sim.room.width=.inf"
    return load(
        None, [f"vehicle={CARS.get(physics, 'txt1')}", f"sim.physics={physics}", *endless, *settings], {}, {}
    ).config


def drive(physics: Foreign, motion: Motion, seconds: float, motor: float, front: float, rear: float) -> Motion:
    for _ in range(round(seconds / 0.02)):
        motion = physics(motion, motor, front, rear, 0.02, 0.0)
    return motion


@pytest.mark.parametrize("name", EACH)
def test_it_drives_a_left_turn_and_stops_by_itself(name: str) -> None:
    given = config(name)
    physics = PHYSICS.make("sim.physics", name, given)
    x, y, theta, v, front, rear, right, left, spin = drive(physics, AT_REST, 1.0, 2500.0, *LEFT)
    free = given.sim.vehicle.speed_gain * (2500.0 - given.sim.vehicle.dead_band)
    assert 0.7 * free < v < 1.1 * free
    assert x > 0.1 and y > 0.0 and theta > 0.1 and right > left > 0.1
    assert front == pytest.approx(0.5 * given.geometry.steering_max, rel=0.2) and rear == pytest.approx(-front, rel=0.3)
    roll, _ = physics.attitude((x, y, theta))
    assert roll > 0.0 or name == "single-track-drift", "the body leans to the right"
    motion = drive(physics, (x, y, theta, v, front, rear, right, left, spin), 4.0, 0.0, 0.0, 0.0)
    assert motion[3] == 0.0 and drive(physics, motion, 1.0, 0.0, 0.0, 0.0) == motion, "it stands"


@pytest.mark.parametrize("name", EACH)
def test_it_drives_backwards(name: str) -> None:
    motion = drive(PHYSICS.make("sim.physics", name, config(name)), AT_REST, 1.5, -1500.0, *LEFT)
    assert motion[0] < -0.1 and motion[3] < -0.1 and motion[2] < 0.0 and motion[6] < 0.0


@pytest.mark.parametrize("name", EACH)
def test_after_a_slide_it_backs_along_its_wheels_and_not_sideways(name: str) -> None:
    physics = PHYSICS.make("sim.physics", name, config(name))
    motion = drive(physics, AT_REST, 2.0, 6000.0, 0.0, 0.0)
    for side in (1.0, -1.0, 1.0):  # hard steering at full reverse, until it backs
        motion = drive(physics, motion, 0.4, -8000.0, side * 18000.0, -side * 18000.0)
    x, y, theta, *_ = drive(physics, motion, 1.0, -3000.0, 0.0, 0.0)
    end = drive(physics, (x, y, theta, *_), 0.5, -3000.0, 0.0, 0.0)
    along = (end[0] - x) * cos(theta) + (end[1] - y) * sin(theta)
    beside = (end[1] - y) * cos(theta) - (end[0] - x) * sin(theta)
    assert along < -0.2 and abs(beside) < 0.05 * abs(along)


@pytest.mark.parametrize("name", EACH)
def test_a_look_ahead_changes_nothing(name: str) -> None:
    ways = []
    for looks in (False, True):
        physics, motion = PHYSICS.make("sim.physics", name, config(name)), AT_REST
        for step in range(40):
            if looks and step % 3 == 0:
                physics(motion, -9000.0, 5000.0, 0.0, 0.013, 0.1)
            motion = physics(motion, 3000.0, *LEFT, 0.02, 0.0)
        ways.append(motion)
    assert ways[0] == ways[1]


@pytest.mark.parametrize("name", EACH)
def test_a_run_repeats_to_the_last_bit(name: str) -> None:
    async def poses() -> list[object]:
        async with Robot.open(config=config(name, "seed=3"), arm=True) as robot:
            await robot.load_gains()
            await asyncio.sleep(0.2)
            driving = asyncio.create_task(robot.drive(0.6, 0.5, duration=1.5))
            seen: list[object] = []
            while not driving.done():
                seen.append(robot.hal.read(robot.now).pose)
                await asyncio.sleep(0.02)
            await driving
        return seen

    first = run(poses(), speed="max")
    assert first == run(poses(), speed="max") and first[-1] != (0.0, 0.0, 0.0)


def test_the_car_in_mujoco_goes_where_ours_goes() -> None:
    """Straight on no tyre slides; in a curve wide tyres that are steered in parallel scrub, and take a wider one."""
    plain, other = (create_sim(config(name, "sim.noise.drag=0")).vehicle for name in ("plain", "mujoco"))
    for vehicle in plain, other:
        vehicle.command(1500.0, 0.0, 0.0)
        vehicle.advance_to(6.0)
    assert other.pose == pytest.approx(plain.pose, rel=0.02, abs=0.01)
    for vehicle in plain, other:
        vehicle.command(1500.0, -4500.0, 4500.0)
        vehicle.advance_to(10.0)
    assert 0.7 * plain.state.theta < other.state.theta < plain.state.theta < pi


@pytest.mark.long
@pytest.mark.parametrize("name", ["single-track-drift", "multi-body"])
def test_an_f1tenth_gets_away_without_spinning_its_wheels(name: str) -> None:
    async def main() -> tuple[float, float]:
        async with Robot.open(config=config(name), arm=True) as robot:
            await robot.load_gains()
            vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
            driving = asyncio.create_task(robot.drive(2.0, 0.0, duration=2.5))
            spins = 0.0
            while not driving.done():
                before = vehicle.motion
                await asyncio.sleep(0.1)
                spins = max(spins, 0.5 * (vehicle.motion[6] - before[6] + vehicle.motion[7] - before[7]) - 0.1 * 2.0)
            await driving
            return vehicle.motion[3], spins / 0.1

    v, spins = run(main(), speed="max")
    assert v == pytest.approx(2.0, abs=0.1)
    assert spins < 0.2, "m/s over the set-point"


def test_a_wall_stops_it() -> None:
    vehicle = create_sim(load(None, ["sim.physics=mujoco"], {}, {}).config).vehicle
    vehicle.command(2500.0, 0.0, 0.0)
    vehicle.advance_to(8.0)
    assert 2.0 < vehicle.pose[0] < 2.5 - 0.5 * vehicle.body.length + 0.01
    vehicle.place(0.0, 0.0, 1.0)
    assert vehicle.pose == (0.0, 0.0, 1.0) and vehicle.state.v == 0.0


def test_on_blocks_its_wheels_turn_and_steer_and_it_stays_where_it_is() -> None:
    vehicle = create_sim(config("mujoco")).vehicle
    vehicle.physics.lift(True)  # type: ignore[union-attr]
    vehicle.command(1000.0, -9000.0, 9000.0)
    vehicle.advance_to(3.0)
    assert vehicle.pose == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert vehicle.state.right > 0.2
    assert vehicle.state.phi_front == pytest.approx(0.5 * vehicle.body.steering_max, rel=0.02), "no floor holds it"
    vehicle.physics.lift(False)  # type: ignore[union-attr]
    vehicle.place(0.0, 0.0, 0.0)
    vehicle.command(1000.0, 0.0, 0.0)
    vehicle.advance_to(6.0)
    assert vehicle.pose[0] > 0.3


def test_one_that_is_held_at_a_wall_remembers_no_more_and_more() -> None:
    vehicle = create_sim(load(None, ["sim.physics=mujoco", "sim.start=[2.2,0,0]"], {}, {}).config).vehicle
    vehicle.command(2500.0, 0.0, 0.0)
    vehicle.advance_to(4.0)
    assert vehicle.state.v == 0.0
    assert len(vehicle.physics._hidden) <= 8  # type: ignore[union-attr]  # noqa: SLF001


def test_two_in_one_world_stop_one_another() -> None:
    world = World()
    cars = [create_sim(config("mujoco", f"sim.start=[{x},0,{theta}]"), world).vehicle for x, theta in ((0, 0), (2, pi))]
    for time in range(1, 300):
        for car in cars:
            car.command(1500.0, 0.0, 0.0)
            car.move_to(0.02 * time)
    gap_left = cars[1].pose[0] - cars[0].pose[0] - cars[0].body.length
    assert -0.01 < gap_left < 0.05 and cars[0].pose[0] == pytest.approx(2.0 - cars[1].pose[0], abs=0.05)


def test_a_physics_that_diverges_ends_the_run_in_a_line_with_neutral_outputs(monkeypatch: pytest.MonkeyPatch) -> None:
    from txt1_physics.four_wheels import FourWheels

    usual = FourWheels.step

    def diverging(
        self: FourWheels, motion: Motion, hidden: object, drive: MotorDrive, *rest: float
    ) -> tuple[Motion, object]:
        after, state = usual(self, motion, hidden, drive, *rest)  # type: ignore[arg-type]
        return ((*after[:3], nan, *after[4:]) if after[0] > 0.1 else after), state

    monkeypatch.setattr(FourWheels, "step", diverging)
    hals = []

    async def main() -> None:
        async with Robot.open(config=config("mujoco"), arm=True) as robot:
            hals.append(robot.hal)
            await robot.load_gains()
            await asyncio.sleep(0.2)
            await robot.drive(0.5, 0.0, duration=5.0)

    with pytest.raises(
        TaskFault, match=r"mujoco fails at .* beyond all bounds; drive slower or steer less, or set sim\.phys"
    ):
        run(main(), speed="max")
    outputs = hals[0].outputs  # type: ignore[attr-defined]
    assert (outputs.motor, outputs.front, outputs.rear) == (0, 0, 0)


def test_a_car_on_its_side_ends_the_run() -> None:
    vehicle = create_sim(config("mujoco", "physics.gravity_height=0.4")).vehicle
    vehicle.command(5000.0, -18000.0, 18000.0)
    with pytest.raises(Exception, match=r"the car has rolled over; drive slower"):
        vehicle.advance_to(10.0)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (
            ["sim.physics=mujoco", "vehicle=f1tenth"],
            "axles both steer, and f1tenth is none; use sim.physics=single-track",
        ),
        (["sim.physics=multi-body"], "txt1 steers both axles; use --vehicle f1tenth, or sim.physics=mujoco"),
        (["sim.physics=multi-body", "vehicle=rover"], "rover has sides at two speeds; use --vehicle f1tenth"),
        (["sim.physics=multibody"], "did you mean 'multi-body'"),
        (["sim.physics=mujoco", "sim.ground.height=0.02"], "sim.ground.height=0.02 has no effect; leave it out"),
        (["sim.physics=mujoco", "sim.vehicle.slip=0.1"], "sim.vehicle.slip=0.1 has no effect; leave it out"),
        (["sim.physics=multi-body", "vehicle=f1tenth", "sim.vehicle.speed_gain=0.001"], "use at most 0.00076"),
        (["sim.physics=mujoco", "sim.vehicle.speed_gain=0.01"], "a wheel turns 2.91 rad in a step"),
        (["sim.physics=mujoco", "physics.mass=1.0"], "physics.mass: 1 kg with wheels of 0.35 kg"),
        (["sim.physics=mujoco", "physics.gravity_height=0.01"], "use at least 0.082 m"),
        (["sim.physics=mujoco", "geometry.wheelbase=0.1"], "wheels would overlap; use 0.163 to 0.51 m"),
        (["sim.physics=mujoco", "geometry.track_width=0.5"], "stand outside the body; use 0.1 to 0.385 m"),
    ],
)
def test_what_a_model_does_not_hold_for_is_refused_in_a_line(settings: list[str], told: str) -> None:
    with pytest.raises(ConfigError, match=told) as caught:
        create_sim(load(None, settings, {}, {}).config)
    assert "\n" not in str(caught.value)


def test_settings_of_mujocos_car_without_mujoco_are_refused() -> None:
    async def main() -> None:
        async with Robot.open(config=load(None, ["physics.mass=5"], {}, {}).config):
            pass

    with pytest.raises(
        ConfigError, match=r"its settings are MuJoCo's, and sim\.physics is plain; set sim\.physics=mujoco"
    ):
        run(main(), speed="max")


def test_the_tyres_of_mujocos_car_do_not_chatter_in_a_curve() -> None:
    physics, motion, rates = PHYSICS.make("sim.physics", "mujoco", config("mujoco")), AT_REST, []
    for _ in range(150):
        before = motion
        motion = physics(motion, 1900.0, -9000.0, 9000.0, 0.02, 0.0)
        # by the encoder wheels, as the loops see it
        rates.append((motion[6] - before[6] - (motion[7] - before[7])) / 0.25 / 0.02)
    settled = rates[-50:]
    assert max(settled) - min(settled) < 0.02 < 0.3 < settled[-1]


def test_a_calibrated_circle_is_judged_by_the_one_that_it_truly_drives() -> None:
    sim = create_sim(config("mujoco")).vehicle
    ours = create_sim(load(None, [], {}, {}).config).vehicle
    assert smallest_circle(ours) == ours.body.radius_min
    assert 1.02 < smallest_circle(sim) / sim.body.radius_min < 1.5, "its tyres scrub, and the linkage gives way"


@pytest.mark.long
@pytest.mark.parametrize("height", [0.3, 0.35])
def test_a_roll_guard_that_knows_the_springs_keeps_a_tall_car_s_wheels_down(height: float) -> None:
    tall = PhysicsSettings(gravity_height=height)

    def highest(gradient: float) -> float:
        given = config(
            "mujoco",
            f"physics.gravity_height={height}",
            "sensors.imu.driver=sim_imu",
            "roll_guard.enabled=true",
            f"roll_guard.gravity_height={height}",
            f"roll_guard.roll_gradient={gradient}",
        )

        async def main() -> float:
            async with Robot.open(config=given, arm=True) as robot:
                await robot.load_gains()
                car, found = robot.hal.vehicle.physics, 0.0  # type: ignore[attr-defined]
                for tick in range(300):
                    robot.program.insist(1.5, 20.0 if tick // 100 % 2 else -20.0)
                    await asyncio.sleep(0.02)
                    found = max(found, *car.heights())
                return found

        return run(main(), speed="max")

    rises = 0.001  # m; a wheel that hops less on stiff contacts has not risen
    assert highest(roll_gradient(Geometry(), tall)) < rises
    assert highest(0.0) > rises, "the IMU sees the lean of a body on soft springs too late"
