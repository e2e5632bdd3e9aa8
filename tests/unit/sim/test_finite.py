"""A physics of a stranger's that returns no number ends the run with neutral outputs."""

from math import isfinite, nan
from typing import Any

import pytest

from txt1 import run
from txt1.errors import TaskFault
from txt1.hal.sim import SimHal
from txt1.plugins import Registry
from txt1.robot import Robot
from txt1.sim.dynamics import Motion


@pytest.mark.parametrize(
    ("end", "told"),
    [
        ((nan,), r"a number that is not finite at 0\.00 m/s; drive slower, or set sim\.physics"),
        ((), "8 numbers, and a motion has 9"),
    ],
)
def test_a_stranger_s_physics_that_says_no_number_ends_the_run_in_a_line(
    monkeypatch: pytest.MonkeyPatch, end: Any, told: str
) -> None:
    def strange(motion: Motion, motor: float, *_: float) -> Motion:
        return (*motion[:8], *end) if motor else motion

    monkeypatch.setattr("txt1.hal.registry.PHYSICS", Registry("physics", "", {"plain": lambda config: strange}))
    hals: list[SimHal] = []

    async def main() -> None:
        async with Robot.open(arm=True) as robot:
            assert isinstance(robot.hal, SimHal)
            hals.append(robot.hal)
            await robot.load_gains()
            await robot.drive(0.5, 0.0, duration=5.0)

    with pytest.raises(TaskFault, match=f"plain returns {told}"):
        run(main(), speed="max")
    assert hals[0].outputs[:3] == (0, 0, 0) and all(map(isfinite, hals[0].vehicle.motion))
