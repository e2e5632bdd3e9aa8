"""`txt1 sensor`: lists or checks sensors, or is a virtual sensor."""

import argparse
import os
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from typing import Any, Final, NamedTuple

from txt1.commands import OK, add_actions, positive, say, takes, velocity
from txt1.config import Config, load
from txt1.config.schema import SensorConfig
from txt1.conformance import verdicts
from txt1.driver import REFRESH
from txt1.errors import ConfigError
from txt1.hal.registry import create as create_hal
from txt1.kernel.ticks import Ticks
from txt1.kit.app import App, get_ready
from txt1.kit.far_end import FAR_END, listen
from txt1.kit.options import CONFIGURATION
from txt1.kit.verdicts import print_verdicts
from txt1.sensors.base import Reading, Sensor, Setup
from txt1.sensors.conformance import COMPUTED, SensorConformance
from txt1.sensors.registry import DRIVERS, create
from txt1.sensors.virtual_sensor import VirtualSensor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    name = {"name": takes("NAME", "a configured sensor, or a driver that needs no options")}
    kind = {
        "kind": {
            "choices": tuple(VIRTUAL),
            "help": "imu: 3DM-GX2; gps: NMEA at --pty, gpsd's JSON at --tcp; "
            "vicon: VRPN; laser: Hokuyo SCIP 2.0; ld19: LDROBOT LD19; "
            "rplidar, rplidar_a3, rplidar_s2: Slamtec RPLIDAR A1, A3, S2; ydlidar, ydlidar_x4, "
            "ydlidar_tg30: YDLIDAR X2, X4, TG30; bno08x: BNO08x in UART-RVC",
        },
        **FAR_END,
        "--drive": takes("V,OMEGA", "velocity of the simulated robot meanwhile: m/s, rad/s", velocity),
        "--duration": takes("S", "end after S seconds", positive),
    }
    add_actions(
        parser,
        {
            "list": (list_sensors, CONFIGURATION),
            "check": (check_sensor, name | CONFIGURATION),
            "virtual": (virtual_sensor, kind | CONFIGURATION),
        },
    )


def list_sensors(arguments: argparse.Namespace) -> int:
    """Print the installed drivers, and the configured sensors."""
    for name in DRIVERS.names():
        print(f"driver {name}")
    for name, given in load(arguments.config, arguments.set, os.environ).config.sensors.items():
        print(f"sensor {name}: {given.driver}")
    return OK


def check_sensor(arguments: argparse.Namespace) -> int:
    """Run a sensor through the conformance suite."""
    config = load(arguments.config, arguments.set, os.environ).config
    name = arguments.name
    given = config.sensors.get(name) or SensorConfig(driver=name)
    hal = create_hal(config)
    pose = (lambda: hal.read(0.0).pose) if hal.capabilities.pose else None

    def make() -> Sensor[Any]:
        return create(given, Setup(name, given.options, config, pose, hal))

    settings = {"speed": "max", "processor": COMPUTED} if make().simulated else {"speed": None}
    return print_verdicts(verdicts(SensorConformance, make, **settings))


class VirtualKind(NamedTuple):
    """A virtual device: the driver of its simulated readings, with options, and the function that makes its far end."""

    driver: str
    options: Mapping[str, Any]
    at_tcp: str
    at_pty: str


