"""A host that is killed while it drives, and the device that is left alone: it stops by a time-out of its own.

Real time and real processes: the device is here, with its simulated vehicle; the host is killed.
"""

import asyncio
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from blockbuster import BlockBuster

from txt1.config import load
from txt1.devices.i2c import pulse_of
from txt1.devices.vesc import Vesc
from txt1.devices.waveshare import Waveshare
from txt1.kernel.loop import run
from txt1.link.pty import listen_pty

LATE = 0.15  # s that a busy machine may be late by


@pytest.fixture(autouse=True)
def made_before_anything_runs(blocking_calls_fail: BlockBuster) -> None:
    for function in blocking_calls_fail.functions.values():
        function.can_block_in("tests/e2e/test_dead_hosts.py", {"body", "motor"})
        function.can_block_in("txt1/link/pty.py", {"listen_pty", "_let_go"})


async def until(condition: Callable[[], bool], patience: float) -> float:
    """Wait for something to become true, and return how long that took, s."""
    time = asyncio.get_running_loop().time
    began = time()
    while not condition():
        assert time() - began < patience, f"not within {patience} s"
        await asyncio.sleep(0.005)
    return time() - began


@pytest.mark.parametrize(
    ("hal", "vehicle", "make", "timeout"),
    [
        pytest.param("vesc", "f1tenth", lambda config: Vesc(config, timeout=0.5), 0.5, id="vesc"),
        pytest.param("waveshare", "rover", Waveshare, 0.5, id="waveshare", marks=pytest.mark.long),
    ],
)
def test_the_device_stops_by_itself(
    hal: str, vehicle: str, make: Callable[[Any], Any], timeout: float, tmp_path: Path
) -> None:
    settings = [f"vehicle={vehicle}", "sim.room.length=.inf", "sim.room.width=.inf"]

    async def body() -> None:
        device, path = make(load(None, settings, {}, {"hal": hal}).config), tmp_path / hal
        listener = listen_pty(str(path), device.line)
        await device.power_up()
        host = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "txt1", "run", "--hal", hal, "--vehicle", vehicle, "--port", str(path), "--arm",
            "--drive", "0.8,0", "--headless", stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            await until(lambda: device.drives and device.car.vehicle.state.v > 0.7, 30.0)
            host.kill()
            await host.wait()
            took = await until(lambda: not device.drives, 5.0)
            assert timeout - 0.1 <= took <= timeout + LATE, f"outputs at rest {took:.3f} s after the kill"
            await until(lambda: abs(device.car.vehicle.state.v) < 0.05, 5.0)
        finally:
            with suppress(ProcessLookupError):
                host.kill()
            await host.wait()
            await device.power_down()
            listener.close()

    run(body())


@pytest.mark.parametrize(
    ("number", "limit"),
    [
        pytest.param(signal.SIGKILL, 0.25, id="killed"),
        pytest.param(signal.SIGSTOP, 0.25, id="hangs", marks=pytest.mark.long),
    ],
)
def test_the_guard_of_a_raspberry_pi_puts_out_neutral(number: signal.Signals, limit: float, tmp_path: Path) -> None:
    registers = tmp_path / "registers"

    def motor() -> float:
        """The pulse of the motor, us, by the servo board's registers; 0 while nothing comes out."""
        found = registers.read_bytes() if registers.exists() else b""
        return pulse_of(found, 0) if len(found) == 256 else 0.0

    async def body() -> None:
        host = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "txt1", "run", "--hal", "pi", "--vehicle", "donkeycar", "--set",
            f"hal_options.bus={registers}", "--arm", "--drive", "0.8,0", "--headless",
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            await until(lambda: motor() > 1530.0, 30.0)
            host.send_signal(number)
            took = await until(lambda: abs(motor() - 1500.0) < 5.0, 5.0)
            assert took <= limit + LATE, f"neutral {took:.3f} s after the signal"
            await asyncio.sleep(0.5)
            assert motor() == pytest.approx(1500.0, abs=5.0)
        finally:
            with suppress(ProcessLookupError):
                host.kill()
            await host.wait()

    run(body())
