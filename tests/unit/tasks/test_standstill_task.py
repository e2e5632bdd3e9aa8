"""The watch of stops, step by step: what it sees, what it tells and when, and which means it takes."""

from __future__ import annotations

import asyncio
from math import inf
from types import SimpleNamespace
from typing import Any

import pytest

from txt1.control.limits import Fault, Gate
from txt1.control.parameters import Limits
from txt1.control.standstill import Stop
from txt1.errors import HalError
from txt1.hal.base import BoardLink, Capabilities, Inputs, Outputs
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import Odometry
from txt1.protocol.messages import Switch
from txt1.tasks.fields import Battery, BatteryState, Control, Power
from txt1.tasks.standstill import Watch, reason_not_to_switch, sees, settle, stands, standstill
from txt1.tasks.state import State

READY = BoardLink(ready=True, losses=0, reason="", text="the board answers", faults={}, gains=True, connected=True)
PWM_TEST = "the robot does not stop: a PWM test of zeros follows"
ESC_OFF = "the robot does not stop: the ESC is switched off"
PUSHED = "the robot moves without a command (pushed, carried, or manual mode): a PWM test of zeros follows"
STANDS = "the robot stands"
FELL = "the speed fell faster than it can: a wall, wheels that spun, or encoders without power; look at the robot"
TOO_SOON = "the ESC came back before the board's loops were cleared: it is switched off"
SLOWS = "the car slows down under a constant command: zeros until its board has settled"


class Car:
    """An armed car at the end of a line: a test says what is measured, and what is commanded."""

    def __init__(self, board: BoardLink | None = READY, power: bool = True) -> None:
        self.halts: list[tuple[float, Outputs]] = []
        self.cleared: list[float] = []
        self.switched: list[tuple[Switch, bool, float]] = []
        can = Capabilities(halt=True, power=power)
        hal: Any = SimpleNamespace(
            capabilities=can,
            halt=lambda outputs, now: self.halts.append((now, outputs)),
            clear_loops=self.cleared.append,
        )
        self.state = State(can=can)
        self.state.board = board
        self.state.gains = self.state.gains._replace(loaded=True)
        self.gate = Gate(Limits(), on_close=lambda reason: None)
        self.gate.arm(0.0)
        self.watch = Watch(self.state, hal, self.gate, 0.4, lambda *given: self.switched.append(given))
        self.now = 0.0

    def step(self, v: float | None, asked: float = 0.0, omega: float = 0.0, period: float = 0.05) -> Stop:
        """A step with odometry of this instant; without any if v is None."""
        self.now = round(self.now + period, 6)
        if v is not None:
            self.state.odometry, self.state.odometry_time = Odometry(v=v, omega=omega), self.now
        return self.watch.step(self.now, Outputs(v=asked))

    def goes(self, duration: float, v: float | None, asked: float = 0.0, period: float = 0.05) -> Stop:
        """Steps for so long, s."""
        for _ in range(round(duration / period)):
            stop = self.step(v, asked, period=period)
        return stop

    @property
    def told(self) -> list[tuple[float, str]]:
        return [(event.time, event.text) for event in self.state.events]

    def tells(self, text: str) -> int:
        """How often it has told this."""
        return [each for _, each in self.told].count(text)

    @property
    def halted(self) -> list[float]:
        """When it has sent PWM tests of zeros."""
        return [time for time, _ in self.halts]


# -- what it sees ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("v", "omega", "seen"),
    [
        (0.0, 0.0, Stop.STANDING),
        (0.0, 0.2, Stop.STANDING),
        (0.02, 0.2, Stop.NONE),
        (0.06, 0.1, Stop.NONE),
        (0.06, -0.3, Stop.UNASKED),
        (-0.06, 0.3, Stop.UNASKED),
        (0.0, 1.0, Stop.UNASKED),
        (0.2, 0.0, Stop.UNASKED),
    ],
)
def test_a_car_of_which_one_wheel_turns_does_not_stand(v: float, omega: float, seen: Stop) -> None:
    car = Car()
    car.gate.disarm("by hand")
    for _ in range(30):
        stop = car.step(v, omega=omega)
    assert stop is seen
    assert car.watch.standstill.stands(car.now) == (seen is Stop.STANDING)
    assert [text for _, text in car.told] == [PUSHED] * (seen is Stop.UNASKED)
    assert car.halted[:1] == [time for time, _ in car.told]


