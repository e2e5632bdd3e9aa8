"""The line of the serial HAL: what is lost on it, a board that is gone or starts again, and opening it anew."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from itertools import pairwise

import pytest
from serial_desk import DRIVE, GAINS, HALF, ORIGIN, STANDING, ZERO, Desk

from txt1.errors import HalError
from txt1.hal.base import Outputs
from txt1.model.odometry import Odometry
from txt1.protocol.decoder import FrameFault
from txt1.protocol.layout import encode
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)

# -- a line that loses something ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [b"\xfa\xfb\x04\x70", bytes([*encode(STANDING)[:-1], 0])])
def test_after_a_damaged_frame_velocity_goes_out_at_every_tick_for_5_s(desk: Desk, noise: bytes) -> None:
    desk.do(lambda: desk.hal.line.received(noise))
    desk.runs(6.0)
    steps = [(since, round(until - since, 6)) for since, until in pairwise(desk.times(Velocity, since=2.0))]
    assert {step for since, step in steps if since < 6.97} == {0.02}
    assert {step for since, step in steps if since > 7.0} == {0.04, 0.06}
    assert sum(desk.link.faults.values()) == 1


def test_an_old_command_is_counted_and_says_nothing_about_the_line(desk: Desk) -> None:
    desk.do(lambda: desk.hal.line.received(bytes([0xFA, 0xFB, 24, 0x6B])))
    desk.runs(0.5)
    assert len(desk.times(Velocity, since=2.0)) == 10
    assert desk.link.faults["line_old_command"] == 1


@pytest.mark.parametrize("missing, late", [(0, 0), (1, 1), (3, 3), (7, 7)])
def test_odometry_that_is_late_means_that_frames_were_lost(desk: Desk, missing: int, late: int) -> None:
    desk.says = None
    desk.runs(0.05 * missing)
    desk.says = STANDING
    desk.runs(1.0)
    assert desk.link.faults["line_late_odometry"] == late
    assert desk.link.losses == 0
    assert len(desk.times(Velocity, since=desk.now - 0.5)) == (25 if missing else 10)


# -- the board is gone, comes back, starts again -----------------------------------------------------------------------


def test_a_board_that_is_silent_for_0_45_s_is_lost(desk: Desk) -> None:
    desk.says = None
    desk.runs(0.39, DRIVE)  # the last odometry came at 1.95
    assert desk.link[:4] == (True, 0, "", "the board answers on desk")
    desk.runs(0.03, DRIVE)
    assert desk.link[:4] == (False, 1, "link lost: no odometry for 0.45 s", "link lost: no odometry for 0.45 s")
    assert desk.link.connected
    desk.runs(2.0, DRIVE)
    assert desk.link.losses == 1
    assert {message for _, message in desk.heard(Velocity, since=2.42)} == {ZERO}, "it is told to stop nevertheless"
    desk.says = STANDING
    desk.runs(1.0, DRIVE)
    assert desk.link[:3] == (False, 1, "link lost: no odometry for 0.45 s")
    assert desk.link.text == "the board answers on desk"
    desk.runs(0.4, DRIVE)
    assert desk.link.ready
    assert desk.sent[-1][1] == HALF


def test_a_host_held_up_notices_by_the_next_odometry_that_the_board_was_lost(desk: Desk) -> None:
    for pause, losses in ((0.35, 0), (0.5, 1)):  # since the last odometry: 50 ms more than the pause
        desk.says = None
        desk.runs(pause, held_up=True)
        desk.says = STANDING
        assert desk.runs(1.0).link.losses == losses
    assert desk.link.reason == "link lost: no odometry for 0.55 s"
    assert desk.link.faults["line_late_odometry"] == 7


@pytest.mark.parametrize("pause, lost", [(0.1, False), (0.15, False), (0.2, True), (0.35, True)])
def test_a_pause_and_then_the_pose_of_power_up_may_be_a_restart(
    make: Callable[..., Desk], pause: float, lost: bool
) -> None:
    desk = make()
    desk.says = ORIGIN
    desk.runs(2.0)
    desk.says = None
    desk.runs(pause)
    desk.says = ORIGIN
    desk.runs(0.1)
    assert desk.link.losses == lost
    if lost:
        assert desk.link.reason == f"the board paused for {pause + 0.05:.2f} s, and may have restarted"


def test_a_pause_at_a_pose_away_from_the_origin_is_no_restart(desk: Desk) -> None:
    desk.says = None
    desk.runs(0.35)
    desk.says = STANDING
    assert desk.runs(0.1).link.losses == 0


def test_a_pose_that_no_motion_leads_to_is_a_restart_and_the_odometry_begins_anew(make: Callable[..., Desk]) -> None:
    desk = make(scale=1.25).runs(2.0)
    desk.says = EncoderOdometry(0.02, 0.0, 0.0, 0.0, 0.0)
    desk.runs(0.1, DRIVE)
    assert desk.link[:3] == (False, 1, "the board restarted: its odometry jumped")
    assert desk.inputs.odometry == Odometry(0.02, 0.0, 0.0), "not what it was before, and on from there"
    assert desk.sent[-1][1] == ZERO
    assert desk.runs(1.2).link.ready


@pytest.mark.parametrize("levels, restarted", [((12.0, 11.0), 0), ((4.8, 4.4), 1), ((4.8, 11.0), 0), ((7.2, 6.6), 0)])
def test_a_battery_filter_that_starts_again_is_a_restart(
    desk: Desk, levels: tuple[float, float], restarted: int
) -> None:
    desk.tells(BatteryLevels(12.0, 11.0))
    desk.tells(BatteryLevels(*levels))
    assert desk.link.losses == restarted
    if restarted:
        assert desk.link.reason == "the board restarted: its battery filter started again"
        desk.runs(0.1)
        desk.tells(BatteryLevels(9.12, 8.36))
        desk.tells(BatteryLevels(12.0, 11.0))
        assert desk.link.losses == 1
    assert desk.runs(0.02).inputs.batteries is not None


def test_after_the_board_was_lost_its_first_battery_levels_are_compared_with_nothing(desk: Desk) -> None:
    desk.tells(BatteryLevels(12.0, 11.0))
    desk.says = None
    desk.runs(1.0)
    desk.says = STANDING
    desk.runs(0.1)
    desk.tells(BatteryLevels(4.8, 4.4))
    assert desk.link.losses == 1


def test_a_mistake_in_the_program_reaches_who_reads(desk: Desk) -> None:
    def mistaken(accepted: bool) -> None:
        raise TypeError("oops")

    desk.hal.load_gains(GAINS, mistaken)
    desk.runs(0.1)
    desk.tells(PidResponse(True))
    with pytest.raises(HalError, match="the link to desk failed: TypeError"):
        desk.hal.read(desk.now)


# -- the line itself ---------------------------------------------------------------------------------------------------


def test_a_line_that_is_cut_is_opened_again_with_longer_and_longer_pauses(desk: Desk) -> None:
    desk.trouble = HalError("unplugged")
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    assert desk.link[:4] == (False, 1, "link lost: cut", "link lost: cut")
    assert not desk.link.connected
    assert desk.link.faults["reconnects"] == 0
    desk.runs(5.0)
    assert desk.link.text == "unplugged"
    steps = [round(later - earlier, 6) for earlier, later in pairwise([2.0, *desk.opened[1:]])]
    assert steps == [0.1, 0.2, 0.4, 0.8, 0.9, 0.9, 0.9]
    assert not desk.times(Velocity, since=2.0)
    desk.trouble = None
    desk.runs(1.0)
    assert desk.link[:3] == (False, 1, "link lost: cut")
    assert desk.link.connected
    assert desk.link.faults["reconnects"] == 1
    desk.runs(1.0)
    assert desk.link.ready
    desk.trouble = HalError("unplugged")
    again = desk.now
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.runs(0.2)
    assert desk.opened[-1] == pytest.approx(again + 0.1), "a board that answered is called soon"


def test_a_line_that_comes_and_goes_without_a_word_is_called_less_and_less_often(make: Callable[..., Desk]) -> None:
    desk = make()
    desk.says = None
    for _ in range(5):
        desk.do(lambda: desk.hal.line.watched.lost("hung up"))
        desk.runs(0.95)
    steps = [round(at - k * 0.95, 6) for k, at in enumerate(desk.opened[1:])]
    assert steps == [0.1, 0.2, 0.4, 0.8, 0.9]
    assert desk.link[:3] == (False, 0, ""), "a board that was never heard was not lost"
    assert desk.link.faults["reconnects"] == 5


def test_a_line_that_is_lost_twice_is_opened_once(desk: Desk) -> None:
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.runs(1.0)
    assert len(desk.opened) == 2
    assert desk.link.losses == 1


def test_a_fresh_line_is_told_at_once_all_that_holds(desk: Desk) -> None:
    desk.loads()
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    held = Outputs(pwm4=1)
    desk.runs(0.5, held)
    desk.do(lambda: desk.hal.line.received(encode(STANDING)[:10]))  # a half frame is the old line's
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.says = None
    desk.runs(0.12, held)
    fresh = {type(message) for time, message in desk.sent if time >= 2.5}
    assert fresh == {Velocity, PwmCommand, PowerControl, PidSet}
    desk.says = STANDING
    desk.runs(0.1, held)
    assert desk.link.text == "the board answers on desk"
    told = {"line_expired": 1, "line_late_odometry": 3, "reconnects": 1}
    assert {name: count for name, count in desk.link.faults.items() if count} == told


def test_a_board_that_is_found_again_is_told_at_once_all_that_holds(desk: Desk) -> None:
    held = Outputs(pwm4=1)
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    desk.runs(0.02, held)
    desk.says = None
    desk.runs(0.78, held)
    desk.tells(STANDING)
    desk.runs(0.02, held)
    assert {type(message) for time, message in desk.sent if time >= 2.8} >= {PwmCommand, PowerControl}


def test_another_error_than_the_port_s_own_ends_the_run(desk: Desk) -> None:
    desk.trouble = ZeroDivisionError("oops")
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    with pytest.raises(HalError, match="the link to desk failed: ZeroDivisionError"):
        desk.runs(0.5)


def test_a_write_on_a_lost_line_sends_nothing(desk: Desk) -> None:
    wire = desk.hal.line.link
    assert wire is not None
    wire.overflows = 3
    wire.shut()
    desk.runs(0.1, DRIVE)
    assert not desk.link.connected
    assert desk.link.faults["line_overflows"] == 3
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.runs(1.0)
    assert desk.link.connected
    assert desk.hal.line.link is not None
    desk.hal.line.link.overflows = 2
    assert desk.link.faults["line_overflows"] == 5


def test_the_board_is_left_with_three_stops_and_its_servos_where_they_are(desk: Desk) -> None:
    desk.runs(0.5, Outputs(pwm4=1000, pwm5=5, v=0.5))
    desk.do(desk.hal.close())
    assert desk.heard(Velocity, since=2.5) == [(pytest.approx(2.5 + 0.05 * k), ZERO) for k in range(3)]
    assert (desk.ports_closed, desk.let_go) == (1, 1)
    assert desk.hal.line.link is None
    assert desk.link[1:4] == (1, "closed", "closed")
    desk.do(desk.hal.close())
    assert (desk.ports_closed, len(desk.heard(Velocity, since=2.5))) == (1, 3), "and once"
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.do(asyncio.sleep(3.0))
    assert len(desk.opened) == 1


def test_a_host_that_closes_the_loops_leaves_the_servos_where_they_are(make: Callable[..., Desk]) -> None:
    desk = make(control="host").runs(2.0, Outputs(1000, 1, -1, 30, 40))
    desk.do(desk.hal.close())
    assert [message for _, message in desk.heard(PwmTest)[-3:]] == [PwmTest(0, 0, 0, 30, 40)] * 3


INSIDE = b"\xfa\xfb\x14\x68" + encode(BatteryLevels(12.0, 11.0))  # whole, in what may be half of a longer frame


def test_of_a_line_that_is_gone_nothing_is_heard_any_more(desk: Desk) -> None:
    desk.do(lambda: desk.hal.line.received(INSIDE))
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.says = None
    assert desk.runs(0.5).inputs.batteries is None
    desk.loop.call_later(0.14, desk.hal.line.received, INSIDE)  # between the last stop and the end
    desk.do(desk.hal.close())
    assert desk.runs(0.5).inputs.batteries is None


def test_closed_before_it_was_opened_there_is_nothing_to_do() -> None:
    desk = Desk()
    desk.do(desk.hal.close())
    assert (desk.ports_closed, desk.sent) == (0, [])
    desk.loop.close()


def test_closed_it_looks_for_the_line_no_more(desk: Desk) -> None:
    desk.trouble = HalError("unplugged")
    desk.do(lambda: desk.hal.line.watched.lost("cut"))
    desk.runs(0.5)
    tries = len(desk.opened)
    desk.do(desk.hal.close())
    desk.do(asyncio.sleep(3.0))
    assert len(desk.opened) == tries


def test_a_port_that_does_not_open_is_let_go_of(make: Callable[..., Desk]) -> None:
    desk = Desk()
    desk.trouble = HalError("no such device")
    with pytest.raises(HalError, match="no such device"):
        desk.opens()
    assert desk.ports_closed == 1
    desk.do(desk.hal.close())
    assert desk.ports_closed == 1
    desk.loop.close()


def test_opened_again_it_begins_anew(desk: Desk) -> None:
    desk.runs(0.1, DRIVE)
    desk.do(lambda: desk.hal.offer_odometry(CombinedOdometry(0.0, 0.0, 0.0, 0.0, 0.0), desk.now))
    desk.do(desk.hal.close())
    desk.do(asyncio.sleep(0.85))
    desk.ms = 0
    desk.sent.clear()
    desk.do(desk.hal.open())
    desk.do(lambda: desk.hal.offer_odometry(CombinedOdometry(0.0, 0.0, 0.0, 0.0, 0.0), 0.0))
    assert len(desk.sent) == 1
    desk.runs(1.5)
    assert len(desk.heard(Velocity)) == 30
    assert desk.inputs.odometry_time == pytest.approx(1.45)
    assert desk.link.ready
    assert not isinstance(desk.hal.read(desk.now), FrameFault)
