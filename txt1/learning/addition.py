"""Learning as an addition: the task on a robot, and the command for many trials."""

from txt1.additions import Addition

_OF_THE_THESIS = (
    "period", "remedy", "policy", "alpha", "rate", "gamma", "temperature", "temperature_decay", "temperature_floor",
    "filtered", "direction", "training", "learn_on",
)  # fmt: skip

ADDITION = Addition(
    name="learning",
    order=200,
    settings="txt1.learning.settings:LearningConfig",
    on_request=True,
    beside="txt1.learning.live_learner:beside",
    options="txt1.learning.options:OPTIONS",
    renamed={f"learning.{name}": f"learning.thesis.{name}" for name in _OF_THE_THESIS},
    commands={"learn": ("txt1.learning.command", "let the robot learn to find the light (thesis 5)")},
)