@pytest.mark.parametrize("asked", [Outputs(motor=1), Outputs(v=-0.2), Outputs(omega=0.1)])
def test_each_output_that_moves_it_is_a_command(asked: Outputs) -> None:
    car = Car()
    car.goes(0.5, 0.0)
    assert car.watch.step(car.now, asked) is Stop.NONE
    assert not car.watch.settled and car.watch.step(car.now, Outputs(front=100, pwm4=100)) is Stop.SLOWING


@pytest.mark.parametrize(
    ("since", "now", "atx", "known"),
    [
        (1.0, 1.29, True, True),
        (1.0, 1.29, None, True),
        (1.0, 1.29, False, False),
        (1.0, 1.31, True, False),
        (0.0, 0.1, True, False),
        (0.1, 0.1, True, True),
    ],
)
def test_a_speed_is_known_if_it_is_recent_and_its_encoders_have_power(
    since: float, now: float, atx: bool | None, known: bool
) -> None:
    state = State()
    state.power, state.odometry_time = Power(atx), since
    assert sees(state, now) == known


def test_without_a_watch_it_stands_when_its_encoders_were_still_for_0_3_s() -> None:
    state = State()
    state.odometry_time, state.moved_time = 1.3, 1.0
    assert stands(state, None, 1.4) and not stands(state, None, 1.7)
    state.moved_time = 1.02
    assert not stands(state, None, 1.4)


def test_a_car_whose_odometry_is_old_is_not_standing_any_more() -> None:
    car = Car()
    assert car.goes(1.0, 0.0) is Stop.STANDING and stands(car.state, car.watch, car.now)
    assert car.goes(0.25, None) is Stop.STANDING
    assert car.goes(0.1, None) is Stop.UNSEEN and not stands(car.state, car.watch, car.now)
    # nobody drives it: its loops have nothing to drive against, and there is nothing to tell
    assert car.told == [] and car.cleared == []


# -- a stop that is not obeyed -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("power", [True, False])
def test_a_stop_not_obeyed_takes_a_pwm_test_after_half_a_second_and_then_the_esc(power: bool) -> None:
    car = Car(power=power)
    car.state.servos = 300, -300
    car.goes(1.0, 0.5, asked=0.5)
    assert car.goes(0.5, 0.5) is Stop.SLOWING and car.gate.reason == "" and car.halts == []
    assert car.step(0.5) is Stop.PWM_ZEROS
    assert not car.gate.armed and car.gate.closed_by is Fault.STOP_UNOBEYED
    assert car.goes(0.45, 0.5) is Stop.PWM_ZEROS and car.switched == []
    assert car.step(0.5) is Stop.ESC_OFF
    assert car.switched == ([(Switch.ESC, False, 2.05)] if power else [])
    assert car.goes(0.3, 0.0) is Stop.ESC_OFF
    assert car.halted == [1.55, 1.65, 1.75, 1.85, 1.95, 2.05, 2.15, 2.25, 2.35], "ten times a second"
    assert not any(any(outputs[:3]) or outputs.v or outputs.omega for _, outputs in car.halts)
    assert car.goes(1.0, 0.0) is Stop.STANDING and len(car.halts) == 9
    assert car.told == [(1.55, PWM_TEST), (2.05, ESC_OFF), (2.4, STANDS)]
    assert len(car.switched) == power


def test_a_robot_not_seen_to_stop_has_failed_to_and_is_said_not_to_be_seen() -> None:
    car = Car()
    car.goes(1.0, 0.5, asked=0.5)
    assert car.goes(1.2, None) is Stop.ESC_OFF
    blind = " (not seen: no odometry)"
    assert [text for _, text in car.told] == [PWM_TEST + blind, ESC_OFF + blind]


