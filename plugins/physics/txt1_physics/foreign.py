"""The common part of others' physics: memory, the motor and the steering servo, and refusals.

How it works. A `txt1.sim.vehicle.Vehicle` calls its physics with its motion, nine numbers, and gets nine back.
Others' models have more: sideways speeds, angular rates, suspensions. This *hidden* state is stored here for each
motion returned since the vehicle last moved on, because the world computes possible motions before it chooses one. A
motion without a stored state was made elsewhere: the vehicle was placed, ran into something, or was pushed. Then the
hidden state is made anew, at rest except for the motion itself (`settled`).

The motor and the steering servo are those of `txt1.sim.dynamics` in every physics. Under power the motor pulls the
wheels towards its free speed w with the acceleration (w - (1 + drag) v) / tau, v being the speed at which the driven
wheels roll; coasting, (v + friction) / tau slows them. The model computes the car's response.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, Final, NamedTuple

from txt1.config import Config, load
from txt1.errors import ConfigError, HalError
from txt1.hal import STEERING_MAX
from txt1.sim.dynamics import Motion

OWN: Final = ("slip", "understeer", "grip", "cornering", "inertia", "stiffness", "skid")
"""Parameters of the package's vehicle that others' models do not use, as they have tyres of their own."""
LEVEL: Final = (0.0, 0.0)
# s: shorter times are rounding errors
INSTANT: Final = 1e-9
# number of motions whose hidden state is stored; the world considers fewer before it chooses
KEPT: Final = 8


class MotorDrive(NamedTuple):
    """The motor's action, held for a while."""

    # otherwise it coasts
    driven: bool
    # the free speed, m/s; while coasting the speed of its dry friction
    free: float
    tau: float  # s
    # 1 + the floor's drag
    loss: float


class Foreign:
    """Others' physics for a vehicle.

    Args:
        name: the setting's value.
        config: the vehicle's configuration.

    Raises ConfigError: a setting would have no effect.
    """

    def __init__(self, name: str, config: Config) -> None:
        self.name = name
        self.body = config.geometry
        self.vehicle = config.sim.vehicle
        # the tyre settings in the vehicle's own file are not the user's mistake
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
        """Return the motion `dt` seconds later; raises HalError if the model has failed."""
        before = motion
        if self._failed:
            # so that neutral outputs still pass when the robot is stopped
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
            # a vehicle at a wall is moved again and again from the same motion
            del self._hidden[next(each for each in self._hidden if each != before)]
        return after

    def drive(self, motor: float, drag: float) -> MotorDrive:
        """Return the motor's action for these counts, as in `txt1.sim.dynamics.move`."""
        p = self.vehicle
        if abs(motor) <= p.dead_band:
            return MotorDrive(False, p.coast_friction, p.coast_time_constant, 1.0 + drag)
        beyond = motor - p.dead_band if motor > 0.0 else motor + p.dead_band
        return MotorDrive(True, p.speed_gain * beyond, p.speed_time_constant, 1.0 + drag)

    def angle(self, counts: float) -> float:
        """Return the steering angle that a servo aims for, rad, left positive; counts as in `Outputs`."""
        limit = float(STEERING_MAX)
        return -self.body.steering_max * min(max(counts, -limit), limit) / limit

    def lost(self, motion: Motion, why: str) -> HalError:
        """Return the error of a failed model; the car stays where it is from then on."""
        self._failed = True
        return HalError(
            f"sim.physics: {self.name} fails at {motion[3]:.2f} m/s with {motion[4]:+.2f} rad of steering: {why}; "
            "drive slower or steer less, or set sim.physics=plain"
        )

    def attitude(self, pose: tuple[float, float, float]) -> tuple[float, float]:
        """Return the present roll (left side up) and pitch (nose down positive) of the body, rad."""
        return LEVEL if self._last is None else self.leaning(self._last)

    def loads(self) -> tuple[float, ...]:
        """Return the wheels' present loads, as shares of their loads at rest; empty if unknown.

        The order is front left, front right, rear left, rear right.
        """
        return () if self._last is None else self.pressing(self._last)

    def heights(self) -> tuple[float, ...]:
        """Return the present heights of the wheels over the floor, m, 0 on the floor; empty if unknown.

        Order as `loads`.
        """
        return () if self._last is None else self.rising(self._last)

    def lift(self, up: bool) -> None:
        """Put the car on blocks, where its wheels turn and steer freely, or on the floor again."""

    # -- the model's own ---------------------------------------------------------------------------------------

    def settled(self, motion: Motion) -> Any:
        """Return the hidden state of a vehicle in this motion and otherwise at rest."""
        raise NotImplementedError

    def step(
        self, motion: Motion, hidden: Any, drive: MotorDrive, front: float, rear: float, dt: float
    ) -> tuple[Motion, Any]:
        """Return motion and hidden state `dt` seconds later; `front` and `rear` are the target steering angles, rad."""
        raise NotImplementedError

    def leaning(self, hidden: Any) -> tuple[float, float]:
        """Return roll and pitch in a hidden state, rad."""
        return LEVEL

    def pressing(self, hidden: Any) -> tuple[float, ...]:
        """Return the wheels' loads in a hidden state."""
        return ()

    def rising(self, hidden: Any) -> tuple[float, ...]:
        """Return the wheels' heights over the floor in a hidden state, m."""
        return ()
