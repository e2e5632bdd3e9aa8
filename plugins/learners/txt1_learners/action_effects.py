"""What each action does to the robot's motion, as observed, and whether it still does so.

    d' = k d + c(a),  (h/d)' = l (h/d) + e(a)        a: the action in force, d and h: distance and turn in a decision

The coefficients come from least squares that forget, for each delay with which an action may take effect (`Effects`).
Actions may begin to do something else, for good, or for a part of each episode, as on a floor that is slippery here and
there. `MotionModel` watches for that:

1. It compares the motion of the last second with what it foretold a second ago. Where odometry's noise hardly explains
   the difference, the actions do something else.
2. The effects that they had before the last such change are taken again, if these tell the last decisions better. If
   not, the effects are learned anew from the last second. Of actions that were not in it little is known; `doubtful`
   names those that should be tried.
3. The last second is partly from before the change. So it decides once more a second later, when all of it is from
   after the change.
4. Where the effects changed later than two seconds after the start of an episode, the next begins with those of before.
"""

from copy import deepcopy
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1_learners.planner import Array, Place, compiled

# numbers of a decision: distance and curvature before it, the actions, the latest first, distance and curvature after
Step = tuple[Place, NDArray[np.int64], Place]
# decisions over which the effects are judged
SECOND: Final = 10
# decisions from one copy of the effects to the next, and the number of copies; the first is from before the change
COPIED: Final = 5
COPIES: Final = 3
# latest decisions that tell at once whether the effects of before the last change are back
LATEST: Final = 4
# weight that earlier effects of the actions keep when they do something else
FADED: Final = 0.01
# decisions at the last change, if there was none, and those after which another one is not part of it
LONG_AGO, SOON = -3 * SECOND, 3 * SECOND


class Effects:
    """The effects of each action on distance and curvature, for each delay of 0, 1, 2, ... decisions.

    y' = k y + c(a), with one k for all actions, by least squares that forget; the last action stands for "no action".
    """

    def __init__(self, actions: int, delays: int) -> None:
        # sums of 1, y, y', y^2, y y': for distance, and for curvature
        self.sums = np.zeros((delays, 2, actions + 1, 5))
        self.sums[..., 3] = 1e-6
        # mean square error of the predictions
        self.error = np.zeros(delays)
        self.k = np.zeros((delays, 2))
        self.c = np.zeros((delays, 2, actions + 1))

    def learn(self, taken: NDArray[np.int64], distance: Place, curvature: Place, forgets: float) -> None:
        """Take distances and curvatures before and after a decision; `taken` are the last actions, the latest first."""
        learn_effects(self.sums, self.error, self.k, self.c, taken, distance, curvature, forgets)

    def numbers(self, delays: int) -> Array:
        """Return the first `delays` delays' errors, k, c, and weight, mean and mean square of the inputs.

        They are equal for equal robots.
        """
        sums = self.sums[:delays]
        weight, before, square = sums[..., 0], sums[..., 1], sums[..., 3]
        once = weight > 1e-9
        means = [np.divide(each, weight, out=np.zeros_like(weight), where=once) for each in (before, square)]
        own = self.error[:delays], self.k[:delays], self.c[:delays]
        return np.concatenate([each.ravel() for each in (*own, weight, *means)])

    def take(self, numbers: Array) -> None:
        """Take over the result of `numbers`; the outputs are computed from its k and c.

        The effects of longer delays are then as those of the last one, and fit worse.
        """
        one = self.c[0].size
        delays = len(numbers) // (1 + 2 + 4 * one)
        error, k, c, rest = np.split(numbers, np.cumsum([delays, 2 * delays, one * delays]))
        longer = np.minimum(np.arange(len(self.error)), delays - 1)
        error = error[longer] + (np.arange(len(self.error)) >= delays) * (1.0 + error.max())
        k, c = k.reshape(delays, 2)[longer], c.reshape(delays, *self.c.shape[1:])[longer]
        weight, mean, square = rest.reshape(3, delays, *self.c.shape[1:])[:, longer]
        weight = np.maximum(weight, 0.0)
        before, squared = weight * mean, weight * np.maximum(square, mean * mean) + 1e-6
        self.error, self.c = np.maximum(error, 0.0), c.copy()
        self.k = np.clip(k, 0.0, 0.95)
        slope = self.k[..., None]
        after, product = slope * before + self.c * weight, slope * squared + self.c * before
        self.sums = np.stack([weight, before, after, squared, product], axis=-1)


def steady(k: Array, c: Array) -> Array:
    """Return distance and curvature to which each action leads, by k and c of one delay; shape (2, actions)."""
    return np.asarray(c[:, :-1] / (1.0 - k[:, None]))


