"""A speed limit as an addition of another package: a section, an option, a command, a guard and a topic."""

from txt1.additions import Addition

ADDITION = Addition(
    name="speed_limit",
    order=50,
    settings="plugin_speed_limit:SpeedLimit",
    prepare="plugin_speed_limit:prepare",
    options="plugin_speed_limit:OPTIONS",
    commands={"limit": ("plugin_limit_command", "print the speed limit")},
)
