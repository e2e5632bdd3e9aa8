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

HOST_LINE: Final = 1
"""Marks the random values of the line at the host's end."""


def create_sim(config: Config) -> Hal:
    """The simulated robot as configured."""
    from txt1.hal.sim import SimHal
    from txt1.sim.room import Room
    from txt1.sim.simulator import Simulator

    sim = config.sim
    try:
        simulator = Simulator(
            sim.vehicle, config.geometry, Room(sim.room.length, sim.room.width), sim.battery, sim.noise, sim.start,
            config.seed,
        )  # fmt: skip
    except ValueError as error:
        raise ConfigError(f"sim.start: {error}; choose another start or a larger sim.room") from None
    simulator.faults = sim.faults
    return SimHal(simulator)


def create_serial(config: Config, port: Port | None = None) -> Hal:
    """The board behind the configured line, or behind a port that somebody has ready, which is nothing real."""
    from numpy.random import SeedSequence

    from txt1.hal.link import End, faulty
    from txt1.hal.serial import DevicePort, SerialHal

    serial = config.serial

    def wrap(end: End) -> End:
        return faulty(end, serial.fault, SeedSequence([config.seed, HOST_LINE]))

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
