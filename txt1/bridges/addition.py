"""Bridges by name as an addition: those of other packages."""

from txt1.additions import Addition

ADDITION = Addition(
    name="bridges",
    order=120,
    wanted=lambda config: False,
    beside="txt1.bridges.beside:beside",
    options="txt1.bridges.options:OPTIONS",
)
