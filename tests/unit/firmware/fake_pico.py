"""Fakes of MicroPython's `machine` and `rp2` for tests on a computer: they note what the firmware does to its pins."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

CONDITIONS = {None: 0, "not_x": 1, "x_dec": 2, "not_y": 3, "y_dec": 4, "x_not_y": 5, "pin": 6}
SOURCES = {"pins": 0, "x": 1, "y": 2, "null": 3, "isr": 6, "osr": 7}
TARGETS = {"pins": 0, "x": 1, "y": 2, "pc": 5, "isr": 6, "osr": 7}


class Program:
    """A PIO program, assembled by the instruction set's table in the RP2040's data sheet, section 3.4."""

    def __init__(self, function: Callable[[], None]) -> None:
        self.labels: dict[str, int] = {}
        self.wrap_target = self.wrap_top = 0
        for _ in range(2):  # the second time all labels are known
            self.code: list[int] = []
            names: dict[str, Any] = {
                name: name for name in ("x", "y", "pins", "isr", "osr", "null", "pc", "x_dec", "y_dec")
            }
            names |= {
                "jmp": self._jmp,
                "in_": self._in,
                "mov": self._mov,
                "push": self._push,
                "label": self._label,
                "wrap_target": self._wrap_target,
                "wrap": self._wrap,
                "invert": lambda source: ("invert", source),
                "noblock": 0,
            }
            FunctionType(function.__code__, names)()

    def _label(self, name: str) -> None:
        self.labels[name] = len(self.code)

    def _wrap_target(self) -> None:
        self.wrap_target = len(self.code)

    def _wrap(self) -> None:
        self.wrap_top = len(self.code) - 1

    def _jmp(self, *words: str) -> None:
        condition, target = words if len(words) == 2 else (None, words[0])
        self.code.append(CONDITIONS[condition] << 5 | self.labels.get(target, 0))

    def _in(self, source: str, bits: int) -> None:
        self.code.append(0b010 << 13 | SOURCES[source] << 5 | bits % 32)

    def _push(self, block: int) -> None:
        self.code.append(0b100 << 13 | block << 5)

    def _mov(self, target: str, source: str | tuple[str, str]) -> None:
        invert = isinstance(source, tuple)
        name = source[1] if isinstance(source, tuple) else source
        self.code.append(0b101 << 13 | TARGETS[target] << 5 | invert << 3 | SOURCES[name])


class Pin:
    """A pin that keeps what was put out, and every value in order."""

    IN, OUT, PULL_UP = 0, 1, 2
    pins: dict[int, Pin] = {}  # noqa: RUF012 - shared on purpose: there is one set of pins

    def __new__(cls, number: int, mode: int = IN, pull: int | None = None, value: int | None = None) -> Pin:
        if number not in cls.pins:
            cls.pins[number] = super().__new__(cls)
            cls.pins[number].values = []
        return cls.pins[number]

    def __init__(self, number: int, mode: int = IN, pull: int | None = None, value: int | None = None) -> None:
        self.number = number
        self.values: list[int]
        if value is not None:
            self.values.append(value)

    def value(self, value: int | None = None) -> int:
        """Put out a value, or return the present one; an input nobody drives is pulled up."""
        if value is not None:
            self.values.append(value)
        return self.values[-1] if self.values else 1


class Pwm:
    """A PWM output: its pulses in ns, in order."""

    outputs: dict[int, Pwm] = {}  # noqa: RUF012

    def __init__(self, pin: Pin) -> None:
        self.rate = 0
        self.pulses: list[int] = []
        self.low_before = list(pin.values)
        Pwm.outputs[pin.number] = self

    def freq(self, rate: int) -> None:
        """Set the rate, Hz."""
        self.rate = rate

    def duty_ns(self, ns: int) -> None:
        """Set the pulse's length."""
        self.pulses.append(ns)


class Timer:
    """A timer that fires when a test calls `fire`."""

    PERIODIC = 1
    timers: list[Timer] = []  # noqa: RUF012

    def __init__(self) -> None:
        self.callback: Callable[[Timer], None] | None = None
        Timer.timers.append(self)

    def init(self, *, callback: Callable[[Timer], None], **_: Any) -> None:
        """Start it."""
        self.callback = callback

    def deinit(self) -> None:
        """Stop it."""
        self.callback = None

    def fire(self) -> None:
        """Let its time come."""
        if self.callback is not None:
            self.callback(self)


class Watchdog:
    """A watchdog that counts how often it was fed."""

    fed = 0

    def __init__(self, timeout: int) -> None:
        self.timeout = timeout
        Watchdog.fed = 0

    def feed(self) -> None:
        """Feed it."""
        Watchdog.fed += 1


class Adc:
    """A converter that reads what a test says, of 65535."""

    reading = 40000

    def __init__(self, pin: Pin) -> None:
        self.pin = pin

    def read_u16(self) -> int:
        """Return the reading."""
        return Adc.reading


class StateMachine:
    """A state machine whose count a test sets."""

    counts: dict[int, int] = {}  # noqa: RUF012

    def __init__(self, number: int, program: Program, in_base: Pin) -> None:
        self.number, self.program, self.in_base = number, program, in_base
        StateMachine.counts[number] = 0

    def active(self, on: int) -> None:
        """Start it."""

    def get(self, buffer: Any) -> None:
        """Put the low 16 bits of the count into a buffer."""
        buffer[0] = StateMachine.counts[self.number] & 0xFFFF


def install() -> None:
    """Make the fakes what `import machine` and `import rp2` find, everything as after a power-up."""
    Pin.pins.clear()
    Pwm.outputs.clear()
    Timer.timers.clear()
    machine, rp2 = ModuleType("machine"), ModuleType("rp2")
    for name, fake in (("Pin", Pin), ("PWM", Pwm), ("Timer", Timer), ("WDT", Watchdog), ("ADC", Adc), ("UART", None)):
        setattr(machine, name, fake)
    rp2.PIO = type("PIO", (), {"SHIFT_LEFT": 0, "SHIFT_RIGHT": 1})  # type: ignore[attr-defined]
    rp2.StateMachine = StateMachine  # type: ignore[attr-defined]
    rp2.asm_pio = lambda **_: Program  # type: ignore[attr-defined]
    sys.modules |= {"machine": machine, "rp2": rp2}
    for name in ("txt1pico.quadrature", "txt1pico.hardware"):
        sys.modules.pop(name, None)


class Poll:
    """A line on which nothing comes."""

    def register(self, stream: object, events: int) -> None:
        """Watch a stream."""

    def poll(self, timeout: int) -> list[object]:
        """Return the streams with something to read."""
        return []


def hardware(settings: dict[str, Any]) -> Any:
    """The firmware's hardware on fresh fakes, as after a power-up."""
    install()
    module = import_module("txt1pico.hardware")
    module.select = SimpleNamespace(poll=Poll, POLLIN=1)  # type: ignore[attr-defined]
    return module.Hardware(settings)