def test_while_nothing_can_be_sent_a_stop_that_is_not_seen_has_more_time() -> None:
    car = Car(board=READY._replace(connected=False))
    car.goes(1.0, 0.5, asked=0.5)
    assert car.goes(5.0, None) is Stop.SLOWING
    car.state.board = READY
    assert car.goes(0.4, None) is Stop.SLOWING and car.goes(0.1, None) is Stop.PWM_ZEROS
    without = Car(board=None)
    without.goes(1.0, 0.5, asked=0.5)
    assert without.goes(0.6, None) is Stop.PWM_ZEROS, "where there is no line, none is cut"


def test_a_car_that_is_pushed_gets_pwm_tests_is_told_of_and_keeps_its_esc() -> None:
    car = Car()
    car.goes(1.0, 0.0)
    car.gate.disarm("by hand")
    car.goes(1.0, 0.3)
    car.goes(1.0, 0.0)
    assert [text for _, text in car.told] == [PUSHED, STANDS]
    assert len(car.halts) > 5 and car.switched == [] and car.gate.counts[Fault.STOP_UNOBEYED] == 0


def test_a_car_that_is_commanded_again_and_stops_by_zeros_is_told_of_by_nothing() -> None:
    car = Car()
    for _ in range(3):
        car.goes(0.5, 0.05, asked=0.05)
        assert car.goes(0.5, 0.0) is Stop.STANDING
    assert car.told == [] and car.halts == [] and car.gate.armed


@pytest.mark.parametrize(
    ("failed", "trouble"),
    [
        (0.0, ""),
        (0.6, "the robot did not stop when told to; it took a PWM test of zeros; is"),
        (1.2, "the robot did not stop when told to; it took switching the ESC off; is"),
    ],
)
def test_a_stop_that_took_more_than_zeros_is_reported_at_the_end(failed: float, trouble: str) -> None:
    car = Car()
    assert car.watch.trouble == "", "it has not driven"
    car.goes(1.0, 0.5, asked=0.5)
    car.step(0.5)
    assert car.watch.trouble == "the robot was not seen to stand (slowing down): look at it"
    if failed:
        car.goes(failed, 0.5)
    car.goes(0.5, 0.0)
    assert car.watch.settled and (car.watch.trouble.startswith(trouble) if trouble else car.watch.trouble == "")


def test_the_report_says_whether_it_was_seen_and_not_that_it_stood() -> None:
    car = Car()
    car.goes(1.0, 0.5, asked=0.5)
    car.goes(0.6, None)
    unseen = ", and this was not seen: there was no odometry"
    assert car.watch.trouble == (
        f"the robot was not seen to stand (does not stop: PWM test of zeros{unseen}): look at it"
    )
    car.goes(0.5, 0.0)
    assert car.watch.trouble.startswith(
        f"the robot did not stop when told to; it took a PWM test of zeros{unseen}; is the board"
    )


def test_a_robot_that_stood_before_it_fell_silent_has_stopped() -> None:
    car = Car()
    car.goes(1.0, 0.5, asked=0.5)
    car.goes(0.5, 0.0)
    assert car.goes(0.5, None) is Stop.UNSEEN and car.watch.settled and car.watch.trouble == ""


# -- a robot that is not seen any more ---------------------------------------------------------------------------------


def falls(car: Car) -> float:
    """A drive, a stop, and a speed that falls faster than brakes can."""
    car.goes(1.0, 1.0, asked=1.0)
    car.state.fell_time = car.now + 0.05
    car.step(0.0)
    return car.now


def test_a_speed_that_falls_too_fast_is_told_clears_the_loops_and_is_no_standing() -> None:
    car = Car()
    falls(car)
    assert car.goes(1.0, 0.0) is Stop.UNSEEN and not car.watch.settled
    assert car.told == [(1.35, FELL)] and car.cleared == [1.35]
    assert car.watch.trouble == "the robot was not seen to stand (not seen): look at it"
    # power for the encoders ends it
    car.state.atx_time = car.now
    assert car.goes(1.0, 0.0) is Stop.STANDING and car.watch.settled


