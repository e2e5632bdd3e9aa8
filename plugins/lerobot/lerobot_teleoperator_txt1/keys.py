"""A teleoperator for terminals: w and s drive, a and d steer, everything else stands; or a drive that is written down.

A key counts for as long as a keyboard takes to repeat it. So whoever lets go of it, or loses the line, has let go.
"""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from dataclasses import dataclass, field
from typing import Any, Final

from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

from txt1.control.hand import Hand
from txt1.model.vehicle import Geometry

HELD: Final = 0.5  # s for which a key counts: keyboards begin to repeat after this
AXES: Final = {"w": (1.0, 0.0), "s": (-1.0, 0.0), "a": (0.0, 1.0), "d": (0.0, -1.0)}
ACTIONS: Final = ("x.vel", "theta.vel")


@TeleoperatorConfig.register_subclass("txt1_keys")
@dataclass(kw_only=True)
class Txt1KeysConfig(TeleoperatorConfig):
    """``--teleop.type=txt1_keys``."""

    speed: float = 0.5
    """Of w and s, m/s."""
    radius: float = Geometry().radius_min
    """The car's smallest circle, m."""
    drive: list[list[float]] = field(default_factory=list)
    """Without keys: seconds, v (m/s) and omega (rad/s) of each stretch, and then it stands."""

    def __post_init__(self) -> None:
        """Raise ValueError for a stretch that is none."""
        if any(len(each) != 3 or each[0] <= 0.0 for each in self.drive):
            raise ValueError(
                f"drive: {self.drive}: give seconds, m/s and rad/s of each stretch, such as [[2, 0.4, 0.3]]"
            )


class Txt1Keys(Teleoperator):
    """See `Txt1KeysConfig`."""

    config_class = Txt1KeysConfig
    name = "txt1_keys"

    def __init__(self, config: Txt1KeysConfig) -> None:
        super().__init__(config)
        self.config = config
        self._hand = Hand(radius=config.radius)
        self._connected = False
        # when the drive was first asked for: a robot may take seconds to open
        self._began: float | None = None
        self._pressed: dict[str, float] = {}
        self._before: list[Any] | None = None

    @property
    def action_features(self) -> dict[str, Any]:
        """The two velocities."""
        return dict.fromkeys(ACTIONS, float)

    @property
    def feedback_features(self) -> dict[str, Any]:
        """None."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether keys are read."""
        return self._connected

    @property
    def is_calibrated(self) -> bool:
        """Yes: there is nothing to calibrate."""
        return True

    def calibrate(self) -> None:
        """Nothing."""

    def configure(self) -> None:
        """Nothing."""

    def connect(self, calibrate: bool = True) -> None:
        """Begin to read keys, where this is a terminal."""
        self._connected = True
        if not self.config.drive and sys.stdin.isatty():
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)

    def get_action(self) -> dict[str, float]:
        """The velocities of the keys that are held, or of the drive that was written down."""
        v, omega = self._written() if self.config.drive else self._of_keys()
        return dict(zip(ACTIONS, (v, omega), strict=True))

    def _written(self) -> tuple[float, float]:
        now = time.monotonic()
        if self._began is None:
            self._began = now
        left = now - self._began
        for seconds, v, omega in self.config.drive:
            if left < seconds:
                return v, omega
            left -= seconds
        return 0.0, 0.0

    def _of_keys(self) -> tuple[float, float]:
        now = time.monotonic()
        while self._before is not None and select.select([sys.stdin], [], [], 0.0)[0]:
            key = os.read(sys.stdin.fileno(), 1).decode("ascii", "replace")
            if key in AXES:
                self._pressed[key] = now
            else:
                self._pressed.clear()
        held = [AXES[key] for key, at in self._pressed.items() if now - at < HELD]
        ahead, left = (max(-1.0, min(1.0, sum(axis))) for axis in zip(*held, strict=True)) if held else (0.0, 0.0)
        return self._hand.velocity(self.config.speed, ahead, left)

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Nothing: keys feel nothing."""

    def disconnect(self) -> None:
        """Give the terminal back."""
        self._connected, self._began = False, None
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
            self._before = None
