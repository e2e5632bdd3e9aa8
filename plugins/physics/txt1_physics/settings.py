"""The section ``physics`` of the configuration."""

from typing import TYPE_CHECKING, Annotated

from annotated_types import Gt, Le

from txt1.config import Section
from txt1.errors import ConfigError
from txt1.units import Positive

if TYPE_CHECKING:
    from txt1.runtime import Runtime


class PhysicsSettings(Section):
    """The car in MuJoCo: parameters that the geometry does not have."""

    mass: Positive = 8.0
    """Mass of the whole car, kg: chassis 4.5, computer 1.4, plate 0.6, two packs 1.0, inverter 0.5; assumed."""
    gravity_height: Positive = 0.15
    """Height of the body's centre of gravity, m: half of the body's height, as for the roll-over guard; assumed."""
    friction: Annotated[float, Gt(0.0), Le(2.0)] = 1.0489
    """Friction of a tyre on the floor: as of the tyre of commonroad-vehicle-models (p_dy1)."""
    tyre_width: Positive = 0.1
    """Width of a tyre, m; assumed."""
    wheel_mass: Positive = 0.35
    """Mass of a wheel with its tyre, kg, a part of `mass`; assumed."""
    suspension: Positive = 3.0
    """Frequency at which the body bounces on its springs, Hz; assumed."""
    damping: Positive = 0.4
    """Damping of this motion, as a share of critical damping; assumed."""


async def prepare(runtime: "Runtime", settings: PhysicsSettings) -> None:
    """Refuse settings that have no effect."""
    physics = runtime.config.sim.physics
    if physics != "mujoco" and settings != PhysicsSettings():
        raise ConfigError(f"physics: its settings are MuJoCo's, and sim.physics is {physics}; set sim.physics=mujoco")
