"""The serial HAL alone, tick by tick: at the other end of its line is a board that says what a test lets it say."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest

from txt1.errors import EncodeError, HalError, NotCapable
from txt1.hal.base import BoardLink, Inputs, Outputs
from txt1.hal.serial import SerialHal
from txt1.kernel.loop import VirtualTimeLoop
from txt1.link.base import End, Link
from txt1.model.odometry import Odometry
from txt1.protocol.decoder import Decoder, FrameFault
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    HostMessage,
    Message,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)

TICK, ODOMETRY = 20, 50  # ms between two steps of the host, and between two messages of the board
NEUTRAL, DRIVE = Outputs(), Outputs(v=0.5, omega=0.25)
ZERO, HALF = Velocity(0.0, 0.0), Velocity(0.5, 0.25)
GAINS = PidSet((1.0, 2.0, 3.0), ((1.5, 4.0, 5.0, 6.0),))
OTHERS = PidSet((1.0, 2.0, 4.0), ((1.5, 4.0, 5.0, 6.0),))
STANDING = EncoderOdometry(1.0, 2.0, 0.5, 0.0, 0.0)
ORIGIN = EncoderOdometry(0.0, 0.0, 0.0, 0.0, 0.0)
BEFORE = 0.3  # s of the loop before the run


class Wire(Link):
    """The line: what the host sends is read at once."""

    desk: Desk

    def _send(self, data: bytes) -> None:
        self.desk.hears(data)

    def _let_go(self) -> None:
        self.desk.let_go += 1


class Desk:
    """A serial HAL, its port, and the board: `says` None keeps silent."""

    address = "desk"

    def __init__(self, wrap: Callable[[End], End] | None = None, **options: Any) -> None:
        self.loop = VirtualTimeLoop()
        self.ms = 0  # of the run
        self.says: Message | None = STANDING
        self.sent: list[tuple[float, HostMessage]] = []
        self.opened: list[float] = []
        self.trouble: BaseException | None = None  # when the port is opened
        self.ports_closed = self.let_go = 0
        self.inputs = Inputs()
        self.hal = SerialHal(self, wrap, **options)
        self._ear = Decoder(Role.BOARD)

    async def open(self, end: End) -> Link:
        self.opened.append(round(self.loop.time() - BEFORE, 6))
        if self.trouble is not None:
            raise self.trouble
        wire = Wire("desk", end)
        wire.desk = self
        end.connected(wire)
        return wire

    async def close(self) -> None:
        self.ports_closed += 1

    @property
    def now(self) -> float:
        return self.ms / 1000.0

    def hears(self, data: bytes) -> None:
        for message in self._ear.feed(data):
            assert isinstance(message, HostMessage)
            self.sent.append((round(self.loop.time() - BEFORE, 6), message))

    def do(self, what: Any) -> Any:
        """Await it, or call it, while the loop runs."""

        async def doing() -> Any:
            return await what if asyncio.iscoroutine(what) else what()

        return self.loop.run_until_complete(doing())

    def opens(self) -> Desk:
        self.do(asyncio.sleep(BEFORE - 0.1))
        self.do(self.hal.open())
        self.do(asyncio.sleep(0.1))
        return self

    def tells(self, message: Message) -> None:
        """The board says it now."""
        self.do(lambda: self.hal.received(encode(message)))

    def runs(self, seconds: float, outputs: Outputs = NEUTRAL, *, held_up: bool = False) -> Desk:
        """Go on for so long, the first tick at once, unless the host is held up."""

        async def running() -> None:
            for _ in range(round(1000 * seconds / 10)):
                if self.says is not None and self.ms % ODOMETRY == 0 and self.hal.link is not None:
                    self.hal.received(encode(self.says))
                if self.ms % TICK == 0 and not held_up:
                    self.inputs = self.hal.read(self.now)
                    self.hal.write(outputs, self.now)
                await asyncio.sleep(0.01)
                self.ms += 10

        self.do(running())
        return self

    @property
    def link(self) -> BoardLink:
        link = self.hal.read(self.now).link
        assert link is not None
        return link

    def heard(self, *kinds: type[HostMessage], since: float = 0.0) -> list[tuple[float, HostMessage]]:
        """What of these kinds it was sent since then, and when."""
        return [(time, message) for time, message in self.sent if isinstance(message, kinds) and time >= since]

    def times(self, *kinds: type[HostMessage], since: float = 0.0) -> list[float]:
        return [time for time, _ in self.heard(*kinds, since=since)]


@pytest.fixture
def make() -> Iterator[Callable[..., Desk]]:
    """A function that makes a desk whose line is open."""
    desks: list[Desk] = []

    def made(**options: Any) -> Desk:
        desks.append(Desk(**options))
        return desks[-1].opens()

    yield made
    for desk in desks:
        desk.do(desk.hal.close())
        desk.loop.close()


@pytest.fixture
def desk(make: Callable[..., Desk]) -> Desk:
    """A desk whose board has been heard for 2 s."""
    return make().runs(2.0)


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
    assert ends == [desk.hal]


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


# -- a line that loses something ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [b"\xfa\xfb\x04\x70", bytes([*encode(STANDING)[:-1], 0])])
def test_after_a_damaged_frame_velocity_goes_out_at_every_tick_for_5_s(desk: Desk, noise: bytes) -> None:
    desk.do(lambda: desk.hal.received(noise))
    desk.runs(6.0)
    steps = [(since, round(until - since, 6)) for since, until in pairwise(desk.times(Velocity, since=2.0))]
    assert {step for since, step in steps if since < 6.97} == {0.02}
    assert {step for since, step in steps if since > 7.0} == {0.04, 0.06}
    assert sum(desk.link.faults.values()) == 1


def test_an_old_command_is_counted_and_says_nothing_about_the_line(desk: Desk) -> None:
    desk.do(lambda: desk.hal.received(bytes([0xFA, 0xFB, 24, 0x6B])))
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


def test_a_host_that_was_held_up_notices_by_the_next_odometry_that_the_board_was_lost(desk: Desk) -> None:
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


def test_a_pause_at_any_other_pose_is_none(desk: Desk) -> None:
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
    desk.hal.receiver.take(BatteryLevels("twelve", 11.0))  # type: ignore[arg-type]
    desk.hal.receiver.take(BatteryLevels("six", 11.0))  # type: ignore[arg-type]
    with pytest.raises(HalError, match="the link to desk failed: TypeError"):
        desk.hal.read(desk.now)


# -- gains -------------------------------------------------------------------------------------------------------------


def loads(desk: Desk, gains: PidSet = GAINS) -> list[bool]:
    """Load gains; the list gets the answer."""
    answers: list[bool] = []
    desk.do(lambda: desk.hal.load_gains(gains, answers.append))
    return answers


def test_gains_go_out_at_once_and_then_once_a_second_until_the_board_has_them(desk: Desk) -> None:
    answers = loads(desk)
    desk.runs(3.5)
    assert desk.heard(PidSet) == [(time, GAINS) for time in (2.0, 3.0, 4.0, 5.0)]
    assert desk.link.gains, "of a board that was not found again, it is not said"
    desk.tells(PidResponse(True))
    assert answers == [True]
    desk.runs(3.0)
    desk.tells(PidResponse(True))
    assert (answers, len(desk.heard(PidSet))) == ([True], 4), "a late answer says nothing"


def test_an_answer_to_what_nobody_sent_says_nothing(desk: Desk) -> None:
    answers = loads(desk)
    desk.tells(PidResponse(True))
    assert (answers, desk.runs(0.1).times(PidSet)) == ([], [2.0])


def test_an_answer_before_anything_was_ever_asked_says_nothing(desk: Desk) -> None:
    desk.tells(PidResponse(True))
    assert desk.runs(11.0).times(PidSet) == []


def test_a_board_that_is_found_for_the_first_time_gets_its_gains_before_any_set_point(
    make: Callable[..., Desk],
) -> None:
    desk = make()
    loads(desk)
    desk.runs(2.1, DRIVE)
    assert not desk.link.gains
    assert {message for _, message in desk.heard(Velocity)} == {ZERO}
    desk.tells(PidResponse(True))
    assert desk.runs(0.1, DRIVE).sent[-1][1] == HALF


def test_gains_that_are_rejected_three_times_are_sent_no_more(desk: Desk) -> None:
    answers = loads(desk)
    for rejections in (1, 2, 3):
        desk.runs(1.0)
        desk.tells(PidResponse(False))
        assert answers == ([False] if rejections == 3 else [])
    desk.runs(11.0)
    assert len(desk.heard(PidSet)) == 3
    assert loads(desk) == []
    desk.runs(0.1)
    assert len(desk.heard(PidSet)) == 4, "unless somebody asks again"


def test_rejections_of_other_gains_do_not_count(desk: Desk) -> None:
    loads(desk)
    for _ in range(2):
        desk.runs(1.0)
        desk.tells(PidResponse(False))
    answers = loads(desk, OTHERS)
    for _ in range(2):
        desk.runs(1.0)
        desk.tells(PidResponse(False))
    assert answers == []
    desk.runs(1.0)
    desk.tells(PidResponse(False))
    assert answers == [False]
    answers = loads(desk)
    desk.runs(1.0)
    desk.tells(PidResponse(False))
    assert answers == [], "they begin at none each time"


def test_gains_that_are_under_way_are_not_sent_sooner_when_they_are_asked_for_again(desk: Desk) -> None:
    loads(desk)
    desk.runs(0.1)
    answers = loads(desk)
    assert desk.runs(1.5).times(PidSet) == [2.0, 3.0]
    desk.tells(PidResponse(True))
    assert answers == [True]


def test_other_gains_wait_for_the_turn_of_those_that_are_under_way(desk: Desk) -> None:
    first = loads(desk)
    desk.runs(0.1)
    second = loads(desk, OTHERS)
    desk.tells(PidResponse(True))
    desk.runs(1.0)
    assert desk.heard(PidSet) == [(2.0, GAINS), (3.0, OTHERS)]
    desk.tells(PidResponse(True))
    assert (first, second) == ([], [True])
    desk.runs(0.1)
    third = loads(desk)
    assert desk.runs(0.1).heard(PidSet)[-1] == (3.2, GAINS), "at once where nothing is under way"
    loads(desk, OTHERS)
    loads(desk)
    desk.runs(0.8)
    assert len(desk.heard(PidSet)) == 3, "however often they change"
    desk.tells(PidResponse(True))
    assert third == []


def test_acknowledged_gains_are_sent_again_after_10_s_while_the_robot_is_not_to_move(desk: Desk) -> None:
    loads(desk)
    desk.runs(0.02)
    desk.tells(PidResponse(True))
    desk.runs(9.98)
    assert desk.times(PidSet) == [2.0]
    desk.runs(1.0, DRIVE)
    assert desk.times(PidSet) == [2.0]
    desk.runs(0.02)
    desk.tells(PidResponse(False))
    desk.tells(PidResponse(False))
    desk.runs(9.96)
    assert desk.times(PidSet) == [2.0, 13.0]
    desk.runs(0.1)
    assert desk.times(PidSet) == [2.0, 13.0, 23.0]
    desk.tells(PidResponse(False))
    assert desk.runs(11.0).times(PidSet) == [2.0, 13.0, 23.0], "a board that now rejects them is left alone"


@pytest.mark.parametrize("answered", [False, True])
def test_a_board_that_was_found_again_gets_its_gains_first_and_stands_until_it_has_them(
    desk: Desk, answered: bool
) -> None:
    answers = loads(desk)
    desk.runs(0.1)
    desk.tells(PidResponse(False))
    desk.tells(PidResponse(False))
    if answered:
        desk.tells(PidResponse(True))
    desk.says = None
    desk.runs(12.02)
    desk.says = STANDING
    assert not desk.link.gains
    found = desk.now
    desk.runs(2.5, DRIVE)
    times = desk.times(PidSet, since=found)
    assert len(times) == 3 and 0.0 <= times[0] - found <= 0.06
    assert [later - earlier for earlier, later in pairwise(times)] == pytest.approx([1.0, 1.0])
    assert desk.link.ready and not desk.link.gains
    assert {message for _, message in desk.heard(Velocity, since=found)} == {ZERO}
    desk.tells(PidResponse(False))
    desk.tells(PidResponse(False))
    assert not desk.link.gains
    desk.tells(PidResponse(True))
    assert desk.link.gains
    assert answers == [True] * (1 + answered)
    assert desk.runs(0.1, DRIVE).sent[-1][1] == HALF


def test_without_gains_to_send_a_board_that_was_found_again_lacks_none(desk: Desk) -> None:
    desk.says = None
    desk.runs(1.0)
    desk.says = STANDING
    assert desk.runs(1.5, DRIVE).link.gains
    assert desk.sent[-1][1] == HALF


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


def test_the_esc_comes_on_after_silence_and_zeros_and_meanwhile_the_board_is_not_ready(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    assert desk.link.text == "the ESC comes on in 3.2 s, when the board's loops are cleared"
    desk.runs(3.24, DRIVE)
    assert not desk.link.ready
    assert desk.times(Velocity, since=2.0)[0] == pytest.approx(4.2)
    assert len(desk.times(Velocity, since=4.2)) == pytest.approx(21, abs=1)
    assert {message for _, message in desk.heard(Velocity, since=2.0)} == {ZERO}
    assert len(desk.heard(PowerControl)) == 1
    desk.runs(0.1, DRIVE)
    assert desk.heard(PowerControl)[1:] == [(5.26, PowerControl(Switch.ESC, True))]
    assert desk.link.ready
    assert desk.link.text == "the ESC was told to come on"
    assert desk.sent[-1][1] == HALF
    desk.runs(3.0, DRIVE)
    assert len(desk.heard(PowerControl)) == 2, "it is told so once"


def test_an_esc_that_is_to_be_off_after_all_does_not_come_on(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.runs(1.0)
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    desk.runs(5.0)
    assert {message for _, message in desk.heard(PowerControl)} == {PowerControl(Switch.ESC, False)}
    assert len(desk.times(Velocity, since=3.0)) == 100


def test_the_esc_comes_on_where_the_line_is_down_meanwhile_as_late_as_ever(desk: Desk) -> None:
    desk.do(lambda: desk.hal.switch(Switch.ESC, True, desk.now))
    desk.trouble = HalError("no")
    desk.do(lambda: desk.hal.lost("cut"))
    desk.runs(4.0)
    assert desk.link.text == "no"
    desk.trouble = None
    desk.runs(3.0, DRIVE)
    assert desk.sent[-1][1] == HALF


def test_combined_odometry_goes_out_50_times_a_second_at_most(desk: Desk) -> None:
    combined = CombinedOdometry(1.0, 2.0, 0.5, 0.25, 0.125)
    for step in range(30):  # every 10 ms
        desk.do(lambda step=step: desk.hal.offer_odometry(combined, 2.0 + 0.01 * step))
    assert [message for _, message in desk.heard(CombinedOdometry)] == [combined] * 15


def test_combined_odometry_outside_the_world_is_refused_and_counted(desk: Desk) -> None:
    before = desk.link
    desk.do(lambda: desk.hal.offer_odometry(CombinedOdometry(3e6, 0.0, 0.0, 0.0, 0.0), 2.0))
    assert desk.link.faults["line_not_encodable"] == before.faults["line_not_encodable"] + 1
    assert not desk.heard(CombinedOdometry)


def test_gains_that_do_not_fit_are_refused(desk: Desk) -> None:
    with pytest.raises(EncodeError):
        desk.hal.load_gains(PidSet((1e9, 0.0, 0.0), ()), lambda accepted: None)


# -- the line itself ---------------------------------------------------------------------------------------------------


def test_a_line_that_is_cut_is_opened_again_with_longer_and_longer_pauses(desk: Desk) -> None:
    desk.trouble = HalError("unplugged")
    desk.do(lambda: desk.hal.lost("cut"))
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
    desk.do(lambda: desk.hal.lost("cut"))
    desk.runs(0.2)
    assert desk.opened[-1] == pytest.approx(again + 0.1), "a board that answered is called soon"


def test_a_line_that_comes_and_goes_without_a_word_is_called_less_and_less_often(make: Callable[..., Desk]) -> None:
    desk = make()
    desk.says = None
    for _ in range(5):
        desk.do(lambda: desk.hal.lost("hung up"))
        desk.runs(0.95)
    steps = [round(at - k * 0.95, 6) for k, at in enumerate(desk.opened[1:])]
    assert steps == [0.1, 0.2, 0.4, 0.8, 0.9]
    assert desk.link[:3] == (False, 0, ""), "a board that was never heard was not lost"
    assert desk.link.faults["reconnects"] == 5


def test_a_line_that_is_lost_twice_is_opened_once(desk: Desk) -> None:
    desk.do(lambda: desk.hal.lost("cut"))
    desk.do(lambda: desk.hal.lost("cut"))
    desk.runs(1.0)
    assert len(desk.opened) == 2
    assert desk.link.losses == 1


def test_a_fresh_line_is_told_at_once_all_that_holds(desk: Desk) -> None:
    loads(desk)
    desk.do(lambda: desk.hal.switch(Switch.ESC, False, desk.now))
    held = Outputs(pwm4=1)
    desk.runs(0.5, held)
    desk.do(lambda: desk.hal.received(encode(STANDING)[:10]))  # a half frame is the old line's
    desk.do(lambda: desk.hal.lost("cut"))
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
    desk.do(lambda: desk.hal.lost("cut"))
    with pytest.raises(HalError, match="the link to desk failed: ZeroDivisionError"):
        desk.runs(0.5)


def test_a_write_that_finds_the_line_lost_is_none(desk: Desk) -> None:
    wire = desk.hal.link
    assert wire is not None
    wire.overflows = 3
    wire.shut()
    desk.runs(0.1, DRIVE)
    assert not desk.link.connected
    assert desk.link.faults["line_overflows"] == 3
    desk.do(lambda: desk.hal.lost("cut"))
    desk.runs(1.0)
    assert desk.link.connected
    assert desk.hal.link is not None
    desk.hal.link.overflows = 2
    assert desk.link.faults["line_overflows"] == 3, "as it was told last"
    desk.do(lambda: desk.hal.received(b"\xfa\xfb\x04\x70"))
    assert desk.link.faults["line_overflows"] == 5


def test_the_board_is_left_with_three_stops_and_its_servos_where_they_are(desk: Desk) -> None:
    desk.runs(0.5, Outputs(pwm4=1000, pwm5=5, v=0.5))
    desk.do(desk.hal.close())
    assert desk.heard(Velocity, since=2.5) == [(pytest.approx(2.5 + 0.05 * k), ZERO) for k in range(3)]
    assert (desk.ports_closed, desk.let_go) == (1, 1)
    assert desk.hal.link is None
    assert desk.link[1:4] == (1, "closed", "closed")
    desk.do(desk.hal.close())
    assert (desk.ports_closed, len(desk.heard(Velocity, since=2.5))) == (1, 3), "and once"
    desk.do(lambda: desk.hal.lost("cut"))
    desk.do(asyncio.sleep(3.0))
    assert len(desk.opened) == 1


def test_a_host_that_closes_the_loops_leaves_the_servos_where_they_are(make: Callable[..., Desk]) -> None:
    desk = make(control="host").runs(2.0, Outputs(1000, 1, -1, 30, 40))
    desk.do(desk.hal.close())
    assert [message for _, message in desk.heard(PwmTest)[-3:]] == [PwmTest(0, 0, 0, 30, 40)] * 3


INSIDE = b"\xfa\xfb\x14\x68" + encode(BatteryLevels(12.0, 11.0))  # whole, in what may be half of a longer frame


def test_of_a_line_that_is_gone_nothing_is_heard_any_more(desk: Desk) -> None:
    desk.do(lambda: desk.hal.received(INSIDE))
    desk.do(lambda: desk.hal.lost("cut"))
    desk.says = None
    assert desk.runs(0.5).inputs.batteries is None
    desk.loop.call_later(0.14, desk.hal.received, INSIDE)  # between the last stop and the end
    desk.do(desk.hal.close())
    assert desk.runs(0.5).inputs.batteries is None


def test_closed_before_it_was_opened_there_is_nothing_to_do() -> None:
    desk = Desk()
    desk.do(desk.hal.close())
    assert (desk.ports_closed, desk.sent) == (0, [])
    desk.loop.close()


def test_closed_it_looks_for_the_line_no_more(desk: Desk) -> None:
    desk.trouble = HalError("unplugged")
    desk.do(lambda: desk.hal.lost("cut"))
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