@pytest.mark.parametrize("power", [True, False])
@pytest.mark.parametrize("way_back", ["motion", "the ATX supply"])
def test_a_car_lost_sight_of_gets_the_strongest_stop_and_is_never_called_standing(way_back: str, power: bool) -> None:
    car = Car(power=power)
    car.goes(1.0, 1.0, asked=1.0)
    car.watch.lose_sight(car.now)
    assert car.switched == ([(Switch.ESC, False, 1.0)] if power else []) and car.cleared == [1.0]
    assert car.goes(3.0, 0.0) is Stop.UNSEEN and not car.watch.settled
    if way_back == "motion":
        car.step(0.04)
    else:
        car.state.atx_time = car.now
    assert car.goes(0.5, 0.0) is Stop.STANDING and car.watch.settled


# -- a car that does not move ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("asked", "limit"), [(0.1, 0.92), (0.6, 0.47), (-0.6, 0.47), (1.0, 0.39)])
def test_it_is_disarmed_when_it_may_have_gone_0_3_m_with_dead_encoders(asked: float, limit: float) -> None:
    car = Car()
    car.goes(1.0, 0.0)
    car.step(0.02, asked)
    began = car.now
    while car.gate.armed and car.now < began + 2.0:
        car.step(0.02, asked, period=0.01)
    assert car.now - began == pytest.approx(limit, abs=0.011)
    assert car.gate.closed_by is Fault.UNMOVED and car.gate.reason.startswith("commanded and not moving: ESC off,")
    assert car.cleared == [car.now]


@pytest.mark.parametrize("state", [None, *BatteryState])
def test_a_battery_that_is_low_is_named_among_the_causes(state: BatteryState | None) -> None:
    car = Car()
    car.state.battery = Battery(state=state)
    car.goes(1.0, 0.0, asked=0.6)
    low = state in (BatteryState.WARNING, BatteryState.BAD)
    assert car.gate.reason.startswith(f"commanded and not moving: {'battery empty, ' if low else ''}ESC off")


@pytest.mark.parametrize(
    "why", ["slow", "moves", "moves back", "not seen", "no gains", "no board", "board silent", "board's gains"]
)
def test_a_car_that_need_not_move_or_moves_is_not_disarmed(why: str) -> None:
    board = {
        "no board": None,
        "board silent": READY._replace(ready=False),
        "board's gains": READY._replace(gains=False),
    }
    car = Car(board=board.get(why, READY))
    car.state.gains = car.state.gains._replace(loaded=why != "no gains")
    v = {"moves": 0.03, "moves back": -0.03, "not seen": None}.get(why, 0.0)
    car.goes(3.0, v, asked=0.09 if why == "slow" else 0.6)
    assert car.gate.armed and car.cleared == []


@pytest.mark.parametrize("event", ["turns", "moves", "rests", "armed anew", "board away"])
def test_it_has_the_same_time_again_after_a_motion_or_another_command(event: str) -> None:
    car = Car()
    car.goes(0.4, 0.0, asked=0.6)
    asked = -0.6 if event == "turns" else 0.6
    if event == "armed anew":
        car.gate.disarm("by hand")
        car.gate.arm(car.now)
    elif event == "board away":
        car.state.board = READY._replace(ready=False)
        car.step(0.0, asked)
        car.state.board = READY
    elif event != "turns":
        car.step(0.2 if event == "moves" else 0.0, 0.0 if event == "rests" else asked)
    car.goes(0.4, 0.0, asked)
    assert car.gate.armed
    car.goes(0.2, 0.0, asked)
    assert car.gate.closed_by is Fault.UNMOVED


def test_a_closed_gate_is_not_closed_again_by_a_car_that_does_not_move() -> None:
    car = Car()
    car.gate.disarm("by hand")
    car.goes(2.0, 0.0, asked=0.6)
    assert car.gate.reason == "by hand" and car.cleared == []


