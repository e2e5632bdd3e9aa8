"""The section ``physics`` as an addition; its models are entry points of their own."""

from txt1.additions import Addition

ADDITION = Addition(
    name="physics", settings="txt1_physics.settings:PhysicsSettings", prepare="txt1_physics.settings:prepare"
)
