"""The core on a desk: a program at the other end of standard input is the vehicle, the clock and the line to the host.

It sends a record for every cycle and gets one back; see `REQUEST` and `REPLY`. Under MicroPython's unix port the core
runs with the heap locked, so a cycle that takes memory ends the run with a MemoryError.
"""

import json
import struct
import sys

from txt1pico import screens
from txt1pico.core import Core
from txt1pico.radio import PWM, Radio

try:
    from micropython import heap_lock, heap_unlock
except ImportError:  # under CPython

    def heap_lock():
        """Do nothing."""

    def heap_unlock():
        """Do nothing."""


REQUEST = "<BBhhHHHH"
"""Periods of 20 ms (0: bytes alone), buttons, counts right and left, mV of both packs, how many bytes follow: of the
host, and of a radio control's receiver."""
REPLY = "<iiiiiBBBBH"
"""The five outputs, switches, state (bits armed, link, manual, buzzer), reason, screen, and how many bytes follow."""
CHUNK = 1024


def fill(source, view):
    """Read until a memoryview is full; False when the other end is gone."""
    done = 0
    while done < len(view):
        count = source.readinto(view[done:])
        if not count:
            return False
        done += count
    return True


def hand_of(words):
    """Return the hand of a radio control whose settings, as JSON, are the first word; None without one."""
    return Radio(json.loads(words[1])) if len(words) > 1 else None


def of_the_receiver(hand, data, count):
    """Hand over what a receiver sends: bytes, or three pulses of two bytes each, us."""
    if hand.protocol != PWM:
        hand.receive(data, count)
    elif count == 6:
        hand.pulses(data[0] | data[1] << 8, data[2] | data[3] << 8, data[4] | data[5] << 8)


def serve(core, source, target):
    """Run the core until the other end closes its output."""
    head = memoryview(bytearray(struct.calcsize(REQUEST)))
    data = bytearray(CHUNK)
    view = memoryview(data)
    panel = screens.Panel()
    while True:
        if not fill(source, head):
            return
        periods, buttons, right, left, one, two, count, radioed = struct.unpack(REQUEST, head)
        fill(source, view[: count + radioed])
        of_radio = view[count : count + radioed]
        heap_lock()
        if count:
            core.receive(data, count)
        if radioed:
            of_the_receiver(core.hand, of_radio, radioed)
        if periods:
            core.step(right, left, one, two, buttons, periods)
            panel.draw(core)
        heap_unlock()
        transmitter = core.transmitter
        state = core.armed | core.link_alive << 1 | core.manual << 2 | core.buzzer << 3
        target.write(
            struct.pack(REPLY, *core.outputs, core.switches, state, core.reason, core.screen, transmitter.length)
        )
        target.write(memoryview(transmitter.buffer)[: transmitter.length])
        target.flush() if hasattr(target, "flush") else None
        transmitter.length = 0


if __name__ == "__main__":
    serve(Core(hand=hand_of(sys.argv)), sys.stdin.buffer, sys.stdout.buffer)
