"""A guard: the robot stays within a circle round its start."""

from dataclasses import dataclass
from math import cos, hypot, sin

from txt1.control.guarding import GuardView
from txt1.runtime import Runtime


@dataclass(frozen=True)
class Fence:
    radius: float = 1.0  # m


async def prepare(runtime: Runtime, settings: Fence) -> None:
    view = GuardView(runtime)

    def guard(v: float, omega: float, now: float) -> tuple[float, float]:
        x, y, theta = view.pose
        outward = v * (x * cos(theta) + y * sin(theta)) > 0.0
        view.holds = hypot(x, y) > settings.radius and outward
        return (0.0, 0.0) if view.holds else (v, omega)

    runtime.guard("fence", guard)
