"""The steps of the calibration, in order, and the run through them.

A step asks the operator to put the vehicle somewhere, drives it a little, and asks for an observation or a measurement.
Its result is kept at once. So an operator who stops the calibration can resume at the same step later.
"""

from collections.abc import Awaitable, Callable, Sequence
from typing import Final, NamedTuple

from txt1.config import Config
from txt1.experiments.calibration.bench import Bench
from txt1.experiments.calibration.blocks import motor, reverse, servo, steering
from txt1.experiments.calibration.floor_steps import circle, scale, straight, turn
from txt1.experiments.calibration.model import speeds, tune
from txt1.hal.base import Hal


class CalibrationStep(NamedTuple):
    """A step of the calibration."""

    does: Callable[[Bench], Awaitable[None]]
    applies: Callable[[Config, Hal], bool]

    @property
    def about(self) -> str:
        """What the step finds, in words."""
        return (self.does.__doc__ or "").rstrip(".")


def _by_pwm(config: Config, hal: Hal) -> bool:
    return hal.capabilities.pwm


def _steers(config: Config, hal: Hal) -> bool:
    return hal.capabilities.pwm and config.geometry.steering != "skid"


def _counts(config: Config, hal: Hal) -> bool:
    return hal.capabilities.pwm and hal.capabilities.ticks


STEPS: Final[dict[str, CalibrationStep]] = {
    "motor": CalibrationStep(motor, _by_pwm),
    "reverse": CalibrationStep(reverse, lambda config, hal: hal.esc),
    "steering": CalibrationStep(steering, _steers),
    "servo": CalibrationStep(servo, lambda config, hal: hal.own_channels is not None),
    "straight": CalibrationStep(straight, _by_pwm),
    "scale": CalibrationStep(scale, lambda config, hal: not hal.capabilities.pwm),
    "circle": CalibrationStep(circle, lambda config, hal: _steers(config, hal) or hal.own_channels is not None),
    "speeds": CalibrationStep(speeds, lambda config, hal: hal.capabilities.blind),
    "turn": CalibrationStep(turn, lambda config, hal: hal.capabilities.pwm and config.geometry.steering == "skid"),
    "tune": CalibrationStep(tune, lambda config, hal: _counts(config, hal) and config.geometry.steering != "skid"),
}
"""The steps by name, in order."""


def steps(config: Config, hal: Hal) -> list[str]:
    """Return the names of the steps of a vehicle's calibration, in order."""
    return [name for name, step in STEPS.items() if step.applies(config, hal)]


async def calibrate(bench: Bench, names: Sequence[str]) -> None:
    """Do these steps, and mark each as done."""
    for number, name in enumerate(names, 1):
        bench.operator.tell(f"-- {number} of {len(names)}, {name}: {STEPS[name].about}")
        await STEPS[name].does(bench)
        done = [each for each in bench.config.calibrated if each != name]
        bench.found({"calibrated": [*done, name]})
