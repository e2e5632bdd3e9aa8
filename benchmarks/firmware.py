"""The Pico's firmware under MicroPython's unix port: time and memory of a cycle, and how regular its cycles are here.

    python -m benchmarks firmware

The times are this computer's. A Pico's are estimated: the bytecodes of a cycle are counted under CPython, which runs
the same core, and divided by the rate at which a Pico runs those of two of MicroPython's own benchmarks, counted alike.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

from txt1.cars.pico.installer import folder
from txt1.cars.pico.virtual_pico import interpreter

HOUR = 180_000
CLOCK = 133 / 125  # MHz of the chip's data sheet by those at which the published times were measured
# Bytecodes a second at 125 MHz: those that CPython 3.11 counts for fannkuch(6) and queens(6), divided by the seconds
# that MicroPython's tests/perf_bench took for them on RPI_PICO (micropython/micropython, pull request 14182)
RATES = {"fannkuch": 114_540 * 53.75 / 6, "queens": 209_865 * 2252.63 / 1000}
SCRIPT = """
import gc, time
from micropython import heap_lock, heap_unlock
before = gc.mem_alloc()
from txt1pico.core import Core
from txt1pico.screens import Panel
core, panel = Core(), Panel()
gc.collect()
held = gc.mem_alloc() - before
message = bytearray(b"\\xfa\\xfb\\x04\\x67\\x01\\xf4\\x02\\xee\\x5b\\xed")
counts = [0] * 1000

def drive():
    worst = total = 0
    heap_lock()
    for k in range(%d):
        start = time.ticks_us()
        if k %% 3 == 0:
            core.receive(message, 10)
        core.step(30, 28, 12000, 0, 0, 1)
        panel.draw(core)
        took = time.ticks_diff(time.ticks_us(), start)
        core.transmitter.length = 0
        total += took
        counts[min(took, 999)] += 1
        worst = max(worst, took)
    heap_unlock()
    return total, worst

total, worst = drive()
seen = p50 = p99 = 0
for took in range(1000):
    seen += counts[took]
    p50 = p50 or (took if seen >= %d else 0)
    p99 = p99 or (took if seen >= %d else 0)
grown = gc.mem_alloc() - before - held

def pace(cycles):
    # in real time, a cycle every 20 ms; returns how late they started, us
    due, late = time.ticks_us(), []
    for k in range(cycles):
        due = time.ticks_add(due, 20000)
        time.sleep_us(max(time.ticks_diff(due, time.ticks_us()), 0))
        late.append(time.ticks_diff(time.ticks_us(), due))
        core.receive(message, 10)
        core.step(30, 28, 12000, 0, 0, 1)
        core.transmitter.length = 0
    late.sort()
    return late[cycles // 2], late[cycles * 99 // 100], late[-1]

print(total / %d, p50, p99, worst, held, grown, *pace(%d))
"""
PACED = 1500  # cycles in real time


def main(*, quick: bool = False) -> None:
    """Print the figures of an hour of cycles, the heap locked, so that a cycle that took memory would end it."""
    cycles = HOUR // 60 if quick else HOUR
    paced = PACED // 10 if quick else PACED
    script = SCRIPT % (cycles, cycles // 2, cycles * 99 // 100, cycles, paced)
    done = subprocess.run([interpreter(), "-c", script], cwd=folder(), capture_output=True, text=True, check=True)
    mean, p50, p99, worst, held, grown, late_50, late_99, latest = map(float, done.stdout.split())
    print(
        f"{cycles} cycles, the screen drawn: {mean:.1f} us each, p50 {p50:.0f}, p99 {p99:.0f}, at most {worst:.0f} us"
    )
    print(f"memory: {held / 1000:.0f} kB at the start, {grown:.0f} bytes more at the end (the figures' own)")
    print(f"{paced} cycles every 20 ms: started late by p50 {late_50:.0f}, p99 {late_99:.0f}, at most {latest:.0f} us")
    estimate()


def estimate() -> None:
    """Print what a cycle takes on a Pico, by the bytecodes of a thousand cycles."""
    sys.path.insert(0, str(folder()))
    core, panel = importlib.import_module("txt1pico.core").Core(), importlib.import_module("txt1pico.screens").Panel()
    message = bytearray.fromhex("fafb046701f402ee5bed")

    def cycle(number: int) -> None:
        if number % 3 == 0:
            core.receive(message, 10)
        core.step(30, 28, 12000, 0, 0, 1)
        panel.draw(core)
        core.transmitter.length = 0

    counted = sorted(bytecodes(cycle, number) for number in range(1000))
    mean, most = sum(counted) / len(counted), counted[-1]
    slow, fast = sorted(CLOCK * rate for rate in RATES.values())
    print(
        f"estimate for a Pico at 133 MHz: {mean:.0f} bytecodes a cycle, at most {most}; {1e3 * mean / fast:.1f} to "
        f"{1e3 * mean / slow:.1f} ms, at most {1e3 * most / fast:.1f} to {1e3 * most / slow:.1f} ms, of 20"
    )


def bytecodes(call: Callable[[int], None], argument: int) -> int:
    """Return how many bytecodes of Python a call runs."""
    count = 0

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal count
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return trace

    sys.settrace(trace)
    try:
        call(argument)
    finally:
        sys.settrace(None)
    return count


if __name__ == "__main__":
    main()
