"""The obstacle stop as an addition; it takes part by itself if there are sensors."""

from txt1.additions import Addition

ADDITION = Addition(
    name="obstacle_stop",
    order=20,
    settings="txt1.guards.obstacle_stop.settings:ObstacleStop",
    wanted=lambda config: bool(config.sensors) or "obstacle_stop" in config.given,
    prepare="txt1.guards.obstacle_stop.guard:prepare",
)
