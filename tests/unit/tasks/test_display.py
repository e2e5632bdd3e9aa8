"""The display task: what it publishes is what the others have written."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from txt1.control.limits import Fault, Gate, Outputs
from txt1.control.parameters import Limits
from txt1.control.pid import Gains
from txt1.kernel import Scheduler, run
from txt1.model.odometry import Odometry
from txt1.tasks import display
from txt1.tasks.fields import Command, Control, Encoders, GainTable, Panel, Power, Snapshot
from txt1.tasks.state import WRITERS, State


def test_every_field_of_the_snapshot_holds_what_its_name_says() -> None:
    async def main() -> tuple[Snapshot, State, dict[str, Any]]:
        state = State()
        state.command = Command(0.5, 0.1, 0.2, 3)
        state.gains = GainTable(Gains(1.0, 2.0, 3.0))
        state.power = Power(True, False)
        state.servos = 1, 2
        state.encoders = Encoders(5, 6)
        state.odometry = Odometry(1.0, 2.0, 0.3, 0.4, 0.5)
        state.pose = 2.0, 1.0, 0.6
        state.control = Control(Outputs(7, 8, 9), 0.7, 0.8)
        state.panel = Panel(screen=2)
        state.backlight = 0.25
        state.received, state.transmitted, state.odometry_time = 3, 4, -0.5
        gate = Gate(Limits(), on_close=lambda reason: None)
        gate.armed = True
        gate.count(Fault.STALE)
        given: dict[str, Any] = {
            "name": "mine",
            "room": (4.0, 3.0),
            "light": (1.0, 2.0),
            "reports": lambda: ("report",),
        }
        hal: Any = SimpleNamespace(capabilities="capabilities", indicate=lambda indicators: None)
        scheduler = Scheduler(lambda name, error: None)
        scheduler.add("display", 2, 0.1, lambda ticks: display.display(ticks, state, hal, gate=gate, **given))
        scheduler.start()
        scheduler.end_at(0.05)
        await scheduler.ended
        assert state.snapshot is not None
        return state.snapshot, state, given

    snapshot, state, given = run(main(), speed="max")
    for field in set(Snapshot._fields) & set(WRITERS):
        assert getattr(snapshot, field) == getattr(state, field), field
    assert (snapshot.time, snapshot.odometry_age) == (0.0, 0.5)
    assert (snapshot.hal, snapshot.capabilities) == ("mine", "capabilities")
    assert (snapshot.armed, snapshot.stopped, snapshot.reason) == (True, False, "not armed yet")
    assert snapshot.faults == {Fault.STALE.value: 1}
    assert (snapshot.room, snapshot.light) == (given["room"], given["light"])
    assert (snapshot.tasks, snapshot.events, snapshot.buzzer) == (("report",), (), True)
