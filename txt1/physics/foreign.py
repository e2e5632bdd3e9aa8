"""What physics of other people have in common: memory, the motor and the steering servo, and what is refused.

How it works. A `txt1.sim.vehicle.Vehicle` calls its physics with its motion, eight numbers, and takes eight back.
Other people's models have more: speeds sideways, angular rates, suspensions. This *hidden* state is remembered here
for each motion that was given back since the vehicle moved on last, because the world asks what a motion would be
before it decides that it comes to pass. A motion that is not remembered was made elsewhere: the vehicle was put down,
ran into something, or was pushed. Then the hidden state is made anew, at rest but for the motion itself (`settled`).

The motor and the steering servo are those of `txt1.sim.dynamics` in every physics. Under power the motor pulls the
wheels towards its free speed w with the acceleration (w - (1 + drag) v) / tau, v being the speed at which the driven
wheels roll; coasting, (v + friction) / tau slows them. What the car does of that is the model's.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any, Final, NamedTuple

from txt1.config import Config, load
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.model.vehicle import STEERING_MAX
from txt1.sim.dynamics import Motion

OWN: Final = ("slip", "understeer", "grip", "cornering", "skid")
"""Parameters of our vehicle for which other people's models have tyres of their own."""
LEVEL: Final = (0.0, 0.0)
# s: shorter times are what is left of rounding
INSTANT: Final = 1e-9
# motions whose hidden state is remembered; the world weighs fewer before it decides
KEPT: Final = 8


class MotorDrive(NamedTuple):
    """What the motor does, held for a while."""

    # else it coasts
    driven: bool
    # the free speed, m/s; where it coasts the speed of its dry friction
    free: float
    tau: float  # s
    # 1 + the floor's drag
    loss: float


class Foreign:
    """Somebody else's physics for one vehicle.

    Args:
        name: of the setting.
        config: of the vehicle.

    Raises ConfigError: a setting would have no effect.
    """

    def __init__(self, name: str, config: Config) -> None:
        self.name = name
        self.body = config.geometry
        self.vehicle = config.sim.vehicle
        # what the vehicle's own file says of its tyres is nobody's mistake
        usual = load(None, [f"vehicle={config.vehicle}"], {}, {}).config.sim.vehicle
        without = [
            f"sim.vehicle.{key}={getattr(self.vehicle, key):g}"
            for key in OWN
            if getattr(self.vehicle, key) != getattr(usual, key)
        ]
        without += [f"sim.ground.height={config.sim.ground.height:g}"] if config.sim.ground.height else []
        if without:
            raise ConfigError(
                f"sim.physics: {name} has tyres and a floor of its own, so {without[0]} has no effect; leave it out, "
                "or set sim.physics=plain"
            )
        self._before: Motion | None = None
        self._hidden: dict[Motion, Any] = {}
        self._last: Any = None
        self._failed = False

    def __call__(self, motion: Motion, motor: float, front: float, rear: float, dt: float, drag: float) -> Motion:
        """Return the motion `dt` seconds later; raises HalError where the model has lost its way."""
        before = motion
        if self._failed:
            # so that whoever stops the robot gets neutral outputs through
            return (*motion[:3], 0.0, *motion[4:])
        if dt < INSTANT:
            return motion
        hidden = self._hidden.get(before)
        if hidden is None:
            hidden = self.settled(before)
        if before != self._before:
            self._before, self._hidden = before, {before: hidden}
        after, hidden = self.step(before, hidden, self.drive(motor, drag), self.angle(front), self.angle(rear), dt)
        if not all(map(isfinite, after)):
            raise self.lost(before, "its numbers grow beyond all bounds")
        self._hidden[after] = self._last = hidden
        if len(self._hidden) > KEPT:
            # one that is held at a wall looks ahead again and again from where it stands
            del self._hidden[next(each for each in self._hidden if each != before)]
        return after

    def drive(self, motor: float, drag: float) -> MotorDrive:
        """What the motor does at so many counts, as `txt1.sim.dynamics.move` has it."""
        p = self.vehicle
        if abs(motor) <= p.dead_band:
            return MotorDrive(False, p.coast_friction, p.coast_time_constant, 1.0 + drag)
        beyond = motor - p.dead_band if motor > 0.0 else motor + p.dead_band
        return MotorDrive(True, p.speed_gain * beyond, p.speed_time_constant, 1.0 + drag)

    def angle(self, counts: float) -> float:
        """The steering angle that a servo goes for, rad, left positive; counts are as in `Outputs`."""
        limit = float(STEERING_MAX)
        return -self.body.steering_max * min(max(counts, -limit), limit) / limit

    def lost(self, motion: Motion, why: str) -> HalError:
        """The error of a model that has lost its way; the car stays where it is from then on."""
        self._failed = True
        return HalError(
            f"sim.physics: {self.name} fails at {motion[3]:.2f} m/s with {motion[4]:+.2f} rad of steering: {why}; "
            "drive slower or steer less, or set sim.physics=plain"
        )

    def attitude(self, pose: tuple[float, float, float]) -> tuple[float, float]:
        """Roll (left side up) and pitch (nose down positive) of the body now, rad."""
        return LEVEL if self._last is None else self.leaning(self._last)

    def loads(self) -> tuple[float, ...]:
        """What the wheels press on the floor with now, as shares of what they do at rest; none where unknown.

        In the order front left, front right, rear left, rear right.
        """
        return () if self._last is None else self.pressing(self._last)

    def heights(self) -> tuple[float, ...]:
        """How high the wheels are over the floor now, m, 0 where they touch it; none where unknown. As `loads`."""
        return () if self._last is None else self.rising(self._last)

    def lift(self, up: bool) -> None:
        """Put the car on blocks, where its wheels turn and steer freely, or down again, as an operator does."""

    # -- the model's own ---------------------------------------------------------------------------------------

    def settled(self, motion: Motion) -> Any:
        """The hidden state of a vehicle in this motion that does nothing else."""
        raise NotImplementedError

    def step(
        self, motion: Motion, hidden: Any, drive: MotorDrive, front: float, rear: float, dt: float
    ) -> tuple[Motion, Any]:
        """Return motion and hidden state `dt` seconds later; front and rear: the steering angles gone for, rad."""
        raise NotImplementedError

    def leaning(self, hidden: Any) -> tuple[float, float]:
        """Roll and pitch in a hidden state, rad."""
        return LEVEL

    def pressing(self, hidden: Any) -> tuple[float, ...]:
        """The wheels' loads in a hidden state."""
        return ()

    def rising(self, hidden: Any) -> tuple[float, ...]:
        """The wheels' heights over the floor in a hidden state, m."""
        return ()


def needed(name: str, load: Callable[[], Any]) -> Any:
    """Return what is imported; raises MissingExtra where a package is not installed."""
    try:
        return load()
    except ImportError as error:
        raise MissingExtra(f"sim.physics={name} (it finds no {error.name})", "physics") from None
