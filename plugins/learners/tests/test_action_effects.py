"""What the pilot knows of its actions, as they begin to do something else."""

import numpy as np
import pytest
from numpy.typing import NDArray

from txt1_learners.action_effects import SECOND, MotionModel, steady

# distance in a decision, m, and the share of distance and curvature that stays from one decision to the next
STEP, STAYS = 0.05, 0.7
# curvature that each of three actions leads to, 1/m
CURVATURES = np.array([-1.8, 0.0, 1.8])
# decisions after which the actions do something else, in each episode
MIDST = 30


class Car:
    """A car whose actions do what `curvatures` says, seen by odometry with noise of a share of its longest motion."""

    def __init__(self, seed: int, noise: float = 0.02) -> None:
        self.model = MotionModel(3, 2, slip=0.15, limit=27.6, tries=5, forgets=0.99)
        self._rng, self._noise = np.random.default_rng(seed), noise
        self.curvatures: NDArray[np.float64] = CURVATURES
        self.begin()

    def begin(self) -> None:
        self._pace, self._taken = (0.0, 0.0), [3, 3]
        self.model.begin()

    def drive(self, decisions: int, *actions: int) -> int | None:
        """Drive each action for five decisions in turn; return the decision at which the model said so."""
        said = None
        for n in range(decisions):
            a = actions[n // 5 % len(actions)]
            self._taken = [a, *self._taken[:-1]]
            d, bend = self._pace
            d = STAYS * d + (1.0 - STAYS) * STEP
            bend = STAYS * bend + (1.0 - STAYS) * self.curvatures[a]
            seen = 1.0 + self._noise * self._rng.standard_normal(2)
            after = float(d * seen[0]), float(bend * seen[1])
            if self.model.learn(self._pace, np.array(self._taken), after) and said is None:
                said = n
            self._pace = after
        return said

    def found(self) -> list[float]:
        """The curvatures that the model believes each action to lead to, 1/m."""
        delay = self.model.delay()
        curvatures: list[float] = steady(self.model.effects.k[delay], self.model.effects.c[delay])[1].tolist()
        return curvatures


@pytest.mark.parametrize("seed", range(5))
def test_actions_that_change_places_are_told_within_a_second_and_learned_in_two(seed: int) -> None:
    car = Car(seed)
    assert car.drive(90, 0, 1, 2) is None
    assert car.found() == pytest.approx(CURVATURES, abs=0.25)
    car.curvatures = CURVATURES[::-1]
    said = car.drive(2 * SECOND, 2)
    assert said is not None
    assert said <= SECOND
    # the other action's new effect is not known yet, but it is asked for
    assert car.found()[2] == pytest.approx(-1.8, abs=0.25)
    assert car.model.doubtful() == [0]
    car.drive(2 * SECOND, 0, 2)
    assert car.found() == pytest.approx([1.8, 0.0, -1.8], abs=0.25)


@pytest.mark.parametrize("seed", range(5))
def test_an_episode_begins_with_the_effects_that_the_last_one_began_with(seed: int) -> None:
    car = Car(seed)
    car.drive(90, 0, 1, 2)
    for _ in range(8):
        car.begin()
        car.curvatures = CURVATURES
        assert car.found() == pytest.approx(CURVATURES, abs=0.3)
        assert car.drive(MIDST, 0, 1, 2) is None
        car.curvatures = CURVATURES[::-1]
        car.drive(50, 2, 1, 0)
        assert car.found() == pytest.approx(CURVATURES[::-1], abs=0.3)
        car.model.end()


def test_what_was_known_before_is_taken_again_at_once() -> None:
    car = Car(1)
    car.drive(90, 0, 1, 2)
    for here in (CURVATURES[::-1], CURVATURES, CURVATURES[::-1]):
        car.curvatures = here
        car.drive(60, 2, 1, 0)
    car.curvatures = CURVATURES
    said = car.drive(SECOND, 2)
    assert said is not None
    # action 0 was not in force since
    assert car.found() == pytest.approx(CURVATURES, abs=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_odometry_is_no_change_of_the_actions(seed: int) -> None:
    assert Car(seed, noise=0.05).drive(3000, 0, 1, 2) is None


def test_a_change_for_good_at_the_start_of_an_episode_is_kept() -> None:
    car = Car(2)
    car.drive(90, 0, 1, 2)
    car.curvatures = CURVATURES[::-1]
    car.begin()
    assert car.drive(60, 0, 1, 2) is not None
    car.model.end()
    car.begin()
    assert car.drive(60, 0, 1, 2) is None


def test_what_is_remembered_holds_both_effects() -> None:
    car = Car(3)
    car.drive(90, 0, 1, 2)
    car.curvatures = CURVATURES[::-1]
    car.drive(60, 2, 1, 0)
    other = Car(4).model
    other.recall(car.model.memory())
    assert other.memory() == car.model.memory()
    assert other.others is not None
    assert other.sound(1e6)
    other.recall({**car.model.memory(), "stale": [3]})
    assert not other.sound(1e6)
    # actions that it would try, too
    car.curvatures = CURVATURES
    car.drive(2 * SECOND, 2)
    car.curvatures = np.array([0.9, 0.0, 0.9])
    car.drive(2 * SECOND, 2)
    other.recall(car.model.memory())
    assert car.model.memory()["stale"]
    assert other.memory() == car.model.memory()
    # one that was kept before there were two
    other.recall({"effects": car.model.memory()["effects"]})
    assert other.others is None


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e7])
@pytest.mark.parametrize("which", ["effects", "others"])
def test_numbers_out_of_range_are_not_sound(which: str, wrong: float) -> None:
    car = Car(3)
    car.drive(90, 0, 1, 2)
    car.curvatures = CURVATURES[::-1]
    car.drive(60, 2, 1, 0)
    memory = car.model.memory()
    memory[which]["k"][0][0] = wrong
    car.model.recall(memory)
    assert not car.model.sound(1e6)
