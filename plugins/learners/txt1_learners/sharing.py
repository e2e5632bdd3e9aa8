"""Several robots learn together: before an episode each takes over what the others have learned.

The rows of a learner (for example of its table) are merged number by number: each number becomes the median over the
robots that know the row. So a minority of these robots may report anything (D. Yin, Y. Chen, K. Ramchandran and P.
Bartlett, "Byzantine-robust distributed learning", ICML 2018). With up to `liars` false reports, a row is taken over
when 2 liars + 1 robots know it: then the true reports outvote the false. Two robots cannot find out a false report, so
each believes the other. A lost robot is only missing.

Each robot keeps its own episodes and its own random values. Its exploration fades by the episodes of all robots that it
hears. Shared tables save no repetition while exploration goes on: each of n parallel learners needs a share of the
repetitions (R. M. Kretchmar, "Parallel reinforcement learning", SCI 2002). A robot does not ask for the numbers of
episodes of other robots: each counts for as many episodes as this robot has done. So no robot can lie about its number.
"""

from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Final, Protocol, runtime_checkable

from txt1 import Robot
from txt1.errors import ConfigError
from txt1.learning.agent import Learned, Rows
from txt1.learning.trial import Episode, Trial

LIARS: Final = 1


@runtime_checkable
class Sharer(Protocol):
    """A learner that can learn together with others, between two episodes."""

    def shared(self) -> Learned:
        """Return its rows, and how well each is known."""

    def take(self, rows: Rows, taken: Sequence[bool], episodes: int) -> int:
        """Take over the rows marked in `taken`, in which others have a part; return how many were taken over.

        `episodes` is the number of episodes that the others have learned in since the last call.
        """


@runtime_checkable
class Exchange(Protocol):
    """A robot's connection to the robots that learn with it; over a network it is the fleet's link."""

    def teach(self, learned: Learned) -> None:
        """Tell the others what this robot has learned."""

    def taught(self) -> Mapping[str, Learned]:
        """The rows of each other robot that is heard now, by name."""

    async def joined(self) -> None:
        """Wait until the others have had time to tell their rows, if this robot is new among them."""


def sharer(name: str, agent: object) -> Sharer:
    """Return the learner if it can learn together with others; raises ConfigError: it cannot."""
    if not isinstance(agent, Sharer):
        raise ConfigError(f"--share: the learner '{name}' shares nothing; choose thesis or another that does")
    return agent


def merge(own: Learned, others: Sequence[Learned], liars: int = LIARS) -> tuple[Rows, list[bool]]:
    """Return the merged rows, and for each whether others have a part in it.

    Rows in which they have none are this robot's own. All have one shape. `liars` is how many of three or more robots
    may lie.
    """
    merged, taken = list(own.rows), [False] * len(own.rows)
    lying = min(liars, len(others) // 2)
    for k in range(len(merged)):
        known = [one for one in (own, *others) if one.visits[k] > 0]
        if len(known) > 2 * lying and known != [own]:
            taken[k] = True
            merged[k] = tuple(median(column) for column in zip(*(one.rows[k] for one in known), strict=True))
    return merged, taken


class Sharing:
    """One robot's part in learning together; see the module.

    It takes over rows before every `every`-th episode. `hurry` lets exploration fade by the episodes of all robots,
    else by its own. `tell` is called with a text: how much was taken over, and from which robots.
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
        # the number of episodes of each robot, as last taken over
        self._known: dict[str, int] = {}
        # names of robots that learn something else
        self._strange: set[str] = set()

    def accompany(self, trial: Trial) -> None:
        """Take part before and after each episode of the learner's trial."""
        told = trial.done

        def done(one: Episode) -> None:
            self.episode_over()
            told(one)

        trial.begins, trial.done = self.episode_begins, done

    async def joined(self) -> None:
        """Wait until the rows of others can be taken over before the first episode."""
        await self._exchange.joined()

    def episode_over(self) -> None:
        """Tell the others this robot's rows."""
        self._done += 1
        self._exchange.teach(self._learner.shared())

    def episode_begins(self) -> None:
        """Take over what the others have learned, if this episode is due for it."""
        if self._done % self._every:
            return
        own = self._learner.shared()
        heard = {name: one for name, one in self._exchange.taught().items() if self._fits(name, own, one)}
        rows, taken = merge(own, list(heard.values()), self._liars)
        if not any(taken):
            return
        news = [name for name, one in heard.items() if self._known.get(name, 0) != one.episodes]
        self._known.update((name, one.episodes) for name, one in heard.items())
        count = self._learner.take(rows, taken, len(news) * self._every if self._hurry else 0)
        if count:
            self._tell(f"took over {count} of {len(rows)} rows from {len(heard)}: {', '.join(sorted(heard))}")

    def _fits(self, name: str, own: Learned, other: Learned) -> bool:
        """Return whether another's rows have the same meaning as ours; report once if they do not."""
        if (other.learner, len(other.rows), len(other.rows[0])) == (own.learner, len(own.rows), len(own.rows[0])):
            return True
        if name not in self._strange:
            self._strange.add(name)
            shape = f"{len(other.rows)} rows of {len(other.rows[0])}"
            self._tell(f"takes nothing from {name}, which learns as '{other.learner}', {shape}")
        return False


def of_robot(robot: Robot, name: str, agent: object, every: int) -> Sharing:
    """Return the part of a robot of a fleet, before every `every`-th episode of its learner of this name."""
    # the options make sure that the robot is in a fleet
    exchange = next(part for part in robot.runtime.parts if isinstance(part, Exchange))
    return Sharing(sharer(name, agent), exchange, every, tell=robot.tell)
