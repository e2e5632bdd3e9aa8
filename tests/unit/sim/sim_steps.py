"""The vehicle's step with names for its numbers."""

from __future__ import annotations

from txt1.sim.vehicle import VehicleParameters, VehicleState, move


def advance(
    state: VehicleState, motor: float, front: float, rear: float, dt: float, drag: float, p: VehicleParameters
) -> VehicleState:
    """The vehicle's state `dt` seconds later; see `txt1.sim.vehicle.move`."""
    return VehicleState(*move(state, motor, front, rear, dt, drag, p))
