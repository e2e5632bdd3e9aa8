"""The roll-over guard as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="roll_guard",
    order=30,
    settings="txt1.guards.roll_guard.settings:RollGuard",
    prepare="txt1.guards.roll_guard.inputs:prepare",
)
