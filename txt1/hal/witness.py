"""A hardware layer whose reports and errors are noted, so that a replay can give them again."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final, cast

from txt1.hal.base import Hal, Inputs

CALLS: Final = ("write", "halt", "switch", "load_gains", "offer_odometry", "indicate", "place")
Note = Callable[[str, str, Any], None]
"""Notes the method that was called, the words of the error that it raised, and the new report that it returned."""


class Witnessed:
    """Another hardware layer: notes each report that differs from the one before, and each error; adds nothing."""

    def __init__(self, hal: Hal, note: Note) -> None:
        self._hal, self._note = hal, note
        self.name, self.capabilities = hal.name, hal.capabilities
        self._last: Inputs | None = None
        for name in CALLS:
            setattr(self, name, partial(self._call, name))

    def __getattr__(self, name: str) -> Any:
        """Whatever else the layer underneath has."""
        return getattr(self._hal, name)

    def read(self, now: float) -> Inputs:
        """The report of the layer underneath."""
        inputs: Inputs = self._call("read", now)
        if inputs is not self._last and inputs != self._last:
            self._note("read", "", inputs)
        self._last = inputs
        return inputs

    def _call(self, name: str, *arguments: Any) -> Any:
        try:
            return getattr(self._hal, name)(*arguments)
        except Exception as error:
            self._note(name, f"{error}", None)
            raise


def witnessed(hal: Hal, note: Note) -> Hal:
    """The hardware layer with its reports noted."""
    return cast("Hal", Witnessed(hal, note))
