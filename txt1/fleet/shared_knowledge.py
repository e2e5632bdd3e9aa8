"""The knowledge that a robot tells the others of its fleet: rows of numbers, checked as they arrive.

The rows are a learner's table, or its other learned numbers. The other robots are alike, with the same learner.
"""

from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

from txt1.learning.agent import Learned
from txt1.telemetry.topics import Rule, Topic, declare

# in all rows together; with visits it makes a message of at most 20 kB
NUMBERS_MAX: Final = 512
# of visits and episodes
COUNT_MAX: Final = 10**9
# of a number
KNOWLEDGE_NUMBER_MAX: Final = 1e9
# letters
NAME_MAX: Final = 40
# s in which every robot has told its rows at least once
ALL_TOLD: Final = 1.5
# s without a message after which a robot is lost; rows are told once a second
FORGET: Final = 5.0


LEARNED: Final = declare(
    Topic("/learned", Learned, "", "std_msgs/String", Rule.SNAPSHOT, "told to those who learn together with this robot")
)


def learned_of(told: Mapping[str, Any]) -> Learned:
    """Return a `Learned` from a received message; ValueError says what is wrong with it."""
    try:
        learner, episodes = str(told["learner"]), int(told["episodes"])
        visits = tuple(int(count) for count in told["visits"])
        rows = tuple(tuple(float(number) for number in row) for row in told["rows"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"is no table: {type(error).__name__}: {str(error)[:NAME_MAX]}") from None
    if len(learner) > NAME_MAX:
        raise ValueError(f"names its learner by {len(learner)} letters, more than {NAME_MAX}")
    if not rows or len(visits) != len(rows) or {len(row) for row in rows} != {len(rows[0])}:
        raise ValueError(f"has {len(rows)} rows, visits of {len(visits)}, and not each row is as long as the first")
    if len(rows) * len(rows[0]) > NUMBERS_MAX:
        raise ValueError(f"has {len(rows) * len(rows[0])} numbers, more than {NUMBERS_MAX}")
    for count in (episodes, *visits):
        if not 0 <= count <= COUNT_MAX:
            raise ValueError(f"counts {str(count)[:NAME_MAX]} visits or episodes")
    for place, row in enumerate(rows):
        for number in row:
            if not (isfinite(number) and abs(number) <= KNOWLEDGE_NUMBER_MAX):
                raise ValueError(f"has the number {number:g} in row {place}")
    return Learned(learner, episodes, visits, rows)
