"""The firmware's hardware module against fakes of the chip, and its PIO program in an emulator."""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest
from pioemu import emulate
from txt1pico import store
from txt1pico.core import Core

from tests.unit.firmware import fake_pico

CLOCK = 133_000_000


@pytest.fixture
def hardware() -> Any:
    """The hardware with its default settings, as after a power-up."""
    return fake_pico.hardware(store.check({}))


def pulses(pin: int) -> list[int]:
    """The pulses put out at a pin, us."""
    return [ns // 1000 for ns in fake_pico.Pwm.outputs[pin].pulses]


def test_every_output_is_low_and_then_neutral_at_power_up(hardware: Any) -> None:
    for pin in (2, 3, 4, 5, 6):
        output = fake_pico.Pwm.outputs[pin]
        assert output.low_before == [0] and output.rate == 50
        assert pulses(pin) == [1500]
    assert fake_pico.Pin(15).values == [0], "the ESC is off until the core says otherwise"


@pytest.mark.parametrize(("counts", "microseconds"), [(-24000, 1000), (0, 1500), (24000, 2000), (12000, 1750)])
def test_a_count_is_a_48th_of_a_microsecond(hardware: Any, counts: int, microseconds: int) -> None:
    core = Core()
    for channel in range(5):
        core.outputs[channel] = counts
    hardware.put(core)
    assert [pulses(pin)[-1] for pin in (2, 3, 4, 5, 6)] == [microseconds] * 5


def test_direction_and_trim_turn_a_channel_round_and_shift_its_neutral() -> None:
    hardware = fake_pico.hardware(store.check({"front_direction": -1, "front_trim": 480}))
    core = Core()
    core.outputs[1] = 4800
    hardware.put(core)
    assert pulses(3) == [1510, 1410]
    hardware.neutral()
    assert pulses(3)[-1] == 1510


def test_the_guard_is_neutral_when_the_loop_stalls_which_feeds_the_watchdog(hardware: Any) -> None:
    core = Core()
    core.outputs[0] = 5000
    hardware.start()
    cycle, guard = fake_pico.Timer.timers
    hardware.put(core)
    hardware.alive()
    for _ in range(5):
        cycle.fire()
        guard.fire()
    assert hardware.periods == 5
    assert pulses(2)[-1] > 1500 and fake_pico.Watchdog.fed == 1
    guard.fire()
    assert pulses(2)[-1] == 1500 and fake_pico.Watchdog.fed == 1


def test_after_a_release_the_outputs_are_neutral_the_esc_off_and_the_chip_stays_up(hardware: Any) -> None:
    hardware.start()
    hardware.stop()
    _, guard = fake_pico.Timer.timers
    guard.fire()
    assert fake_pico.Watchdog.fed == 1
    assert fake_pico.Pin(15).values[-1] == 0 and pulses(2)[-1] == 1500


def test_the_battery_reads_its_divider(hardware: Any) -> None:
    fake_pico.Adc.reading = 49648  # 2.5 V of 3.3
    assert hardware.voltage(0) == pytest.approx(12000, abs=10)
    assert hardware.voltage(1) == 0, "no second pack is fitted"


def test_counts_are_read_once_across_the_end_of_16_bits_and_by_direction() -> None:
    fake_pico.install()
    from txt1pico.quadrature import Quadrature

    fake_pico.StateMachine.counts[0] = 0
    wheel = Quadrature(0, 10, direction=-1)
    for count, moved in ((5, -5), (5, 0), (-3, 8), (-40, 37), (32760, -32800 + 65536)):
        fake_pico.StateMachine.counts[0] = count
        assert wheel.counts() == moved


def edges(rng: random.Random, count: int, rate: float) -> Iterator[tuple[float, int]]:
    """Levels of the two tracks with the clock cycle at which they appear, and at random turned round."""
    grey, position, clock = (0b00, 0b10, 0b11, 0b01), 0, 0.0
    for _ in range(count):
        position += rng.choice((1, 1, 1, -1))
        clock += CLOCK / rate
        yield clock, grey[position % 4]
    yield position, -1


def test_the_pio_program_counts_20000_edges_a_second_both_ways() -> None:
    fake_pico.install()
    from txt1pico.quadrature import quadrature

    *turns, (position, _) = edges(random.Random(1), 60, 20_000.0)
    speed_up = 200  # the emulator is slow: the same program at 4 million edges a second is the harder case
    changes = [(clock / speed_up, level) for clock, level in turns]

    def levels(clock):  # type: ignore[no-untyped-def]  # the emulator reads annotations
        return next((level for at, level in reversed(changes) if at <= clock), 0)

    end = changes[-1][0] + 100
    last: int | None = None
    states = emulate(
        quadrature.code,
        stop_when=lambda _, state: state.clock > end,
        input_source=levels,
        shift_isr_right=False,
        wrap_target=quadrature.wrap_target,
        wrap_top=quadrature.wrap_top,
    )
    for _, state in states:
        while state.receive_fifo:
            last = state.receive_fifo.popleft()
    assert last is not None and (last - (1 << 32) if last >> 31 else last) == position
    assert len(quadrature.code) <= 32


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"motor_pins": 3}, "unknown setting motor_pins"),
        ({"track_width": "wide"}, "track_width: 'wide' is no int"),
        ({"circumference": 5123}, "circumference: 5123 is not a multiple of 5"),
        ({"left_direction": 0}, "left_direction: 0 is neither 1 nor -1"),
    ],
)
def test_a_wrong_setting_is_named(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(store.SettingsError, match=said.replace("(", r"\(")):
        store.check(settings)


def test_a_torn_or_foreign_settings_file_leaves_the_defaults_and_says_so(tmp_path: Any) -> None:
    file = str(tmp_path / "settings.json")
    assert store.load(file) == (store.DEFAULTS, "")
    store.save({"name": "blue"}, file)
    assert store.load(file)[0]["name"] == "blue"
    with open(file, "w") as torn:
        torn.write('{"name": "bl')
    settings, problem = store.load(file)
    assert settings == store.DEFAULTS and "settings.json" in problem


def test_a_full_flash_leaves_the_old_settings(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    file = str(tmp_path / "settings.json")
    store.save({"name": "old"}, file)

    def full(*_: Any) -> None:
        raise OSError(28, "no space")

    monkeypatch.setattr(store.json, "dump", full)
    with pytest.raises(OSError, match="no space"):
        store.save({"name": "new"}, file)
    assert store.load(file)[0]["name"] == "old"


def test_the_pulses_of_a_receivers_servo_outputs_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    import time

    fake_pico.install()
    handlers: list[Any] = []
    monkeypatch.setattr(fake_pico.Pin, "IRQ_RISING", 4, raising=False)
    monkeypatch.setattr(fake_pico.Pin, "IRQ_FALLING", 8, raising=False)
    monkeypatch.setattr(
        fake_pico.Pin, "irq", lambda self, handler, edges, hard: handlers.append((self, handler)), raising=False
    )
    clock = [0]
    monkeypatch.setattr(time, "ticks_us", lambda: clock[0], raising=False)
    monkeypatch.setattr(time, "ticks_diff", lambda a, b: a - b, raising=False)
    inputs = import_module("txt1pico.hardware").ServoInputs([20, 21, 22])
    taken: list[tuple[int, ...]] = []
    hand = SimpleNamespace(pulses=lambda *pulses: taken.append(pulses))
    for k, us in enumerate((1500, 1040, 1980)):
        inputs.take(hand)
        assert taken == [], "not before each has had one"
        pin, changed = handlers[k]
        pin.value(1)
        changed(pin)
        clock[0] += us
        pin.value(0)
        changed(pin)
    inputs.take(hand)
    inputs.take(hand)
    assert taken == [(1500, 1040, 1980)], "once"


@pytest.mark.parametrize(("protocol", "line"), [("sbus", (100000, 0, 2, 1)), ("crsf", (420000, None, None, None))])
def test_a_receivers_uart_has_its_protocols_line(protocol: str, line: tuple[object, ...]) -> None:
    made: list[tuple[object, ...]] = []

    class Uart:
        INV_RX = 1

        def __init__(self, number: int, baud: int, **more: Any) -> None:
            made.append((baud, more.get("parity"), more.get("stop"), more.get("invert")))
            self.waits, self.sent = [b"\xc8\x02"], b""

        def any(self) -> int:
            return len(self.waits)

        def readinto(self, buffer: bytearray) -> int:
            data = self.waits.pop()
            buffer[: len(data)] = data
            return len(data)

        def write(self, data: memoryview) -> None:
            self.sent += bytes(data)

    fake_pico.install()
    sys.modules["machine"].UART = Uart  # type: ignore[attr-defined]
    module = import_module("txt1pico.hardware")
    module.select = SimpleNamespace(poll=fake_pico.Poll, POLLIN=1)  # type: ignore[attr-defined]
    rows = {"throttle": [2, 1000, 1500, 2000], "steering": [1, 1000, 1500, 2000], "switch": [5, 1000, 2000]}
    settings = store.check({"receiver": {"protocol": protocol, "uart": 1, "rx_pin": 9, "tx_pin": 8, **rows}})
    hardware = module.Hardware(settings)
    assert made == [line]
    got: list[bytes] = []
    hand = SimpleNamespace(
        receive=lambda data, count: got.append(bytes(data[:count])), telemetry=bytearray(b"12345"), telemetry_length=3
    )
    core = SimpleNamespace(hand=hand, transmitter=SimpleNamespace(length=0))
    hardware.receive(core)
    hardware.send(core)
    assert got == [b"\xc8\x02"] and hand.telemetry_length == 0
