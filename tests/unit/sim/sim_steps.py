"""The vehicle's step with names for its numbers."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import fields
from typing import Any

from txt1.model.vehicle import Geometry
from txt1.sim.dynamics import VehicleState, dynamics, move
from txt1.sim.parameters import VehicleParameters

Parameters: Any = namedtuple(
    "Parameters",
    [
        "wheelbase",
        "track_width",
        "steering_max",
        *(f.name for f in fields(VehicleParameters) if f.name != "skid"),
        "ramp_step",
        "steered",
    ],
    defaults=dynamics(VehicleParameters(), Geometry()),
)
"""`txt1.sim.dynamics.Dynamics` with names."""


def advance(
    state: VehicleState, motor: float, front: float, rear: float, dt: float, drag: float, p: Any
) -> VehicleState:
    """The vehicle's state `dt` seconds later; see `txt1.sim.dynamics.move`."""
    return VehicleState(*move(state, motor, front, rear, dt, drag, p))
