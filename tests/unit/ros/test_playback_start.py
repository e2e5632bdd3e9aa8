"""`txt1 replay --ros2` under a Python without ROS: the node itself is reached, and says what it lacks."""

from __future__ import annotations

import os
import sys

import pytest

from tests.golden.test_golden import FOLDER
from txt1.errors import HalError
from txt1.kernel.loop import run
from txt1.ros.playback import Playback, publish
from txt1.ros.python import RosPython


@pytest.mark.waits
def test_the_node_of_a_played_recording_is_started(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mcap")
    here = RosPython((sys.executable,), dict(os.environ), "here")

    async def play() -> None:
        await publish(Playback(FOLDER / "line.mcap", None, 1.0, None, False, print), here, "")

    with pytest.raises(HalError, match="the node of ROS 2 ended"):
        run(play())
    assert "No module named 'rclpy'" in capfd.readouterr().err
