"""How long outputs go on when the host is killed, the device left alone: `python -m benchmarks.dead_hosts`.

Real time and real processes: the device is here, with its simulated vehicle, or is a guard whose servo board has its
registers in a file; the host drives, and gets a signal at a random instant. The figures go to the pages of the HALs.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import signal
import sys
from asyncio.subprocess import DEVNULL
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, Final

from rigs import page_parts
from txt1.config import load
from txt1.hal.pi.double import pulse_of
from txt1.hal.vesc.double import Vesc
from txt1.hal.waveshare.double import Waveshare
from txt1.kernel.loop import run
from txt1.link.pty import listen_pty

SPEED: Final = 0.8  # m/s
PROGRAM: Final = (sys.executable, "-m", "txt1")
STARTS: Final = 60.0  # s that a host has until it drives
LOOK: Final = 0.002  # s between two looks at the outputs
ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
DOCS: Final = Path(__file__).parents[1] / "docs"

Device = Callable[[Any], Any]
DEVICES: Final[dict[str, tuple[str, Device]]] = {
    "vesc": ("f1tenth", lambda config: Vesc(config, timeout=0.5)),
    "waveshare": ("rover", Waveshare),
}
"""Vehicles, and devices whose time-outs are 0.5 s, by the name of the HAL."""


async def until(condition: Callable[[], bool], patience: float) -> float:
    """Wait for something to become true, and return how long that took, s; TimeoutError when it does not."""
    time = asyncio.get_running_loop().time
    began = time()
    while not condition():
        if time() - began > patience:
            raise TimeoutError(f"not within {patience:g} s")
        await asyncio.sleep(LOOK)
    return time() - began


@asynccontextmanager
async def host(*words: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A host that drives, in a process of its own."""
    drive = ("--arm", "--drive", f"{SPEED:g},0", "--headless")
    process = await asyncio.create_subprocess_exec(*PROGRAM, "run", *words, *drive, stdin=DEVNULL, stdout=DEVNULL)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


async def device_without_host(hal: str, folder: Path, later: float = 0.0) -> float:
    """Seconds from the host's SIGKILL, `later` s after it drives, until the device's motors have no power."""
    vehicle, make = DEVICES[hal]
    device, path = make(load(None, [f"vehicle={vehicle}", *ENDLESS], {}, {"hal": hal}).config), folder / hal
    listener = listen_pty(str(path), device.line)
    await device.power_up()
    try:
        async with host("--hal", hal, "--vehicle", vehicle, "--port", str(path)) as process:
            await until(lambda: device.drives and device.car.vehicle.state.v > 0.9 * SPEED, STARTS)
            await asyncio.sleep(later)
            process.kill()
            took = await until(lambda: not device.drives, 5.0)
            await until(lambda: abs(device.car.vehicle.state.v) < 0.05, 5.0)
            return took
    finally:
        await device.power_down()
        listener.close()


async def guard_without_host(number: signal.Signals, folder: Path, later: float = 0.0) -> float:
    """Seconds from a signal to the host of a Raspberry Pi until its guard puts out neutral, which then lasts."""
    registers = folder / "registers"

    def motor() -> float:
        """The pulse of the motor, us, by the servo board's registers; 0 while nothing comes out."""
        found = registers.read_bytes() if registers.exists() else b""
        return pulse_of(found, 0) if len(found) == 256 else 0.0

    def neutral() -> bool:
        return abs(motor() - 1500.0) < 5.0

    async with host("--hal", "pi", "--vehicle", "donkeycar", "--set", f"hal_options.bus={registers}") as process:
        await until(lambda: motor() > 1530.0, STARTS)
        await asyncio.sleep(later)
        process.send_signal(number)
        took = await until(neutral, 5.0)
        await asyncio.sleep(0.5)
        if not neutral():
            raise AssertionError(f"the guard puts out {motor():.0f} us again")
        return took


Case = Callable[[Path, float], Coroutine[Any, Any, float]]
CASES: Final[tuple[tuple[str, str, Case], ...]] = (
    ("hal-vesc.md", "killed (SIGKILL)", partial(device_without_host, "vesc")),
    ("hal-waveshare.md", "killed (SIGKILL)", partial(device_without_host, "waveshare")),
    ("hal-pi.md", "killed (SIGKILL)", partial(guard_without_host, signal.SIGKILL)),
    ("hal-pi.md", "stopped (SIGSTOP)", partial(guard_without_host, signal.SIGSTOP)),
)
"""The page, what happens to the host, and one round of it."""


def measured(case: Case, rounds: int) -> list[float]:
    """Times of so many rounds, s, each at another instant of the host's cycle; rising."""
    rng, times = random.Random(1), []
    for _ in range(rounds):
        with TemporaryDirectory() as folder:
            times.append(run(case(Path(folder), rng.uniform(0.0, 0.1))))
    return sorted(times)


def main() -> None:
    """Measure, print, and write the pages."""
    parser = argparse.ArgumentParser(prog="benchmarks.dead_hosts", description=__doc__)
    parser.add_argument("--rounds", type=int, default=20, metavar="N", help="so many of each case; default 20")
    rounds: int = parser.parse_args().rounds
    told: dict[str, list[str]] = {}
    for page, event, case in CASES:
        load_then = os.getloadavg()[0]
        times = measured(case, rounds)
        told.setdefault(page, []).append(
            f"- Host {event} while it drives, {rounds} times: {median(times):.3f} s at the median, "
            f"{times[-1]:.3f} s at most; load of the machine {load_then:.1f}"
        )
        print(page, told[page][-1], flush=True)
    for page, lines in told.items():
        page_parts.write(DOCS / page, "dead_hosts", "\n".join(lines), "benchmarks.dead_hosts")


if __name__ == "__main__":
    main()
