"""How long outputs go on when host or guard is killed or hangs: `python -m benchmarks.dead_hosts`.

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
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from math import inf, isinf
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, Final

from rigs import page_parts
from txt1.cars.pi.chips import pulse_of
from txt1.cars.pi.virtual_pi import Monostable
from txt1.cars.vesc.virtual_vesc import Vesc
from txt1.cars.waveshare.virtual_rover import Waveshare
from txt1.config import load
from txt1.kernel.loop import run
from txt1.link.pty import listen_pty

SPEED: Final = 0.8  # m/s
PROGRAM: Final = (sys.executable, "-m", "txt1")
STARTS: Final = 60.0  # s that a host has until it drives
LEFT: Final = 5.0  # s after which outputs that still drive do so for ever
NAMESPACE: Final = ("unshare", "--user", "--map-root-user", "--pid", "--fork", "--mount-proc", "--kill-child")
HEAD: Final = (
    f"| what happens | of {{rounds}} times left driving | median | at most | load of the machine |\n|{'---|' * 5}"
)
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
async def host(*words: str, before: Sequence[str] = ()) -> AsyncIterator[asyncio.subprocess.Process]:
    """A host that drives, in a process of its own, which the words `before` start."""
    drive = ("--arm", "--drive", f"{SPEED:g},0", "--headless")
    process = await asyncio.create_subprocess_exec(
        *before, *PROGRAM, "run", *words, *drive, stdin=DEVNULL, stdout=DEVNULL
    )
    try:
        yield process
    finally:
        with suppress(OSError):  # a guard that was stopped would stay for ever
            for guard in guards(process.pid):
                os.kill(guard, signal.SIGCONT)
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
        model = ("--set", "hal_options.model=ugv-rover") if hal == "waveshare" else ()
        async with host("--hal", hal, "--vehicle", vehicle, "--port", str(path), *model) as process:
            await until(lambda: device.drives and device.car.vehicle.state.v > 0.9 * SPEED, STARTS)
            await asyncio.sleep(later)
            process.kill()
            took = await until(lambda: not device.drives, 5.0)
            await until(lambda: abs(device.car.vehicle.state.v) < 0.05, 5.0)
            return took
    finally:
        await device.power_down()
        listener.close()


class Outputs:
    """What comes out of a servo board whose registers are in a file, as its guard and its watchdog leave it."""

    def __init__(self, folder: Path, watchdog: bool) -> None:
        self._registers, self._pin = folder / "registers", folder / "registers.watchdog"
        self._watchdog, self._monostable = watchdog, Monostable()
        option = ("--set", "hal_options.watchdog=22") if watchdog else ()
        self.words = ("--hal", "pi", "--vehicle", "donkeycar", "--set", f"hal_options.bus={self._registers}", *option)
        """The robot's options."""

    def motor(self) -> float:
        """The pulse of the motor, us; 0 while nothing comes out."""
        found = self._registers.read_bytes() if self._registers.exists() else b""
        if self._watchdog:
            now = asyncio.get_running_loop().time()
            level = self._pin.read_bytes() if self._pin.exists() else b""
            self._monostable.set(level == b"\1", now)
            if now >= self._monostable.ends:
                return 0.0
        return pulse_of(found, 0) if len(found) == 256 else 0.0

    def drives(self) -> bool:
        """Whether the motor is told to run forward."""
        return self.motor() > 1530.0

    def at_rest(self) -> bool:
        """Whether the motor is told to stand, or nothing is told."""
        return not self.motor() or abs(self.motor() - 1500.0) < 5.0


def children(process: int) -> list[int]:
    """The processes that one has started, by any of its threads."""
    found = []
    for thread in Path(f"/proc/{process}/task").iterdir():
        found += [int(word) for word in (thread / "children").read_text().split()]
    return found


def guards(process: int) -> list[int]:
    """The guards among the processes that one has started, and theirs."""
    found = []
    for child in children(process):
        found += [child] if b"guard.py" in Path(f"/proc/{child}/cmdline").read_bytes() else guards(child)
    return found


Blow = Callable[[int], None]
"""What happens, given the process that was started."""


def to_host(number: signal.Signals) -> Blow:
    """A signal to the robot's process."""
    return lambda process: os.kill(process, number)


def to_guard(number: signal.Signals) -> Blow:
    """A signal to the guard."""
    return lambda process: os.kill(guards(process)[0], number)


def to_both(number: signal.Signals) -> Blow:
    """A signal to the guard and at once to the robot's process."""

    def blow(process: int) -> None:
        for each in (*guards(process), process):
            os.kill(each, number)

    return blow


