"""Bridges by name, from other packages, as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="bridges",
    order=120,
    beside="txt1.bridges.named_bridges:beside",
    options="txt1.bridges.options:OPTIONS",
)
