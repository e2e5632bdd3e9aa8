"""A stop of all, as the peer that gives it sees it: which robots are expected to answer, and which have.

Each stop has an identity of 128 random bits, so it is never rejected for its clock, number or order. A robot obeys each
identity once, so the echo of a stop does not undo a later arming. A stop without an identity is obeyed each time.

An answer states what is: first that the gate is closed, later that the robot was seen to stand, by its own watch over
stops. The newest answer of each robot counts.
"""

from collections.abc import Iterable
from secrets import token_hex
from typing import NamedTuple

from txt1.fleet.messages import StopAnswer


class Standing(NamedTuple):
    """How a stop of all stands; robots by name."""

    stands: tuple[str, ...] = ()
    """Robots whose gates are closed and that were seen to stand."""
    stopped: tuple[tuple[str, str], ...] = ()
    """Robots whose gates are closed but that were not yet seen to stand, and how the stop is going."""
    others: tuple[tuple[str, str], ...] = ()
    """Robots whose gates are not closed, and why."""
    silent: tuple[str, ...] = ()
    """Robots that were expected to answer, and have not."""

    @property
    def closed(self) -> bool:
        """Whether some gates are closed, and all that are expected to be."""
        return bool(self.stands or self.stopped) and not self.others and not self.silent

    @property
    def complete(self) -> bool:
        """Whether all those gates are closed, and all their robots were seen to stand."""
        return self.closed and not self.stopped

    def __str__(self) -> str:
        """Return it in one line."""
        parts = (
            ("stands", ", ".join(self.stands)),
            ("stopped, not seen to stand", _told(self.stopped, "it does not say how it goes")),
            ("not stopped", _told(self.others, "it does not say why")),
            ("no answer", ", ".join(self.silent)),
        )
        return "; ".join(f"{what}: {who}" for what, who in parts if who) or "no robot of the fleet is heard"


def _told(robots: Iterable[tuple[str, str]], nothing: str) -> str:
    return ", ".join(f"{name} ({why or nothing})" for name, why in robots)


class StopOfAll:
    """One stop of all; `expected` are names of robots that must answer, whether they are heard or not."""

    def __init__(self, expected: Iterable[str], began: float) -> None:
        self.identity = token_hex(16)
        self.began = began
        """When it was first given, s."""
        self._expected = set(expected)
        self._answers: dict[str, StopAnswer] = {}

    def expect(self, names: Iterable[str]) -> None:
        """Expect the answers of more robots; a robot once expected is expected to the end."""
        self._expected.update(names)

    def answered(self, name: str, answer: StopAnswer) -> None:
        """Take an answer; the newest of each robot counts."""
        self._answers[name] = answer

    def standing(self) -> Standing:
        """Return how it stands now."""
        answers = sorted(self._answers.items())
        return Standing(
            tuple(name for name, answer in answers if answer.stands),
            tuple((name, answer.why) for name, answer in answers if answer.closed and not answer.stands),
            tuple((name, answer.why) for name, answer in answers if not answer.closed),
            tuple(sorted(self._expected - self._answers.keys())),
        )
