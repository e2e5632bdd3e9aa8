"""`txt1 world`: list the maps and worlds there are, or draw one before anything drives in it."""

import argparse
import os
from math import isfinite
from pathlib import Path
from shutil import get_terminal_size
from typing import Final

import numpy as np
import yaml
from rich.console import Console

from txt1.commands import OK, add_actions, takes
from txt1.config import Config, load
from txt1.errors import ConfigError
from txt1.file_limits import read_text
from txt1.hal.registry import create_sim
from txt1.kit.options import CONFIGURATION, VEHICLE
from txt1.learning.world_presets import content, worlds
from txt1.maps.files import Map, names, read
from txt1.maps.grid import FREE, OCCUPIED_FROM
from txt1.safe_yaml import read_yaml
from txt1.sim.movers import Moving
from txt1.sim.obstacles import Outline, outline
from txt1.sim.parameters import Mover
from txt1.tasks.encoder import POSE
from txt1.tasks.fields import MOVERS, SURROUNDINGS, WALLS, Surroundings
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.map import draw_map
from txt1.ui.viewer import Viewer

# characters of a drawing
WIDTH_MAX: Final = 120


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    name = {"name": takes("NAME", "a map or a world by its name (txt1 world list), or a .yaml that is one")}
    add_actions(parser, {"list": (list_worlds, {}), "show": (show, name | CONFIGURATION | VEHICLE)})


def list_worlds(_: argparse.Namespace) -> int:
    """Print the maps and the worlds that come with the package."""
    print("\n".join(f"map {name}" for name in names()))
    print("\n".join(f"world {name}: {one.get('about', '')}" for name, one in worlds().items()))
    return OK


def show(arguments: argparse.Namespace) -> int:
    """Draw a map or a world with the robot at its start, and say how large it is; refuse a start in a wall."""
    config = configured(arguments)
    found = None if config.sim.room.map is None else read(config.sim.room.map)
    walls = config.sim.room.built().walls
    width, height = get_terminal_size()
    told: dict[str, object] = {
        SURROUNDINGS.name: surroundings(config),
        POSE.name: config.sim.start,
        MOVERS.name: tuple(each for mover in config.sim.movers for each in drawn(mover)),
    }
    if walls is not None:
        told[WALLS.name] = walls.outlines
    console = Console(width=min(width, WIDTH_MAX), highlight=False)
    for line in draw_map(Snapshot(0.0, "", told), Viewer(), console.width, max(10, height - 8)):
        console.print(line)
    for text in describe(config, found):
        print(text)
    # where it cannot start, that is told
    create_sim(config)
    return OK


def configured(arguments: argparse.Namespace) -> Config:
    """Return the configuration of a robot in the world that is named."""
    name, given = arguments.name, {"vehicle": arguments.vehicle} if arguments.vehicle else {}
    file = Path(name) if name.endswith((".yaml", ".yml")) else None
    if name in names() or (file is not None and file.is_file() and is_map(file)):
        settings = [f"sim.room.map={name}", *arguments.set]
        return load(arguments.config, settings, os.environ, given).config
    world = file if file is not None and file.is_file() else content(worlds()[name]) if name in worlds() else None
    if world is None:
        raise ConfigError(f"{name}: there is no such map or world; 'txt1 world list' names ours, or give a .yaml")
    if arguments.config:
        raise ConfigError(f"--config {arguments.config}: {name} is a configuration itself; give one of them")
    return load(world, arguments.set, os.environ, given).config


def is_map(file: Path) -> bool:
    """Whether a .yaml is a map's, not a configuration."""
    try:
        tree = read_yaml(read_text(file))
    except (OSError, ValueError, yaml.YAMLError):
        return False
    return isinstance(tree, dict) and ("image" in tree or "resolution" in tree)


def surroundings(config: Config) -> Surroundings:
    """Return a world's values for the screens."""
    room, body = config.sim.room, config.geometry
    size = (room.length, room.width) if isfinite(room.length) and isfinite(room.width) else None
    return Surroundings(
        size, room.light, (body.length, body.width, body.centre), tuple(map(outline, config.sim.obstacles))
    )


def drawn(mover: Mover) -> tuple[Outline, ...]:
    """Return the outlines of a mover at its start, and of its way."""
    try:
        start = Moving(mover).at(0.0)
    except ValueError:
        # a path without length, which is refused after the drawing
        return ()
    back = () if mover.lap else mover.path[-2:0:-1]
    return outline(start), mover.path + back


def describe(config: Config, found: Map | None) -> list[str]:
    """Return lines that describe a world."""
    room, (x, y, theta) = config.sim.room, config.sim.start
    lines = []
    if found is None:
        lines.append(f"room:  {room.length:g} m x {room.width:g} m around (0, 0)")
    else:
        grid = found.grid
        rows, columns = grid.cells.shape
        unknown, solid = grid.cells < FREE, grid.cells >= OCCUPIED_FROM
        shares = [np.mean(each) for each in (~unknown & ~solid, solid, unknown)]
        area = grid.resolution**2 * np.sum(~unknown & ~solid)
        low = ", ".join(f"{value:g}" for value in grid.origin)
        lines.append(
            f"map:   {found.file}, {columns * grid.resolution:g} m x {rows * grid.resolution:g} m, cells of "
            f"{grid.resolution:g} m, lower left at ({low})"
        )
        lines.append(
            f"floor: {area:.1f} m^2; free {shares[0]:.0%}, walls {shares[1]:.0%}, unknown {shares[2]:.0%}; "
            f"SHA-256 {found.digest[:12]}"
        )
        lines += [f"note:  {remark}" for remark in found.remarks]
    lines.append(f"start: ({x:g}, {y:g}, {theta:g}), light: ({room.light[0]:g}, {room.light[1]:g})")
    for name, things in (("obstacles", config.sim.obstacles), ("movers", config.sim.movers)):
        if things:
            lines[-1] += f", {name}: {len(things)}"
    return lines
