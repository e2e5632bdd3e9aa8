"""The filter as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="estimation",
    order=10,
    settings="txt1.estimation.settings:EstimationConfig",
    prepare="txt1.estimation.task:prepare",
)
