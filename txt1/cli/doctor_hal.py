"""Findings of `txt1 doctor --hal NAME` on a hardware layer, and on the Raspberry Pi that may run it."""

import asyncio
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from txt1.hal.base import Hal, Outputs
from txt1.kit.findings import Finding, judged

READING_PERIOD: Final = 0.02  # s
# readings a second of a hardware layer that computes odometry, at least
ODOMETRY_RATE_MIN: Final = 15.0
THROTTLED: Final = (
    (0, "under-voltage now", "a stronger supply, or shorter and thicker wires to it"),
    (2, "slowed down now", "cool it, and look at its supply"),
    (16, "under-voltage since it was switched on", "a stronger supply: motors that start pull it down"),
    (18, "slowed down since it was switched on", "cool it, and look at its supply"),
)
"""Bits of `vcgencmd get_throttled`, their meaning, and the remedy."""


def supply(text: str) -> Finding:
    """Return the remark on an output of `vcgencmd get_throttled`, such as throttled=0x50005."""
    try:
        bits = int(text.strip().partition("=")[2], 16)
    except ValueError:
        return Finding("supply", f"vcgencmd says {text.strip()!r}, which is not understood", False)
    for bit, meaning, remedy in THROTTLED:
        if bits >> bit & 1:
            return Finding("supply", f"{meaning}: {remedy}", False)
    return Finding("supply", "no under-voltage since it was switched on")


def computer() -> Iterator[Finding]:
    """Yield findings on the Raspberry Pi and its supply, if this computer is a Raspberry Pi."""
    model = Path("/proc/device-tree/model")
    if model.exists():
        yield Finding("computer", model.read_text(errors="replace").strip("\0\n "))
    command = shutil.which("vcgencmd")
    if command is not None:
        words = [command, "get_throttled"]
        said = subprocess.run(words, capture_output=True, text=True, check=False, timeout=5.0)  # noqa: S603 - ours
        yield supply(said.stdout or said.stderr)


async def examined(hal: Hal, duration: float) -> list[Finding]:
    """Hold a HAL's outputs neutral for `duration` s; return findings on its reports.

    Raises HalError if it cannot be opened.
    """
    time = asyncio.get_running_loop().time
    await hal.open()
    began, ready, taken, readings, slowest = time(), None, -1.0, 0, 0.0
    inputs = hal.read(0.0)
    try:
        while (now := time() - began) < duration:
            inputs = hal.read(now)
            if ready is None and (inputs.link is None or inputs.link.ready):
                ready = now
            if inputs.odometry is not None and inputs.odometry_time > taken:
                slowest = max(slowest, inputs.odometry_time - taken) if taken > 0.0 else 0.0
                taken, readings = inputs.odometry_time, readings + 1
            hal.write(Outputs(), now)
            await asyncio.sleep(READING_PERIOD)
    finally:
        await hal.close()
    can, link = hal.capabilities, inputs.link
    found = []
    if link is not None:
        cause = "is it on? is this its port? are its transmit and receive lines crossed?"
        text = link.text if ready is None else f"{link.text}; ready after {ready:.1f} s"
        found.append(judged("link", text, ready is not None and link.ready, cause))
        faults = {name: count for name, count in link.faults.items() if count}
        told = ", ".join(f"{count} x {name}" for name, count in faults.items())
        found.append(judged("faults", told or "none", sum(faults.values()) <= 2, "look at cable, ground and baud rate"))
    if can.odometry:
        rate = readings / duration
        text = f"{rate:.0f} a second, at most {1e3 * slowest:.0f} ms apart"
        found.append(judged("odometry", text, rate >= ODOMETRY_RATE_MIN, "the line is slow, or loses answers"))
    if can.ticks and inputs.ticks is not None:
        found.append(Finding("encoders", f"right {inputs.ticks[0]}, left {inputs.ticks[1]} counts"))
    if can.battery:
        volts = None if inputs.batteries is None else max(inputs.batteries)
        text = "not reported" if volts is None else f"{volts:.2f} V"
        found.append(judged("battery", text, bool(volts), "is it switched on, and measured where the HAL looks?"))
    return found
