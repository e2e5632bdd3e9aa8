"""Hobby ESCs that brake before they reverse, behind a Raspberry Pi's servo board."""

from __future__ import annotations

import asyncio
from math import inf
from typing import Any

import pytest

from txt1.cars.pi.driver import UNKNOWN, PiHal, PiOptions, setup_of
from txt1.cars.pi.esc import CLICK, ESC_FORGOTTEN, BrakeFirst
from txt1.cars.pi.virtual_pi import VirtualPi
from txt1.config import Config, checked, load
from txt1.errors import ConfigError
from txt1.hal.registry import create
from txt1.kernel.loop import run
from txt1.robot import Robot

CYCLE = 0.02


class Car:
    """A car behind a virtual servo board, and every pulse that its motors got."""

    def __init__(self, vehicle: str, *words: str) -> None:
        settings = [f"vehicle={vehicle}", "hal_options.bus=virtual", "sim.room.length=.inf", "sim.room.width=.inf"]
        self.config: Config = load(None, [*settings, *words], {}, {"hal": "pi"}).config
        self.options = checked(PiOptions, self.config.hal_options, "x")
        self.desk = VirtualPi(self.config, setup_of(self.options, self.config.geometry))
        self.hal = PiHal(self.desk, self.options, self.config.geometry, simulated=True, dead_band=300.0)
        self.pulses: list[float] = []
        put = self.desk.put

        def seen(pulses: Any, now: float) -> None:
            self.pulses += pulses[: len(self.options.motor)]
            put(pulses, now)

        self.desk.put = seen  # type: ignore[method-assign]

    async def ready(self, robot: Robot) -> None:
        await robot.linked(5.0)
        if not self.hal.capabilities.blind:
            await robot.load_gains()
        robot.arm()

    @property
    def v(self) -> float:
        return self.desk.vehicle.state.v

    @property
    def went(self) -> float:
        """Its true place ahead of its start, m."""
        return self.desk.vehicle.state.x - self.config.sim.start[0]


CARS = {
    "without encoders": ("donkeycar",),
    "one encoder": ("f1tenth", "hal_options.encoders=[[17, 27]]"),
    "one encoder without direction": ("f1tenth", "hal_options.encoders=[[17]]"),
    "rover": ("rover", "hal_options.encoders=[[17, 27], [22, 23]]", "hal_options.motor=[4, 5]"),
}


@pytest.mark.parametrize("words", CARS.values(), ids=CARS)
def test_it_drives_back_after_a_drive_forward_and_its_odometry_knows_when(words: tuple[str, ...]) -> None:
    car = Car(*words, "hal_options.reverse=brake_first")

    async def body() -> None:
        async with Robot.open(car.hal, config=car.config) as robot:
            await car.ready(robot)
            for _ in range(2):
                await robot.drive(0.6, 0.0, 2.0)
                await robot.drive(-0.5, 0.0, 4.0)
                assert car.v == pytest.approx(-0.5, rel=0.15)
                assert robot.armed, robot.reason
                await robot.drive(0.0, 0.0, 1.0)
            # without encoders no braking is known; an ESC that reverses at once leaves 0.28 m
            assert robot.odometry.x == pytest.approx(car.went, abs=0.45 if car.hal.capabilities.blind else 0.05), (
                "of 6 m"
            )

    run(body(), speed="max")


def test_an_esc_that_brakes_first_does_not_reverse_for_a_car_that_thinks_it_does() -> None:
    car = Car("donkeycar", "hal_options.reverse=direct")

    async def body() -> None:
        async with Robot.open(car.hal, config=car.config) as robot:
            await car.ready(robot)
            await robot.drive(0.6, 0.0, 2.0)
            await robot.drive(-0.5, 0.0, 4.0)
            assert car.v > -0.01
            assert robot.odometry.x < car.went - 1.0, "dead reckoning went back alone"

    run(body(), speed="max")


def test_an_esc_that_reverses_at_once_is_driven_either_way() -> None:
    for mode in ("direct", "brake_first"):
        car = Car("donkeycar", "hal_options.virtual_esc=direct", f"hal_options.reverse={mode}")

        async def body(car: Car = car) -> None:
            async with Robot.open(car.hal, config=car.config) as robot:
                await car.ready(robot)
                await robot.drive(0.6, 0.0, 2.0)
                await robot.drive(-0.5, 0.0, 4.0)
                assert car.v == pytest.approx(-0.5, rel=0.15)

        run(body(), speed="max")


