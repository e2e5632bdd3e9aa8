"""A speed limit as an addition of another package: a guard, what shows it, and whatever asks for it."""

from txt1.additions import Addition

ADDITION = Addition(
    name="speed_limit",
    order=50,
    settings="plugin_speed_limit:SpeedLimit",
    prepare="plugin_speed_limit:prepare",
    options="plugin_speed_limit:OPTIONS",
    parts={
        "txt1.screens": {"LIMIT": "plugin_limit_screen:screen"},
        "txt1.bridges": {"limited": "plugin_limit_bridge:main"},
    },
    commands={"limit": ("plugin_limit_command", "print the speed limit")},
)
