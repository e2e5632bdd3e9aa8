"""Learning by several robots: each learns by itself, and before an episode takes over what the others have learned.

Rows (of a table, say) are merged number by number by their median, over those who know the row: so fewer than half of
these may lie as they like (D. Yin, Y. Chen, K. Ramchandran and P. Bartlett, "Byzantine-robust distributed learning",
ICML 2018). As up to `liars` may, a row is taken over when 2 liars + 1 know it, so that the others outvote them; of two
robots, where nobody can say who lies, each believes the other. Who is lost is missing, and no more.

Each keeps its own episodes and its own random values; its exploration fades by the episodes of all whom it hears,
because shared tables spare no repetition while it goes on exploring (each of n that learn in parallel needs a share of
the repetitions: R. M. Kretchmar, "Parallel reinforcement learning", SCI 2002). How many they were is not asked of them:
each counts for as many as one's own, so nobody can lie about it.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from txt1.errors import ConfigError
from txt1.learning.agent import Rows, Sharer
from txt1.learning.learned import Learned, learned_of
from txt1.learning.trial import Episode, Trial

LIARS: Final = 1


@runtime_checkable
class Exchange(Protocol):
    """A robot's way to those who learn with it; over a network it is the fleet's link."""

    def teach(self, learned: Learned) -> None:
        """Tell the others what this robot has learned."""

    def taught(self) -> Mapping[str, Learned]:
        """What each of the others has learned, of those who are heard now."""

    async def joined(self) -> None:
        """Wait until the others have had the time to tell it, when this robot is new among them."""


def sharer(name: str, agent: object) -> Sharer:
    """The learner of this name, as one that can learn together with others; ConfigError: it cannot."""
    if not isinstance(agent, Sharer):
        raise ConfigError(f"--share: the learner '{name}' shares nothing; choose thesis, sweeps or pilot")
    return agent


def merge(own: Learned, others: Sequence[Learned], liars: int = LIARS) -> tuple[Rows, NDArray[np.bool_]]:
    """The rows of all, shape (rows, columns), and which of them others have a part in; the rest are one's own.

    All are of one shape. `liars` is how many of three or more robots may lie.
    """
    every = [own, *others]
    rows, known = np.array([one.rows for one in every]), np.array([one.visits for one in every]) > 0
    lying = min(liars, (len(every) - 1) // 2)
    taken = (known.sum(axis=0) > 2 * lying) & known[1:].any(axis=0)
    merged = rows[0].copy()
    for row in np.flatnonzero(taken):
        merged[row] = np.median(rows[known[:, row], row], axis=0)
    return merged, taken


class Sharing:
    """One robot's part in learning together; see the module.

    `every` so many episodes it takes over what it hears; `hurry` says whether exploration fades by the episodes of all,
    or by its own; `tell` is told in words what was taken over, and from whom.
    """

    def __init__(
        self,
        learner: Sharer,
        exchange: Exchange,
        every: int = 1,
        liars: int = LIARS,
        hurry: bool = True,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._learner, self._exchange, self._every = learner, exchange, every
        self._liars, self._hurry, self._tell = liars, hurry, tell
        self._done = 0
        self._known: dict[str, int] = {}  # episodes of each of whom something was taken over
        self._strange: set[str] = set()  # names of those who learn something else

    def accompany(self, trial: Trial) -> None:
        """Do its part before and after each episode of the learner's trial."""
        told = trial.done

        def done(one: Episode) -> None:
            self.episode_over()
            told(one)

        trial.begins, trial.done = self.episode_begins, done

    async def joined(self) -> None:
        """Wait until it can take over what others have learned before the first episode."""
        await self._exchange.joined()

    def episode_over(self) -> None:
        """Tell the others."""
        self._done += 1
        self._exchange.teach(self._learner.shared())

    def episode_begins(self) -> None:
        """Take over what the others have learned, if it is time for that."""
        if self._done % self._every:
            return
        own = self._learner.shared()
        heard = {name: one for name, one in self._exchange.taught().items() if self._fits(name, own, one)}
        rows, taken = merge(own, list(heard.values()), self._liars)
        if not taken.any():
            return
        news = [name for name, one in heard.items() if self._known.get(name, 0) != one.episodes]
        self._known.update((name, one.episodes) for name, one in heard.items())
        count = self._learner.take(rows, taken, len(news) * self._every if self._hurry else 0)
        if count:
            self._tell(f"took over {count} of {len(rows)} rows from {len(heard)}: {', '.join(sorted(heard))}")

    def _fits(self, name: str, own: Learned, other: Learned) -> bool:
        """Whether another's rows mean the same as one's own; tells once when they do not."""
        if (other.learner, len(other.rows), len(other.rows[0])) == (own.learner, len(own.rows), len(own.rows[0])):
            return True
        if name not in self._strange:
            self._strange.add(name)
            shape = f"{len(other.rows)} rows of {len(other.rows[0])}"
            self._tell(f"takes nothing from {name}, which learns as '{other.learner}', {shape}")
        return False


class Lessons:
    """What the robots of one process teach one another.

    `lies` makes of a robot's name and what it has learned what it teaches; `lost` are the names of those who neither
    teach nor hear.
    """

    def __init__(
        self,
        lies: Callable[[str, Learned], Learned] = lambda name, learned: learned,
        lost: frozenset[str] = frozenset(),
    ) -> None:
        self.taught: dict[str, Learned] = {}
        self._lies, self._lost = lies, lost

    def of(self, name: str) -> "Pupil":
        """A robot's way to the others."""
        return Pupil(self, name)

    def teach(self, name: str, learned: Learned) -> None:
        """Let the others know it, unless it is refused."""
        self.taught.pop(name, None)
        with suppress(ValueError):
            if name not in self._lost:
                self.taught[name] = learned_of(self._lies(name, learned)._asdict())

    def heard(self, name: str) -> Mapping[str, Learned]:
        """What a robot hears of the others."""
        return {other: one for other, one in self.taught.items() if name != other and name not in self._lost}


class Pupil(NamedTuple):
    """One robot's end of the lessons."""

    lessons: Lessons
    name: str

    def teach(self, learned: Learned) -> None:
        """Tell the others what this robot has learned."""
        self.lessons.teach(self.name, learned)

    def taught(self) -> Mapping[str, Learned]:
        """What each of the others has learned, of those who are heard now."""
        return self.lessons.heard(self.name)

    async def joined(self) -> None:
        """They are heard at once."""
