"""The vehicle's step with names for its numbers."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import fields
from typing import Any

from txt1.model.vehicle import Geometry
from txt1.sim.dynamics import Dynamics, VehicleState, dynamics, move, reckoned
from txt1.sim.parameters import VehicleParameters

NAMES = [
    "wheelbase",
    "track_width",
    "steering_max",
    *(f.name for f in fields(VehicleParameters) if f.name not in ("skid", "voltage")),
    "ramp_step",
    "steered",
]
Parameters: Any = namedtuple("Parameters", NAMES, defaults=dynamics(VehicleParameters(), Geometry())[: len(NAMES)])
"""`txt1.sim.dynamics.Dynamics` with names, without what follows from the others."""


def numbers(p: Any) -> Dynamics:
    """All of them."""
    return *p, *reckoned(p.wheelbase, p.steering_max, p)  # type: ignore[return-value]


def advance(
    state: VehicleState, motor: float, front: float, rear: float, dt: float, drag: float, p: Any
) -> VehicleState:
    """The vehicle's state `dt` seconds later; see `txt1.sim.dynamics.move`."""
    return VehicleState(*move(state, motor, front, rear, dt, drag, numbers(p)))
