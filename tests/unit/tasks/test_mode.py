"""The mode task says why the link is lost."""

import pytest

from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.hal.base import BoardLink
from txt1.kernel.ticks import Ticks
from txt1.tasks.mode import mode
from txt1.tasks.state import State

RESTARTED = "the board restarted: its odometry jumped"


@pytest.mark.parametrize(
    ("ready", "reason", "told"),
    [(False, RESTARTED, RESTARTED), (False, "", "link lost"), (True, "", "link lost"), (True, RESTARTED, "link lost")],
)
def test_a_board_that_is_lost_in_the_instant_of_the_mode_task_is_named_as_the_cause(
    ready: bool, reason: str, told: str
) -> None:
    state, gate = State(), Gate(Limits(), on_close=lambda reason: None)
    task = mode(Ticks(1.0), state, gate)
    task.send(None)
    state.board, state.velocity_count = BoardLink(True, 0, "", "", {}), 20
    task.send(1.0)
    gate.arm(1.0)
    state.board = BoardLink(ready, 1, reason, "", {})
    task.send(2.0)
    task.close()
    assert (gate.armed, gate.reason, gate.closed_by) == (False, told, Fault.LINK)
