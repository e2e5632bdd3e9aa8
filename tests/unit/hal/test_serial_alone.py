"""The serial HAL alone, tick by tick: what it can do, and when it sends set-points, servos and switches."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from serial_desk import DRIVE, GAINS, HALF, STANDING, ZERO, Desk

from txt1.errors import EncodeError, HalError, NotCapable
from txt1.hal.base import Outputs
from txt1.link.base import End
from txt1.model.odometry import Odometry
from txt1.protocol.layout import encode
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)

# -- what it can do, and what it says of the line ----------------------------------------------------------------------


def test_a_board_closes_the_loops_unless_the_host_does(make: Callable[..., Desk]) -> None:
    for control in ("board", "host"):
        can = make(control=control).hal.capabilities
        assert can.pwm is (control == "host")
        assert can.gains is can.combined is (control == "board")
        assert all((can.odometry, can.battery, can.smoothed, can.power, can.servos, can.halt))
        assert not any((can.ticks, can.power_known, can.buttons, can.place, can.pose, can.simulated))
    assert make(simulated=True).hal.capabilities.simulated


def test_what_it_cannot_do_is_refused_by_name(make: Callable[..., Desk]) -> None:
    host = make(control="host").hal
    with pytest.raises(NotCapable, match="gains"):
        host.load_gains(GAINS, lambda accepted: None)
    with pytest.raises(NotCapable, match="combined"):
        host.offer_odometry(CombinedOdometry(0.0, 0.0, 0.0, 0.0, 0.0), 0.0)
    with pytest.raises(NotCapable, match="place"):
        host.place(0.0, 0.0, 0.0, 0.0)


def test_what_the_board_said_comes_with_the_times_at_which_it_came(make: Callable[..., Desk]) -> None:
    desk = make()
    desk.says = None
    before = desk.runs(0.1, held_up=True).runs(0.02).inputs
    assert (before.odometry, before.odometry_time, before.batteries, before.battery_time) == (None, 0.0, None, 0.0)
    desk.tells(BatteryLevels(12.0, 11.0))
    desk.runs(0.03)
    desk.tells(EncoderOdometry(1.0, 2.0, 6.0, 0.5, -0.25))
    after = desk.runs(0.05).inputs
    assert (after.batteries, after.battery_time) == ((12.0, 11.0), 0.12)
    assert after.odometry == Odometry(1.0, 2.0, pytest.approx(6.0 - 6.283185307), 0.5, -0.25)
    assert after.odometry_time == 0.15


def test_the_state_of_the_line_is_told_from_its_first_instant(make: Callable[..., Desk]) -> None:
    fresh = Desk()
    assert fresh.link[:4] == (False, 0, "", "connecting to desk")
    assert fresh.link[5:] == (True, False)
    fresh.loop.close()
    desk = make()
    assert desk.link[:4] == (False, 0, "", "connected to desk, waiting for odometry")
    assert desk.link.connected
    assert {**dict.fromkeys(desk.link.faults, 0)} == desk.link.faults
    assert {"line_late_odometry", "line_not_encodable", "line_overflows", "reconnects", "line_bad_checksum"} <= set(
        desk.link.faults
    )
    desk.runs(0.1)
    assert desk.link[:4] == (False, 0, "", "the board answers on desk")


def test_the_report_is_the_same_object_while_nothing_happens(desk: Desk) -> None:
    first = desk.link
    assert desk.runs(1.0).link is first


def test_all_bytes_are_known_to_who_taps_the_line(make: Callable[..., Desk]) -> None:
    desk, tapped = make(), []
    desk.hal.tap_line(lambda direction, data: tapped.append((direction, data)))
    desk.runs(0.02)
    assert tapped == [("in", encode(STANDING)), ("out", encode(ZERO))]


def test_a_wrapper_stands_between_the_line_and_the_hal(make: Callable[..., Desk]) -> None:
    ends: list[End] = []

    def wrap(end: End) -> End:
        ends.append(end)
        return end

    desk = make(wrap=wrap)
    assert ends == [desk.hal.line.watched]


# -- set-points --------------------------------------------------------------------------------------------------------


def test_velocity_goes_out_20_times_a_second_from_the_first_tick(make: Callable[..., Desk]) -> None:
    desk = make().runs(1.0)
    assert desk.times(Velocity)[:6] == [0.0, 0.06, 0.1, 0.16, 0.2, 0.26]
    assert len(desk.times(Velocity)) == 20


def test_after_a_pause_of_the_host_nothing_is_made_up_for(desk: Desk) -> None:
    desk.runs(0.3, held_up=True).runs(0.2)
    assert desk.times(Velocity, since=2.0) == pytest.approx([2.3, 2.36, 2.4, 2.46])


def test_a_message_that_a_late_tick_missed_follows_it(make: Callable[..., Desk]) -> None:
    desk = make().runs(0.02).runs(0.08, held_up=True).runs(0.2)
    assert desk.times(Velocity) == [0.0, 0.1, 0.12, 0.16, 0.2, 0.26]


def test_no_set_point_goes_out_before_the_board_has_been_heard_for_1_2_s(make: Callable[..., Desk]) -> None:
    desk = make().runs(1.18, DRIVE)
    assert {message for _, message in desk.heard(Velocity)} == {ZERO}
    assert not desk.link.ready
    desk.runs(0.1, DRIVE)
    assert desk.link.ready
    assert desk.heard(Velocity, since=1.18)[0] == (1.2, HALF)


@pytest.mark.parametrize("moving", [DRIVE, Outputs(v=-0.1), Outputs(omega=0.1)])
def test_a_stop_goes_out_in_its_tick_and_once(desk: Desk, moving: Outputs) -> None:
    desk.runs(0.12, moving)
    desk.runs(0.1)
    assert [time for time, message in desk.heard(Velocity, since=2.12) if message == ZERO] == [2.12, 2.16, 2.2]
    desk.runs(0.1)
    assert desk.times(Velocity, since=2.22) == pytest.approx([2.26, 2.3])


def test_a_host_that_closes_the_loops_sends_counts_and_a_sign_of_life(make: Callable[..., Desk]) -> None:
    desk = make(control="host")
    driven = Outputs(1000, 200, -200, 30, 40, 0.5, 0.25)
    desk.runs(1.18, driven)
    assert {message for _, message in desk.heard(PwmTest, Velocity)} == {ZERO, PwmTest(0, 0, 0, 30, 40)}
    desk.runs(0.1, driven)
    assert [message for _, message in desk.heard(PwmTest, Velocity)[-2:]] == [ZERO, PwmTest(1000, 200, -200, 30, 40)]
    desk.runs(0.02, Outputs(motor=1000))
    stopped = desk.runs(0.02, Outputs(front=200)).heard(PwmTest)[-1]
    assert stopped == (1.3, PwmTest(0, 200, 0, 0, 0)), "the motor's stop, in its tick"


def test_a_board_that_reads_low_is_asked_for_less(make: Callable[..., Desk]) -> None:
    desk = make(scale=1.25).runs(1.3, DRIVE)
    assert desk.heard(Velocity)[-1][1] == Velocity(0.4, 0.2)


def test_a_halt_is_a_pwm_test_of_zeros_that_leaves_the_servos_where_they_are(desk: Desk) -> None:
    desk.do(lambda: desk.hal.halt(Outputs(1000, 200, -200, 30, 40, 0.5, 0.25), desk.now))
    assert desk.sent[-1][1] == PwmTest(0, 0, 0, 30, 40)


# -- servos, switches, combined odometry -------------------------------------------------------------------------------


def test_servos_go_out_when_they_move_and_once_a_second_from_then_on(desk: Desk) -> None:
    assert desk.times(PwmCommand, PowerControl) == []
    desk.runs(0.04)
    desk.runs(2.5, Outputs(pwm4=1000, pwm5=-2000))
    assert desk.heard(PwmCommand) == [(time, PwmCommand(1000, -2000)) for time in (2.04, 3.04, 4.04)]
    desk.runs(1.1, Outputs(pwm4=1000, pwm5=-2001, v=0.5))
    assert desk.heard(PwmCommand)[3:] == [(time, PwmCommand(1000, -2001)) for time in (4.54, 5.54)]


def test_esc_off_goes_out_at_once_and_once_a_second_until_it_is_to_be_on(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    desk.runs(2.5)
    off = PowerControl(Switch.ESC, False)
    assert desk.heard(PowerControl) == [(time, off) for time in (2.0, 2.0, 3.0, 4.0)]
    assert {message for _, message in desk.heard(Velocity)} == {ZERO}
    assert desk.runs(0.1, DRIVE).sent[-1][1] == HALF, "what it is told to do goes out as ever"


@pytest.mark.parametrize("on", [False, True])
def test_the_atx_supply_is_switched_once_and_at_once(desk: Desk, on: bool) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ATX, on, desk.now))
    assert desk.runs(3.0, DRIVE).heard(PowerControl) == [(2.0, PowerControl(Switch.ATX, on))]
    assert desk.times(Velocity, since=2.0)[:3] == [2.0, 2.06, 2.1]


def test_the_esc_comes_on_after_silence_and_zeros_and_the_board_waits(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    assert desk.link.text == "the ESC comes on in 3.2 s, when the board's loops are cleared"
    desk.runs(3.24, DRIVE)
    assert not desk.link.ready
    assert desk.times(Velocity, since=2.0)[0] == pytest.approx(4.2)
    assert len(desk.times(Velocity, since=4.2)) == pytest.approx(21, abs=1)
    assert len(desk.times(PwmTest, since=2.0)) == pytest.approx(110, abs=1), "with each cycle of the silence"
    assert desk.times(PwmTest)[-1] < 4.2, "and with none after it"
    assert {message for _, message in desk.heard(Velocity, since=2.0)} == {ZERO}
    assert len(desk.heard(PowerControl)) == 1
    desk.runs(0.1, DRIVE)
    assert desk.heard(PowerControl)[1:] == [(5.26, PowerControl(Switch.ESC, True))]
    assert desk.link.ready
    assert desk.link.text == "the ESC is being switched on"
    assert desk.sent[-1][1] == HALF
    desk.runs(3.0, DRIVE)
    assert len(desk.heard(PowerControl)) == 2, "it is told so once"


def test_an_esc_that_is_to_be_off_after_all_does_not_come_on(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.runs(1.0)
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    desk.runs(5.0)
    assert {message for _, message in desk.heard(PowerControl)} == {PowerControl(Switch.ESC, False)}
    assert desk.times(Velocity, since=2.0)[0] == pytest.approx(4.2), "but the board's loops are cleared"
    assert desk.link.text == "the silence that clears the board's loops is over"


def test_loops_are_cleared_by_zeros_then_silence_then_zeros(desk: Desk) -> None:
    desk.runs(1.0, DRIVE)
    desk.do(lambda: desk.hal.clear_loops(desk.now))
    assert desk.link.text == "silence clears the board's loops; that takes 3.4 s"
    desk.runs(3.38, DRIVE)
    times = desk.times(Velocity, since=3.0)
    assert {message for _, message in desk.heard(Velocity, since=3.0)} == {ZERO}, "whatever it is told to do"
    last = max(time for time in times if time < 4.0)
    assert len([time for time in times if time <= last]) == 3, "so that one of them may be lost"
    assert (last, min(time for time in times if time > last)) == (3.1, 5.36)
    assert not desk.link.ready
    desk.runs(0.1, DRIVE)
    assert (desk.link.ready, desk.link.text) == (True, "the silence that clears the board's loops is over")
    assert desk.sent[-1][1] == HALF
    assert not desk.heard(PowerControl), "no switch is touched"


def test_what_stops_a_board_goes_out_while_its_loops_are_cleared(desk: Desk) -> None:
    desk.do(lambda: desk.hal.clear_loops(desk.now))
    desk.runs(1.0)
    desk.do(lambda: desk.hal.halt(Outputs(), desk.now))
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    assert [message for _, message in desk.sent[-2:]] == [PwmTest(0, 0, 0, 0, 0), PowerControl(Switch.ESC, False)]
    assert not desk.times(Velocity, since=2.2)


def test_an_esc_that_is_off_is_told_so_with_each_pwm_test_of_zeros(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    for _ in range(5):
        desk.do(lambda: desk.hal.halt(Outputs(), desk.now))
    off = PowerControl(Switch.ESC, False)
    assert [message for _, message in desk.sent[-10:]] == [PwmTest(0, 0, 0, 0, 0), off] * 5


def test_an_esc_asked_for_while_loops_are_cleared_gets_a_silence_of_its_own(desk: Desk) -> None:
    desk.do(lambda: desk.hal.clear_loops(desk.now))
    desk.runs(1.0)
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.runs(4.0)
    assert desk.heard(PowerControl) == [(6.26, PowerControl(Switch.ESC, True))]
    assert min(desk.times(Velocity, since=3.0)) == pytest.approx(5.2)


def test_the_last_zeros_before_the_silence_go_out_whatever_the_line_does(desk: Desk) -> None:
    desk.runs(1.0, DRIVE)
    desk.says = None
    desk.runs(0.3, DRIVE)
    desk.do(lambda: desk.hal.clear_loops(desk.now))
    desk.tells(STANDING)
    desk.runs(0.1, DRIVE)
    assert [message for _, message in desk.heard(Velocity)][-1] == ZERO


def test_only_a_board_in_manual_mode_that_was_moved_by_hand_is_sent_pwm_counts(make: Callable[..., Desk]) -> None:
    hand, zeros = Outputs(motor=500, front=3), Outputs()
    desk = make(by_hand=True)
    assert desk.hal.capabilities.by_hand and not make().hal.capabilities.by_hand
    desk.runs(2.0, zeros)
    assert not desk.heard(PwmTest), "nobody has moved it"
    for outputs, counts in (
        (hand, [(500, 3)]),
        (zeros, [(0, 0)]),
        (DRIVE, []),
        (zeros, []),
        (hand, [(500, 3)]),
        (Outputs(v=0.5), []),
        (zeros, []),
    ):
        since = desk.loop.time()
        desk.runs(0.2, outputs)
        sent = desk.heard(Velocity, PwmTest)[-1][1]
        assert isinstance(sent, PwmTest) is bool(counts), outputs
        if isinstance(sent, PwmTest):
            assert [(sent.motor, sent.front)] == counts
        assert desk.loop.time() > since
    plain = make()
    plain.runs(2.0, zeros).runs(0.2, hand)
    assert not plain.heard(PwmTest), "whose user did not ask for it"


def test_an_esc_that_was_switched_on_is_not_switched_on_again_when_loops_are_cleared(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.runs(4.0)
    desk.do(lambda: desk.hal.clear_loops(desk.now))
    desk.runs(4.0)
    assert desk.heard(PowerControl) == [(5.26, PowerControl(Switch.ESC, True))]


def test_loops_at_the_hosts_end_need_no_silence(make: Callable[..., Desk]) -> None:
    desk = make(control="host").runs(2.0)
    desk.do(lambda: desk.hal.clear_loops(desk.now))
    desk.runs(3.0, Outputs(motor=1000))
    assert len(desk.times(Velocity, since=2.0)) == 60 and desk.link.ready


def test_the_esc_comes_on_only_after_a_silence_that_no_line_has_broken(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.trouble = HalError("no")
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.runs(4.0)
    assert desk.link.text == "no"
    desk.trouble = None
    desk.runs(5.0, DRIVE)
    assert desk.sent[-1][1] == HALF
    (came,) = (time for time, message in desk.heard(PowerControl) if message == PowerControl(Switch.ESC, True))
    assert came - desk.opened[-1] >= 3.2


@pytest.mark.parametrize(
    ("begins", "pauses", "comes"),
    [(0.5, 0.3, 4.06), (0.5, 0.1, 3.26), (1.0, 0.3, 3.26), (1.9, 1.0, 3.26), (1.5, 3.0, 7.76)],
)
def test_zeros_that_a_stalled_line_may_keep_for_later_make_the_silence_begin_again(
    desk: Desk, begins: float, pauses: float, comes: float
) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.runs(begins)
    desk.says = None
    desk.runs(pauses)
    desk.says = STANDING
    desk.runs(5.0)
    (came,) = (time for time, message in desk.heard(PowerControl) if message == PowerControl(Switch.ESC, True))
    assert came - 2.0 == pytest.approx(comes, abs=0.06)


def test_combined_odometry_goes_out_50_times_a_second_at_most(desk: Desk) -> None:
    combined = CombinedOdometry(1.0, 2.0, 0.5, 0.25, 0.125)
    for step in range(30):  # every 10 ms
        desk.do(lambda step=step: desk.hal.offer_odometry(combined, 2.0 + 0.01 * step))
    assert [message for _, message in desk.heard(CombinedOdometry)] == [combined] * 15


def test_no_combined_odometry_goes_out_while_a_board_s_loops_are_cleared(desk: Desk) -> None:
    combined = CombinedOdometry(0.0, 0.0, 0.0, 0.045, 0.0)
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    while not desk.heard(PowerControl):
        desk.do(lambda: desk.hal.offer_odometry(combined, desk.now))
        desk.runs(0.02)
    assert not desk.heard(CombinedOdometry), "the loops would wind up by the last one, and the ESC come on"
    desk.do(lambda: desk.hal.offer_odometry(combined, desk.now))
    assert len(desk.heard(CombinedOdometry)) == 1


def test_combined_odometry_outside_the_world_is_refused_and_counted(desk: Desk) -> None:
    before = desk.link
    desk.do(lambda: desk.hal.offer_odometry(CombinedOdometry(3e6, 0.0, 0.0, 0.0, 0.0), 2.0))
    assert desk.link.faults["line_not_encodable"] == before.faults["line_not_encodable"] + 1
    assert not desk.heard(CombinedOdometry)


def test_gains_that_do_not_fit_are_refused(desk: Desk) -> None:
    with pytest.raises(EncodeError):
        desk.hal.load_gains(PidSet((1e9, 0.0, 0.0), ()), lambda accepted: None)
