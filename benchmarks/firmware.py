"""The Pico's firmware under MicroPython's unix port: time and memory of a cycle, and how regular its cycles are here.

    python -m benchmarks firmware

The times are this computer's. A Pico's are not known here.
"""

from __future__ import annotations

import subprocess

from txt1.devices.installer import folder
from txt1.devices.pico import interpreter

HOUR = 180_000
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
print(total / %d, p50, p99, worst, held, gc.mem_alloc() - before - held)
"""


def main(*, quick: bool = False) -> None:
    """Print the figures of an hour of cycles, the heap locked, so that a cycle that took memory would end it."""
    cycles = HOUR // 60 if quick else HOUR
    script = SCRIPT % (cycles, cycles // 2, cycles * 99 // 100, cycles)
    done = subprocess.run([interpreter(), "-c", script], cwd=folder(), capture_output=True, text=True, check=True)
    mean, p50, p99, worst, held, grown = map(float, done.stdout.split())
    print(
        f"{cycles} cycles, the screen drawn: {mean:.1f} us each, p50 {p50:.0f}, p99 {p99:.0f}, at most {worst:.0f} us"
    )
    print(f"memory: {held / 1000:.0f} kB at the start, {grown:.0f} bytes more at the end (the figures' own)")


if __name__ == "__main__":
    main()
