"""A screen: which way the robot's nose points."""

from __future__ import annotations

from math import degrees

from rich.text import Text

from txt1.tasks.encoder import ODOMETRY
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.viewer import Viewer


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> Text:
    return Text(f"the nose points {degrees(snapshot[ODOMETRY].theta):.0f} degrees to the left")
