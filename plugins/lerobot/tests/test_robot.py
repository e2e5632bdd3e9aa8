"""The robot without LeRobot, whose classes stand here for themselves."""

import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest


class RobotConfig:
    @classmethod
    def register_subclass(cls, name: str) -> Callable[[type], type]:
        return lambda kind: kind


class Robot:
    def __init__(self, config: object) -> None:
        pass


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A simulated robot for LeRobot, connected."""
    modules = {
        name: ModuleType(name) for name in ("lerobot", "lerobot.robots", "lerobot.utils", "lerobot.utils.errors")
    }
    modules["lerobot.robots"].__dict__.update(Robot=Robot, RobotConfig=RobotConfig)
    errors = {name: type(name, (Exception,), {}) for name in ("DeviceAlreadyConnectedError", "DeviceNotConnectedError")}
    modules["lerobot.utils.errors"].__dict__.update(errors)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    for name in ("lerobot_robot_txt1", "lerobot_robot_txt1.txt1", "lerobot_robot_txt1.config_txt1"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    from lerobot_robot_txt1.config_txt1 import Txt1Config
    from lerobot_robot_txt1.txt1 import Txt1

    made = Txt1(Txt1Config(seed=1))
    made.connect()
    yield made
    for name in ("lerobot_robot_txt1", "lerobot_robot_txt1.txt1", "lerobot_robot_txt1.config_txt1"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(("v", "told"), [(0.0, 1), (0.3, 0)])
def test_actions_that_are_all_zero_are_told(
    robot: Any, v: float, told: int, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(5):
        robot.send_action({"x.vel": v, "theta.vel": 0.0})
    robot.disconnect()
    assert capsys.readouterr().err.count("all 5 actions were 0, so what was recorded is a robot that stands") == told
