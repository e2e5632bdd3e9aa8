"""Learning as an addition: the task beside a robot, and the command of many trials."""

from txt1.additions import Addition

ADDITION = Addition(
    name="learning",
    order=200,
    settings="txt1.learning.settings:LearningConfig",
    wanted=lambda config: False,
    beside="txt1.learning.beside:beside",
    options="txt1.learning.options:OPTIONS",
    commands={"learn": ("txt1.learning.command", "let the robot learn to find the light (thesis 5)")},
)
