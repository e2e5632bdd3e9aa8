"""`txt1 device`: be one of the devices whose drivers we have, with a simulated vehicle behind it."""

from __future__ import annotations

import argparse
import os

from txt1.cli import options
from txt1.cli.app import App, say
from txt1.cli.options import takes
from txt1.config import Config, load
from txt1.devices.pico import Pico
from txt1.link.pty import listen_pty
from txt1.link.tcp import listen_tcp


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the devices, and where they are to be found."""
    parser.add_argument("name", choices=("pico",), help="pico: our firmware under MicroPython's unix port")
    options.add(parser.add_mutually_exclusive_group(required=True), {
        "--pty": takes("PATH", "a pseudo-terminal with a link to it at PATH"),
        "--tcp": takes("[HOST:]PORT", "a TCP port; HOST is 127.0.0.1", options.host_and_port),
    })  # fmt: skip
    options.add(parser, options.CONFIGURATION | {"--duration": takes("S", "end after S seconds", options.positive)})
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Run the device until the duration is over or a signal comes."""
    config = load(arguments.config, arguments.set, os.environ).config
    app = App()
    return app.run(_serve(arguments, config))


async def _serve(arguments: argparse.Namespace, config: Config) -> None:
    pico = Pico(config)
    if arguments.pty is not None:
        listener = listen_pty(arguments.pty, pico.line)
    else:
        host, port = arguments.tcp
        listener = await listen_tcp(host, port, pico.line)
    try:
        await pico.power_up()
        say(f"{arguments.name} is at {listener.address}")
        await pico.ended(arguments.duration)
    finally:
        try:
            await pico.power_down()
        finally:
            listener.close()
