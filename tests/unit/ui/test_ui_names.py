"""Names of values are always whole, and faults are faults only."""

from __future__ import annotations

import re

import pytest
from ui_snapshots import full, mode

from txt1.tasks.diagnostics import FAULTS
from txt1.ui.terminal_process import drawn
from txt1.ui.viewer import Viewer

COLOUR = re.compile(r"\x1b\[[\d;]*m")
REASON = "blocked: a wall or an obstacle, or dead encoders"


@pytest.mark.parametrize(("width", "rows"), [(60, 20), (80, 24), (132, 40), (200, 50)])
def test_status_keeps_its_labels_beside_a_long_reason(width: int, rows: int) -> None:
    text = "\n".join(drawn(mode(full(), armed=False, reason=REASON), Viewer(), width, rows))
    text = COLOUR.sub("", text)
    for name in ("state", "link", "odometry", "mode", "driver", "command", "set-point", "power"):
        assert f" {name} " in text


def test_a_value_kept_within_its_limits_is_no_fault() -> None:
    text = "\n".join(drawn(full().replaced({FAULTS: {"motor_limited": 7, "link_lost": 2}}), Viewer(), 80, 24))
    assert "link_lost" in text
    assert "motor_limited" not in text