VIRTUAL: Final = {
    "imu": VirtualKind("sim_imu", {}, "txt1.sensors.virtual_imu:VirtualImu", "txt1.sensors.virtual_imu:VirtualImu"),
    "bno08x": VirtualKind(
        "sim_imu",
        {},
        "txt1.sensors.virtual_bno08x:bno08x",
        "txt1.sensors.virtual_bno08x:bno08x",
    ),
    "gps": VirtualKind("sim_gps", {}, "txt1.sensors.virtual_gps:VirtualGpsd", "txt1.sensors.virtual_gps:receiver"),
    "vicon": VirtualKind(
        "sim_vicon",
        {},
        "txt1.sensors.virtual_mocap:VirtualVicon",
        "txt1.sensors.virtual_mocap:VirtualVicon",
    ),
    "laser": VirtualKind(
        "sim_laser",
        {"range_max": 5.6},
        "txt1.sensors.virtual_lasers:VirtualScip",
        "txt1.sensors.virtual_lasers:VirtualScip",
    ),
    "ld19": VirtualKind(
        "sim_laser",
        {"steps": 450, "beams": 450, "range_max": 12.0},
        "txt1.sensors.virtual_lasers:ld19",
        "txt1.sensors.virtual_lasers:ld19",
    ),
    "rplidar": VirtualKind(
        "sim_laser",
        {"steps": 720, "beams": 720, "range_max": 12.0},
        "txt1.sensors.virtual_rplidar:a1",
        "txt1.sensors.virtual_rplidar:a1",
    ),
    "rplidar_a3": VirtualKind(
        "sim_laser",
        {"steps": 720, "beams": 720, "range_max": 25.0},
        "txt1.sensors.virtual_rplidar:a3",
        "txt1.sensors.virtual_rplidar:a3",
    ),
    "rplidar_s2": VirtualKind(
        "sim_laser",
        {"steps": 720, "beams": 720, "range_max": 30.0},
        "txt1.sensors.virtual_rplidar:s2",
        "txt1.sensors.virtual_rplidar:s2",
    ),
    "ydlidar": VirtualKind(
        "sim_laser",
        {"steps": 720, "beams": 720, "range_max": 8.0},
        "txt1.sensors.virtual_ydlidar:x2",
        "txt1.sensors.virtual_ydlidar:x2",
    ),
    "ydlidar_x4": VirtualKind(
        "sim_laser",
        {"steps": 720, "beams": 720, "range_max": 10.0},
        "txt1.sensors.virtual_ydlidar:x4",
        "txt1.sensors.virtual_ydlidar:x4",
    ),
    "ydlidar_tg30": VirtualKind(
        "sim_laser",
        {"steps": 720, "beams": 720, "range_max": 30.0},
        "txt1.sensors.virtual_ydlidar:tg30",
        "txt1.sensors.virtual_ydlidar:tg30",
    ),
}
# m/s and rad/s of the robot that carries a virtual device, a circle of 1 m
WALK: Final = (0.3, 0.3)


def virtual_sensor(arguments: argparse.Namespace) -> int:
    """Be a virtual device: the far end of its protocol, fed by a simulated robot that drives in its world."""
    if (arguments.pty is None) == (arguments.tcp is None):
        raise ConfigError("sensor virtual: say where, with one of --pty PATH and --tcp PORT")
    chosen = VIRTUAL[arguments.kind]
    config = load(arguments.config, arguments.set, os.environ).config
    if config.hal != "sim":
        raise ConfigError(f"hal: '{config.hal}' is no simulation, which feeds the devices on the desk; use sim")
    given = config.sensors.get(arguments.kind, SensorConfig(driver=chosen.driver, options=dict(chosen.options)))
    config = config.model_copy(update={"sensors": {arguments.kind: given}})
    app = App()
    return app.run(_serve(app, config, arguments, chosen))


async def _serve(app: App, config: Config, arguments: argparse.Namespace, chosen: VirtualKind) -> None:
    where = chosen.at_tcp if arguments.pty is None else chosen.at_pty
    device: VirtualSensor = EntryPoint(arguments.kind, where, "").load()()
    v, omega = arguments.drive or WALK
    async with app.robot(config) as robot:
        await get_ready(robot, True)
        if arguments.duration is not None:
            robot.runtime.scheduler.end_at(robot.now + arguments.duration)
        listener = await listen(arguments, device)
        try:
            say(f"on the desk: {arguments.kind} at {listener.address}")

            async def drive(ticks: Ticks) -> None:
                async for _ in ticks:
                    robot.command(v, omega)

            robot.add_task("drive", REFRESH, drive)
            topic = robot.sensors[arguments.kind].sensor.topic
            robot.runtime.bus.subscribe(lambda _, value, time: device.show(Reading(time, value)), [topic])
            await robot.runtime.scheduler.ended
        finally:
            listener.close()
