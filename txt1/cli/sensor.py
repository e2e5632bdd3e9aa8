"""`txt1 sensor`: list or check sensors."""

from __future__ import annotations

import argparse
import os
from typing import Any

from txt1.cli.exit_codes import FAULT, OK
from txt1.cli.options import add_config
from txt1.config import load
from txt1.config.schema import SensorConfig
from txt1.conformance import BROKEN, verdicts
from txt1.hal.registry import create as create_hal
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.registry import DRIVERS, create


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    show = actions.add_parser("list", help="print the drivers that are installed, and the sensors that are configured")
    add_config(show)
    show.set_defaults(main=list_sensors)
    check = actions.add_parser("check", help="run one through the conformance suite")
    check.add_argument("name", metavar="NAME", help="a configured sensor, or a driver that needs no options")
    add_config(check)
    check.set_defaults(main=check_sensor)


def list_sensors(arguments: argparse.Namespace) -> int:
    """Print a line for each driver and for each configured sensor."""
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

    kept = True
    for text, verdict in verdicts(SensorConformance, make, speed="max" if make().simulated else None):
        kept = kept and not verdict.startswith(BROKEN)
        print(f"{text}: {verdict}")
    return OK if kept else FAULT
