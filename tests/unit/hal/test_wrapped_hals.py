"""Hardware layers round another one: what they pass on, what they change, and what they note."""

from __future__ import annotations

from typing import Any

import pytest

from txt1.errors import NotCapable
from txt1.hal.base import Capabilities, Indicators, Inputs, Outputs
from txt1.hal.channels import Rewired, rewired
from txt1.hal.plain_hal import PlainHal
from txt1.hal.recorded_hal import CALLS, Witnessed, witnessed
from txt1.model.channels import STRAIGHT, Channel, Channels

DRIVE = Outputs(motor=1000, front=200, rear=-200, pwm4=7)


class Noting(PlainHal):
    """Notes what it is told, and reports what a test lets it report."""

    name = "noting"
    capabilities = Capabilities(pwm=True, ticks=True, odometry=True)

    def __init__(self) -> None:
        self.told: list[tuple[str, tuple[Any, ...]]] = []
        self.report = Inputs(ticks=(3, 5))
        self.broken = False
        self.colour = "red"

    def read(self, now: float) -> Inputs:
        self._note("read", now)
        return self.report

    def _note(self, call: str, *arguments: Any) -> None:
        if self.broken:
            raise ValueError(f"no {call}")
        self.told.append((call, arguments))

    def __getattribute__(self, name: str) -> Any:
        if name in CALLS:
            return lambda *arguments: self._note(name, *arguments)
        return super().__getattribute__(name)


# -- witnessed ---------------------------------------------------------------------------------------------------------


def noted() -> tuple[Noting, Any, list[tuple[str, str, Any]]]:
    """A layer, itself with a witness, and what that has noted."""
    hal, notes = Noting(), list[tuple[str, str, Any]]()
    return hal, witnessed(hal, lambda *note: notes.append(note)), notes


def test_a_witness_has_the_layer_s_name_and_abilities_and_passes_every_call_on() -> None:
    hal, seen, _ = noted()
    assert isinstance(seen, Witnessed)
    assert (seen.name, seen.capabilities, seen.colour) == ("noting", hal.capabilities, "red")
    for call in CALLS:
        getattr(seen, call)(call, 2.5)
    assert hal.told == [(call, (call, 2.5)) for call in CALLS]


def test_a_report_is_noted_once_however_often_it_is_read() -> None:
    hal, seen, notes = noted()
    first, again, other = Inputs(ticks=(3, 5)), Inputs(ticks=(3, 5)), Inputs(ticks=(4, 5))
    for hal.report in (first, first, again, other, other, first):
        assert seen.read(0.02) is hal.report
    assert notes == [("read", "", first), ("read", "", other), ("read", "", first)]


@pytest.mark.parametrize("call", ["read", *CALLS])
def test_an_error_of_the_layer_is_noted_and_raised(call: str) -> None:
    hal, seen, notes = noted()
    hal.broken = True
    with pytest.raises(ValueError, match=f"no {call}"):
        getattr(seen, call)(0.02)
    assert notes == [(call, f"no {call}", None)]


# -- behind the vehicle's channels -------------------------------------------------------------------------------------

BACKWARDS = Channels(motor=Channel(direction=-1), right_encoder=-1)


def test_outputs_are_converted_to_the_wiring_in_every_call_that_has_some() -> None:
    hal = Noting()
    put = rewired(hal, BACKWARDS, False)
    put.write(DRIVE, 0.1)
    put.halt(DRIVE, 0.2)
    turned = DRIVE._replace(motor=-1000)
    assert hal.told == [("write", (turned, 0.1)), ("halt", (turned, 0.2))]
    assert (put.name, put.colour) == ("noting", "red")  # type: ignore[attr-defined]


@pytest.mark.parametrize("unseen", [False, True])
def test_encoders_are_corrected_and_hidden_while_their_signs_are_unknown(unseen: bool) -> None:
    put = Rewired(Noting(), BACKWARDS, False, unseen) if unseen else Rewired(Noting(), BACKWARDS, False)
    can = put.capabilities
    assert (can.ticks, can.odometry, can.pwm) == (not unseen, not unseen, True)
    assert put.counts is None, "before the first reading"
    assert put.read(0.0).ticks == (None if unseen else (-3, 5))
    assert put.counts == (-3, 5)


def test_a_layer_is_left_as_it_is_where_nothing_has_to_be_converted() -> None:
    hal = Noting()
    assert rewired(hal, STRAIGHT, False) is hal
    assert rewired(hal, STRAIGHT, False, unseen=True) is not hal
    put = rewired(hal, BACKWARDS, False)
    assert rewired(put, BACKWARDS, False) is put, "once is enough"
    board = Noting()
    board.capabilities = Capabilities(odometry=True)
    assert rewired(board, BACKWARDS, False) is board, "a board knows its own wiring"


# -- plain -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "arguments"),
    [
        ("halt", (DRIVE, 0.0)),
        ("switch", (0, True, 0.0)),
        ("load_gains", (None, None)),
        ("offer_odometry", (None, 0.0)),
        ("place", (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_a_plain_layer_refuses_what_it_has_not(call: str, arguments: tuple[Any, ...]) -> None:
    with pytest.raises(NotCapable):
        getattr(PlainHal(), call)(*arguments)
    PlainHal().indicate(Indicators())  # no harm: there is no buzzer
