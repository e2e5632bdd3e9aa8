"""`txt1 run --rc`."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.commands import takes
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.rc.settings import RcParameters


def asked(arguments: Namespace, config: Config) -> RcParameters | None:
    """Return the settings of the receiver, None if there is none; raises ConfigError."""
    if arguments.rc is None:
        return None
    from dataclasses import replace

    from txt1.rc.settings import BOARD, RcParameters, take_over

    given = config.section(RcParameters)
    port = arguments.rc or given.port
    if not port:
        raise ConfigError("--rc: which port has the receiver? Give it, such as --rc /dev/ttyAMA0, or set rc.port")
    if port != BOARD:
        if arguments.speed is not None:
            raise ConfigError("--rc: a receiver runs in real time only; leave --speed out")
        take_over(given)
    return replace(given, port=port)


OPTIONS: Final = Options(
    "radio control",
    {
        "--rc": takes(
            "PORT",
            "a radio control takes over by a switch; its receiver is at PORT, by default at rc.port, or board "
            "(txt1 calibrate --rc finds its channels)",
            nargs="?",
            const="",
        )
    },
    asked,
)
