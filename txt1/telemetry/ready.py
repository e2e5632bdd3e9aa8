"""Messages that are bytes already: a recorder makes each once, for its files, the live view and bridges alike."""

from typing import NamedTuple, Protocol

from txt1.telemetry.topics import Take, Unsubscribe


class Ready(NamedTuple):
    """A message as CDR, to be told in place of its value."""

    data: bytes
    epoch: int  # time of the run's start in its time stamp, ns
    stamp: int | None  # offset of that stamp; None where it has none


class Maker(Protocol):
    """Makes messages of everything that is told, in the loop."""

    def tap(self, take: Take) -> Unsubscribe:
        """Have `take` told every message from now on, as it is made, until the function returned is called."""

    def make(self) -> None:
        """Make what has been told up to now."""