@pytest.mark.parametrize(
    ("later", "v", "power", "armed", "goes_off"),
    [
        (0.1, 0.13, True, False, True),
        (3.2, 0.13, True, False, True),
        (3.5, 0.13, True, False, False),
        (0.1, 0.05, True, False, False),
        (0.1, None, True, False, False),
        (0.1, 0.13, False, False, False),
        (0.1, 0.13, True, True, False),
    ],
)
def test_an_esc_that_comes_back_while_the_loops_are_full_goes_off_once(
    later: float, v: float | None, power: bool, armed: bool, goes_off: bool
) -> None:
    car = Car(power=power)
    while car.gate.armed:
        car.step(0.0, asked=0.6)
    car.goes(later - 0.05, 0.0)
    if v is None:
        car.state.odometry_time = -inf
    if armed:
        car.gate.arm(car.now)
    car.goes(0.15, v)
    assert car.tells(TOO_SOON) == goes_off
    assert [each[:2] for each in car.switched] == [(Switch.ESC, False)] * goes_off


# -- a board that stops obeying for a moment ---------------------------------------------------------------------------


def slows(car: Car, v: float = 0.2) -> None:
    """A car that had reached its command, and falls below half of it."""
    car.goes(1.0, 0.6, asked=0.6)
    car.step(0.4, asked=0.6)
    car.step(0.35, asked=0.6)
    car.goes(0.3, v, asked=0.6)


@pytest.mark.parametrize("board", [READY, None])
def test_a_car_that_slows_under_its_command_gets_zeros_until_its_board_has_settled(
    board: BoardLink | None,
) -> None:
    car = Car(board)
    slows(car)
    assert car.gate.held and car.gate.armed and car.tells(SLOWS) == 1
    held = next(time for time, text in car.told if text == SLOWS)
    while car.gate.held and car.now < 10.0:
        car.step(0.0)
    assert car.now - held == pytest.approx(1.2, abs=0.051) and car.now - held >= 1.2 - 1e-6
    assert car.told[-1] == (car.now, "the board has settled")


def test_a_car_that_does_not_stand_is_held_for_longer() -> None:
    car = Car()
    slows(car)
    car.goes(0.4, 0.08)
    car.goes(2.0, 0.06)
    assert car.gate.held
    car.goes(0.4, 0.0)
    assert not car.gate.held


@pytest.mark.parametrize("why", ["board away", "not seen yet", "armed anew"])
def test_a_car_that_may_slow_down_is_not_held(why: str) -> None:
    car = Car()
    car.goes(1.0, 0.6, asked=0.6)
    car.step(0.4, asked=0.6)
    car.step(0.35, asked=0.6)
    if why == "board away":
        car.state.board = READY._replace(ready=False)
    elif why == "not seen yet":
        car.gate.sight.turns(0.6, 0.05)
        assert not car.gate.sight.lost(0.6, 0.01) and car.gate.sight.unseen
    else:
        car.gate.disarm("by hand")
        car.step(0.3)
        car.gate.arm(car.now)
    car.goes(0.5, 0.2, asked=0.6)
    assert not car.gate.held
    # it has to reach its command again
    car.state.board = READY
    car.gate.sight.clear()
    car.goes(0.3, 0.2, asked=0.6)
    assert car.gate.held == (why == "not seen yet")


def test_a_speed_that_was_not_known_for_a_while_has_to_reach_its_command_anew() -> None:
    car = Car()
    car.goes(1.0, 0.6, asked=0.6)
    car.goes(0.5, None, asked=0.6)
    car.goes(0.5, 0.2, asked=0.6)
    assert not car.gate.held


# -- switches ----------------------------------------------------------------------------------------------------------

ESC, ATX = Switch.ESC, Switch.ATX


