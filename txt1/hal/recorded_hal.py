"""A hardware layer whose reports and errors are recorded for a replay."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final, cast

from txt1.hal.base import Hal, Inputs

CALLS: Final = ("write", "halt", "switch", "load_gains", "offer_odometry", "indicate", "place")
Note = Callable[[str, str, Any], None]
"""Called with the method, the text of its error, and its new report."""


class Witnessed:
    """Records each new report of a hardware layer, and each error; passes everything on unchanged."""

    def __init__(self, hal: Hal, note: Note) -> None:
        self._hal, self._note = hal, note
        self.name, self.capabilities = hal.name, hal.capabilities
        self._last: Inputs | None = None
        for name in CALLS:
            setattr(self, name, partial(self._call, name))

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the hardware layer."""
        return getattr(self._hal, name)

    def read(self, now: float) -> Inputs:
        """Return the report of the hardware layer."""
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
    """Return the hardware layer with its reports recorded."""
    return cast("Hal", Witnessed(hal, note))
