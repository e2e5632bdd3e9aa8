"""The Pico's program as a whole, on fakes of the chip: whatever happens, it ends neutral."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from txt1pico import facts, store

from tests.unit.firmware import fake_pico
from txt1.config import Config
from txt1.protocol.layout import encode
from txt1.protocol.messages import Velocity


class Over(Exception):
    """Ends the loop of a test."""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The module main.py on fresh fakes, its files in a folder of the test's."""
    monkeypatch.chdir(tmp_path)
    fake_pico.install()
    sys.modules["machine"].reset = lambda: resets.append(1)  # type: ignore[attr-defined]
    resets: list[int] = []
    monkeypatch.setitem(sys.modules, "micropython", ModuleType("micropython"))
    sys.modules["micropython"].kbd_intr = lambda byte: None  # type: ignore[attr-defined]
    hardware = import_module("txt1pico.hardware")
    hardware.select = SimpleNamespace(poll=fake_pico.Poll, POLLIN=1)  # type: ignore[attr-defined]
    monkeypatch.setattr(sys, "print_exception", lambda error, file: file.write(repr(error)), raising=False)
    monkeypatch.setattr("time.ticks_ms", lambda: 1234, raising=False)
    sys.modules.pop("main", None)
    program = import_module("main")
    program.resets = resets  # type: ignore[attr-defined]
    yield program
    sys.modules.pop("main", None)


def driving(program: Any, cycles: int, then: Exception, settings: dict[str, Any] | None = None) -> tuple[Any, Any]:
    """Hardware and core, of a program that has driven for so many cycles and then raised; a wheel turns along."""
    hardware, core, display = program.build(store.check(settings or {}))
    done = 0
    messages = [encode(Config().control.pid_set())]

    def receive(core: Any) -> None:
        nonlocal done
        if done == cycles:
            raise then
        hardware.due, hardware.periods = True, 1
        if done % 5 == 0:
            messages.append(encode(Velocity(0.5, 0.0)))
        while messages:
            data = messages.pop(0)
            core.receive(data, len(data))
        if core.outputs[0]:
            for number in (0, 1):
                fake_pico.StateMachine.counts[number] += 20
        done += 1

    hardware.receive = receive
    hardware.send = lambda core: setattr(core.transmitter, "length", 0)
    with pytest.raises(type(then)):
        program.loop(hardware, core, display)
    return hardware, core


def test_it_drives_and_ends_neutral_with_the_esc_off_whatever_is_raised(program: Any) -> None:
    for then in (Over(), MemoryError(), KeyboardInterrupt()):
        _, core = driving(program, 150, then)
        motor = [ns for ns in fake_pico.Pwm.outputs[2].pulses if ns != 1_500_000]
        assert motor, "it drove"
        assert fake_pico.Pwm.outputs[2].pulses[-1] == 1_500_000
        assert not core.armed and list(core.outputs)[:3] == [0, 0, 0]
        assert fake_pico.Pin(15).values[-1] == 0
        fake_pico.Pin.pins.clear()


def test_a_fault_is_noted_and_the_chip_restarted(program: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise ValueError("a bug")

    monkeypatch.setattr(program, "loop", broken)
    program.main()
    assert program.resets == [1]
    assert "a bug" in (tmp_path / "fault.log").read_text()


def test_a_full_flash_does_not_keep_it_from_restarting(program: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise ValueError("a bug")

    monkeypatch.setattr(program, "loop", broken)
    monkeypatch.setattr(program, "LOG", "/proc/no/such/place")
    program.main()
    assert program.resets == [1]


def test_a_screen_that_stalls_leaves_the_outputs_neutral_after_a_tenth_of_a_second(program: Any) -> None:
    hardware, core, _ = program.build(store.check({}))
    core.outputs[0] = 5000
    hardware.start()
    _, guard = fake_pico.Timer.timers[-2:]

    class Stalled:
        def draw(self, panel: Any) -> None:
            for _ in range(6):  # the guard's timer goes on while the loop waits for the display
                guard.fire()
            raise Over

    hardware.due, hardware.receive = True, lambda core: None
    with pytest.raises(Over):
        program.loop(hardware, core, Stalled())
    assert fake_pico.Pwm.outputs[2].pulses[-1] == 1_500_000


def test_gains_of_the_settings_are_there_at_power_up_and_nothing_moves(program: Any) -> None:
    rows = [[11000, 18000, 250], [-150, 1000, 30000, 5], [1500, 4000, 130000, 5]]
    _, core, _ = program.build(store.check({"gains": rows}))
    assert list(core.linear_gains) == rows[0] and core.set_count == 2 and core.gains_loaded
    for _ in range(200):
        core.step(0, 0, 12000, 0, 0, 1)
    assert list(core.outputs) == [0, 0, 0, 0, 0]
    with pytest.raises(store.SettingsError, match="gains: the first row has three numbers"):
        store.check({"gains": [[1, 2]]})


def test_the_golden_frames_of_the_protocol_are_understood() -> None:
    from txt1pico.frame import Receiver

    frame = bytes.fromhex("FAFB046701F402EE5BED")  # v = 0.5 m/s, omega = 0.75 rad/s
    receiver = Receiver()
    for byte in frame:
        receiver.put(byte)
    at = receiver.next()
    assert (at, receiver.buffer[at + 3]) == (0, facts.VELOCITY)
