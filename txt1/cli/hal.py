"""`txt1 hal`: lists or checks hardware layers, or makes a new one."""

import argparse
import asyncio
import sys
from collections.abc import Callable
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from string import Template
from typing import Final

from txt1.commands import OK, add_actions, flag, path, signals_to, takes
from txt1.conformance import verdicts
from txt1.errors import ConfigError, HalError
from txt1.hal.base import Hal, Outputs
from txt1.hal.conformance import HalConformance
from txt1.hal.line import Line
from txt1.hal.registry import HALS, create
from txt1.installing import installs_package
from txt1.kernel.loop import run
from txt1.kit.options import CONFIGURATION, LINE, VEHICLE, loaded
from txt1.kit.verdicts import print_verdicts
from txt1.link.base import Port
from txt1.resources import PACKAGE
from txt1.sim.parameters import LineFaults

# s within which a board on a line answers
ANSWERS_WITHIN: Final = 10.0
# s between two checks for the board
LOOK_PERIOD: Final = 0.02
SKELETON: Final = PACKAGE / "hal" / "skeleton"
MODULE_NAME: Final = "the name of a Python module, such as mycar"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    lifted = flag("the wheels are off the ground: without it, nothing real is checked")
    check = {"name": takes("MODULE_NAME"), "--wheels-up": lifted} | CONFIGURATION | LINE | VEHICLE
    new = {
        "name": takes("MODULE_NAME", MODULE_NAME),
        "--to": takes("FOLDER", "folder in which its own folder is made; the present folder by default", path),
    }
    add_actions(parser, {"list": (list_hals, {}), "check": (check_hal, check), "new": (new_hal, new)})


def list_hals(_: argparse.Namespace) -> int:
    """Print the names of the installed hardware layers."""
    print("\n".join(HALS.names()))
    return OK


def check_hal(arguments: argparse.Namespace) -> int:
    """Run a hardware layer through the conformance suite. It drives slowly at first, with full power at the end."""
    arguments.hal = arguments.name
    config = loaded(arguments).config
    # a HAL that lacks some is exactly what the check has to find
    capabilities = getattr(create(config), "capabilities", None)
    simulated = getattr(capabilities, "simulated", False)
    if not simulated:
        moves = f"'{arguments.name}' is real hardware, and the check moves its wheels, a little at first"
        if not arguments.wheels_up:
            raise ConfigError(f"{moves}: lift them off the ground and add --wheels-up")
        if sys.stdin.isatty():
            print(f"{moves}. Does nothing touch them? [y/N] ", end="", flush=True)
            if sys.stdin.readline().strip().lower() not in ("y", "yes"):
                raise ConfigError(f"{moves}: nothing was moved")

        run(_answers(create(config)))

    def over(faults: LineFaults) -> Hal:
        """Return the configured HAL, with these faults of its line."""
        serial = config.serial.model_copy(update={"fault": faults})
        return create(config.model_copy(update={"serial": serial}))

    def behind(wrap: Callable[[Port], Port]) -> Hal | None:
        """Return the configured HAL with the port of its `Line` wrapped; None if it holds none."""
        hal = create(config)
        lines = [part for part in vars(hal).values() if isinstance(part, Line)]
        for line in lines:
            line.watched.port = wrap(line.watched.port)
        return hal if lines else None

    # a check closes its hardware halfway
    with signals_to(lambda number, _: sys.exit(128 + number)):
        # real hardware has no simulated faults and outages
        settings = {"over": staticmethod(over), "behind": staticmethod(behind)} if simulated else {"speed": None}
        skids = config.geometry.steering == "skid"
        return print_verdicts(verdicts(HalConformance, lambda: create(config), skids=skids, **settings))


async def _answers(hal: Hal) -> None:
    """Wait for the board of a HAL. Raises HalError if none answers; the error names the devices found.

    Without this each check would wait for a minute, and find no more than the first.
    """
    loop = asyncio.get_running_loop()
    begin = loop.time()
    await hal.open()
    try:
        while (link := hal.read(now := loop.time() - begin).link) is not None and not link.ready:
            if now > ANSWERS_WITHIN:
                raise HalError(f"nothing is checked, as no board of the HAL '{hal.name}' answers: {link.text}")
            hal.write(Outputs(), now)
            await asyncio.sleep(LOOK_PERIOD)
    finally:
        await hal.close()


def new_hal(arguments: argparse.Namespace) -> int:
    """Write a package with a new hardware layer and its test (docs/your-own-hal.md)."""
    name: str = arguments.name
    if not (name.isidentifier() and name.islower() and name.isascii()) or iskeyword(name):
        raise ConfigError(f"'{name}' cannot be the name of a HAL: it is {MODULE_NAME}")
    if name in HALS.ours:
        raise ConfigError(f"'{name}' is one of txt1's own HALs: choose another name")
    known = find_spec(name)
    # a plain folder of this name has no origin
    if known is not None and known.origin is not None:
        raise ConfigError(f"'{name}' is a Python module that is there already: choose another name")
    folder = (arguments.to or Path()) / name
    if folder.exists():
        raise ConfigError(f"{folder} is there already: remove it or choose another name")
    folder.mkdir(parents=True)
    words = {"name": name, "kind": "".join(part.capitalize() for part in name.split("_"))}
    for file, written in (("pyproject", "pyproject.toml"), ("hal", f"{name}.py"), ("test", f"test_{name}.py")):
        text = Template((SKELETON / f"{file}.txt").read_text()).substitute(words)
        (folder / written).write_text(text)
        print(folder / written)
    print(f"{installs_package(str(folder.absolute()), '-e ')}, then txt1 hal check {name}")
    return OK