@compiled
def learn_effects(
    sums: Array,
    error: Array,
    k: Array,
    c: Array,
    taken: NDArray[np.int64],
    distance: Place,
    curvature: Place,
    forgets: float,
) -> None:
    """See `Effects.learn`."""
    weight = distance[1] * distance[1]
    for delay in range(sums.shape[0]):
        a = taken[delay]
        miss = (k[delay, 1] * curvature[0] + c[delay, 1, a] - curvature[1]) ** 2 * weight
        miss += (k[delay, 0] * distance[0] + c[delay, 0, a] - distance[1]) ** 2
        error[delay] += 0.03 * (miss - error[delay])
        for row in range(2):
            y, y_next = distance if row == 0 else curvature
            w = 1.0 if row == 0 else weight
            one = sums[delay, row]
            one[a] *= forgets
            one[a, 0] += w
            one[a, 1] += w * y
            one[a, 2] += w * y_next
            one[a, 3] += w * y * y
            one[a, 4] += w * y * y_next
            within = across = 1e-12
            for b in range(one.shape[0]):
                within += one[b, 3] - one[b, 1] * one[b, 1] / (one[b, 0] + 1e-12)
                across += one[b, 4] - one[b, 1] * one[b, 2] / (one[b, 0] + 1e-12)
            k[delay, row] = min(max(across / within, 0.0), 0.95)
            for b in range(one.shape[0]):
                c[delay, row, b] = (one[b, 2] - k[delay, row] * one[b, 1]) / (one[b, 0] + 1e-12)


