"""The configuration of a practice, which `make run` begins: a simulated car on a track, and nothing else.

The track, the laser and the light's place are defaults: a file, the environment and `--set` come before them. The light
is on the far side of the track, so the car does not start on it.
"""

import argparse

from txt1.config import Config
from txt1.errors import ConfigError
from txt1.kit.options import loaded

TRACK = ("sim.room.map=oval", "sim.room.light=[0.0, 8.1]")
LASER = ("sensors.laser.driver=sim_laser",)


def configured(arguments: argparse.Namespace) -> Config:
    """Return the configuration of a practice; raises ConfigError if it asks for another layer than the simulation."""
    given = loaded(arguments)
    if given.config.hal != "sim":
        origin = given.origins["hal"] if arguments.hal or arguments.port is None else "--port"
        raise ConfigError(
            f"hal: '{given.config.hal}' ({origin}): a practice drives the simulation only; leave it out, or drive it "
            f"with: txt1 run --hal {given.config.hal}"
        )
    first = () if any(key.startswith(("sim.room", "sim.start", "world")) for key in given.origins) else TRACK
    return loaded(arguments, (*first, *(() if given.config.sensors else LASER))).config
