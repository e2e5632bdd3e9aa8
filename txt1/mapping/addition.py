"""Mapping with a laser as an addition."""

from txt1.additions import Addition

ADDITION = Addition(name="mapping", wanted=lambda config: False)
