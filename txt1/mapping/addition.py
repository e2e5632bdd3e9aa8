"""Mapping with a laser as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="mapping",
    order=5,
    settings="txt1.mapping.settings:MappingConfig",
    watch="txt1.mapping.map_sensors:watch",
    prepare="txt1.mapping.map_sensors:prepare",
    options="txt1.mapping.options:OPTIONS",
    parts={
        "txt1.sensors": {"map": "txt1.mapping.map_sensors:create", "map_news": "txt1.mapping.map_sensors:create_news"}
    },
    commands={"map": ("txt1.mapping.command", "make a map of a room from a recorded drive with a laser")},
)
