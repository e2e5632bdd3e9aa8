"""Quadrature counting by a PIO state machine, with no help of the processor (spec of the encoders: thesis 3.7.1).

The program samples both tracks, joins them with the sample before to a number from 0 to 15, and jumps there: an edge
one way adds 1 to the count, one the other way takes 1 away, and anything else leaves it. Every round the count goes to
the FIFO unless that is full, so a reader empties the FIFO and takes the next value. A round takes at most 12
instructions: at 133 MHz it sees edges that are 90 ns apart.
"""

from array import array

import rp2
from machine import Pin

FRESH = 5
"""Values to read until one is new: the FIFO holds four."""


@rp2.asm_pio(in_shiftdir=rp2.PIO.SHIFT_LEFT, out_shiftdir=rp2.PIO.SHIFT_RIGHT)
def quadrature():
    """Count in X, the sample before in Y; the table has to begin at instruction 0."""
    # fmt: off
    jmp("next")             # 00 -> 00
    jmp("down")             # 00 -> 01
    jmp("up")               # 00 -> 10
    jmp("next")             # 00 -> 11: two edges at once; one was missed
    jmp("up")               # 01 -> 00
    jmp("next")             # 01 -> 01
    jmp("next")             # 01 -> 10
    jmp("down")             # 01 -> 11
    jmp("down")             # 10 -> 00
    jmp("next")             # 10 -> 01
    jmp("next")             # 10 -> 10
    jmp("up")               # 10 -> 11
    jmp("next")             # 11 -> 00
    jmp("up")               # 11 -> 01
    label("down")           # 11 -> 10, and all that go the same way
    jmp(x_dec, "next")
    label("next")           # 11 -> 11, and all that stay
    wrap_target()
    mov(isr, x)
    push(noblock)
    mov(isr, null)
    in_(y, 2)
    mov(y, pins)
    in_(y, 2)
    mov(pc, isr)
    label("up")
    mov(x, invert(x))
    jmp(x_dec, "again")
    label("again")
    mov(x, invert(x))
    wrap()
    # fmt: on


class Quadrature:
    """A wheel's counter on two neighbouring pins.

    Args:
        machine: number of the state machine, 0 to 3: they share one program.
        pin: of track A; track B is the next one.
        direction: 1, or -1 where forward counts down.

    """

    def __init__(self, machine, pin, direction=1):
        self._machine = rp2.StateMachine(machine, quadrature, in_base=Pin(pin, Pin.IN, Pin.PULL_UP))
        Pin(pin + 1, Pin.IN, Pin.PULL_UP)
        self._direction = direction
        self._count = array("H", (0,))  # the low 16 bits: a number of all 32 would need memory
        self._machine.active(1)
        self._before = self._read()

    def _read(self):
        for _ in range(FRESH):
            self._machine.get(self._count)
        return self._count[0]

    def counts(self):
        """Return the counts since the last call, forward positive, for at most 20 turns of the wheel."""
        now = self._read()
        moved = (now - self._before) & 0xFFFF
        self._before = now
        if moved & 0x8000:
            moved -= 0x10000
        return moved * self._direction
