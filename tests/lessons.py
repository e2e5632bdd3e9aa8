"""The exchange among robots that learn together in one process, in place of the fleet's link."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

from txt1.fleet.shared_knowledge import learned_of
from txt1.learning.agent import Learned


class Lessons:
    """The exchange among the robots of one process.

    `lies` changes what a robot teaches, given its name and its rows. `lost` are the names of robots that neither teach
    nor hear.
    """

    def __init__(
        self,
        lies: Callable[[str, Learned], Learned] = lambda name, learned: learned,
        lost: frozenset[str] = frozenset(),
    ) -> None:
        self.taught: dict[str, Learned] = {}
        self._lies, self._lost = lies, lost

    def of(self, name: str) -> "Pupil":
        """Return a robot's connection to the others."""
        return Pupil(self, name)

    def teach(self, name: str, learned: Learned) -> None:
        """Pass a robot's rows on, unless they are refused."""
        self.taught.pop(name, None)
        with suppress(ValueError):
            if name not in self._lost:
                self.taught[name] = learned_of(self._lies(name, learned)._asdict())

    def heard(self, name: str) -> Mapping[str, Learned]:
        """Return the rows that a robot hears from the others."""
        return {other: one for other, one in self.taught.items() if name != other and name not in self._lost}


class Pupil(NamedTuple):
    """One robot's connection to the lessons."""

    lessons: Lessons
    name: str

    def teach(self, learned: Learned) -> None:
        """Tell the others what this robot has learned."""
        self.lessons.teach(self.name, learned)

    def taught(self) -> Mapping[str, Learned]:
        """The rows of each other robot that is heard now, by name."""
        return self.lessons.heard(self.name)

    async def joined(self) -> None:
        """Return at once: the others are heard immediately."""
