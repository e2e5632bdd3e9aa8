"""The TXT-1's board on a Raspberry Pi Pico. The core runs unchanged under CPython and every port of MicroPython."""

VERSION = "0.2"
