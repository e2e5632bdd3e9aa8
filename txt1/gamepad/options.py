"""`txt1 run --gamepad`."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.commands import flag, need

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.gamepad.pad import PadParameters


def asked(arguments: Namespace, config: Config) -> PadParameters | None:
    """Return the parameters of the pads, None if no gamepad is to drive; raises MissingExtra."""
    if not arguments.gamepad:
        return None
    need("--gamepad", "gamepad", "pygame")
    from txt1.gamepad.pad import PadParameters, mapping_of

    parameters = config.section(PadParameters)
    mapping_of(parameters)
    return parameters


OPTIONS: Final = Options(
    "gamepads", {"--gamepad": flag("let gamepads drive, whichever are plugged in (see txt1 gamepad)")}, asked
)
