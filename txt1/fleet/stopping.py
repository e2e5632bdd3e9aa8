"""A stop of all, as whoever says it sees it: who was expected to answer, and who has.

It has an identity of its own making, 128 random bits: no clock, number or order of messages keeps it out. A robot obeys
each identity once, so the echo of a stop does not undo an arming after it; a stop without one is obeyed each time.
"""

from collections.abc import Iterable
from secrets import token_hex
from typing import NamedTuple

from txt1.fleet.messages import StopAnswer


class Standing(NamedTuple):
    """How a stop of all stands: those whose gates are closed, those who answer something else, those without answer."""

    stopped: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()  # and why
    silent: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether somebody was stopped and nobody was not."""
        return bool(self.stopped) and not self.others and not self.silent

    def __str__(self) -> str:
        """Return it in one line."""
        others = ", ".join(f"{name} ({why or 'it does not say why'})" for name, why in self.others)
        parts = ("stopped", ", ".join(self.stopped)), ("not stopped", others), ("no answer", ", ".join(self.silent))
        return "; ".join(f"{what}: {who}" for what, who in parts if who) or "no robot of the fleet is heard"


class StopOfAll:
    """One stop of all; `expected` are names of robots that must answer, whether they are heard or not."""

    def __init__(self, expected: Iterable[str], began: float) -> None:
        self.identity = token_hex(16)
        self.began = began
        """When it was said first, s."""
        self._expected = set(expected)
        self._answers: dict[str, StopAnswer] = {}

    def expect(self, names: Iterable[str]) -> None:
        """Expect the answers of more robots: whoever was heard while it was said is expected to the end."""
        self._expected.update(names)

    def answered(self, name: str, answer: StopAnswer) -> None:
        """Take an answer; the newest of each robot counts."""
        self._answers[name] = answer

    def standing(self) -> Standing:
        """Return how it stands now."""
        answers = sorted(self._answers.items())
        return Standing(
            tuple(name for name, answer in answers if answer.closed),
            tuple((name, answer.why) for name, answer in answers if not answer.closed),
            tuple(sorted(self._expected - self._answers.keys())),
        )