def in_namespace(number: signal.Signals, init: bool) -> Blow:
    """A signal to process 1 of a pid namespace, which is our small init, or to the robot's process behind it."""

    def blow(process: int) -> None:
        (first,) = children(process)
        (behind,) = children(first)
        os.kill(first if init else behind, number)

    return blow


async def guard_after(
    blow: Blow, folder: Path, later: float = 0.0, watchdog: bool = False, namespace: bool = False
) -> float:
    """Seconds from a blow to the robot of a Raspberry Pi until its outputs are at rest and stay so; inf: never."""
    outputs = Outputs(folder, watchdog)
    async with host(*outputs.words, before=NAMESPACE if namespace else ()) as process:
        await until(outputs.drives, STARTS)
        await watched(outputs, later)
        blow(process.pid)
        try:
            took = await until(outputs.at_rest, LEFT)
        except TimeoutError:
            return inf
        if not await watched(outputs, 0.5):
            raise AssertionError(f"the motor is told {outputs.motor():.0f} us again")
        return took


async def watched(outputs: Outputs, duration: float) -> bool:
    """Look at the outputs all the time, as the watchdog does, and return whether they were at rest all the time."""
    time = asyncio.get_running_loop().time
    began, rest = time(), True
    while time() - began < duration:
        rest = outputs.at_rest() and rest
        await asyncio.sleep(LOOK)
    return rest


Case = Callable[[Path, float], Coroutine[Any, Any, float]]
KILLED, STOPPED = signal.SIGKILL, signal.SIGSTOP
CASES: Final[tuple[tuple[str, str, Case], ...]] = (
    ("hal-vesc.md", "Host killed (SIGKILL)", partial(device_without_host, "vesc")),
    ("hal-waveshare.md", "Host killed (SIGKILL)", partial(device_without_host, "waveshare")),
    ("hal-pi.md", "Host and guard killed at once", partial(guard_after, to_both(KILLED))),
    (
        "hal-pi.md",
        "Process 1 of a pid namespace killed",
        partial(guard_after, in_namespace(KILLED, True), namespace=True),
    ),
    (
        "hal-pi.md",
        "The same, with a watchdog",
        partial(guard_after, in_namespace(KILLED, True), namespace=True, watchdog=True),
    ),
    (
        "hal-pi.md",
        "Host and guard killed at once, with a watchdog",
        partial(guard_after, to_both(KILLED), watchdog=True),
    ),
    (
        "hal-pi.md",
        "Host and guard stopped (SIGSTOP) at once, with a watchdog",
        partial(guard_after, to_both(STOPPED), watchdog=True),
    ),
    ("hal-pi.md", "Host killed in a pid namespace", partial(guard_after, in_namespace(KILLED, False), namespace=True)),
    ("hal-pi.md", "Host killed", partial(guard_after, to_host(KILLED))),
    ("hal-pi.md", "Host stopped", partial(guard_after, to_host(STOPPED))),
    ("hal-pi.md", "Guard killed", partial(guard_after, to_guard(KILLED))),
    ("hal-pi.md", "Guard stopped", partial(guard_after, to_guard(STOPPED))),
)
"""The page, what happens, and one round of it; first what may fail."""


def measured(case: Case, rounds: int) -> list[float]:
    """Times of so many rounds, s, each at another instant of the host's cycle; rising."""
    rng, times = random.Random(1), []
    for _ in range(rounds):
        with TemporaryDirectory() as folder:
            times.append(run(case(Path(folder), rng.uniform(0.0, 0.1))))
    return sorted(times)


def told_of(time: float) -> str:
    """A time in words."""
    return "never" if isinf(time) else f"{time:.3f} s"


def main() -> None:
    """Measure, print, and write the pages."""
    parser = argparse.ArgumentParser(prog="benchmarks.dead_hosts", description=__doc__)
    parser.add_argument("--rounds", type=int, default=20, metavar="N", help="so many of each case; default 20")
    parser.add_argument("--page", metavar="NAME", help="only the cases of this page, such as hal-pi.md")
    given = parser.parse_args()
    rounds: int = given.rounds
    told: dict[str, list[str]] = {}
    for page, event, case in CASES:
        if given.page not in (None, page):
            continue
        load_then = os.getloadavg()[0]
        times = measured(case, rounds)
        told.setdefault(page, [HEAD.format(rounds=rounds)]).append(
            f"| {event} | {sum(map(isinf, times))} | {told_of(median(times))} | {told_of(times[-1])} "
            f"| {load_then:.1f} |"
        )
        print(page, told[page][-1], flush=True)
    for page, lines in told.items():
        page_parts.write(DOCS / page, "dead_hosts", "\n".join(lines), "benchmarks.dead_hosts")


if __name__ == "__main__":
    main()
