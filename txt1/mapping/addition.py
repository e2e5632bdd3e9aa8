"""Mapping with a laser as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="mapping",
    wanted=lambda config: False,
    commands={"map": ("txt1.mapping.command", "make a map of a room from a recorded drive with a laser")},
)
