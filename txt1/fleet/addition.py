"""Fleets as an addition: the option that lets a robot join a fleet, and the command for several robots."""

from txt1.additions import Addition

ADDITION = Addition(
    name="fleet",
    order=140,
    beside="txt1.fleet.membership:beside",
    options="txt1.fleet.options:OPTIONS",
    sources={"fleet": 30},
    commands={
        "fleet": ("txt1.fleet.command", "run several simulated robots in one world, or watch the robots of a network")
    },
    parts={
        "txt1.bridges": {"fleet": "txt1.fleet.bridge:main"},
        "txt1.screens": {"FLEET": "txt1.fleet.screen:screen"},
    },
)
