"""`txt1 device`: start a virtual device, with a simulated vehicle behind it."""

from __future__ import annotations

import argparse
import os
from typing import Final, Protocol

from txt1 import commands
from txt1.commands import say, takes
from txt1.config import Config, load
from txt1.errors import Txt1Error
from txt1.hal.registry import HALS
from txt1.kit import options
from txt1.kit.app import App
from txt1.kit.far_end import FAR_END, listen
from txt1.link.base import End
from txt1.plugins import Registry

DEVICES: Final = Registry("device", "txt1.devices", {}, Txt1Error)


class Device(Protocol):
    """A device with a simulated vehicle behind it."""

    line: End
    """The device's end of the line, with the configured faults."""

    async def power_up(self) -> None:
        """Start the device; raises a Txt1Error if it cannot."""

    async def power_down(self) -> None:
        """Stop the device; harmless when it is stopped already."""

    async def ended(self, duration: float | None = None) -> None:
        """Wait for its end, at most `duration` s; raises its error."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the devices, and the place of the line."""
    parser.add_argument(
        "name",
        choices=DEVICES.names(),
        help="a board with our firmware, under MicroPython's unix port, or the controller that the hardware layer of "
        "that name drives",
    )
    commands.add(parser.add_mutually_exclusive_group(required=True), FAR_END)
    commands.add(parser, options.CONFIGURATION | {"--duration": takes("S", "end after S seconds", commands.positive)})
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Run the device until the duration is over or a signal comes."""
    own = {"hal": arguments.name} if arguments.name in HALS.ours else {}
    config = load(arguments.config, arguments.set, os.environ, own).config
    return App().run(_serve(arguments, config))


async def _serve(arguments: argparse.Namespace, config: Config) -> None:
    device: Device = DEVICES.make("device", arguments.name, config)
    listener = await listen(arguments, device.line)
    try:
        await device.power_up()
        say(f"{arguments.name} is at {listener.address}")
        await device.ended(arguments.duration)
    finally:
        try:
            await device.power_down()
        finally:
            listener.close()