class MotionModel:
    """The effects of the actions now, and those that they had before the last change; see the module.

    `slip` is the standard deviation of distance and turn in a decision, as a share of the longest and the largest.
    `limit` is what the squared error in a second, in deviations, exceeds with the probability of a false alarm. An
    action's effect is known once it was in force for `tries` decisions.
    """

    def __init__(self, actions: int, delays: int, *, slip: float, limit: float, tries: int, forgets: float) -> None:
        self.effects = Effects(actions, delays)
        # those before the last change; None: there was none
        self.others: Effects | None = None
        self._actions, self._delays = actions, delays
        self._slip, self._limit, self._tries, self._forgets = slip, limit, tries, forgets
        # actions that were not in force since the effects were learned anew
        self._stale = set[int]()
        self.begin()

    def begin(self) -> None:
        """An episode begins."""
        # its decisions
        self._steps: list[Step] = []
        # of the decisions since the effects were others: the effects known then
        self._foretold: list[tuple[int, Array, Array, Array]] = []
        self._copies = [deepcopy(self.effects)] * COPIES
        # the effects of its first two seconds, once there are others
        self._first: Effects | None = None
        # the number of decisions at the last change, and the effects before it until it is settled
        self._changed = LONG_AGO
        self._before: Effects | None = None
        # whether it then went on by those of before the change before, and whether that was less than 3 s before
        self._back = self._soon = False

    def end(self) -> None:
        """An episode is over."""
        if self._first is not None:
            self.effects, self.others = self._first, self.effects

    def delay(self) -> int:
        """Return the delay with the best predictions, in decisions."""
        return int((self.effects.error * (1.0 + 0.02 * np.arange(self._delays))).argmin())

    def learn(self, before: Place, taken: NDArray[np.int64], after: Place) -> bool:
        """Learn from a decision: distance and curvature before it, the last actions, and distance and curvature after.

        Return whether the actions do something else than before.
        """
        delay, known = self.delay(), self.effects
        foretold = delay, known.k[delay].copy(), known.c[delay].copy(), known.sums[delay, 0, :, 0].copy()
        self._foretold = [*self._foretold[1 - SECOND :], foretold]
        self._steps.append((before, taken, after))
        self._add(self._steps[-1])
        if len(self._steps) % COPIED == 0:
            self._copies = [*self._copies[1:], deepcopy(known)]
        if self._before is not None and len(self._steps) == self._changed + SECOND:
            self._settle(self._before)
        if len(self._foretold) < SECOND or not self._strayed():
            return False
        self._change()
        return True

    def doubtful(self) -> list[int]:
        """Return actions to try: not in force since the effects were learned anew, and like one that was."""
        if not self._stale:
            return []
        delay = self.delay()
        self._stale.discard(int(self._steps[-1][1][delay]) if self._steps else self._actions)
        does = steady(self.effects.k[delay], self.effects.c[delay])
        near = self._slip * np.abs(does).max(axis=1)
        known = [does[:, a] for a in range(self._actions) if a not in self._stale]
        alike = [a for a in sorted(self._stale) if any((np.abs(does[:, a] - one) < near).all() for one in known)]
        self._stale -= set(alike)
        return alike

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        both = {"effects": self.effects, "others": self.others}
        numbers = {key: each and {name: own.tolist() for name, own in vars(each).items()} for key, each in both.items()}
        return {**numbers, "stale": sorted(self._stale)}

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""
        self.effects, self.others = self._of(memory["effects"]), None
        # older memories lack them
        if memory.get("others") is not None:
            self.others = self._of(memory["others"])
        self._stale = set(map(int, memory.get("stale", ())))
        self.begin()

    def sound(self, largest: float) -> bool:
        """Return whether the effects have their shapes, and no number is larger than `largest` or not finite."""
        if not self._stale <= set(range(self._actions)):
            return False
        usual = vars(Effects(self._actions, self._delays))
        known = [self.effects] if self.others is None else [self.effects, self.others]
        return all(
            own.shape == usual[name].shape and bool((np.abs(own) <= largest).all())
            for effects in known
            for name, own in vars(effects).items()
        )

    def _of(self, numbers: dict[str, Any]) -> Effects:
        effects = Effects(self._actions, self._delays)
        for name, kept in numbers.items():
            setattr(effects, name, np.array(kept))
        return effects

    def _strayed(self) -> bool:
        """Whether the motion of the last second is other than foretold, by actions whose effects are known."""
        delay, k, c, known = self._foretold[0]
        second = self._steps[-SECOND:]
        in_force = [int(taken[delay]) for _, taken, _ in second]
        if any(a == self._actions or known[a] < self._tries for a in in_force):
            return False
        return self._error(second, delay, k, c) > self._limit

    def _error(self, steps: list[Step], delay: int, k: Array, c: Array) -> float:
        """Return the squared error, in deviations, of the distance and the turn foretold for these decisions."""
        d, bend = steps[0][0]
        distance = turn = 0.0
        for _, taken, (ahead, curvature) in steps:
            a = taken[delay]
            d, bend = k[0] * d + c[0, a], k[1] * bend + c[1, a]
            distance, turn = distance + d - ahead, turn + d * bend - ahead * curvature
        longest, sharpest = np.abs(steady(k, c)).max(axis=1)
        slip = self._slip * max(float(longest), 1e-9)
        return float(((distance / slip) ** 2 + (turn / (slip * max(float(sharpest), 1e-3))) ** 2) / len(steps))

    def _by(self, effects: Effects, steps: list[Step], like: Effects) -> float:
        """As `_error`, by these effects, with the delay of others."""
        delay = int(like.error.argmin())
        return self._error(steps, delay, effects.k[delay], effects.c[delay])

    def _change(self) -> None:
        """Go on by the effects of before the last change, or learn them anew."""
        before, now = self._copies[0], len(self._steps)
        self._before, self._soon, self._changed = before, now - self._changed < SOON, now
        if self._first is None and now > 2 * SECOND:
            self._first = before
        others, latest = self.others, self._steps[-LATEST:]
        if others is not None and self._by(others, latest, before) < 0.5 * self._by(before, latest, before):
            self._back = True
            self._take(others, before)
        else:
            self._back = False
            self._learn_anew(self._steps[-SECOND:], before, SECOND // 2)

    def _settle(self, before: Effects) -> None:
        """Decide again, by a second that is all from after the change."""
        self._before, self._foretold = None, []
        second = self._steps[-SECOND:]
        if self._by(before, second, before) <= self._limit:
            # it does not tell: what is known better stays
            if self._back:
                self.others = before
            else:
                self._take(before, before)
                self._learn(second, before)
                self._changed = LONG_AGO
        elif self.others is not None and self._by(self.others, second, before) <= self._limit:
            self._take(self.others, before)
            self._learn(second, before)
            self.others = before
        else:
            self._learn_anew(self._steps[-SECOND - 1 :], before, SECOND)
            if not self._soon:
                self.others = before
        self._copies = [deepcopy(self.effects)] * COPIES

    def _take(self, effects: Effects, before: Effects) -> None:
        """Go on by effects that are known; the delay stays as before."""
        self.effects = deepcopy(effects)
        self.effects.error = before.error.copy()
        self._stale, self._foretold = set(), []

    def _learn_anew(self, steps: list[Step], before: Effects, since: int) -> None:
        """Learn what actions do from these decisions; the others are stale."""
        self.effects = deepcopy(before)
        self.effects.sums *= FADED
        for delay in range(self._delays):
            for a in {int(taken[delay]) for _, taken, _ in steps}:
                self.effects.sums[delay, :, a] = 0.0
                self.effects.sums[delay, :, a, 3] = 1e-6
        self._learn(steps, before)
        delay = self.delay()
        self._stale = set(range(self._actions)) - {int(taken[delay]) for _, taken, _ in steps[-since:]}
        self._foretold = []

    def _learn(self, steps: list[Step], before: Effects) -> None:
        """Learn from these decisions; the delay stays as before."""
        for step in steps:
            self._add(step)
        self.effects.error = before.error.copy()

    def _add(self, step: Step) -> None:
        before, taken, after = step
        self.effects.learn(taken, (before[0], after[0]), (before[1], after[1]), self._forgets)
