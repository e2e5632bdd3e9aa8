"""A hardware layer with a motor and steering only; other layers add their abilities."""

from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from txt1.errors import NotCapable
from txt1.hal.base import Capabilities, Indicators, Outputs
from txt1.protocol.messages import CombinedOdometry, PidSet, Switch
from txt1.sim.parameters import Box


class PlainHal:
    """Refuses every optional ability of a HAL: no switches, no gains, no free servos, no simulated room.

    A class with a capability overrides the capability's method.
    """

    name = "plain"
    capabilities = Capabilities()
    own_channels: Any = None
    esc = False
    waits = False

    def halt(self, outputs: Outputs, now: float) -> None:
        """Refuse: nothing stands between `write` and the actuators."""
        self._refuse("halt")

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Refuse: there are no switches."""
        self._refuse("power")

    def load_gains(self, gains: PidSet, answered: Callable[[bool], None]) -> None:
        """Refuse: no loops take txt1's gains."""
        self._refuse("gains")

    def offer_odometry(self, combined: CombinedOdometry, now: float) -> None:
        """Refuse: no loop would use it."""
        self._refuse("combined")

    def indicate(self, indicators: Indicators) -> None:
        """Ignore buzzer and LEDs: there are none."""

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        """Refuse: software cannot lift a real robot."""
        self._refuse("place")

    def tap_line(self, tap: Callable[[str, bytes], None]) -> bool:
        """Return that there is no line."""
        return False

    def clear_loops(self, now: float) -> None:
        """Do nothing: no loops of its own wind up."""

    def blocked_by(self) -> str | None:
        """Return None: nobody knows."""
        return None

    def attitude(self) -> tuple[float, float]:
        """Return roll and pitch of level ground."""
        return 0.0, 0.0

    def others(self) -> tuple[tuple[float, float, float], ...]:
        """Return no vehicles."""
        return ()

    def movers(self) -> Sequence[Box]:
        """Return no boxes."""
        return ()

    def _refuse(self, capability: str) -> NoReturn:
        raise NotCapable(self.name, capability)