@pytest.mark.parametrize(
    ("switch", "on", "armed", "atx", "stop", "still", "can", "told"),
    [
        (ESC, True, False, True, Stop.STANDING, True, {}, None),
        (ESC, True, False, None, Stop.UNSEEN, False, {}, None),
        (ESC, True, True, True, Stop.STANDING, True, {}, "only while the robot is disarmed: disarm first"),
        (ESC, True, False, False, Stop.STANDING, True, {}, "without the ATX supply the encoders see nothing"),
        (ESC, True, False, True, Stop.PWM_ZEROS, False, {}, "the robot did not stop when told to"),
        (ESC, True, False, True, Stop.ESC_OFF, False, {}, "the robot did not stop when told to"),
        (ESC, True, True, False, Stop.ESC_OFF, False, {"power_known": True}, None),
        (ESC, False, True, False, Stop.ESC_OFF, False, {}, None),
        (ATX, True, True, False, Stop.ESC_OFF, False, {}, None),
        (ATX, False, True, False, Stop.ESC_OFF, False, {}, None),
        (ATX, False, False, True, Stop.ESC_OFF, True, {}, None),
        (ATX, False, False, None, Stop.STANDING, True, {}, None),
        (ATX, False, True, True, Stop.STANDING, True, {}, "it stays on: disarm first"),
        (ATX, False, False, True, Stop.STANDING, True, {"pwm": True}, "switch it off at the robot"),
        (ATX, False, False, True, Stop.UNSEEN, False, {}, "until they have seen the robot stand"),
    ],
)
def test_why_a_supply_is_not_switched(
    switch: Switch,
    on: bool,
    armed: bool,
    atx: bool | None,
    stop: Stop,
    still: bool,
    can: dict[str, bool],
    told: str | None,
) -> None:
    car = Car()
    car.state.power, car.watch.standstill.stop = Power(atx), stop
    if not armed:
        car.gate.disarm("by hand")
    abilities = Capabilities(power=True, **can)
    reason = reason_not_to_switch(switch, on, car.state, abilities, car.gate, car.watch, still)
    assert (reason is None) if told is None else (reason is not None and told in reason)
    if stop not in (Stop.PWM_ZEROS, Stop.ESC_OFF):
        assert reason_not_to_switch(switch, on, car.state, abilities, car.gate, None, still) == reason


# -- the task, and the end of a run ------------------------------------------------------------------------------------


def test_the_task_judges_the_outputs_of_the_last_cycle() -> None:
    car = Car()
    ticks = Ticks(0.05)
    task = standstill(ticks, car.watch)
    task.send(None)
    judged = []
    for now, v in ((0.05, 0.5), (0.1, 0.0)):
        car.state.control = Control(Outputs(v=v))
        task.send(now)
        judged.append(car.watch.standstill.stop)
    task.close()
    assert judged == [Stop.NONE, Stop.SLOWING]


@pytest.mark.parametrize(
    ("speed", "drove", "fails", "ends", "stop"),
    [
        (0.0, False, False, 0.0, Stop.NONE),
        (0.0, True, False, 0.35, Stop.STANDING),
        (0.5, True, False, 3.0, Stop.ESC_OFF),
        (0.0, True, True, 0.05, Stop.NONE),
    ],
)
def test_the_end_of_a_run_waits_until_it_stands_for_three_seconds_at_most(
    speed: float, drove: bool, fails: bool, ends: float, stop: Stop
) -> None:
    car = Car()
    if drove:
        car.goes(1.0, speed, asked=0.5)
    car.gate.disarm("the run has ended")
    before, written = car.now, []

    def read(now: float) -> Inputs:
        if fails:
            raise HalError("the line is gone")
        return Inputs(odometry=Odometry(v=speed), odometry_time=now, link=READY)

    io: Any = SimpleNamespace(read=read, write=lambda outputs, now: written.append((outputs, now)))

    async def main() -> float:
        loop = asyncio.get_running_loop()
        began = loop.time()
        await settle(car.watch, io, lambda: before + loop.time() - began)
        return loop.time() - began

    assert run(main(), speed="max") == pytest.approx(ends, abs=0.011)
    assert car.watch.standstill.stop is stop
    assert len(written) == (0 if fails else round(ends / 0.05))
    assert {outputs for outputs, _ in written} <= {Outputs()}, "a line may have lost the first"
