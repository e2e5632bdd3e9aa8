"""The options by which a run is recorded, and shown live."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from txt1.additions import Options
from txt1.commands import existing, flag, gone, host_and_port, need, path, say, takes
from txt1.errors import ConfigError
from txt1.kernel.clock import seconds, wall_ns
from txt1.resources import resource

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.kernel.loop import Speed
    from txt1.record.live_view import LiveView

# of Foxglove's panels
LAYOUT: Final = resource("config/foxglove/txt1.foxglove-layout.json")


def new_file(text: str) -> Path:
    """Return the path of a recording to make: {time} in it is the local date and time; ArgumentTypeError, as `path`."""
    return path(text.replace("{time}", f"{datetime.fromtimestamp(seconds(wall_ns())).astimezone():%Y%m%d-%H%M%S}"))


def recording(text: str) -> Path:
    """Return the path of an existing recording; raises ArgumentTypeError, and MissingExtra without its reader."""
    from txt1.record.session import MODULES

    need("reading a recording", "record", *MODULES)
    return existing(text)


RECORDING: Final = {"file": takes("FILE", None, recording)}
ONE_ROBOT: Final = {"--robot": takes("NAME", "name of the robot, in a recording of several")}
LOG: Final = {
    "--log": takes("FILE", "record everything to this MCAP file; {time} in its name is the date and time", new_file)
}
VIEW: Final = {
    "--view": takes(
        "[HOST:]PORT",
        "serve the Foxglove protocol to this computer; 127.0.0.1:8765",
        host_and_port,
        nargs="?",
        const=("127.0.0.1", 8765),
    ),
    "--view-token": gone("the live view is for this computer alone: ssh -L 8765:127.0.0.1:8765 ROBOT, or --web"),
}


class RecordingAsked(NamedTuple):
    """The recording and the live view that the command line asks for."""

    file: Path | None
    view: LiveView | None = None
    about: Mapping[str, object] = {}
    """The command line, for the recording's metadata."""
    speed: Speed = None


def to_file(file: Path | None, about: Mapping[str, object], speed: Speed) -> dict[str, object]:
    """Return the additions of `Robot.open` that record a run to a file, none without one; `about` describes the run."""
    return {} if file is None else {"record": RecordingAsked(file, None, about, speed)}


def live_view(arguments: Namespace, *, control: bool = False) -> LiveView | None:
    """Return the live view, None without one; ConfigError: one of its options stands without it."""
    if arguments.view is None:
        if control:
            raise ConfigError("--view-control: there is no live view; add --view")
        return None
    from txt1.record.session import open_view

    view = open_view(*arguments.view, control=control)
    say(f"the live view is at {view.address}")
    say(f"its layout for Foxglove, to be imported from file: {LAYOUT}")
    return view


def asked(arguments: Namespace, config: Config) -> RecordingAsked | None:
    """Return the recording and live view to make, None for neither; raises ConfigError, MissingExtra."""
    view = live_view(arguments, control=arguments.view_control)
    if arguments.log is None and view is None:
        return None
    return RecordingAsked(arguments.log, view, dict(_given(arguments)), arguments.speed)


def _given(arguments: Namespace) -> Mapping[str, Any]:
    """Return the options that were given, as far as they are words and numbers; not where this recording goes."""
    every = (one for each in arguments.optional.values() for one in each.arguments.items())
    usual = {names.split()[0].strip("-").replace("-", "_"): told.get("default") for names, told in every}
    return {
        name: str(value) if isinstance(value, Path) else value
        for name, value in vars(arguments).items()
        if value
        and isinstance(value, str | int | float | tuple | list | Path)
        and value != usual.get(name)
        and name != "log"
    }


OPTIONS: Final = Options(
    "recordings and live view", LOG | VIEW | {"--view-control": flag("let the live view's teleop panel drive")}, asked
)
