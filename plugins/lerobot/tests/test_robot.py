"""The robot without LeRobot."""

from typing import Any

import pytest


@pytest.fixture
def robot(lerobot: None) -> Any:
    """A simulated robot for LeRobot, connected."""
    from lerobot_robot_txt1.config_txt1 import Txt1Config
    from lerobot_robot_txt1.txt1 import Txt1

    made = Txt1(Txt1Config(seed=1))
    made.connect()
    return made


@pytest.mark.parametrize(("v", "told"), [(0.0, 1), (0.3, 0)])
def test_actions_that_are_all_zero_are_told(
    robot: Any, v: float, told: int, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(5):
        robot.send_action({"x.vel": v, "theta.vel": 0.0})
    robot.disconnect()
    assert capsys.readouterr().err.count("all 5 actions were 0, so what was recorded is a robot that stands") == told
