"""`txt1 gamepad`: shows the readings of the pads, live; makes a mapping for a pad that SDL does not know."""

from __future__ import annotations

import argparse
import select
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from txt1 import commands
from txt1.commands import OK, need, say
from txt1.config import Config
from txt1.errors import ConfigError
from txt1.gamepad.pad import PadParameters, Pads, PadState, mapping_of
from txt1.kit import options

if TYPE_CHECKING:
    from txt1.gamepad.bridge import Devices

# s between two lines
LINES_PERIOD: Final = 0.05
STEPS: Final = {
    "a": "press the button that is to be the dead-man (lowest of the four)",
    "b": "press the button for the emergency stop (right of the four)",
    "y": "press the button for the next screen (top of the four)",
    "back": "press the button for manual mode (back or select)",
    "start": "press the button for arming (start)",
    "leftx": "push the left stick to the right",
    "lefty": "pull the left stick towards you",
    "righttrigger": "pull the right trigger",
    "lefttrigger": "pull the left trigger",
}
"""The wizard's requests, by SDL's names; Enter skips one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the configuration, and the file for a mapping."""
    commands.add(
        parser,
        options.CONFIGURATION
        | {
            "--map": commands.takes(
                "FILE",
                "ask for all buttons and axes of the first pad, and write SDL's mapping of it to FILE",
                commands.path,
            ),
            "--duration": commands.takes("S", "end after S seconds", commands.positive),
        },
    )


def main(arguments: argparse.Namespace) -> int:
    """Show the pads until Ctrl-C, or ask for the parts of a pad."""
    need("txt1 gamepad", "gamepad", "pygame")
    from txt1.gamepad.bridge import Devices

    config = options.loaded(arguments).config
    devices = Devices(mapping_of(config.section(PadParameters)))
    try:
        if arguments.map is not None:
            return _map(devices, arguments.map)
        _show(devices, config, arguments.duration)
    finally:
        devices.close()
    return OK


def _show(devices: Devices, config: Config, duration: float | None) -> None:
    """Print a line for each pad, again and again."""
    from txt1.gamepad.bridge import now

    pads, ends = Pads(config.section(PadParameters), config.hand()), now() + (duration or 1e9)
    told: dict[int, str] = {}
    while now() < ends:
        readings = devices.look()
        wish = pads.take(readings, now())
        for number, stick in devices.unknown.items():
            if told.get(number) != "unknown":
                told[number] = "unknown"
                say(f"'{stick.get_name()}' is not known to SDL: txt1 gamepad --map FILE, and gamepad.mapping=FILE")
        for number, (reading, _) in readings.items():
            drives = number == pads.driver and wish.velocity is not None
            moves = "  v={:+.2f} omega={:+.2f}".format(*wish.velocity or ()) if drives else ""
            line = f"{number} {devices.names[number]}: {described(reading)}{moves}"
            if told.get(number) != line:
                told[number] = line
                print(line, flush=True)
        if not readings and not devices.unknown and told.get(-1) is None:
            told[-1] = "none"
            say("no gamepad is there: plug one in, or wake it by a button")
        select.select([], [], [], LINES_PERIOD)


def described(reading: PadState) -> str:
    """Return a reading in words: axes in hundredths, pressed buttons."""
    axes = "  ".join(f"{name} {value:+.2f}" for name, value in reading.axes.items())
    return f"{axes}  {' '.join(sorted(reading.buttons)) or 'no button'}"


# -- the wizard ------------------------------------------------------------------------------------------------


def _map(devices: Devices, file: Path) -> int:
    """Ask for the parts of the first pad, and write its mapping."""
    devices.look()
    sticks = [*devices.unknown.values(), *devices.sticks()]
    if not sticks:
        raise ConfigError("--map: no gamepad is there: plug one in")
    stick = sticks[0]
    print(f"{stick.get_name()}: for each line do as it says; Enter leaves it out")
    found: dict[str, str] = {}
    for name, asked in STEPS.items():
        part = _part(stick, devices, asked)
        if part is not None:
            found[name] = part
            print(f"  {part}")
    line = mapping_line(stick.get_guid(), stick.get_name(), found)
    with file.open("a", encoding="utf-8") as out:
        out.write(line + "\n")
    print(f"{file}: written; use it with --set gamepad.mapping={file}")
    return OK


def _part(stick: Any, devices: Devices, asked: str) -> str | None:
    """Return SDL's word for the part that moves after all parts were at rest; None for Enter."""
    print(asked, flush=True)
    devices.look()
    rest = _state(stick)
    while True:
        devices.look()
        part = moved(rest, _state(stick))
        if part is not None:
            while moved(rest, _state(stick)) is not None:
                devices.look()
                select.select([], [], [], LINES_PERIOD)
            return part
        if select.select([sys.stdin], [], [], LINES_PERIOD)[0] and sys.stdin.readline() is not None:
            return None


def _state(stick: Any) -> dict[str, float]:
    """Return the parts of a joystick by SDL's words for them: b0, a1, h0.4."""
    state: dict[str, float] = {f"b{k}": float(stick.get_button(k)) for k in range(stick.get_numbuttons())}
    state |= {f"a{k}": stick.get_axis(k) for k in range(stick.get_numaxes())}
    for k in range(stick.get_numhats()):
        x, y = stick.get_hat(k)
        state |= {f"h{k}.1": float(y > 0), f"h{k}.2": float(x > 0), f"h{k}.4": float(y < 0), f"h{k}.8": float(x < 0)}
    return state


def moved(rest: Mapping[str, float], state: Mapping[str, float]) -> str | None:
    """Return the part that is farthest from its rest, if it is far; a ~ follows it if it moved in the negative
    direction.
    """
    part = max(state, key=lambda name: abs(state[name] - rest.get(name, 0.0)), default=None)
    if part is None or abs(state[part] - rest.get(part, 0.0)) < 0.5:
        return None
    return f"{part}~" if part.startswith("a") and state[part] < rest.get(part, 0.0) else part


def mapping_line(guid: str, name: str, found: Mapping[str, str]) -> str:
    """Return SDL's mapping of a pad: GUID, name, and the part for each name."""
    parts = ",".join(f"{key}:{part}" for key, part in found.items())
    return f"{guid},{name.replace(',', ' ')},{parts},platform:{'Mac OS X' if sys.platform == 'darwin' else 'Linux'},"
