"""Wiring of a vehicle: the directions of its channels, their neutral positions, and their ranges.

For the robot's tasks a count has the same meaning on every vehicle: motor forward, front steering right, rear steering
left, 18000 counts of steering to the stop, encoders forward. Channels convert these counts to and from a particular
vehicle's wiring.
"""

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from annotated_types import Ge, Le

from txt1.model.vehicle import PWM_MAX, outputs_of, sides
from txt1.units import Positive

# counts from the middle, 50 us, that contain a motor's neutral
NEUTRAL_MAX: Final = 2400.0


@dataclass(frozen=True, slots=True)
class Channel:
    """An output. Its counts on the wire are trim + direction * scale * counts, within +-24000."""

    direction: Literal[1, -1] = 1
    """-1: the output is reversed."""
    trim: Annotated[float, Ge(-PWM_MAX), Le(PWM_MAX)] = 0.0
    """Counts on the wire at which the motor is in neutral, or the wheels point straight ahead."""
    scale: Positive = 1.0
    """Gain. Full lock is at trim +- 18000 * scale."""

    def wired(self, counts: float) -> float:
        """Return the counts on the wire for `counts` of the controller."""
        return min(max(self.trim + self.direction * self.scale * counts, -PWM_MAX), PWM_MAX)

    def meant(self, counts: float) -> float:
        """Return the controller's counts for `counts` on the wire; the inverse of `wired`."""
        return self.direction * (counts - self.trim) / self.scale


@dataclass(frozen=True, slots=True)
class Channels:
    """A vehicle's outputs and encoders, as `txt1 calibrate` finds them; a section of the configuration."""

    motor: Channel = Channel()
    """Motor of a vehicle that steers."""
    front: Channel = Channel()
    """Front steering."""
    rear: Channel = Channel()
    """Rear steering."""
    right: Channel = Channel()
    """Right side of a vehicle whose sides run at two speeds."""
    left: Channel = Channel()
    """Left side of such a vehicle."""
    right_encoder: Literal[1, -1] = 1
    """-1: the right encoder counts backwards."""
    left_encoder: Literal[1, -1] = 1
    """-1: the left encoder counts backwards."""
    encoders_swapped: bool = False
    """Whether the right wheel's encoder is connected as the left wheel's."""

    def __post_init__(self) -> None:
        """Refuse a neutral that would move the vehicle, because neutral is also put out while the gate is closed."""
        for name, channel in (("motor", self.motor), ("right", self.right), ("left", self.left)):
            if abs(channel.trim) > NEUTRAL_MAX:
                raise ValueError(
                    f"{name}.trim: {channel.trim:g}; a motor is in neutral within {NEUTRAL_MAX:g} counts of the middle"
                )

    def wired(self, motor: float, front: float, rear: float, skids: bool) -> tuple[int, int, int]:
        """Return the counts on the wires for motor and steering.

        `skids`: the sides run at two speeds, as `txt1.model.vehicle.sides` of motor and rear.
        """
        if skids:
            right, left = sides(motor, rear)
            both, turn = outputs_of(self.right.wired(right), self.left.wired(left))
            return round(both), -round(turn), round(turn)
        return round(self.motor.wired(motor)), round(self.front.wired(front)), round(self.rear.wired(rear))

    def meant(self, motor: float, front: float, rear: float, skids: bool) -> tuple[float, float, float]:
        """Return motor and steering for counts on the wires: the inverse of `wired`."""
        if skids:
            right, left = sides(motor, rear)
            both, turn = outputs_of(self.right.meant(right), self.left.meant(left))
            return both, -turn, turn
        return self.motor.meant(motor), self.front.meant(front), self.rear.meant(rear)

    def counted(self, right: int, left: int) -> tuple[int, int]:
        """Return encoder counts (right, left), forward positive, for the received counts."""
        if self.encoders_swapped:
            right, left = left, right
        return self.right_encoder * right, self.left_encoder * left

    def sent(self, right: int, left: int) -> tuple[int, int]:
        """Return the counts that wheels send after turning by `right` and `left`: the inverse of `counted`."""
        right, left = self.right_encoder * right, self.left_encoder * left
        return (left, right) if self.encoders_swapped else (right, left)


STRAIGHT: Final = Channels()
"""Every channel as in the robot's tasks."""
