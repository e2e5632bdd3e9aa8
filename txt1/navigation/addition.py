"""Navigation as an addition: programs, routes and experiments call it."""

from txt1.additions import Addition

ADDITION = Addition(name="navigation")
