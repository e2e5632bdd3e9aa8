"""The board in portable C answers byte for byte as the core of the Pico's firmware, whatever a host sends."""

from __future__ import annotations

import ctypes
import random
import runpy
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from txt1pico import facts
from txt1pico.core import Core

from txt1.config import Config
from txt1.protocol.decoder import Decoder, FrameFault
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)

ROOT = Path(__file__).parents[3]
LIBRARY = ROOT / "firmware" / "arduino"
SOURCE = LIBRARY / "src" / "txt1_board.c"
GAINS = Config().control.pid_set()
IDENTITY = b"txt1 C board"
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wno-sign-conversion", "-pedantic", "-Werror"]
COMPILER = shutil.which("cc")
needs_a_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")


class Head(ctypes.Structure):
    """The first members of struct txt1_board."""

    _fields_ = (
        ("outputs", ctypes.c_int32 * 5),
        ("switches", ctypes.c_int32),
        ("armed", ctypes.c_bool),
        ("reason", ctypes.c_int),
        ("link_alive", ctypes.c_bool),
        ("buzzer", ctypes.c_bool),
    )


class CBoard:
    """The compiled board."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        library.txt1_board_take.restype = ctypes.POINTER(ctypes.c_uint8)
        self._memory = ctypes.create_string_buffer(library.size_of_board())
        self.head = Head.from_buffer(self._memory)
        library.txt1_board_begin(self._memory, facts.CIRCUMFERENCE, facts.TRACK_WIDTH, IDENTITY)

    def receive(self, data: bytes) -> None:
        self._library.txt1_board_receive(self._memory, data, ctypes.c_size_t(len(data)))

    def step(self, *inputs: int) -> None:
        self._library.txt1_board_step(self._memory, *inputs)

    def take(self) -> bytes:
        count = ctypes.c_size_t()
        data = self._library.txt1_board_take(self._memory, ctypes.byref(count))
        return ctypes.string_at(data, count.value)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The library, compiled by this computer's compiler; overflows of integers end the program."""
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("c")
    wrapper = folder / "wrapper.c"
    wrapper.write_text(f'#include "{SOURCE}"\nint size_of_board(void) {{ return (int)sizeof(struct txt1_board); }}\n')
    made = folder / "board.so"
    trapping = ["-fsanitize=signed-integer-overflow,bounds,shift-exponent", "-fsanitize-undefined-trap-on-error"]
    words = [COMPILER, "-std=c99", "-O1", *trapping, "-shared", "-fPIC", "-o", str(made), str(wrapper)]
    subprocess.run(words, check=True)
    return ctypes.CDLL(str(made))


def a_host(rng: random.Random) -> bytes:
    """The bytes of a host in a cycle: often a set-point, at times anything else, or damaged."""
    choices: list[Callable[[], bytes]] = [
        lambda: encode(Velocity(rng.uniform(-1.8, 1.8), rng.uniform(-3.0, 3.0))),
        lambda: encode(GAINS),
        lambda: encode(PidSet((rng.uniform(0.0, 300.0), rng.uniform(0, 50), 0.0), ())),
        lambda: encode(CombinedOdometry(1.0, 2.0, 0.3, rng.uniform(-4.0, 4.0), rng.uniform(-4.0, 4.0))),
        lambda: encode(PwmTest(*(rng.randrange(-(2**31), 2**31) for _ in range(5)))),
        lambda: encode(PwmCommand(rng.randrange(-30000, 30000), 5)),
        lambda: encode(PowerControl(rng.choice(list(Switch)), rng.random() < 0.7)),
        lambda: bytes((0xFA, 0xFB, 0, facts.IDENTITY, 0, facts.IDENTITY)),
        lambda: rng.randbytes(rng.randrange(40)),
        lambda: bytes((0xFA, 0xFB, 0xF0, 0x70)) + rng.randbytes(60),
        lambda: bytes((0xFA, 0xFB, 0x11, 0x70)),
    ]
    data = rng.choice(choices)()
    if data and rng.random() < 0.1:
        place = rng.randrange(len(data))
        data = data[:place] + bytes((data[place] ^ 1 << rng.randrange(8),)) + data[place + 1 :]
    return data[: rng.randrange(len(data) + 1)] if rng.random() < 0.1 else data