@pytest.mark.parametrize("words", [("donkeycar",), CARS["one encoder"], CARS["rover"]], ids=["blind", "one", "rover"])
def test_a_car_whose_esc_is_unknown_refuses_reverse_and_names_the_remedy(words: tuple[str, ...]) -> None:
    car = Car(*words)

    async def body() -> None:
        async with Robot.open(car.hal, config=car.config) as robot:
            await car.ready(robot)
            await robot.drive(0.6, 0.0, 2.0)
            await robot.drive(0.0, 0.0, 3.0)
            told = [event.text for event in robot.runtime.state.events]
            assert UNKNOWN not in told, "a stop asks for no reverse"
            x = robot.odometry.x
            await robot.drive(-0.5, 0.0, 2.0)
            assert min(car.pulses) >= 1500.0
            assert robot.odometry.x == pytest.approx(x, abs=0.02)
            assert [event.text for event in robot.runtime.state.events].count(UNKNOWN) == 1
            assert robot.armed
            await robot.drive(0.6, 0.0, 2.0)
            assert car.v == pytest.approx(0.6, rel=0.1)

    run(body(), speed="max")


@pytest.mark.parametrize("words", CARS.values(), ids=CARS)
@pytest.mark.parametrize("stop", ["zeros", "silence", "disarm", "stop"])
def test_a_stop_is_neutral_and_never_a_pulse_on_the_reverse_side(words: tuple[str, ...], stop: str) -> None:
    car = Car(*words, "hal_options.reverse=brake_first")

    async def body() -> None:
        async with Robot.open(car.hal, config=car.config) as robot:
            await car.ready(robot)
            await robot.drive(0.6, 0.0, 2.0) if stop == "zeros" else await drive_on(robot)
            if stop in ("disarm", "stop"):
                getattr(robot, stop)()
            elif stop == "zeros":
                await robot.drive(0.0, 0.0, 1.0)
            await asyncio.sleep(3.0)
            assert abs(car.v) < 0.02
            assert min(car.pulses) >= 1500.0

    run(body(), speed="max")


async def drive_on(robot: Robot) -> None:
    for _ in range(40):
        robot.command(0.6, 0.0)
        await asyncio.sleep(0.05)


def test_a_virtual_bus_by_its_old_name_is_no_file() -> None:
    with pytest.raises(ConfigError, match=r"hal_options.bus: the virtual bus is named 'virtual', not 'desk'"):
        create(load(None, ["vehicle=donkeycar", "hal_options.bus=desk"], {}, {"hal": "pi"}).config)


def put(esc: BrakeFirst, counts: float, begin: float, lasts: float, stands: bool = True) -> list[bool]:
    """Whether the pulse of a motor is put out, each cycle."""
    cycles = round(lasts / CYCLE)
    return [esc.passes([counts], begin + CYCLE * k, stands=stands, brakes=False)[0] for k in range(cycles)]


def test_the_first_reverse_is_a_click_and_neutral_between_and_the_next_is_none() -> None:
    esc, click = BrakeFirst(1, 300.0), round(CLICK / CYCLE)
    assert all(put(esc, 900.0, 0.0, 1.0))
    assert not any(put(esc, -900.0, 1.0, 0.4, stands=False)), "it rolls"
    assert put(esc, -900.0, 1.4, 1.0) == [True] * click + [False] * click + [True] * (50 - 2 * click)
    assert all(put(esc, 0.0, 2.4, 0.5))
    assert all(put(esc, -900.0, 2.9, 0.5)), "it is in reverse"
    put(esc, 0.0, 3.4, ESC_FORGOTTEN + CYCLE)
    assert not all(put(esc, -900.0, 3.4 + ESC_FORGOTTEN + CYCLE, 1.0)), "it may have been switched off"


def test_motors_of_two_sides_wait_for_each_other() -> None:
    esc = BrakeFirst(2, 300.0)
    seen = [esc.passes([900.0, -900.0], CYCLE * k, stands=True, brakes=True) for k in range(20)]
    assert seen[0] == (False, True), "the click is for the side that reverses"
    assert (False, False) in seen
    assert seen[-1] == (True, True)
    assert esc.passes([-900.0, -900.0], 0.4, stands=False, brakes=True) == (True, False), (
        "it brakes, the other side shut"
    )
    assert esc.waits
    assert esc.passes([0.0, 0.0], inf, stands=False, brakes=False) == (True, True)
