"""A board with the habits of the originals, as a host meets it: bytes on a line."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from math import pi

import pytest

from tests.e2e.test_board import GAINS, Desk, Host
from txt1.board.board import Board, BoardEvent
from txt1.link.base import connect
from txt1.link.impairments import paced
from txt1.protocol.layout import checksum, encode
from txt1.protocol.messages import BatteryLevels, EncoderOdometry, PidSet, PowerControl, PwmTest, Switch, Velocity


@asynccontextmanager
async def original(*settings: str, driven: float = 0.0) -> AsyncIterator[tuple[Desk, Board, Host]]:
    """An original board and its host: link alive, gains loaded, driven at so many m/s."""
    desk, host = Desk("virtual", "board.habits=original", *settings), Host()
    await desk.power_up()
    connect(host, paced(desk, 57600))
    host.send(GAINS)
    await host.drive(Velocity(0.0, 0.0), 2.5)
    if driven:
        await host.drive(Velocity(driven, 0.0), 3.0)
    assert isinstance(desk.end, Board)
    try:
        yield desk, desk.end, host
    finally:
        await desk.power_down()


def poses(host: Host) -> list[EncoderOdometry]:
    return [message for _, message in host.heard if isinstance(message, EncoderOdometry)]


async def test_speeds_read_6_per_cent_low_and_slow_ones_read_zero() -> None:
    async with original(driven=0.8) as (desk, board, host):
        await host.drive(Velocity(0.8, 0.0), 0.1)
        begin, true = poses(host)[-1].x, board.vehicle.pose[0]
        await host.drive(Velocity(0.8, 0.0), 4.0)
        assert (poses(host)[-1].x - begin) / (board.vehicle.pose[0] - true) == pytest.approx(0.937, abs=0.02)
        assert desk.speed > 0.8, "so it drives too fast"
    async with original() as (desk, _, host):
        await host.drive(Velocity(0.04, 0.0), 3.0)
        assert desk.speed > 0.0
        assert all(pose.v == 0.0 or pose.v >= 0.022 for pose in poses(host)), "a wheel's least is 0.045 m/s"


async def test_headings_go_from_0_to_6283_and_the_pose_is_truncated() -> None:
    async with original() as (_, _, host):
        await host.drive(Velocity(0.5, -0.6), 6.0)
        headings = [pose.theta for pose in poses(host)]
        assert all(0.0 <= theta < 2.0 * pi for theta in headings)
        assert max(headings) > 5.0, "it turned right"
        assert all(pose.x * 1000.0 == pytest.approx(round(pose.x * 1000.0)) for pose in poses(host))


async def test_the_first_set_point_after_an_outage_kicks() -> None:
    async with original(driven=0.5) as (desk, _, host):
        await asyncio.sleep(5.0)
        fastest = 0.0
        for _ in range(60):
            await host.drive(Velocity(0.5, 0.0), 0.05, rate=20.0)
            fastest = max(fastest, desk.speed)
        assert fastest > 1.0, "the whole outage was its first period"


async def test_zeros_until_the_link_rule_has_seen_a_second_of_them_prevent_that() -> None:
    async with original(driven=0.5) as (desk, _, host):
        await asyncio.sleep(5.0)
        await host.drive(Velocity(0.0, 0.0), 2.1)
        fastest = 0.0
        for _ in range(60):
            await host.drive(Velocity(0.5, 0.0), 0.05, rate=20.0)
            fastest = max(fastest, desk.speed)
        assert fastest < 0.65


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.7])
async def test_a_dead_host_stops_it_after_one_to_two_seconds(phase: float) -> None:
    async with original(driven=0.8) as (desk, _, host):
        await host.drive(Velocity(0.8, 0.0), 0.1 + phase)
        last = host.time()
        await asyncio.sleep(2.5)
        assert 0.9 < desk.neutral - last <= 2.0


async def test_manual_mode_keeps_the_last_pwm_until_a_pwm_test_of_zeros() -> None:
    async with original(driven=0.6) as (desk, board, host):
        await desk.press_centre()
        held = desk.outputs
        assert held[0] > 1000
        await host.drive(Velocity(0.0, 0.0), 4.0)
        await asyncio.sleep(4.0)
        assert desk.outputs == held, "not even the link is looked at"
        assert desk.speed > 0.5
        host.send(PwmTest(0, 0, 0, 100, -100))
        await asyncio.sleep(2.0)
        assert desk.speed == 0.0
        assert board.runtime.state.servos == (100, -100)


async def test_a_host_at_a_wall_is_told_once_that_it_gets_no_further() -> None:
    async with original("sim.room.length=3.0", driven=0.5) as (desk, board, host):
        await host.drive(Velocity(0.5, 0.0), 4.0)
        assert abs(desk.speed) < 0.01
        told = [event.text for event in board.runtime.state.events if "no further" in event.text]
        assert told == ["the vehicle gets no further: it is at a wall of the 3 x inf m room"]


async def test_a_pwm_test_moves_it_for_a_cycle_in_controller_mode() -> None:
    async with original() as (desk, _, host):
        host.send(PwmTest(9000, 0, 0, 0, 0))
        await asyncio.sleep(0.01)
        moved = desk.outputs[0]
        await host.drive(Velocity(0.0, 0.0), 0.1, rate=20.0)
        assert moved == 9000 != desk.outputs[0]


@pytest.mark.parametrize(("tests", "period"), [(1, 1.0), (10, 0.1)])
async def test_without_a_link_neutral_follows_a_pwm_test_at_once(tests: int, period: float) -> None:
    desk, host = Desk("virtual", "board.habits=original"), Host()
    await desk.power_up()
    connect(host, paced(desk, 57600))
    await asyncio.sleep(2.0)
    fastest = 0.0
    for _ in range(tests):
        host.send(PwmTest(3000, 0, 0, 0, 0))
        for _ in range(round(period / 0.02)):
            await asyncio.sleep(0.02)
            fastest = max(fastest, desk.speed)
    await desk.power_down()
    assert 0.0 < fastest < 0.25, "it was 0.8 where it held until the next second"


async def test_both_packs_are_there() -> None:
    async with original() as (_, _, host):
        levels = [message for _, message in host.heard if isinstance(message, BatteryLevels)]
        assert levels[-1].battery1 > 5.0
        assert levels[-1].battery2 == pytest.approx(levels[-1].battery1, abs=0.05), "but for the converter's noise"


async def test_a_bad_pid_set_gets_silence_and_a_good_one_its_answer() -> None:
    async with original() as (_, _, host):
        host.heard.clear()
        body = bytes((0x70, *bytes(17)))
        assert host.link is not None
        host.link.write(b"\xfa\xfb\x11" + body + checksum(body).to_bytes(2, "big"))
        await asyncio.sleep(1.0)
        assert host.answers() == []
        host.send(GAINS)
        await asyncio.sleep(0.2)
        assert [accepted for _, accepted in host.answers()] == [True]


async def test_an_empty_angular_table_freezes_the_steering() -> None:
    async with original() as (desk, _, host):
        await host.drive(Velocity(0.5, 0.4), 2.0)
        host.send(PidSet(GAINS.linear, ()))
        await host.drive(Velocity(0.5, 0.4), 0.2, rate=20.0)
        front = desk.outputs[1]
        await host.drive(Velocity(0.5, -0.4), 2.0)
        assert desk.outputs[1] == front


async def test_with_the_esc_off_it_winds_up_and_lurches_when_that_comes_on() -> None:
    async with original() as (desk, board, host):
        board.happen(BoardEvent("esc", 0.0))
        await host.drive(Velocity(0.4, 0.0), 8.0)
        assert desk.outputs[0] == 24000
        assert desk.speed == 0.0
        host.send(PowerControl(Switch.ESC, True))
        fastest = 0.0
        for _ in range(40):
            await host.drive(Velocity(0.4, 0.0), 0.05, rate=20.0)
            fastest = max(fastest, desk.speed)
        assert fastest > 1.0


async def test_a_restart_forgets_gains_pose_and_battery_and_keeps_the_switches() -> None:
    async with original(driven=0.5) as (desk, board, host):
        board.happen(BoardEvent("esc", 0.0))
        await host.drive(Velocity(0.0, 0.0), 0.2)
        assert poses(host)[-1].x > 1.0
        board.happen(BoardEvent("restart", 0.2))
        await asyncio.sleep(0.02)
        host.heard.clear()
        await host.drive(Velocity(0.5, 0.0), 3.0, rate=20.0)
        assert poses(host)[0] == EncoderOdometry(0.0, 0.0, 0.0, 0.0, 0.0)
        volts = [message.battery1 for _, message in host.heard if isinstance(message, BatteryLevels)]
        assert volts[0] < 6.0, "the filter starts at zero"
        assert desk.outputs == (0, 0, 0), "no gains"
        assert not board.vehicle.esc_on


async def test_a_stray_start_byte_costs_a_frame_and_a_false_length_255_bytes() -> None:
    async with original() as (_, board, host):
        assert host.link is not None
        received = board.runtime.state.received
        host.link.write(b"\xfa" + encode(Velocity(0.1, 0.0)) + encode(Velocity(0.2, 0.0)))
        await asyncio.sleep(0.1)
        assert board.runtime.state.received == received + 1
        host.link.write(b"\xfa\xfb\xff" + 26 * encode(Velocity(0.1, 0.0)))
        await asyncio.sleep(0.2)
        assert board.runtime.state.received == received + 1, "no time-out gives them back"
        host.link.write(b"\x00" + encode(Velocity(0.3, 0.0)))
        await asyncio.sleep(0.1)
        assert board.runtime.state.received == received + 2
