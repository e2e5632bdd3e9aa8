"""`txt1 sensor`: list or check sensors."""

import argparse
import os
from collections.abc import Iterable
from typing import Any

from txt1.cli import FAULT, OK
from txt1.cli.options import CONFIGURATION, add_actions, takes
from txt1.config import load
from txt1.config.schema import SensorConfig
from txt1.conformance import BROKEN, verdicts
from txt1.hal.registry import create as create_hal
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.registry import DRIVERS, create


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    name = {"name": takes("NAME", "a configured sensor, or a driver that needs no options")}
    add_actions(parser, {"list": (list_sensors, CONFIGURATION), "check": (check_sensor, name | CONFIGURATION)})


def list_sensors(arguments: argparse.Namespace) -> int:
    """Print the drivers that are installed, and the sensors that are configured."""
    for name in DRIVERS.names():
        print(f"driver {name}")
    for name, given in load(arguments.config, arguments.set, os.environ).config.sensors.items():
        print(f"sensor {name}: {given.driver}")
    return OK


def check_sensor(arguments: argparse.Namespace) -> int:
    """Run one through the conformance suite."""
    config = load(arguments.config, arguments.set, os.environ).config
    name = arguments.name
    given = config.sensors.get(name) or SensorConfig(driver=name)
    hal = create_hal(config)
    pose = (lambda: hal.read(0.0).pose) if hal.capabilities.pose else None

    def make() -> Sensor[Any]:
        return create(given, Setup(name, given.options, config, pose, hal))

    return print_verdicts(verdicts(SensorConformance, make, speed="max" if make().simulated else None))


def print_verdicts(found: Iterable[tuple[str, str]]) -> int:
    """Print each promise of a conformance suite and its verdict; the exit code."""
    kept = True
    for text, verdict in found:
        kept = kept and not verdict.startswith(BROKEN)
        print(f"{text}: {verdict}")
    return OK if kept else FAULT
