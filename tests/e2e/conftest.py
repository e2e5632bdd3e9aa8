"""A robot in an endless room, its gains loaded, and a recording of what it does.

Asynchronous tests run in virtual time, and fail when something blocks the event loop.
"""

from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import Any, NamedTuple

import pytest
from blockbuster import BlockBuster, blockbuster_ctx

from txt1.kernel.loop import VirtualTimeLoop
from txt1.kernel.ticks import Ticks
from txt1.record import recorder as recorder_module
from txt1.robot import Robot
from txt1.runtime import Runtime

ENDLESS = ("sim.room.length=.inf", "sim.room.width=.inf")


class Sample(NamedTuple):
    """One tick: time in s, true pose and speed, what the encoders say, and the PWM counts."""

    time: float
    x: float
    y: float
    theta: float
    v: float
    measured_v: float
    measured_omega: float
    motor: int
    rear: int
    command_v: float


def recorder(robot: Robot) -> list[Sample]:
    """A list that grows by one sample per controller period from now on."""
    samples: list[Sample] = []

    async def record(ticks: Ticks) -> None:
        async for now in ticks:
            true = robot.hal.vehicle.state  # type: ignore[attr-defined]
            odometry, control = robot.odometry, robot.runtime.state.control
            samples.append(
                Sample(
                    now,
                    true.x,
                    true.y,
                    true.theta,
                    true.v,
                    odometry.v,
                    odometry.omega,
                    control.outputs.motor,
                    control.outputs.rear,
                    control.v,
                )
            )

    robot.add_task("recorder", 0.02, record, priority=-1)
    return samples


def pytest_asyncio_loop_factories(config: pytest.Config, item: pytest.Item) -> dict[str, Callable[[], VirtualTimeLoop]]:
    return {"virtual": VirtualTimeLoop}


@pytest.fixture(autouse=True)
def blocking_calls_fail() -> Iterator[BlockBuster]:
    """A call that blocks the loop fails, but for those before the first tick and after the last."""
    with blockbuster_ctx("txt1") as blockbuster:
        may_block(blockbuster, "txt1/additions.py", "ours", "strangers", "load")
        may_block(blockbuster, "txt1/hal/registry.py", "create", "names")
        may_block(blockbuster, "txt1/maps/files.py", "read")
        may_block(blockbuster, "txt1/sensors/registry.py", "create")
        may_block(blockbuster, "txt1/kernel/timeslice.py", "ordinary", "_threads")  # the kernel answers from memory
        may_block(blockbuster, "txt1/kernel/loop.py", "shutdown_default_executor")  # waits for the recorder's thread
        may_block(blockbuster, "txt1/record/recorder.py", "_hand_over")  # at full speed nothing is late by it
        if not recorder_module.__file__.endswith(".py"):  # compiled, `_hand_over` has no frame
            may_block(blockbuster, "txt1/record/file_sink.py", "write")
            may_block(blockbuster, "txt1/record/comparison.py", "write")
        may_block(blockbuster, "tests/patience.py", "lateness")
        yield blockbuster


def may_block(blockbuster: BlockBuster, file: str, *functions: str) -> None:
    """Let functions of a file block the loop: nobody waits for a tick meanwhile."""
    for call in blockbuster.functions.values():
        call.can_block_in(file, set(functions))


@pytest.fixture
async def robot() -> AsyncIterator[Robot]:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        assert await robot.load_gains()
        yield robot


@pytest.fixture
def samples(robot: Robot) -> list[Sample]:
    return recorder(robot)


@pytest.fixture
def every_tick(robot: Robot) -> Callable[[Callable[[], None]], None]:
    """Call something at every controller period from now on."""

    def start(action: Callable[[], None]) -> None:
        async def task(ticks: Ticks) -> None:
            async for _ in ticks:
                action()

        made: Callable[[Ticks], Coroutine[Any, Any, None]] = task
        robot.add_task("every tick", 0.02, made)

    return start


@pytest.fixture
def reject_gains(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """After the call boards find every gain schedule wrong."""

    def reject(sets: object) -> None:
        raise ValueError

    return lambda: monkeypatch.setattr("txt1.tasks.serial.Schedule", reject)


class Passed(NamedTuple):
    """A speed that passed the safety gate, m/s: when, and when it was given, s of the run."""

    time: float
    given: float
    v: float


def passing(runtime: Runtime) -> list[Passed]:
    """Speeds that pass the safety gate; the list grows by one per controller period while it drives."""
    passed: list[Passed] = []

    def note(v: float, omega: float, now: float) -> tuple[float, float]:
        command = runtime.state.command
        assert command is not None
        if v:
            passed.append(Passed(now, command.time, v))
        return v, omega

    runtime.gate.guards.append(note)
    return passed
