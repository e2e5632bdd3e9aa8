"""AprilTags as an addition: a driver that gets its pictures from another sensor."""

from txt1.additions import Addition

ADDITION = Addition(
    name="tags",
    order=2,
    wanted=lambda config: any(each.driver == "apriltags" for each in config.sensors.values()),
    prepare="txt1.tags.sensor:prepare",
    parts={"txt1.sensors": {"apriltags": "txt1.tags.sensor:create"}},
)
