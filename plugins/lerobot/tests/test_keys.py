"""The teleoperator without LeRobot."""

import pytest


@pytest.mark.usefixtures("lerobot")
def test_a_drive_begins_with_the_first_action(monkeypatch: pytest.MonkeyPatch) -> None:
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
