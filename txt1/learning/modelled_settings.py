"""The settings that simulations of many trials model; a setting without effect is refused by its name.

The running robot (`txt1 learn`) models everything. Environments, and the trials in lockstep and floors of the plug-in
txt1-learners, leave out the rest of the robot. The settings that environments read are listed here, by key or by the
beginning of a key; the plug-in has its own lists. Any other that differs from the default of the vehicle is refused.
What a vehicle's own file sets came with the vehicle, and stays.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final

from txt1.config import Config, completed, flatten, load
from txt1.errors import ConfigError

# refused elsewhere, or no physics
NAMES: Final = ("hal", "vehicle", "name", "seed", "calibrated", "sim.physics")
CAR: Final = ("geometry.radius_min", "geometry.wheelbase", "geometry.track_width", "geometry.steering")
WHEELS: Final = ("geometry.circumference", "geometry.counts_per_rev")
LOOPS: Final = ("control.linear", "control.angular", "car", "safety.motor_max")
TASK: Final = ("learning.actions", "learning.start_radius", "learning.goal_radius", "learning.boundary")
STEERED: Final = ("motor", "front", "rear", "right_encoder", "left_encoder", "encoders_swapped")
VEHICLE: Final = (
    *(f"sim.vehicle.{name}" for name in ("speed_gain", "dead_band", "speed_time_constant", "coast_time_constant")),
    *(f"sim.vehicle.{name}" for name in ("coast_friction", "servo_rate", "scrub", "slip", "understeer")),
    "sim.noise.drag",
)
SHOWN: Final = ("learning.world", "learning.world_options", "sim.obstacles", "sim.room.map")
BATCH: Final = (
    *NAMES, *CAR, *WHEELS, *VEHICLE, *TASK, "safety.motor_max", "sim.room.light", "sim.light.intensity",
    "sim.light.exponent", "sim.light.height", "sim.light.noise", "learning.time_limit",
)  # fmt: skip
ONE: Final = (
    "learning.randomised",
    *NAMES, *CAR, *WHEELS, *LOOPS, *VEHICLE, *TASK, "learning.delay", "learning.time_limit", "sim.light",
    "sim.room.light", *SHOWN, "sim.movers", "sim.faults.right_encoder", "sim.faults.left_encoder",
    *(f"{wired}.{name}" for wired in ("channels", "sim.channels") for name in STEERED),
)  # fmt: skip


@cache
def usual_values(vehicle: str) -> dict[str, Any]:
    """Every value of a vehicle without any other setting."""
    return dict(flatten(completed(load(options={"vehicle": vehicle}).config)))


def refuse_others(
    config: Config, modelled: Sequence[str], who: str, unless: Callable[[str], str] = lambda key: ""
) -> None:
    """Refuse the settings that `who`, a simulation in words, does not model; ConfigError names the key.

    `unless` is asked for each key that is modelled: why this value of it is not, "" if it is.
    """
    body = config.geometry
    if config.hal != "sim":
        raise ConfigError(f"hal: {config.hal}: {who} know only the simulated robot; set hal=sim")
    if modelled is not ONE and (body.steering == "skid" or not body.counts_per_rev):
        lacks = "geometry.steering: skid" if body.steering == "skid" else "geometry.counts_per_rev: 0"
        raise ConfigError(f"{lacks}: {who} model cars that steer, with encoders; take txt1 learn")
    # a map takes the rectangle away
    brought = ("sim.room.length", "sim.room.width") if config.sim.room.map is not None else ()
    for key, value in flatten(completed(config)):
        why = "do not model it"
        if usual_values(config.vehicle).get(key) == value or key in brought:
            continue
        if key.startswith("car.") and key != "car.known" and not config.car.known:
            why = "have no use for it while car.known is false"
        elif among(key, modelled) and not (why := unless(key)):
            continue
        raise ConfigError(f"{key}: {value}: {who} {why}, so it would have no effect; take it out, or take txt1 learn")


def among(key: str, modelled: Sequence[str]) -> bool:
    """Whether a key, or the key of a section around it, is in the list."""
    return any(key == each or key.startswith(f"{each}.") for each in modelled)
