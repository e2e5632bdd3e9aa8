"""The programs behind the golden recordings: what the robot is, and five seconds of what it does."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.config import load
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet
from txt1.errors import CommandRefused, NotArmed
from txt1.fleet.fleet import Fleet
from txt1.fleet.plan import FleetPlan
from txt1.hal.base import Button
from txt1.kernel.loop import Speed, run
from txt1.learning import task as learning
from txt1.learning.registry import agent_of
from txt1.navigation import fused_pose, go_to, true_pose
from txt1.protocol.messages import Switch
from txt1.record.session import recording, recording_together
from txt1.robot import Robot
from txt1.ros.robot_end import Ros2RobotEnd
from txt1.sidecar import Request
from txt1.sim.room import Room

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")


class Recipe(NamedTuple):
    """How a recording is made."""

    about: str
    """What it covers."""
    drive: Callable[[Any], Awaitable[None]]
    settings: Sequence[str]
    speed: Speed = "max"
    plan: Mapping[str, Any] | None = None
    """Of a fleet, whose `drive` gets the fleet; else a robot."""


def make(name: str, path: Path) -> None:
    """Make the recording of this name there."""
    run(_make(name, path, RECIPES[name]), speed=RECIPES[name].speed)


async def _make(name: str, path: Path, recipe: Recipe) -> None:
    """Record a robot or a fleet."""
    config = load(None, ("seed=1", *recipe.settings)).config
    about = {"golden": name}
    if recipe.plan is not None:
        plan = FleetPlan.model_validate(recipe.plan)
        configs = plan.configs(load(None, [*plan.overrides, "seed=1", *recipe.settings]).config)
        async with (
            recording_together(path, configs, recipe.speed, about, print) as attach,
            Fleet.of(plan, configs, attach) as fleet,
        ):
            await fleet.get_ready()
            await recipe.drive(fleet)
        return
    async with (
        recording(path, config, recipe.speed, about, print) as attach,
        Robot.open(config=config, arm=True, attach=attach) as robot,
    ):
        await recipe.drive(robot)


# -- one robot in virtual time -----------------------------------------------------------------------------------


async def _towards_a_post(robot: Robot) -> None:
    """Drives at a post and is slowed, backs off, curves past it while readings are late and lost."""
    await robot.load_gains()
    await robot.drive(0.9, 0.0, 2.4)
    await robot.drive(-0.3, 0.0, 0.6)
    await robot.drive(0.6, 0.6, 1.2)


async def _over_waves(robot: Robot) -> None:
    """Asks for curves that the waves do not allow."""
    await robot.load_gains()
    await robot.drive(1.5, 2.5, 2.2)
    await robot.drive(1.5, -2.5, 2.0)


async def _by_the_filter(robot: Robot) -> None:
    """Drives on fused velocities, with slip, late tracking, and a time in which nobody tracks it."""
    await robot.load_gains()
    await robot.drive(0.6, 0.5, 2.5)
    robot.place(1.0, -1.0, 0.5)
    await robot.drive(0.5, -0.4, 1.6)


async def _to_a_pose(robot: Robot) -> None:
    """Drives to a pose around an obstacle, by the pose that the filter makes of GPS and gyro-free encoders."""
    await robot.load_gains()
    with suppress(TimeoutError):
        async with asyncio.timeout(2.6):
            await go_to(robot, (1.2, 0.6, 1.0), pose_source=true_pose(robot), room=Room(5.0, 5.0), speed=0.8)
    source = fused_pose(robot)
    assert source.read() is None, "positions alone tell no heading so soon"
    await robot.drive(-0.4, 0.4, 0.8)
    with suppress(TimeoutError):
        async with asyncio.timeout(1.0):
            await go_to(robot, (0.0, 0.0, 0.0), speed=0.8)


async def _by_hand(robot: Robot) -> None:
    """A rover is driven by PWM counts, moves its servos, pivots, runs into a wall; refused values."""
    await robot.load_gains()
    await robot.set_manual(True)
    await robot.hold_pwm(3500, 2500, -2500, 100, -100, duration=0.5)
    with suppress(CommandRefused):
        robot.pwm_test(float("nan"), 0, 0)
    robot.press(Button.RIGHT)
    await robot.set_manual(False)
    robot.servos(500, -500)
    robot.combined_odometry(0.0, 0.0, 0.0, 0.1, 0.1)
    await robot.drive(-0.3, -1.0, 0.4)
    await robot.drive(0.0, 1.2, 0.6)
    with suppress(NotArmed):
        await robot.drive(0.8, 0.0, 3.0)
    robot.tell("the rover has run into the wall")
    robot.switch_power(Switch.ESC, False)
    await asyncio.sleep(0.4)  # it is seen to stand
    robot.switch_power(Switch.ATX, False)
    await asyncio.sleep(0.2)
    robot.switch_power(Switch.ATX, True)
    robot.switch_power(Switch.ESC, True)
    await asyncio.sleep(0.5)  # it is seen to stand
    robot.arm()
    await robot.drive(-0.4, 0.0, 0.4)


async def _stops(robot: Robot) -> None:
    """A car without encoders: disarmed, stopped, armed again, carried elsewhere, asked for too much and for old."""
    await robot.load_gains()
    await robot.drive(0.8, 0.5, 1.0)
    robot.program.insist(0.8, 5.0)
    await asyncio.sleep(0.1)
    robot.disarm("a look around")
    await asyncio.sleep(0.4)
    robot.arm()
    await robot.drive(-0.5, 0.3, 0.7)
    robot.program.insist(0.6, 0.0)
    await asyncio.sleep(0.5)  # the command grows stale
    robot.program.insist(0.6, 0.0)
    robot.stop()
    await asyncio.sleep(0.3)
    robot.place(0.5, 0.5, 1.0)
    robot.arm()
    await robot.drive(0.9, -0.5, 0.8)


async def _with_other_gains(robot: Robot) -> None:
    """A fast car whose gains are changed as it drives, and refused once."""
    await robot.load_gains()
    await robot.drive(2.5, 1.0, 1.0)
    robot.program.insist(2.5, 1.0)
    await robot.load_gains(linear=Gains(9.0, 15.0, 0.2))
    await robot.drive(2.5, -1.0, 0.8)
    await robot.load_gains(angular=[GainSet(0.5, Gains(3.0, 20.0, 0.0)), GainSet(3.0, Gains(1.5, 12.0, 0.05))])
    with suppress(CommandRefused):
        await robot.load_gains(linear=Gains(float("inf"), 0.0, 0.0))
    robot.program.insist(2.0, 0.5)
    await robot.drive(1.0, 1.0, 1.0)


async def _learns(robot: Robot) -> None:
    """The thesis's learner drives to the light."""
    await robot.load_gains()
    agent = agent_of(robot.config, "thesis", None)
    await learning.need_light(robot)
    learning.start(robot, agent)
    await asyncio.sleep(4.2)


