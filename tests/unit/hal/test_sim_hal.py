"""The simulated robot as a hardware layer: it does at each instant what it was told before, and no sooner."""

from __future__ import annotations

from typing import Any

import pytest

from txt1.config import load
from txt1.hal.base import Capabilities, Indicators, Outputs
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.kernel.loop import run
from txt1.model.channels import STRAIGHT, Channel, Channels
from txt1.protocol.messages import Switch

DRIVE = Outputs(motor=3000)


def made(*settings: str) -> Any:
    """A simulated robot in a room of 5 m, at its middle."""
    return create(load(overrides=["sim.noise.drag=0", *settings]).config)


def opened(*settings: str) -> Any:
    """The same, open."""

    async def opening() -> Any:
        hal = made(*settings)
        await hal.open()
        return hal

    return run(opening(), speed="max")


def where(hal: Any, now: float) -> tuple[float, float, float]:
    x, y, theta = hal.read(now).pose
    return x, y, theta


def test_it_has_all_that_the_thesis_s_robot_had() -> None:
    can = SimHal(made().vehicle).capabilities
    assert can == Capabilities(
        ticks=True,
        pwm=True,
        battery=True,
        power=True,
        power_known=True,
        servos=True,
        place=True,
        pose=True,
        simulated=True,
    )
    assert SimHal(made().vehicle, alone=True).capabilities.repeats, "alone in its world, its run repeats exactly"
    assert not can.repeats


def test_without_encoders_it_reports_no_counts() -> None:
    hal = made("vehicle=donkeycar")
    assert not hal.vehicle.body.counts_per_rev and not hal.capabilities.ticks
    assert hal.read(0.02).ticks is None


def test_it_moves_from_when_it_is_told_until_it_is_told_to_stop() -> None:
    hal = opened()
    hal.write(DRIVE, 1.0)
    assert where(hal, 1.0) == where(opened(), 0.0), "not a millimetre before"
    assert where(hal, 2.0)[0] > 0.1
    other = opened()
    other.write(DRIVE, 1.0)
    hal.switch(Switch.ESC, False, 3.0)
    assert where(hal, 3.0) == where(other, 3.0), "it drove until then"
    assert where(hal, 4.0)[0] < where(other, 4.0)[0], "and no longer"
    other.place(0.5, -0.5, 0.25, 5.0)
    assert where(other, 5.0) == (0.5, -0.5, 0.25)


def test_opened_and_closed_its_outputs_are_neutral() -> None:
    hal = made()
    assert hal.outputs == Outputs()
    hal.write(DRIVE, 0.0)

    async def opening() -> None:
        await hal.open()

    hal.write(Outputs(), 0.5)
    before = where(hal, 7.0)
    hal.write(DRIVE, 7.0)
    run(opening(), speed="max")
    assert hal.outputs == Outputs()
    assert where(hal, 0.0) == before
    assert where(hal, 1.0) == pytest.approx(before, abs=0.01), "a new run begins at 0 s, its outputs neutral"
    hal.write(DRIVE, 1.0)
    assert hal.outputs == DRIVE
    assert where(hal, 2.0) != pytest.approx(before, abs=0.1)

    async def closing() -> None:
        await hal.close()

    run(closing(), speed="max")
    assert hal.outputs == Outputs()


@pytest.mark.parametrize("steering", ["both", "front"])
@pytest.mark.parametrize("wiring", [STRAIGHT, Channels(front=Channel(trim=0.0, scale=0.999999))])
def test_a_car_that_steers_in_front_turns_whatever_its_wiring(steering: str, wiring: Channels) -> None:
    vehicle = made(f"geometry.steering={steering}").vehicle
    hal = SimHal(vehicle, wiring=wiring)
    # of a car that steers in front only the front counts
    turn = Outputs(motor=3000, front=9000, rear=-9000 if steering == "front" else -4000)
    hal.write(turn, 0.0)
    reference = SimHal(made(f"geometry.steering={steering}").vehicle)
    reference.write(turn, 0.0)
    assert where(hal, 2.0) == pytest.approx(where(reference, 2.0), abs=1e-3)
    assert abs(where(hal, 2.0)[2]) > 0.2


def test_what_is_in_its_way_is_named_only_when_it_is_there() -> None:
    hal = opened("sim.room.length=5.0", "sim.room.width=5.0")
    assert hal.blocked_by() is None
    hal.place(2.0, 0.0, 0.0, 0.0)
    assert hal.blocked_by() is None, "0.2 m of room"
    hal.place(2.5 - 0.255 - 0.01, 0.0, 0.0, 0.0)
    assert hal.blocked_by() is not None


def test_it_keeps_what_its_buzzer_and_leds_show_and_stands_level_on_a_level_floor() -> None:
    hal = opened()
    hal.indicate(Indicators())
    shown = Indicators(*[True] * len(Indicators._fields))
    hal.indicate(shown)
    assert hal.indicators == shown
    assert hal.attitude() == (0.0, 0.0)
    rough = opened("sim.ground.height=0.03", "sim.ground.longest=1.0", "sim.ground.shortest=0.2")
    assert rough.attitude() != (0.0, 0.0)
