"""The runtime of the TXT-1 laboratory robot.

::

    import txt1

    async def main() -> None:
        async with txt1.Robot.open(hal="sim", seed=1) as robot:
            await robot.load_gains()
            await robot.drive(v=0.5, omega=0.3, duration=2.0)
            print(robot.odometry, robot.battery)

    txt1.run(main(), speed="max")   # as fast as the processor; without `speed`, in real time
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from txt1.version import __version__

if TYPE_CHECKING:
    from txt1.errors import Txt1Error
    from txt1.fleet.fleet import Fleet
    from txt1.hal.base import Button
    from txt1.kernel.loop import run
    from txt1.kernel.ticks import Ticks
    from txt1.model.odometry import Odometry
    from txt1.protocol.messages import Switch
    from txt1.robot import Robot
    from txt1.sim.parameters import Box, Post
    from txt1.sim.room import Room
    from txt1.sim.world import World

__all__ = [
    "Box",
    "Button",
    "Fleet",
    "Odometry",
    "Post",
    "Robot",
    "Room",
    "Switch",
    "Ticks",
    "Txt1Error",
    "World",
    "__version__",
    "run",
]

_WHERE = {
    "Box": "txt1.sim.parameters",
    "Button": "txt1.hal.base",
    "Fleet": "txt1.fleet.fleet",
    "Odometry": "txt1.model.odometry",
    "Post": "txt1.sim.parameters",
    "Robot": "txt1.robot",
    "Room": "txt1.sim.room",
    "Switch": "txt1.protocol.messages",
    "Ticks": "txt1.kernel.ticks",
    "Txt1Error": "txt1.errors",
    "World": "txt1.sim.world",
    "run": "txt1.kernel.loop",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: the drawing process needs none of them, and starts sooner."""
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'txt1' has no attribute '{name}'")


def __dir__() -> list[str]:
    """Return the public names, for ``dir`` and ``help``."""
    return [*__all__, "__doc__", "__name__", "__path__"]
