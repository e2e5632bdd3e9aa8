"""Exploring as an addition: a source of commands, which takes part when it is asked for."""

from txt1.additions import Addition

ADDITION = Addition(
    name="exploring",
    order=205,
    on_request=True,
    prepare="txt1.exploring.explorer:prepare",
    beside="txt1.exploring.explorer:beside",
    options="txt1.exploring.options:OPTIONS",
)
