"""What the guards take for granted, as the manual tells it."""

from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.guards.roll_guard.settings import RollGuard


def test_the_guards_keep_the_distances_and_times_that_the_manual_tells() -> None:
    assert ObstacleStop() == ObstacleStop(
        enabled="auto", sensor="", margin=0.08, reaction=0.15, deceleration=1.0, people=0.0, reverse=0.3, timeout=0.5
    )
    assert RollGuard() == RollGuard(
        enabled=False, sensor="imu", gravity_height=0.15, roll_gradient=0.0, share=0.75, memory=3.0
    )
