"""The velocity loops of a vehicle: the thesis's, or those of a known car."""

from typing import Protocol

from txt1.control.parameters import KnownCar
from txt1.control.pid import Gains, VelocityLoops
from txt1.model.vehicle import Geometry


class Loops(Protocol):
    """What turns a set-point into outputs: `VelocityLoops`, `txt1.control.car.InformedLoops`, or `OpenLoop`."""

    def clear(self) -> None:
        """Forget the past."""

    def step(
        self, v: float, omega: float, v_now: float, omega_now: float, linear: Gains, angular: Gains, dt: float
    ) -> tuple[float, float]:
        """Return motor and steering output, counts; see `txt1.control.pid.VelocityLoops.step`."""


def loops_for(known: KnownCar, body: Geometry) -> Loops:
    """Return the loops of a car, known or not."""
    if known.known:
        # few cars are known, so it is imported when it is needed
        from txt1.control.car import InformedLoops, car_of

        car = car_of(known, body)
        if car is not None:
            return InformedLoops(car)
    return VelocityLoops(body.steering != "skid")
