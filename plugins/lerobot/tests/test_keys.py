"""The teleoperator without LeRobot, whose two classes stand here for themselves."""

import sys
from collections.abc import Callable
from types import ModuleType

import pytest


class TeleoperatorConfig:
    @classmethod
    def register_subclass(cls, name: str) -> Callable[[type], type]:
        return lambda kind: kind


class Teleoperator:
    def __init__(self, config: object) -> None:
        pass


def test_a_drive_begins_with_the_first_action(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("lerobot.teleoperators")
    module.__dict__.update(Teleoperator=Teleoperator, TeleoperatorConfig=TeleoperatorConfig)
    monkeypatch.setitem(sys.modules, "lerobot", ModuleType("lerobot"))
    monkeypatch.setitem(sys.modules, "lerobot.teleoperators", module)
    from lerobot_teleoperator_txt1 import keys

    now = 100.0
    monkeypatch.setattr("lerobot_teleoperator_txt1.keys.time.monotonic", lambda: now)
    teleoperator = keys.Txt1Keys(keys.Txt1KeysConfig(drive=[[2.0, 0.4, 0.3]]))
    teleoperator.connect()
    assert teleoperator.is_connected
    # a robot that takes long to open
    now = 110.0
    assert teleoperator.get_action() == {"x.vel": 0.4, "theta.vel": 0.3}
    now = 111.9
    assert teleoperator.get_action()["x.vel"] == 0.4
    now = 112.1
    assert teleoperator.get_action() == {"x.vel": 0.0, "theta.vel": 0.0}
    teleoperator.disconnect()
    assert not teleoperator.is_connected