async def _by_ros(robot: Robot) -> None:
    """What a node of ROS 2 asks for reaches the bridge's own desk: velocities, a goal, gains, a disarm."""
    desk = Ros2RobotEnd(robot)
    calls = 0

    def call(name: str, **fields: Any) -> None:
        nonlocal calls
        calls += 1
        desk.request(Request("call", {"id": calls, "name": name, "fields": fields}, 0.0))

    async def twist(v: float, omega: float, seconds: float) -> None:
        for _ in range(round(10 * seconds)):
            desk.request(Request("drive", {"v": v, "omega": omega}, 0.0))
            await asyncio.sleep(0.1)

    call("load_gains")
    await asyncio.sleep(0.2)
    await twist(0.5, 0.4, 1.0)
    call("set", values={"control.linear.kp": 9.0, "v_max": 0.6})
    await twist(1.0, -0.5, 0.8)
    call("disarm")
    await twist(0.5, 0.0, 0.3)
    call("arm")
    call("drive_to", frame="odom", x=1.5, y=0.5, theta=0.0, speed=0.4)
    await asyncio.sleep(1.5)
    desk.lost()
    await asyncio.sleep(0.4)


# -- others ------------------------------------------------------------------------------------------------------


async def _together(fleet: Fleet) -> None:
    """Three robots: two run into one another, the third follows the first and sees it with its laser."""
    one, two, three = fleet.robots.values()

    async def ram(robot: Robot, v: float) -> None:
        with suppress(NotArmed):
            await robot.drive(v, 0.0, 3.0)

    await asyncio.gather(ram(one, 0.5), ram(two, 0.4), three.drive(0.7, 0.0, 3.0))
    fleet.stop_all()
    await asyncio.sleep(0.5)
    three.arm()
    await three.drive(-0.3, 0.3, 0.7)


