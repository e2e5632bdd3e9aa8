"""An SSD1306 of 128 x 64 points on I2C, fed a line of text at a time so that no cycle waits for it."""

import framebuf
from machine import I2C, Pin

from txt1pico.screens import LINES

ADDRESS = 0x3C
COMMAND, DATA = b"\x80", 0x40
START = bytes(
    (
        0xAE,
        0x20,
        0x00,
        0x40,
        0xA1,
        0xA8,
        63,
        0xC8,
        0xD3,
        0,
        0xDA,
        0x12,
        0xD5,
        0x80,
        0xD9,
        0xF1,
        0xDB,
        0x30,
        0x81,
        0xFF,
        0xA4,
        0xA6,
        0x8D,
        0x14,
        0xAF,
    )
)
"""Horizontal addressing, 64 rows, charge pump, on: the chip's data sheet, section 'Application example'."""
ROW = 8
"""Rows of points to a line of text."""


class Display:
    """The LCD's place. A display that does not answer is left alone."""

    def __init__(self, sda, scl):
        self._i2c = I2C(sda >> 1 & 1, sda=Pin(sda), scl=Pin(scl), freq=400000, timeout=2000)
        self._page = bytearray(129)
        self._page[0] = DATA
        self._frame = framebuf.FrameBuffer(memoryview(self._page)[1:], 128, ROW, framebuf.MONO_VLSB)
        self._window = bytearray((0x00, 0x21, 0, 127, 0x22, 0, 7))
        self._next = 0
        self.works = True
        self._try(self._begin)

    def _begin(self):
        for command in START:
            self._i2c.writeto(ADDRESS, bytes((0x80, command)))

    def _try(self, action):
        """Do something with the chip; give it up when it does not answer."""
        if self.works:
            try:
                action()
            except OSError:
                self.works = False

    def draw(self, panel):
        """Draw the next line of a panel; six calls draw them all."""
        self._frame.fill(0)
        self._frame.text(str(panel.lines[self._next], "ascii"), 0, 0)
        self._window[5] = self._next
        self._try(self._send)
        self._next = (self._next + 1) % LINES

    def _send(self):
        self._i2c.writeto(ADDRESS, self._window)
        self._i2c.writeto(ADDRESS, self._page)
