"""Hardware layers by name: the package's own from a table and additions, others' through the entry points ``txt1.hal``.

A package announces its HAL in its pyproject.toml::

    [project.entry-points."txt1.hal"]
    mycar = "mycar.hal:create"

where ``create(config: txt1.config.Config) -> txt1.hal.Hal``; ``config.hal_options`` are its own settings. It is
imported when it is first used.

The simulation takes values instead of a configuration; the function here makes it from a configuration. Every other HAL
is a text, and is imported when it is used. So a simulated robot imports no line, and a board imports no simulation.

An addition brings a HAL, its virtual device, or both. With a HAL at `serial.port`, the HAL's name is the port of its
virtual device; with a HAL at an I2C bus, `hal_options.bus` is VIRTUAL.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from txt1.config import Config
from txt1.errors import ConfigError, HalError
from txt1.hal.base import Hal
from txt1.plugins import Registry

if TYPE_CHECKING:
    from txt1.hal.sim import SimHal
    from txt1.link.base import End, Port
    from txt1.sim.world import World


def in_world(config: Config, world: World) -> Config:
    """Return the configuration of a robot in this world: with the world's room, light and obstacles."""
    length, width, walls = world.room.length, world.room.width, world.room.walls
    told = {"length": length, "width": width, "map": walls and walls.name, "light": world.light}
    room = config.sim.room.model_copy(update=told)
    movers = tuple(each.mover for each in world.movers)
    sim = config.sim.model_copy(update={"room": room, "obstacles": world.obstacles, "movers": movers})
    return config.model_copy(update={"sim": sim})


def world_of(config: Config) -> World:
    """Return the configured world, still without vehicles; raises ConfigError."""
    from txt1.sim.world import World

    sim, moving = config.sim, []
    if sim.movers:
        from txt1.sim.movers import Moving

        try:
            for each in sim.movers:
                moving.append(Moving(each))
        except ValueError as error:
            raise ConfigError(f"sim.movers.{len(moving)}.path: {error}") from None
    return World(sim.room.built(), sim.room.light, sim.obstacles, tuple(moving))


def create_sim(config: Config, world: World | None = None) -> SimHal:
    """Return the simulated robot as configured, in a world of its own, or in a shared world."""
    from txt1.hal.sim import SimHal
    from txt1.sim.vehicle import Vehicle

    sim, alone = config.sim, world is None
    if world is None:
        world = world_of(config)
    try:
        vehicle = Vehicle(
            world, sim.vehicle, config.geometry, sim.battery, sim.noise, sim.start, config.own_seed, config.name
        )
    except ValueError as error:
        remedy = "choose another start, a larger sim.room, or other sim.obstacles or walls"
        if (walls := world.room.walls) is not None:
            remedy += f"; there is room at [{walls.freest()[0]:g}, {walls.freest()[1]:g}, 0]"
        raise ConfigError(f"sim.start: {error}; {remedy}") from None
    vehicle.faults, vehicle.physics = sim.faults, PHYSICS.make("sim.physics", sim.physics, config)
    if vehicle.physics is not None:
        from txt1.sim.finite import Finite

        vehicle.physics = Finite(sim.physics, vehicle.physics)
    # in others' physics the body leans by itself
    leans: Any = vehicle.physics
    if sim.ground.height:
        from txt1.sim.ground import Ground

        leans = Ground(sim.ground, config.geometry, config.own_seed)
    return SimHal(vehicle, leans, sim.channels, alone)


HALS: Final = Registry("HAL", "txt1.hal", {"sim": create_sim, "serial": "txt1.hal.serial:create"}, HalError)
# physics of a simulated vehicle; the default is in `txt1.sim.vehicle`
PHYSICS: Final = Registry("physics", "txt1.sim.physics", {"plain": lambda config: None})
# simulated ports by name; any other name is a device
PORTS: Final = Registry("serial port", "txt1.ports", {})
# simulated I2C buses, by the HAL whose `hal_options.bus` is VIRTUAL
BUSES: Final = Registry("bus", "txt1.buses", {})
VIRTUAL: Final = "virtual"


def create(config: Config, world: World | None = None) -> Hal:
    """Return the hardware layer named by ``config.hal``, not opened yet, in a shared world if one is given.

    Raises as `Registry.make`.
    """
    if world is not None and config.hal != "sim":
        raise ConfigError(f"world: a robot with the HAL '{config.hal}' is in none; choose hal=sim")
    hal: Hal = HALS.make("hal", config.hal, config, *(() if world is None else (world,)))
    return hal


def port_of(config: Config, baud: int | None = None, behind: str | None = None) -> Port:
    """Return the configured port, or the only port of this computer.

    `baud` is the rate in bits a second, by default `serial.baud`. `behind` is the command that serves such a port, by
    default ``txt1 board``.
    """
    from txt1.link.device import DevicePort
    from txt1.link.tcp import BOARD

    serial = config.serial
    if serial.port is not None and serial.port in PORTS.ours:
        port: Port = PORTS.make("serial.port", serial.port, config)
        return port
    return DevicePort(serial.port, baud or serial.baud, serial.secret_file, behind or BOARD, serial.transport)


def faults_of(config: Config) -> Callable[[End], End]:
    """Return the function that puts the configured faults on the host's end of a line."""
    from txt1.link.impairments import faulty

    return lambda end: faulty(end, config.serial.fault, config.own_seed, "the host's line")


def is_on_a_line(hal: str) -> bool:
    """Return whether the far end of a HAL is at `serial.port`: for the board, and for each HAL with a port of
    its name.
    """
    return hal == "serial" or (hal in HALS.ours and hal in PORTS.ours)


def is_simulated(config: Config) -> bool:
    """Return whether the configured hardware is simulated, as far as this is known before it is made."""
    if is_on_a_line(config.hal):
        return config.serial.port in PORTS.ours
    return config.hal == "sim" or (config.hal in BUSES.ours and config.hal_options.get("bus") == VIRTUAL)
