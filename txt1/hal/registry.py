"""Hardware layers by name: ours from a table, other packages' through the entry-point group ``txt1.hal``.

A package announces its HAL in its pyproject.toml::

    [project.entry-points."txt1.hal"]
    mycar = "mycar.hal:create"

where ``create(config: txt1.config.Config) -> txt1.hal.Hal``; its own settings come in ``config.hal_options``. It is
imported when it is first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from txt1.config import Config
from txt1.errors import ConfigError
from txt1.hal.base import Hal
from txt1.plugins import Registry

if TYPE_CHECKING:
    from txt1.hal.serial import Port
    from txt1.sim.world import World

HOST_LINE: Final = 1
"""Marks the random values of the line at the host's end."""


def create_world(config: Config) -> World:
    """The world as configured, with nobody in it."""
    from txt1.sim.room import Room
    from txt1.sim.world import World

    room = config.sim.room
    return World(Room(room.length, room.width), room.light, config.sim.obstacles)


def create_sim(config: Config, world: World | None = None) -> Hal:
    """The simulated robot as configured, in a world of its own, or in one that it shares with others.

    Raises:
        ConfigError: something is in its way where it starts.

    """
    from txt1.hal.sim import SimHal
    from txt1.sim.simulator import Vehicle

    sim = config.sim
    try:
        vehicle = Vehicle(
            create_world(config) if world is None else world,
            sim.vehicle, config.geometry, sim.battery, sim.noise, sim.start, config.own_seed, config.name,
        )  # fmt: skip
    except ValueError as error:
        raise ConfigError(
            f"sim.start: {error}; choose another start, a larger sim.room or other sim.obstacles"
        ) from None
    vehicle.faults = sim.faults
    return SimHal(vehicle)


def create_serial(config: Config, port: Port | None = None) -> Hal:
    """The board behind the configured line, or behind a port that somebody has ready, which is nothing real."""
    from numpy.random import SeedSequence

    from txt1.hal.serial import DevicePort, SerialHal
    from txt1.link import End, faulty

    serial = config.serial

    def wrap(end: End) -> End:
        return faulty(end, serial.fault, SeedSequence([config.own_seed, HOST_LINE]))

    return SerialHal(
        DevicePort(serial.port, serial.baud) if port is None else port,
        wrap,
        serial.control,
        config.odometry.scale,
        simulated=port is not None,
    )


HALS: Final = Registry("HAL", "txt1.hal", {"sim": create_sim, "serial": create_serial})


def names() -> list[str]:
    """The names of all hardware layers that are installed."""
    return HALS.names()


def create(config: Config) -> Hal:
    """The hardware layer named by ``config.hal``, not opened yet.

    Raises:
        ConfigError: there is none of that name (the message lists those there are), or its settings are wrong.
        HalError: it cannot be imported or made; the cause is chained.

    """
    hal: Hal = HALS.make("hal", config.hal, config)
    return hal
