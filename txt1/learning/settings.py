"""The section ``learning`` of the configuration."""

from collections.abc import Collection, Sequence
from importlib.metadata import entry_points
from typing import Annotated, Any, ClassVar, Final, Literal, Self, TypeVar

from pydantic import Field, model_validator

from txt1.config.schema import Brought, OpenSection, Section
from txt1.errors import ConfigError
from txt1.model.vehicle import LEARNING_SPEED, Geometry
from txt1.units import NotNegative, Positive

# sharpest yaw rate at the learning robot's speed, rad/s: v / R = 0.3 / 0.56 = 0.536, which table 5.2 prints as 0.54
TURN: Final = LEARNING_SPEED / Geometry().radius_min

GROUP: Final = "txt1.learning"
"""Entry points by which packages bring keys to the section: each names the type of a key's value."""

OURS: Final = ("thesis", "locator", "options")
"""The sections of learners that are not brought."""

T = TypeVar("T")

# (v, omega) of one of the learner's actions, m/s and rad/s
Action = tuple[float, float]


def _names() -> Collection[str]:
    return entry_points(group=GROUP).names


def _kind(name: str) -> Any:
    for point in entry_points(group=GROUP, name=name):
        return point.load()
    return None


class ThesisConfig(Section):
    """The thesis's learner (thesis 5)."""

    period: Positive = 0.5
    """Time between two decisions, s."""
    remedy: Literal["none", "hold", "sensed"] = "sensed"
    """Remedy for the delay: update the commanded action; hold until it is reached; update the sensed action."""
    policy: Literal["boltzmann", "greedy", "random"] = "boltzmann"
    """How it chooses an action."""
    alpha: Annotated[float, Field(gt=0.0, le=1.0)] = 0.3
    """Learning rate."""
    rate: Literal["constant", "fading", "per_state"] = "constant"
    """How the learning rate changes: not at all, over episodes, or by visits of each state."""
    gamma: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.5
    """Discount factor."""
    temperature: Positive = 5.0
    """Temperature in the first episode."""
    temperature_decay: Annotated[float, Field(gt=0.0, le=1.0)] = 0.65
    """Factor of the temperature from an episode to the next."""
    temperature_floor: Positive = 0.05
    """Lowest temperature."""
    cooling: Literal["episodes", "decisions"] = "episodes"
    """Whether the temperature falls with episodes or with decisions."""
    filtered: bool = True
    """Whether the readings pass the filter (5.10)."""
    direction: Literal["summed", "diagonal", "corrected"] = "corrected"
    """How the readings make a direction: the thesis's sum (5.3) by the letter, with 45 degrees a sensor, or without
    compression (docs/results/thesis.md argues for the last)."""
    training: Annotated[int, Field(ge=0)] | None = None
    """Episodes after which it chooses greedily; null: never."""
    learn_on: bool = True
    """Whether it goes on learning when it chooses greedily."""

    @model_validator(mode="after")
    def _ends_with_training(self) -> Self:
        if not self.learn_on and self.training is None:
            raise ValueError("learn_on: it would have no effect, as it never ends its training; set training")
        return self


class LocatorConfig(Section):
    """The learner that fits the light's place (`txt1.learning.locator`)."""

    alarm: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.02
    """Probability that it doubts its model in an episode that is fine."""


class LearningConfig(OpenSection):
    """The learning task (thesis 5), and the learners' settings by their names."""

    brought: ClassVar[Brought] = Brought(GROUP, _names, _kind)

    actions: Annotated[tuple[Action, ...], Field(min_length=2)] = (
        (LEARNING_SPEED, -TURN),
        (LEARNING_SPEED, 0.0),
        (LEARNING_SPEED, TURN),
    )
    """(v, omega) of each action, m/s and rad/s; right, straight, left (table 5.2). The learners see their numbers."""
    delay: NotNegative = 0.0
    """Delay with which every action reaches the robot, s, as over a slow link."""
    start_radius: Positive = 1.25
    """Distance from the light at which an episode begins, m."""
    goal_radius: Positive = 0.5
    """Distance at which an episode has succeeded, m."""
    boundary: Positive = 8.0
    """An episode has failed when abs(x) or abs(y) is more, m; the simulated room is made large enough."""
    time_limit: Positive = 300.0
    """An episode has failed when it takes longer, s; not in the thesis."""
    goal_period: Positive | None = None
    """Time between two looks for the goal and the boundary, s; null: at the learner's decisions, as in the thesis."""
    pose: Annotated[str, Field(min_length=1)] = "truth"
    """Where the robot is, for goal and boundary: the simulation's truth, odometry from the start pose on, fused (by all
    sensors together), map (on the map that it drives in), or the name of a motion capture system among `sensors`."""
    world: Annotated[str, Field(min_length=1)] | None = None
    """The learner's world: composed (by world_options), or another package's; null: sim.light and odometry."""
    world_options: dict[str, Any] = {}
    """Its settings, handed to it as they are."""
    randomised: dict[str, tuple[float, float]] = {}
    """Ranges of numbers, by dotted key, that environments draw anew for each episode of a robot."""
    sensor: Annotated[str, Field(min_length=1)] = "light"
    """Name of the four light sensors; if it is not among `sensors`, a simulated robot gets simulated sensors."""
    thesis: ThesisConfig = ThesisConfig()
    locator: LocatorConfig = LocatorConfig()
    options: dict[str, Any] = {}
    """Settings of a learner from another package."""

    def part(self, name: str, usual: T) -> T:
        """Return the value of a key that a package brings, `usual` if it is not given."""
        found: T = (self.__pydantic_extra__ or {}).get(name, usual)
        return found


def section_of(learner: str) -> str:
    """Return the name of the section below `learning` that this learner reads."""
    return learner if learner in {*OURS, *_names()} else "options"


def settings_of(learning: LearningConfig, learner: str) -> dict[str, Any]:
    """Return the settings of a learner, JSON values, with those that are not given."""
    name = section_of(learner)
    known = {*LearningConfig.model_fields, *learning.given}
    whole = learning if name in known else LearningConfig.model_validate({name: {}})
    found: dict[str, Any] = whole.model_dump(mode="json")[name]
    return found


def refuse_unread(words: Sequence[str], learner: str) -> None:
    """Raise ConfigError if one of the words KEY=VALUE sets what this learner does not read."""
    others, own = {*OURS, *_names()}, section_of(learner)
    for word in words:
        key = word.partition("=")[0]
        section, _, rest = key.partition(".")
        name = rest.partition(".")[0]
        if section == "learning" and name in others and name != own:
            raise ConfigError(
                f"--set {key}: the learner '{learner}' does not read it, only learning.{own}; leave it out"
            )


def refuse_of_studies(learning: LearningConfig, learners: Collection[str]) -> None:
    """Raise ConfigError if a setting is given that a package brings and that none of these learners has."""
    for name in learning.given:
        if name not in learners:
            raise ConfigError(f"learning.{name}: no running robot reads it, only studies do; leave it out")