def session(seed: int, library: ctypes.CDLL, cycles: int) -> int:
    """Drive both with the same host, wheels and packs, and compare them in each cycle; return the bytes they sent."""
    rng, core, board, sent = random.Random(seed), Core(identity=IDENTITY), CBoard(library), 0
    chatty, wild = rng.random(), rng.random() < 0.3
    volts = rng.choice((0, 9300, 12000))
    v = rng.uniform(-1.2, 1.2)
    for data in (encode(GAINS), encode(Velocity(0.0, 0.0))):
        core.receive(data, len(data))
        board.receive(data)
    for cycle in range(cycles):
        data = b""
        if cycle % 5 in (0, 2):
            # a host lets go at times, so that the gate opens again
            asked = 0.0 if cycle // 100 % 3 == 0 else v
            data = encode(Velocity(asked, 0.3))
        if rng.random() < 0.2 * chatty:
            data += a_host(rng)
        core.receive(data, len(data))
        board.receive(data)
        counts = int(core.outputs[0] / 150)
        wheels = (counts, counts) if not wild else (rng.randrange(-60, 60), rng.randrange(-60, 60))
        volts = max(0, volts - rng.randrange(3))
        buttons = 16 if rng.random() < 0.01 else 0
        periods = 1 if rng.random() < 0.97 else rng.randrange(1, 9)
        core.step(*wheels, volts, 0, buttons, periods)
        board.step(*wheels, volts, 0, buttons, periods)
        transmitter = core.transmitter
        theirs = bytes(transmitter.buffer[: transmitter.length])
        transmitter.length = 0
        ours = board.take()
        assert ours == theirs, (seed, cycle)
        head = board.head
        told = list(head.outputs), head.switches, head.armed, head.reason, head.link_alive, head.buzzer
        expected = list(core.outputs), core.switches, core.armed, core.reason, core.link_alive, core.buzzer
        assert told == expected, (seed, cycle)
        sent += len(ours)
    return sent


def test_it_answers_as_the_picos_core_does_byte_for_byte(library: ctypes.CDLL) -> None:
    assert sum(session(seed, library, 1500) for seed in range(12)) > 50_000


@pytest.mark.long
def test_it_answers_as_the_picos_core_does_in_many_hours(library: ctypes.CDLL) -> None:
    assert sum(session(seed, library, 3000) for seed in range(100, 600)) > 1_000_000


def test_what_it_sends_is_what_the_virtual_board_would_send_of_the_same_values(library: ctypes.CDLL) -> None:
    """txt1's own encoder, by which the virtual board sends, makes the same bytes of what the decoder reads."""
    board, decoder, spacer, kinds = CBoard(library), Decoder(Role.HOST), b"\x00", set()
    board.receive(encode(GAINS))
    for k in range(400):
        if k % 5 in (0, 2):
            board.receive(encode(Velocity(-0.6 if k > 200 else 0.6, 0.4)))
        counts = int(board.head.outputs[0] / 150)
        board.step(counts, counts - (counts > 0), 12000, 11950, 0, 1)
        sent = board.take()
        events = [event for event in decoder.feed(sent) if not isinstance(event, FrameFault)]
        kinds |= {type(event) for event in events}
        assert spacer.join(encode(event) for event in events) == sent
    assert kinds == {PidResponse, EncoderOdometry, BatteryLevels}


def test_nothing_moves_before_gains_have_come_and_a_silent_host_stops_it(library: ctypes.CDLL) -> None:
    board = CBoard(library)

    def run(seconds: float, v: float | None) -> None:
        for k in range(round(seconds / 0.02)):
            if v is not None and k % 5 in (0, 2):
                board.receive(encode(Velocity(v, 0.0)))
            board.step(1, 1, 0, 0, 0, 1)

    run(3.0, 0.5)
    assert list(board.head.outputs) == [0] * 5, "it has no gains"
    board.receive(encode(GAINS))
    run(3.0, 0.0)
    run(0.2, 0.5)
    assert board.head.armed and board.head.outputs[0] > 0
    run(0.27, None)
    assert list(board.head.outputs)[:3] == [0, 0, 0]


def test_odometry_of_any_counts_overflows_nothing(library: ctypes.CDLL) -> None:
    board, rng = CBoard(library), random.Random(1)
    for _ in range(2000):
        right, left = (rng.choice((-(2**31), 2**31 - 1, 2000, -2000, 0)) for _ in range(2))
        board.step(right, left, -5, 2**31 - 1, 0, rng.choice((-1, 0, 1, 100, 2**31 - 1)))


def test_the_shared_numbers_are_those_of_txt1() -> None:
    made = runpy.run_path(str(ROOT / "firmware" / "make_facts.py"))
    assert made["HEADER"].read_text() == made["header"](), "run: python firmware/make_facts.py"


