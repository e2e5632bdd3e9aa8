"""`txt1 run --bridge`."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from txt1.additions import Options
from txt1.commands import bridge_options, takes

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.kernel.loop import Speed


class BridgesAsked(NamedTuple):
    """The requested bridges."""

    bridges: Sequence[tuple[str, Mapping[str, object]]]
    """Names and options of the bridges."""
    speed: Speed
    """Speed of the robot's time, for recordings that a bridge begins."""


def asked(arguments: Namespace, config: Config) -> BridgesAsked | None:
    """Return the requested bridges, None for none. Raises ConfigError: there is no bridge of this name."""
    if not arguments.bridge:
        return None
    from txt1.bridges.registry import BRIDGES

    for name, _ in arguments.bridge:
        BRIDGES.place("bridge", name)
    return BridgesAsked(arguments.bridge, arguments.speed)


BRIDGE: Final = {
    "--bridge": takes(
        "NAME[:KEY=VALUE,...]",
        "run this bridge beside the robot (entry points txt1.bridges); may be given again",
        bridge_options,
        action="append",
        default=[],
    ),
}
OPTIONS: Final = Options("bridges", BRIDGE, asked)