async def _over_the_wire(robot: Robot) -> None:
    """A board behind a line is driven, disarmed and armed again; its ESC is switched off, and gains are changed."""
    await robot.load_gains()
    await robot.drive(0.5, 0.4, 1.2)
    robot.servos(300, -300)
    await robot.load_gains(linear=Gains(9.0, 15.0, 0.2))
    await robot.drive(-0.3, 0.2, 0.8)
    robot.disarm("a look around")
    robot.switch_power(Switch.ESC, False)
    await asyncio.sleep(0.6)


RECIPES: Final[dict[str, Recipe]] = {
    "obstacle": Recipe(
        "the obstacle stop slows: laser with late and lost readings; wiring put right, two weak batteries",
        _towards_a_post,
        ("sensors.laser.driver=sim_laser", "sensors.laser.delay=0.04", "sensors.laser.drop_out=0.1",
         "sim.obstacles=[{kind: post, x: 1.9, y: 0.0, radius: 0.1}]", "sim.battery.used_1=20.0",
         "sim.battery.used_2=30.0", "sim.battery.by_speed=true",
         *(f"{where}={{motor: {{direction: -1}}, encoders_swapped: true}}" for where in ("channels", "sim.channels"))),
    ),
    "roll": Recipe(
        "the roll guard slows on rough ground: IMU", _over_waves,
        (*ENDLESS, "sensors.imu.driver=sim_imu", "sim.ground.height=0.06", "roll_guard.enabled=true"),
    ),
    "filter": Recipe(
        "the velocity loops go by the filter: IMU, motion capture, slip, an occlusion", _by_the_filter,
        (*ENDLESS, "estimation.preset=vicon", "estimation.loops=true", "sim.vehicle.slip=0.05",
         "sim.vehicle.understeer=0.1", "sensors.vicon.driver=sim_vicon", "sensors.vicon.period=0.05",
         "sensors.vicon.delay=0.03", "sensors.vicon.options={occlusions: [[2.0, 3.4]]}",
         "sensors.imu.driver=sim_imu", "sensors.imu.period=0.02"),
    ),
    "goto": Recipe(
        "navigation to poses; a filter of encoders and GPS beside it", _to_a_pose,
        ("estimation.sensors=[encoders, gps]", "sensors.gps.driver=sim_gps",
         "sim.obstacles=[{kind: box, x: 1.0, y: -0.9, length: 0.3, width: 0.3}]"),
    ),
    "rover": Recipe(
        "a rover that pivots; manual mode, PWM, servos, buttons, refused values; a runaway at a wall, power switches",
        _by_hand, ("vehicle=rover", "sim.start=[1.9, 0.0, 0.0]"),
    ),
    "donkeycar": Recipe(
        "a car without encoders; disarming, emergency stop, stale commands, carried elsewhere", _stops,
        ("vehicle=donkeycar",),
    ),
    "f1tenth": Recipe(
        "a fast car with loops that know it; gains changed as it drives", _with_other_gains,
        ("vehicle=f1tenth", "car.known=true", *ENDLESS),
    ),
    "learner": Recipe(
        "the thesis's learner drives by four light sensors", _learns,
        ("sensors.light.driver=sim_light", "sim.room.length=20", "sim.room.width=20"),
    ),
    "ros": Recipe("requests as a node of ROS 2 sends them, through the bridge's own code", _by_ros, ()),
    "fleet": Recipe(
        "three robots in one world: a collision, a laser that sees another car, a stop of all", _together, (),
        plan={
            "robots": {
                "txt01": {"start": (0.0, 0.0, 0.0)},
                "txt02": {"start": (1.7, 0.05, 3.14)},
                "txt03": {"start": (-1.5, 0.0, 0.0), "set": {"sensors.laser.driver": "sim_laser"}},
            }
        },
    ),
    "wire": Recipe(
        "a virtual board over the wire on the real clock", _over_the_wire,
        ("hal=serial", "serial.port=virtual"), speed=None,
    ),
    "line": Recipe(
        "a virtual board over a bad line in virtual time, byte by byte", _over_the_wire,
        ("hal=serial", "serial.port=virtual", "serial.fault={drop: 0.02, flip: 0.0002, jitter: 0.005}"),
    ),
}  # fmt: skip
"""By name."""