@needs_a_compiler
@pytest.mark.parametrize("language", [["-x", "c", *STRICT], ["-x", "c++", "-fsyntax-only", "-Wall", "-Werror"]])
def test_it_compiles_without_a_warning_and_without_a_library(language: list[str], tmp_path: Path) -> None:
    source = SOURCE if "c" in language else LIBRARY / "src" / "txt1_board.h"
    words = [str(COMPILER), *language, "-Os", "-ffreestanding", "-c", "-o", str(tmp_path / "board.o"), str(source)]
    assert subprocess.run(words, check=False, capture_output=True, text=True).stderr == ""


TARGETS = {
    "Cortex-M0+ (Pico)": ("arm-none-eabi", "-mcpu=cortex-m0plus", "-mthumb"),
    "Cortex-M4 (Uno R4)": ("arm-none-eabi", "-mcpu=cortex-m4", "-mthumb"),
    "Cortex-M7 (Teensy 4)": ("arm-none-eabi", "-mcpu=cortex-m7", "-mthumb"),
    "RISC-V (ESP32-C3)": ("riscv64-unknown-elf", "-march=rv32imc", "-mabi=ilp32"),
    # of ESP32's LX6 and LX7 Debian has no compiler
    "Xtensa LX106 (ESP8266)": ("xtensa-lx106-elf",),
}


@pytest.mark.parametrize("target", TARGETS)
def test_it_compiles_for_a_microcontroller_and_needs_no_heap(target: str, tmp_path: Path) -> None:
    prefix, *kind = TARGETS[target]
    if shutil.which(f"{prefix}-gcc") is None:
        pytest.skip(f"there is no compiler for a {target}")
    made = tmp_path / "board.o"
    words = [f"{prefix}-gcc", *STRICT, *kind, "-Os", "-ffreestanding", "-c", "-o", str(made), str(SOURCE)]
    assert subprocess.run(words, check=False, capture_output=True, text=True).stderr == ""
    wanted = subprocess.run([f"{prefix}-nm", "-u", str(made)], check=True, capture_output=True, text=True).stdout
    # the compiler's own arithmetic, and what it makes of loops
    names = set(wanted.split()) - {"U", "memset", "memcpy", "memmove", "strlen"}
    assert all(name.startswith("__") for name in names), names


BOARDS = {"ESP32": "ARDUINO_ARCH_ESP32", "Teensy": "TEENSYDUINO", "Uno R4": "ARDUINO_UNOR4_MINIMA"}
# as much of Arduino's own headers as the sketch uses
ARDUINO = """
#pragma once
#include <stddef.h>
#include <stdint.h>
enum { INPUT_PULLUP, OUTPUT, LOW, CHANGE };
void pinMode(int, int); void digitalWrite(int, int); int digitalRead(int);
int digitalPinToInterrupt(int); void attachInterrupt(int, void (*)(), int);
void noInterrupts(); void interrupts(); unsigned long millis();
struct SerialPort { void begin(long); int available(); int read(); size_t write(const uint8_t *, size_t); };
extern SerialPort Serial;
struct Servo { void attach(int, int, int); void writeMicroseconds(int); };
struct Wdt { void begin(unsigned long); void refresh(); };
extern Wdt WDT;
struct WDT_timings_t { double timeout; };
enum { WDT1 };
template <int> struct WDT_T4 { void begin(WDT_timings_t); void feed(); };
struct esp_task_wdt_config_t { unsigned long timeout_ms; unsigned idle_core_mask; bool trigger_panic; };
enum { ESP_OK };
int esp_task_wdt_init(const esp_task_wdt_config_t *); int esp_task_wdt_reconfigure(const esp_task_wdt_config_t *);
int esp_task_wdt_add(void *); int esp_task_wdt_reset();
"""


@needs_a_compiler
@pytest.mark.parametrize("board", BOARDS)
def test_the_sketch_compiles_against_arduinos_names(board: str, tmp_path: Path) -> None:
    for name in ("Arduino.h", "Servo.h", "ESP32Servo.h", "esp_task_wdt.h", "Watchdog_t4.h", "WDT.h"):
        (tmp_path / name).write_text(ARDUINO if name == "Arduino.h" else '#include "Arduino.h"\n')
    sketch = LIBRARY / "examples" / "Car" / "Car.ino"
    words = [str(COMPILER), "-x", "c++", "-std=c++17", "-Wall", "-Wextra", "-fsyntax-only", f"-D{BOARDS[board]}"]
    words += ["-I", str(tmp_path), "-I", str(LIBRARY / "src"), "-include", "Arduino.h", str(sketch)]
    told = subprocess.run(words, check=False, capture_output=True, text=True)
    assert (told.returncode, told.stderr) == (0, "")
