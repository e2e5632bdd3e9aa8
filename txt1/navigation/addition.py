"""Navigation as an addition: programs, routes and experiments call it."""

from txt1.additions import Addition

ADDITION = Addition(
    name="navigation",
    order=6,
    wanted=lambda config: "mapping" in config.given,
    prepare="txt1.navigation.ways:ready",
)
