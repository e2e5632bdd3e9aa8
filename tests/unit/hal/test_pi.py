"""A Raspberry Pi on a car: registers byte by byte, pulses, encoders, and the guard that owns the outputs."""

import asyncio
import fcntl
import gc
import inspect
import json
import os
import select
import signal
import subprocess
import sys
import threading
import types
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.patience import LIMIT, until, wait_until
from txt1.cars.pi import driver
from txt1.cars.pi import guard as pi_guard
from txt1.cars.pi.chips import FileBus, Pca9685Chip, VirtualBus, pulse_of
from txt1.cars.pi.driver import GuardAnswer, PiHal, PiOptions, Process, pulses_of, setup_of
from txt1.cars.pi.guard import Ads1115, Guarded, GuardSetup, Pca9685, Quadrature, guarded, ina219_voltage, pulses_in
from txt1.cars.pi.virtual_pi import VirtualPi
from txt1.config import Config, checked, load
from txt1.control.limits import Outputs
from txt1.errors import ConfigError, HalError, Txt1Error
from txt1.hal.base import BoardLink
from txt1.hal.registry import create
from txt1.installing import installs
from txt1.kernel.loop import run
from txt1.model.channels import Channel, Channels
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.robot import Robot

FRONT, SKID, BOTH = Geometry(steering="front"), Geometry(steering="skid"), Geometry()


class Recorder:
    """A bus that keeps what is written, and reads what it is given."""

    def __init__(self, *answers: Sequence[int]) -> None:
        self.written: list[tuple[int, int, list[int]]] = []
        self.read: list[tuple[int, int, int]] = []
        self.answers = list(answers)

    def write_i2c_block_data(self, address: int, register: int, data: Sequence[int]) -> None:
        self.written.append((address, register, list(data)))

    def read_i2c_block_data(self, address: int, register: int, count: int) -> Sequence[int]:
        self.read.append((address, register, count))
        return self.answers.pop(0)

    def close(self) -> None: ...


def setup(geometry: Geometry = FRONT, **options: Any) -> GuardSetup:
    return setup_of(checked(PiOptions, options, "hal_options"), geometry)


# -- registers, worked out by hand from the data sheets ----------------------------------------------------------------


def test_golden_registers_of_the_servo_board() -> None:
    bus = Recorder([0x11], [0x1E])  # as it is after power-up: asleep
    board = Pca9685(bus, setup())
    board.put((1500.0, 2000.0))
    assert bus.written == [
        (0x40, 0x00, [0x30]),  # asleep, counting registers on
        (0x40, 0xFE, [121]),  # 25 MHz / (4096 * 50 Hz) - 1 = 121.07
        (0x40, 0x01, [0x04]),  # totem pole
        (0x40, 0x00, [0x20]),  # awake
        (0x40, 0x06, [0, 0, 0x33, 0x01]),  # 1500 us of 19988 us in 4096 steps: 307
        (0x40, 0x0A, [0, 0, 0x9A, 0x01]),  # 2000 us: 410
    ]


def test_a_servo_board_that_runs_is_not_put_to_sleep() -> None:
    bus = Recorder([0x20], [121])
    Pca9685(bus, setup()).put((1500.0, 1500.0))
    assert (0x40, 0x00, [0x30]) not in bus.written
    assert (0x40, 0x01, [0x04]) in bus.written, "outputs low while output-enable is high, whoever ran it before"


def test_golden_voltages() -> None:
    assert ina219_voltage(Recorder([0x5D, 0xC2]), setup(battery="ina219")) == pytest.approx(3000 * 0.004)
    made = setup(battery="ads1115", battery_channel=2, divider=4.0)
    bus, converter = Recorder([0x3E, 0x80]), Ads1115()
    assert converter.voltage(bus, made) == -1.0
    assert bus.written == [(0x48, 0x01, [0xE3, 0x83])]  # start, third input, +-4.096 V, once; 128 a second
    assert converter.voltage(bus, made) == pytest.approx(16000 * 0.000125 * 4.0)


# -- pulses ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outputs", "options", "geometry", "pulses"),
    [
        (Outputs(), {}, FRONT, (1500.0, 1500.0)),
        (Outputs(motor=12000, front=-18000, rear=18000), {}, FRONT, (1750.0, 1900.0)),  # forward, full lock left
        (Outputs(motor=12000), {"motor_range": -400.0, "motor_neutral": 1490.0}, FRONT, (1290.0, 1500.0)),
        (Outputs(front=-9000), {"steering_range": -300.0, "straight": 1520.0}, FRONT, (1500.0, 1370.0)),
        (Outputs(front=-9000, rear=9000), {"steering": (1, 2), "rear_range": -400.0}, BOTH, (1500.0, 1700.0, 1300.0)),
        (Outputs(motor=6000, front=-18000, rear=18000), {"motor": (0, 1)}, SKID, (1750.0, 1500.0)),  # right is faster
        (Outputs(motor=24000, front=-18000), {"motor_range": 2000.0}, FRONT, (2500.0, 1900.0)),
    ],
)
def test_pulses(outputs: Outputs, options: dict[str, Any], geometry: Geometry, pulses: tuple[float, ...]) -> None:
    assert pulses_of(outputs, checked(PiOptions, options, "x"), geometry) == pytest.approx(pulses)


def test_neutral_is_where_the_calibration_found_it() -> None:
    channels = Channels(motor=Channel(trim=-480.0), front=Channel(direction=-1, trim=900.0))
    assert setup_of(PiOptions(), FRONT, channels).neutral == pytest.approx((1490.0, 1480.0))


@pytest.mark.parametrize(
    ("options", "geometry", "message"),
    [
        ({}, SKID, "hal_options.motor: 1 of them; a car with geometry.steering 'skid' has 2: give as many, or"),
        ({"steering": (1, 2)}, FRONT, "hal_options.steering: 2 of them; a car with geometry.steering 'front' has 1:"),
        ({"encoders": ((1, 2),)}, Geometry(steering="front", counts_per_rev=0), "geometry.counts_per_rev"),
        ({"encoders": ((1,), (2,))}, FRONT, "two pins each"),
        ({"motor": (0, 1), "encoders": ((1, 2),)}, SKID, "a rover takes two"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, Any], geometry: Geometry, message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace(".", r"\.")):
        setup(geometry, **options)


# -- encoders ----------------------------------------------------------------------------------------------------------

CYCLE = ((17, 1), (27, 1), (17, 0), (27, 0))  # edges of a wheel that rolls forward: A first


@given(st.lists(st.sampled_from((1, -1)), max_size=50))
def test_an_encoder_counts_every_edge_with_its_direction(steps: list[int]) -> None:
    encoder, at = Quadrature((17, 27)), 0
    for step in steps:
        pin, level = CYCLE[at % 4] if step > 0 else (CYCLE[(at - 1) % 4][0], 1 - CYCLE[(at - 1) % 4][1])
        at += step
        encoder.edge(pin, level)
    assert encoder.count == at


@given(st.lists(st.tuples(st.sampled_from((17, 27)), st.integers(0, 2)), max_size=50))
def test_no_sequence_of_edges_counts_more_than_its_edges(edges: list[tuple[int, int]]) -> None:
    encoder = Quadrature((17, 27))
    for edge in edges:
        encoder.edge(*edge)
    assert abs(encoder.count) <= len(edges)


# -- GPIO --------------------------------------------------------------------------------------------------------------


class Header(types.ModuleType):
    """lgpio on a Raspberry Pi 5 with an early kernel: the header's chip is number 4."""

    BOTH_EDGES, SET_PULL_UP = 3, 32

    class error(Exception):
        """As lgpio has it."""

    def __init__(self) -> None:
        super().__init__("lgpio")
        self.pulses: dict[int, tuple[int, int]] = {}
        self.claimed: list[int] = []
        self.outputs: list[tuple[int, int, int]] = []
        self.alerts: list[tuple[int, int, int, int]] = []
        self.called: list[tuple[int, int, int]] = []
        self.closed: list[int] = []
        self.levels: list[tuple[int, int]] = []
        self.calls: dict[int, Callable[..., None]] = {}

    def gpiochip_open(self, number: int) -> int:
        return number

    def gpiochip_close(self, chip: int) -> None:
        self.closed.append(chip)

    def gpio_get_chip_info(self, chip: int) -> tuple[int, int, str, str]:
        return (0, 54, f"gpiochip{chip}", "pinctrl-rp1" if chip == 4 else "gpio-brcmstb@107d508500")

    def gpio_claim_output(self, chip: int, pin: int, level: int) -> None:
        self.claimed.append(pin)
        self.outputs.append((chip, pin, level))

    def gpio_claim_alert(self, chip: int, pin: int, edges: int, flags: int) -> None:
        self.claimed.append(pin)
        self.alerts.append((chip, pin, edges, flags))

    def callback(self, chip: int, pin: int, edges: int, call: Callable[..., None]) -> None:
        self.called.append((chip, pin, edges))
        self.calls[pin] = call

    def gpio_write(self, chip: int, pin: int, level: int) -> None:
        assert chip == 4
        self.levels.append((pin, level))

    def tx_servo(self, chip: int, pin: int, pulse: int, frequency: int) -> None:
        assert chip == 4
        self.pulses[pin] = pulse, frequency


@pytest.fixture
def header(monkeypatch: pytest.MonkeyPatch) -> Header:
    made = Header()
    monkeypatch.setitem(sys.modules, "lgpio", made)
    return made


def test_pulses_straight_from_pins_and_an_encoder(header: Header) -> None:
    guard = guarded(setup(output="gpio", motor=(12,), steering=(13,), encoders=((17, 27),)))
    for pin, level in CYCLE:
        header.calls[pin](4, pin, level, 0)
    done, voltage, count, _ = pi_guard.ANSWER.unpack(guard.answer((1600.0, 1400.0)))
    assert (header.pulses, done, voltage, count) == ({12: (1600, 50), 13: (1400, 50)}, True, -1.0, 4)
    guard.neutral()
    assert header.pulses == {12: (1500, 50), 13: (1500, 50)}


@pytest.fixture(scope="module")
def lgpio(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LG_WD", str(tmp_path_factory.mktemp("lgpio")))
        here = os.getcwd()
        module = pytest.importorskip("lgpio", reason="lgpio has no wheel for this Python")
        os.chdir(here)  # it goes where it makes its pipe
    return module


@pytest.mark.parametrize("name", [name for name in vars(Header) if not name.startswith("_")])
def test_the_fake_lgpio_has_what_the_real_one_has(lgpio: Any, name: str) -> None:
    real, fake = getattr(lgpio, name), getattr(Header, name)
    if isinstance(fake, int):
        assert fake == real
    elif isinstance(fake, type):
        assert issubclass(real, Exception)
    else:
        inspect.signature(real).bind(*[0] * (len(inspect.signature(fake).parameters) - 1))


@pytest.mark.skipif(find_spec("lgpio") is None, reason="lgpio has no wheel for this Python")
@pytest.mark.skipif(Path("/dev/gpiochip0").exists(), reason="this computer has GPIO")
def test_a_guard_on_a_computer_without_a_header_says_so_wherever_it_is_started() -> None:
    words = json.dumps(setup(output="gpio", motor=(12,), steering=(13,))._asdict())
    command = [sys.executable, "-P", pi_guard.__file__, words]
    done = subprocess.run(command, cwd="/proc", capture_output=True, text=True, check=False)  # nobody may write there
    assert (done.returncode, "no GPIO header: is this a Raspberry Pi?" in done.stderr) == (1, True)


@pytest.fixture(scope="module")
def gpiozero() -> Any:
    return pytest.importorskip("gpiozero", reason="not installed: the group dev has it")


@given(steps=st.lists(st.sampled_from((1, 1, 1, -1)), max_size=60))
def test_gpiozero_counts_the_same_turns_of_an_encoder(gpiozero: Any, steps: list[int]) -> None:
    pins = import_module("gpiozero.pins.mock").MockFactory()
    other, ours, at = gpiozero.RotaryEncoder(17, 27, max_steps=0, pin_factory=pins), Quadrature((17, 27)), 2
    ours.edge(17, 1)  # pins are high at first, as they are pulled up
    ours.edge(27, 1)
    begin = ours.count
    for step in steps + [1] * (-sum(steps) % 4):
        pin, level = CYCLE[at % 4] if step > 0 else (CYCLE[(at - 1) % 4][0], 1 - CYCLE[(at - 1) % 4][1])
        at += step
        ours.edge(pin, level)
        pins.pin(pin).drive_high() if level else pins.pin(pin).drive_low()
    assert (ours.count - begin, other.steps) == (at - 2, (at - 2) // 4)
    other.close()


@pytest.mark.parametrize("share", [-1.0, -0.25, 0.0, 0.6, 1.0])
def test_gpiozero_makes_the_same_pulses_of_a_share_of_the_range(gpiozero: Any, header: Header, share: float) -> None:
    guard = guarded(setup(output="gpio", motor=(12,), steering=(13,)))
    options = checked(PiOptions, {"output": "gpio", "motor": (12,), "steering": (13,)}, "x")
    guard.answer(pulses_of(Outputs(motor=round(24000 * share)), options, FRONT))
    mock = import_module("gpiozero.pins.mock")
    servo = gpiozero.Servo(12, initial_value=share, pin_factory=mock.MockFactory(pin_class=mock.MockPWMPin))
    pulse, frequency = header.pulses[12]
    assert (servo.pwm_device.value, servo.pwm_device.frequency) == (pytest.approx(1e-6 * pulse * frequency), frequency)
    servo.close()


# -- the car on the desk -----------------------------------------------------------------------------------------------


def config(vehicle: str, *words: str) -> Config:
    settings = [f"vehicle={vehicle}", "hal_options.bus=virtual", "sim.room.length=.inf", "sim.room.width=.inf", *words]
    return load(None, settings, {}, {"hal": "pi"}).config


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        ("donkeycar", ("hal_options.motor_range=-450", "hal_options.straight=1530")),
        ("f1tenth", ("hal_options.encoders=[[17, 27]]", "hal_options.steering_range=-350")),
        ("f1tenth", ("hal_options.encoders=[[17]]",)),
        ("rover", ("hal_options.encoders=[[17, 27], [22, 23]]", "hal_options.motor=[4, 5]")),
    ],
)
def test_it_drives_as_asked(vehicle: str, words: tuple[str, ...]) -> None:
    made = config(vehicle, *words)
    options = checked(PiOptions, made.hal_options, "x")
    desk = VirtualPi(made, setup_of(options, made.geometry))
    hal = PiHal(desk, options, made.geometry, simulated=True)

    async def drive() -> None:
        async with Robot.open(hal, config=made) as robot:
            await robot.linked(5.0)
            if hal.capabilities.ticks or hal.capabilities.odometry:
                await robot.load_gains()
            robot.arm()
            await robot.drive(0.6, 0.3, 4.0)
            true = desk.vehicle.state
            assert true.v == pytest.approx(0.6, rel=0.1)
            assert robot.odometry.theta == pytest.approx(true.theta, abs=0.15)

    run(drive(), speed="max")


def test_a_servo_board_that_loses_its_power_disarms_and_is_set_up_again() -> None:
    made = config("donkeycar")
    options = checked(PiOptions, made.hal_options, "x")
    desk = VirtualPi(made, setup_of(options, made.geometry))
    hal = PiHal(desk, options, made.geometry, simulated=True)

    async def drive() -> None:
        async with Robot.open(hal, config=made) as robot:
            await robot.linked(5.0)
            robot.arm()
            robot.command(0.6, 0.0)
            await asyncio.sleep(0.2)
            board = desk.bus.chips.pop(0x40)
            await asyncio.sleep(0.5)
            assert (robot.armed, "the bus fails" in robot.runtime.gate.reason) == (False, True)
            desk.bus.chips[0x40] = board
            desk.board.write(0x00, [0x11])  # asleep, as after power-up
            await robot.linked(5.0)
            assert desk.board.pulse(0) == pytest.approx(1500.0, abs=5.0)

    run(drive(), speed="max")


class Scripted:
    """A guard that answers as told."""

    def __init__(self, *answers: GuardAnswer | HalError) -> None:
        self.answers = list(answers)

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    def put(self, pulses: Sequence[float], now: float) -> None: ...

    def heard(self, now: float) -> GuardAnswer | None:
        answer = self.answers.pop(0)
        if isinstance(answer, HalError):
            raise answer
        return answer


def test_a_guard_that_ended_is_a_loss_however_soon_another_answers() -> None:
    counts = [(0, 0), (7, 9), None, (0, 0), (2, -1)]
    guard = Scripted(
        *(HalError("their guard has ended") if each is None else GuardAnswer(True, None, each) for each in counts)
    )
    options = checked(PiOptions, {"encoders": ((17, 27), (22, 23)), "motor": (0, 1)}, "x")
    hal = PiHal(guard, options, SKID)
    seen = [hal.read(time) for time in (0.0, 1.5, 1.52, 1.54, 1.56)]
    assert [each.link.ready for each in seen if each.link] == [False, True, False, False, False]
    assert [each.ticks for each in seen] == [(0, 0), (7, 9), (7, 9), (7, 9), (9, 8)]
    assert seen[-1].link is not None and seen[-1].link[1:3] == (1, "their guard has ended")


# -- the guard as a process --------------------------------------------------------------------------------------------


def processes_of(path: Path) -> list[int]:
    """The guards whose bus is that file."""
    found = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has just ended
            words = place.read_bytes()
            if os.fsencode(path) in words and b"guard.py" in words:
                found.append(int(place.parent.name))
    return found


def test_a_guard_that_is_killed_is_lost_and_another_one_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("GUARD_SILENCE", "HANGS"):  # a stall of the machine is not to be taken for another loss
        monkeypatch.setattr(f"txt1.cars.pi.driver.{name}", LIMIT)
    registers = tmp_path / "registers"
    hal = create(config("donkeycar", f"hal_options.bus={registers}"))

    async def body() -> None:
        loop = asyncio.get_running_loop()
        began = loop.time()
        await hal.open()
        try:
            ready: list[bool] = []
            while loop.time() - began < LIMIT and ready.count(True) < 2:
                await asyncio.sleep(0.02)
                link = hal.read(loop.time() - began).link
                assert link is not None
                if not ready or link.ready is not ready[-1]:
                    ready.append(link.ready)
                    if ready == [False, True]:
                        (guard,) = processes_of(registers)
                        os.kill(guard, signal.SIGKILL)
                hal.write(Outputs(), loop.time() - began)
            assert ready == [False, True, False, True]
            assert link.losses == 1
        finally:
            await hal.close()
        assert processes_of(registers) == []
        assert pulse_of(registers.read_bytes(), 0) == pytest.approx(1500.0, abs=5.0)

    run(body())


def motor_pulse(registers: Path) -> float:
    return pulse_of(registers.read_bytes(), 0)


async def drive_until(hal: PiHal, reached: Callable[[], bool], began: float) -> None:
    """Hand the guard half of full speed 50 times a second, for 30 s at most."""
    loop = asyncio.get_running_loop()
    ends = loop.time() + 30.0
    while not reached():
        assert loop.time() < ends, "not within 30 s"
        hal.read(loop.time() - began)
        hal.write(Outputs(12000), loop.time() - began)
        await asyncio.sleep(0.02)


async def stopped_while_driving(hal: PiHal, registers: Path, began: float) -> int:
    """Return the guard that hangs behind a pulse that drives, which a host that was held up does not have for long."""
    while True:
        await drive_until(hal, lambda: motor_pulse(registers) > 1700.0, began)
        (guard,) = processes_of(registers)
        os.kill(guard, signal.SIGSTOP)
        wait_until(lambda pid=guard: Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T")
        if motor_pulse(registers) > 1700.0:
            return guard
        os.kill(guard, signal.SIGCONT)


@pytest.mark.parametrize("number", [signal.SIGSTOP, pytest.param(signal.SIGKILL, marks=pytest.mark.long)])
def test_each_guard_that_hangs_or_is_killed_is_replaced_behind_neutral_outputs(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    registers = tmp_path / "registers"
    hal = create(config("donkeycar", f"hal_options.bus={registers}"))
    put, seen = pi_guard.neutral_without_guard, []

    def neutral_without_guard(setup: GuardSetup) -> bool:
        before, living = motor_pulse(registers), processes_of(registers)
        seen.append((before > 1700.0, living, put(setup), motor_pulse(registers)))
        return True

    monkeypatch.setattr(pi_guard, "neutral_without_guard", neutral_without_guard)

    async def body() -> None:
        began = asyncio.get_running_loop().time()
        await hal.open()
        try:
            for count in (1, 2):  # the second guard hangs as well
                os.kill(await stopped_while_driving(hal, registers, began), number)
                await drive_until(hal, lambda n=count: sum(drove for drove, *_ in seen) >= n, began)
        finally:
            await hal.close()

    run(body())
    # on a slow machine guards that stood already are replaced as well
    assert [rest for _, *rest in seen] == [[[], True, pytest.approx(1500.0, abs=5.0)]] * len(seen)
    assert processes_of(registers) == []


@pytest.mark.parametrize("number", [pytest.param(signal.SIGSTOP, marks=pytest.mark.long), signal.SIGKILL])
def test_closed_outputs_are_neutral_even_if_their_guard_was_killed_or_hangs(
    number: signal.Signals, tmp_path: Path
) -> None:
    registers = tmp_path / "registers"
    hal = create(config("donkeycar", f"hal_options.bus={registers}"))

    async def body() -> None:
        began = asyncio.get_running_loop().time()
        await hal.open()
        try:
            await drive_until(hal, lambda: motor_pulse(registers) > 1700.0, began)
            (guard,) = processes_of(registers)
            os.kill(guard, number)
        finally:
            await hal.close()
        assert processes_of(registers) == []
        assert motor_pulse(registers) == pytest.approx(1500.0, abs=5.0)

    run(body())


def test_outputs_that_cannot_be_made_neutral_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    registers = tmp_path / "registers"
    monkeypatch.setattr(pi_guard, "open_bus", lambda _: VirtualBus({}))  # nothing answers there

    async def body() -> None:
        process = Process(setup(bus=str(registers)))
        await process.open()
        (guard,) = processes_of(registers)
        os.kill(guard, signal.SIGKILL)
        await process.close()

    with pytest.raises(HalError, match=r"perhaps not neutral.*take its battery out"):
        run(body())


def test_a_guard_that_the_kernel_holds_in_the_bus_is_told_and_gets_no_successor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    registers = tmp_path / "registers"
    wrote: list[bool] = []
    killed: list[subprocess.Popen[bytes]] = []
    monkeypatch.setattr(driver, "ENDS", 0.01)
    monkeypatch.setattr(driver, "DIES", 0.01)
    monkeypatch.setattr(pi_guard, "neutral_without_guard", lambda _: wrote.append(True))

    async def body() -> None:
        process = Process(setup(bus=str(registers)))
        await process.open()
        (guard,) = processes_of(registers)
        os.kill(guard, signal.SIGSTOP)
        with monkeypatch.context() as patch:
            patch.setattr(subprocess.Popen, "kill", lambda self: killed.append(self))  # the signal waits for the bus
            process.put((1700.0, 1500.0), 0.0)
            with pytest.raises(HalError, match="hung"):
                process.heard(1.0)
            for tries in range(4):
                await asyncio.sleep(0.1)
                assert process.heard(3.0 + 2.0 * tries) is None
            assert processes_of(registers) == [guard]
            with pytest.raises(HalError, match="perhaps not neutral"):
                await process.close()
        os.kill(guard, signal.SIGKILL)
        killed[0].wait()

    run(body())
    assert not wrote, "two at once"


def test_a_bus_that_blocks_this_process_does_not_keep_it_from_telling(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks = threading.Event()
    monkeypatch.setattr(driver, "WRITES", 0.05)
    monkeypatch.setattr(pi_guard, "neutral_without_guard", lambda _: blocks.wait(LIMIT))

    async def body() -> None:
        process = Process(setup(bus=str(tmp_path / "registers")))
        await process.open()
        os.kill(processes_of(tmp_path / "registers")[0], signal.SIGKILL)
        await process.close()

    with pytest.raises(HalError, match="perhaps not neutral"):
        run(body())
    waiting = [thread for thread in threading.enumerate() if thread.name == "neutral"]
    assert waiting and all(thread.daemon for thread in waiting), "nor from ending"
    blocks.set()


@pytest.mark.long
def test_a_servo_board_is_driven_by_one_robot_at_a_time(tmp_path: Path) -> None:
    bus = str(tmp_path / "registers")

    async def body() -> None:
        one, two, next_to_it = Process(setup(bus=bus)), Process(setup(bus=bus)), Process(setup(bus=bus, address=0x41))
        await one.open()
        try:
            assert not pi_guard.neutral_without_guard(setup(bus=bus)), "nor written to beside its guard"
            with pytest.raises(HalError, match=r"end it first: .*another robot"):
                await two.open()
            held = pi_guard.claim(setup(bus=bus, address=0x41))
            os.close(held)
        finally:
            await one.close()
        await two.open()
        await two.close()
        await next_to_it.close()

    run(body())


def test_pulses_that_a_host_which_is_gone_has_left_are_not_put_out(tmp_path: Path) -> None:
    registers = tmp_path / "registers"
    made = setup(bus=str(registers))
    words = [pi_guard.__file__, json.dumps(made._asdict()), pulses_in(made, (1700, 1500)).hex()]
    with subprocess.Popen([sys.executable, "-c", HOST, *words], stdout=subprocess.PIPE, text=True) as host:
        assert host.stdout is not None
        guard = int(host.stdout.readline())
    writes = 0
    os.kill(guard, signal.SIGCONT)
    while processes_of(registers):
        writes += motor_pulse(registers) > 1600.0
    assert writes == 0
    assert motor_pulse(registers) == pytest.approx(1500.0, abs=5.0)


HOST = """
import os, signal, subprocess, sys
guard = subprocess.Popen([sys.executable, "-P", *sys.argv[1:3]], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
guard.stdout.read(1)
os.kill(guard.pid, signal.SIGSTOP)
os.waitid(os.P_PID, guard.pid, os.WSTOPPED)
os.write(guard.stdin.fileno(), bytes.fromhex(sys.argv[3]))
print(guard.pid, flush=True)
"""
"""A host whose guard hangs with pulses in its pipe, and which then ends."""


def test_a_watchdog_is_fed_by_pulses_that_were_put_out_and_by_nothing_else() -> None:
    levels: list[int] = []
    bus = VirtualBus({0x40: Pca9685Chip()})
    made = setup(watchdog=22)
    guard = Guarded(made, bus, Pca9685(bus, made), feed=levels.append)
    guard.neutral()
    assert not levels, "a guard without a host feeds nothing"
    for _ in range(4):
        guard.answer(made.neutral)
    assert levels == [1, 0, 1, 0]
    bus.chips.clear()
    guard.answer(made.neutral)
    assert levels == [1, 0, 1, 0]


def test_the_pin_of_a_watchdog_is_an_output_of_the_header(header: Header, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pi_guard, "open_bus", lambda _: VirtualBus({0x40: Pca9685Chip()}))
    guard = guarded(setup(watchdog=22))
    guard.answer(guard.setup.neutral)
    guard.answer(guard.setup.neutral)
    assert (header.claimed, header.levels) == ([22], [(22, 1), (22, 0)])
    with pytest.raises(ConfigError, match="for output pca9685"):
        setup(output="gpio", watchdog=22)


@pytest.mark.parametrize("watched", [True, False])
def test_a_car_whose_guard_hangs_in_the_bus_stands_if_it_has_a_watchdog(watched: bool) -> None:
    made = config("donkeycar", *["hal_options.watchdog=22"] * watched)
    desk = VirtualPi(made, setup_of(checked(PiOptions, made.hal_options, "x"), made.geometry))
    hal = PiHal(desk, checked(PiOptions, made.hal_options, "x"), made.geometry, simulated=True)

    async def drive() -> None:
        async with Robot.open(hal, config=made) as robot:
            for _ in range(20):
                robot.command(0.6, 0.0)
                await asyncio.sleep(0.05)
            assert desk.vehicle.state.v > 0.4
            desk.hangs = True
            hung, v = robot.now, desk.vehicle.state.v
            await asyncio.sleep(0.1)
            assert desk.vehicle.state.v > 0.9 * v, "the servo board keeps the last pulse"
            assert desk.watchdog is None or desk.watchdog.ends <= hung + 0.2
            await asyncio.sleep(0.3)
            assert (desk.vehicle.state.v < 0.9 * v) is watched
            await asyncio.sleep(2.0)
            assert (abs(desk.vehicle.state.v) < 0.01) is watched

    run(drive(), speed="max")


def test_a_guard_that_has_answered_does_not_hang_however_long_the_host_pauses(tmp_path: Path) -> None:
    async def body() -> None:
        process = Process(setup(bus=str(tmp_path / "registers")))
        await process.open()
        try:
            process.put((1500.0, 1500.0), 0.0)
            while process.heard(0.0) is None:
                await asyncio.sleep(0.01)
            assert process.heard(60.0) is None
            process.put((1500.0, 1500.0), 60.0)
            process.heard(60.15)
        finally:
            await process.close()

    run(body())


def test_a_guard_whose_bus_fails_for_a_moment_tries_again() -> None:
    class Loose(Recorder):
        fails = 5

        def write_i2c_block_data(self, address: int, register: int, data: Sequence[int]) -> None:
            self.fails -= 1
            if self.fails >= 0:
                raise OSError(121, "Remote I/O error")
            super().write_i2c_block_data(address, register, data)

    bus = Loose(*[[0x20], [121]] * 10)
    made = setup()
    guard = Guarded(made, bus, Pca9685(bus, made))
    assert guard.neutral()
    assert bus.written[-2:] == [(0x40, 0x06, [0, 0, 0x33, 0x01]), (0x40, 0x0A, [0, 0, 0x33, 0x01])]


def test_a_guard_that_cannot_begin_says_what_to_do(tmp_path: Path) -> None:
    async def body() -> None:
        await Process(setup(bus=str(tmp_path / "none" / "registers"))).open()

    with pytest.raises(HalError, match=r"^switch I2C on \(sudo raspi-config.*: the outputs .*No such file"):
        run(body())


def test_a_guard_imports_nothing_that_it_does_not_need() -> None:
    found = subprocess.run(
        [sys.executable, "-P", "-X", "importtime", pi_guard.__file__, "{}"], capture_output=True, text=True, check=False
    ).stderr
    names = {row.rpartition("|")[2].strip() for row in found.splitlines() if row.startswith("import time:")}
    assert not names & {"txt1", "numpy", "asyncio", "pydantic", "smbus2", "lgpio"}


def test_the_file_of_a_bus_shows_its_registers(tmp_path: Path) -> None:
    path = tmp_path / "registers"
    Pca9685(FileBus(str(path)), setup()).put((1600.0, 1400.0))
    assert [pulse_of(path.read_bytes(), channel) for channel in (0, 1, 2)] == pytest.approx([1600, 1400, 0], abs=5)
    assert json.loads(json.dumps(setup()._asdict()))["bus"] == 1


# -- the servo board and the sensors, by what goes over the bus --------------------------------------------------------


@pytest.mark.parametrize(
    ("oscillator", "frequency", "prescale"),
    [(25e6, 50.0, 121), (27e6, 40.0, 164), (25e6, 200.0, 30), (1e6, 200.0, 3), (50e6, 40.0, 255)],
)
def test_the_prescaler_is_that_of_the_frequency_within_what_the_chip_takes(
    oscillator: float, frequency: float, prescale: int
) -> None:
    bus = Recorder([0x11], [0x1E])
    Pca9685(bus, setup(oscillator=oscillator, frequency=frequency)).put((1500.0, 1500.0))
    assert (0x40, 0xFE, [prescale]) in bus.written


def test_a_servo_board_of_another_frequency_is_set_up_once_and_after_failures() -> None:
    class Loose(Recorder):
        fails = False

        def write_i2c_block_data(self, address: int, register: int, data: Sequence[int]) -> None:
            if self.fails:
                raise OSError(121, "Remote I/O error")
            super().write_i2c_block_data(address, register, data)

    bus = Loose([0x20], [0x1E], [0x20], [121])  # awake at 200 Hz, as another program has left it; then as it should be
    board = Pca9685(bus, setup())
    board.put((1500.0, 1500.0))
    assert bus.written[:2] == [(0x40, 0x00, [0x30]), (0x40, 0xFE, [121])]
    assert bus.read == [(0x40, 0x00, 1), (0x40, 0xFE, 1)]
    bus.written.clear()
    board.put((1500.0, 1500.0))
    assert [register for _, register, _ in bus.written] == [0x06, 0x0A]
    bus.fails = True
    with pytest.raises(OSError, match="Remote I/O"):
        board.put((1500.0, 1500.0))
    bus.fails = False
    bus.written.clear()
    board.put((1500.0, 1500.0))
    assert [register for _, register, _ in bus.written] == [0x01, 0x00, 0x06, 0x0A]


def test_no_pulse_is_longer_than_its_period_and_there_is_one_for_each_channel(header: Header) -> None:
    bus = Recorder([0x20], [121])
    board = Pca9685(bus, setup())
    board.put((25000.0, 1500.0))
    assert (0x40, 0x06, [0, 0, 0xFF, 0x0F]) in bus.written
    pins = guarded(setup(output="gpio", motor=(12,), steering=(13,)))
    for output in (board, pins.output):
        with pytest.raises(ValueError, match="zip"):
            output.put((1500.0,))


@pytest.mark.parametrize(
    ("battery", "answer", "read", "voltage"),
    [
        ("ina219", [0x5D, 0xC2], (0x41, 0x02, 2), 3000 * 0.004 * 2.0),
        ("ads1115", [0x3E, 0x80], (0x48, 0x00, 2), 16000 * 0.000125 * 2.0),
        ("ads1115", [0x7F, 0xFF], (0x48, 0x00, 2), 32767 * 0.000125 * 2.0),
        ("ads1115", [0x80, 0x00], (0x48, 0x00, 2), 0.0),  # below ground
        ("ads1115", [0xFF, 0xFF], (0x48, 0x00, 2), 0.0),
        ("ads1115", [0x00, 0x00], (0x48, 0x00, 2), 0.0),
    ],
)
def test_the_battery_is_read_every_fiftieth_time_and_its_voltage_is_never_negative(
    battery: str, answer: list[int], read: tuple[int, int, int], voltage: float
) -> None:
    made = setup(battery=battery, divider=2.0)
    bus = Recorder(answer, answer)
    guard = Guarded(made, bus, Out())
    voltages = [pi_guard.ANSWER.unpack(guard.answer(made.neutral))[1] for _ in range(100)]
    first = voltage if battery == "ina219" else -1.0  # a converter is asked first
    assert voltages == [pytest.approx(first)] * 50 + [pytest.approx(voltage)] * 50
    assert set(bus.read) == {read}


@pytest.mark.parametrize("count", [0, 1, 2])
def test_the_guard_tells_whether_pulses_are_out_and_what_encoders_counted(count: int) -> None:
    encoders = [Quadrature((17,)), Quadrature((22,))][:count]
    for encoder, edges in zip(encoders, (3, 5), strict=False):
        for _ in range(edges):
            encoder.edge(encoder.count, 1)
    guard = Guarded(setup(), None, Out(0, 1), encoders)
    counts = (*(3, 5)[:count], 0, 0)[:2]
    assert pi_guard.ANSWER.unpack(guard.answer(guard.setup.neutral)) == (True, -1.0, *counts)
    assert pi_guard.ANSWER.unpack(guard.answer(guard.setup.neutral)) == (False, -1.0, *counts)


def test_an_encoder_does_not_count_a_level_that_it_has_already() -> None:
    encoder = Quadrature((17, 27))
    for pin, level in ((17, 0), (27, 0), (17, 1), (17, 1), (27, 1), (27, 1), (17, 1), (17, 0), (17, 0), (27, 1)):
        encoder.edge(pin, level)
    assert encoder.count == 3


# -- what the guard opens and locks ------------------------------------------------------------------------------------


class Out:
    """An output that fails as often as it is told to, after some pulses that it puts out."""

    def __init__(self, *fails: int) -> None:
        self.fails = list(fails)
        self.tries = 0
        self.pulses: list[tuple[float, ...]] = []

    def put(self, pulses: Sequence[float]) -> None:
        self.tries += 1
        if self.fails and self.fails.pop(0):
            raise OSError(121, "Remote I/O error")
        self.pulses.append(tuple(pulses))


class Seam:
    """A module as the guard sees it: some of its functions are replaced here."""

    def __init__(self, module: Any, **functions: Any) -> None:
        self._module = module
        vars(self).update(functions)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


def opened() -> int:
    gc.collect()  # what earlier tests left
    return len(os.listdir("/proc/self/fd"))


class SMBus(VirtualBus):
    """The bus of smbus2."""

    fd = 77
    closed = 0

    def __init__(self, number: int) -> None:
        super().__init__({0x40: Pca9685Chip()})
        self.number = number

    def close(self) -> None:
        type(self).closed += 1


@pytest.fixture
def smbus(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int, int]]:
    """What is asked of the bus' driver."""
    module = types.ModuleType("smbus2")
    monkeypatch.setitem(vars(module), "SMBus", SMBus)
    monkeypatch.setitem(sys.modules, "smbus2", module)
    asked: list[tuple[int, int, int]] = []

    def ioctl(*words: int) -> None:
        asked.append(words)
        if len(asked) > 1:
            raise OSError(25, "Inappropriate ioctl for device")

    monkeypatch.setattr(pi_guard, "fcntl", Seam(fcntl, ioctl=ioctl))
    return asked


def test_a_transfer_on_the_bus_is_given_up_soon_if_its_adapter_can(smbus: list[tuple[int, int, int]]) -> None:
    for _ in range(2):  # the second one cannot
        bus = pi_guard.open_bus(setup(bus=7))
        assert isinstance(bus, SMBus)
        assert bus.number == 7
    assert smbus == [(77, 0x0702, 5)] * 2, "I2C_TIMEOUT of Linux, 50 ms"


@pytest.mark.parametrize(
    ("options", "opens"),
    [
        ({}, True),
        ({"battery": "ina219"}, True),
        ({"output": "gpio", "motor": (12,), "steering": (13,)}, False),
        ({"output": "gpio", "motor": (12,), "steering": (13,), "battery": "ina219"}, True),
    ],
)
def test_a_bus_is_opened_if_something_is_on_it(
    options: dict[str, Any], opens: bool, smbus: list[tuple[int, int, int]], tmp_path: Path
) -> None:
    assert (pi_guard.open_bus(setup(**options)) is not None) is opens
    smbus.clear()
    assert isinstance(pi_guard.open_bus(setup(bus=str(tmp_path / "registers"), **options)), FileBus) is opens
    assert not smbus, "a file has no driver"


def test_each_servo_board_has_a_lock_of_its_own_which_a_guard_waits_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus, waits = str(tmp_path / "registers"), list[float]()
    monkeypatch.setattr(pi_guard, "select", Seam(select, select=lambda *words: waits.append(words[3])))
    next_to_it = pi_guard.claim(setup(bus=bus, address=0x41))
    held = pi_guard.claim(setup(bus=bus))
    assert not os.get_inheritable(held)
    before = opened()
    for patience, times in ((None, 0), (0, 0), (1, 1), (3, 3)):
        waits.clear()
        with pytest.raises(OSError, match="another robot drives this servo board") as told:
            pi_guard.claim(setup(bus=bus)) if patience is None else pi_guard.claim(setup(bus=bus), patience)
        assert (told.value.errno, waits, opened()) == (16, [0.2] * times, before)
    os.close(held)
    waits.clear()
    os.close(pi_guard.claim(setup(bus=bus), 3))
    assert not waits
    os.close(next_to_it)


def test_the_lock_of_a_real_bus_is_on_its_device_and_pins_need_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, int]] = []

    def open_(path: str, flags: int) -> int:
        asked.append((path, flags))
        return os.open(tmp_path / "device", flags | os.O_CREAT, 0o600)

    monkeypatch.setattr(pi_guard, "os", Seam(os, open=open_))
    os.close(pi_guard.claim(setup(bus=7)))
    assert asked == [("/dev/i2c-7", os.O_RDWR | os.O_CLOEXEC)]
    assert pi_guard.claim(setup(output="gpio", motor=(12,), steering=(13,))) == -1


@pytest.mark.parametrize("number", [0, 4])
def test_the_header_is_found_wherever_it_is_and_other_chips_are_left_alone(
    header: Header, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def label(chip: int) -> tuple[int, int, str, str]:
        return (0, 54, f"gpiochip{chip}", "pinctrl-bcm2711" if chip == number else "raspberrypi-exp-gpio")

    monkeypatch.setattr(header, "gpio_get_chip_info", label)
    assert pi_guard.open_chip(header) == number
    assert header.closed == [0] * (number > 0)


def test_a_computer_without_a_header_is_told(header: Header, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(number: int) -> int:
        raise header.error

    monkeypatch.setattr(header, "gpiochip_open", gone)
    with pytest.raises(OSError, match=r"no GPIO header: is this a Raspberry Pi\?"):
        pi_guard.open_chip(header)


def test_lgpio_makes_its_pipe_where_anybody_may_write(header: Header, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LG_WD", "/here")
    assert pi_guard.pins_library() is header
    assert os.environ["LG_WD"] == "/here"
    monkeypatch.delenv("LG_WD")
    pi_guard.pins_library()
    assert Path(os.environ["LG_WD"]).is_dir()
    Path(os.environ["LG_WD"]).rmdir()


def test_pins_are_low_until_they_have_pulses_and_encoders_are_pulled_up(
    header: Header, monkeypatch: pytest.MonkeyPatch
) -> None:
    guarded(setup(output="gpio", motor=(12,), steering=(13,), encoders=((17, 27),)))
    assert header.outputs == [(4, 12, 0), (4, 13, 0)]
    assert header.alerts == [(4, 17, 3, 32), (4, 27, 3, 32)]
    assert header.called == [(4, 17, 3), (4, 27, 3)]
    header.outputs.clear()
    monkeypatch.setattr(pi_guard, "open_bus", lambda _: VirtualBus({0x40: Pca9685Chip()}))
    guard = guarded(setup(watchdog=22, motor=(0, 1), encoders=((17, 27), (22, 23)), geometry=SKID))
    assert header.outputs == [(4, 22, 0)]
    for pin in (17, 27, 17, 22):
        header.calls[pin](4, pin, 1, 0)
    assert [encoder.count for encoder in guard.encoders] == [2, 1], "each counts its own pins"


def test_a_servo_board_alone_needs_no_pins_and_its_watchdog_on_the_desk_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "lgpio", None)  # cannot be imported
    bus = str(tmp_path / "registers")
    guarded(setup(bus=bus)).answer((1500.0, 1500.0))
    assert not Path(f"{bus}.watchdog").exists()
    guard = guarded(setup(bus=bus, watchdog=22))
    levels = []
    for _ in range(3):
        guard.answer((1600.0, 1400.0))
        levels.append(Path(f"{bus}.watchdog").read_bytes())
    assert (levels, motor_pulse(Path(bus))) == ([b"\1", b"\0", b"\1"], pytest.approx(1600.0, abs=5.0))
    monkeypatch.setattr(pi_guard, "open_bus", lambda _: VirtualBus({0x40: Pca9685Chip()}))
    guarded(setup()).answer((1500.0, 1500.0))
    for options in ({"watchdog": 22}, {"encoders": ((17, 27),)}):
        with pytest.raises(ImportError):
            guarded(setup(**options))


def test_neutral_in_place_of_a_guard_leaves_nothing_open_and_says_whether_it_is_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = str(tmp_path / "registers")
    made = setup(bus=bus)
    closed: list[bool] = []
    monkeypatch.setattr(VirtualBus, "close", lambda _: closed.append(True))
    before = opened()
    assert pi_guard.neutral_without_guard(made)
    assert (motor_pulse(Path(bus)), closed, opened()) == (pytest.approx(1500.0, abs=5.0), [True], before)
    held = pi_guard.claim(made)
    assert not pi_guard.neutral_without_guard(made), "a guard lives"
    os.close(held)
    with monkeypatch.context() as patch:
        patch.setattr(pi_guard, "open_bus", lambda _: VirtualBus({}))
        assert not pi_guard.neutral_without_guard(made), "nothing answers"
    assert (closed, opened()) == ([True, True], before)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "txt1.cars.pi.chips", None)
        assert not pi_guard.neutral_without_guard(made), "no library"
    monkeypatch.setattr(pi_guard, "claim", lambda _: pytest.fail("pulses from pins end with their guard"))
    assert pi_guard.neutral_without_guard(setup(output="gpio", motor=(12,), steering=(13,)))


# -- the guard from its host's first word to its end -------------------------------------------------------------------

HERE, GONE = 4242, 1  # the parent's process id


class Host:
    """A guard's host, for a guard in this process: what comes through the pipe, in turn.

    Bytes come; None is 0.2 s of silence; GONE is a host that ends and leaves bytes behind; nothing more is a host that
    has closed the pipe.
    """

    def __init__(self, *events: bytes | int | None) -> None:
        self.events = list(events)
        self.parent = HERE
        self.out = Out()
        self.answers: list[tuple[Any, ...]] = []
        self.deaf = False
        self.waits: list[float] = []
        self.ignored: dict[int, Any] = {}
        self.blocks: dict[int, bool] = {}
        self.claimed: list[int] = []
        self.looked_at = False

    def write(self, descriptor: int, data: bytes) -> None:
        assert descriptor == 1
        if self.deaf:
            raise BlockingIOError
        self.answers.append(pi_guard.ANSWER.unpack(data))

    def read(self, descriptor: int, count: int) -> bytes:
        assert descriptor == 0
        assert count >= 4096
        if not self.events:
            return b""
        event = self.events.pop(0)
        if event == GONE:
            self.parent = GONE
            event = self.events.pop(0)
        assert isinstance(event, bytes)
        return event

    def register(self, descriptor: int, what: int) -> None:
        assert (descriptor, what) == (0, select.POLLIN)
        self.looked_at = True

    def poll(self, milliseconds: int | None = None) -> Any:
        if milliseconds is None:
            return self
        assert (milliseconds, self.looked_at) == (200, True)
        if self.events and self.events[0] is None:
            self.events.pop(0)
            return []
        return [(0, select.POLLIN)]

    def run(self, monkeypatch: pytest.MonkeyPatch, made: GuardSetup) -> int:
        """Run a guard for this host to its end."""

        def claim(made: GuardSetup, patience: int) -> int:
            self.claimed.append(patience)
            return 9

        def ignore(number: int, what: Any) -> None:
            self.ignored[number] = what

        def wait(*words: Any) -> None:
            self.waits.append(words[3])

        blocks = self.blocks.__setitem__
        words = {"read": self.read, "write": self.write, "set_blocking": blocks, "getppid": lambda: self.parent}
        monkeypatch.setattr(pi_guard, "os", Seam(os, **words))
        monkeypatch.setattr(pi_guard, "select", Seam(select, poll=self.poll, select=wait))
        monkeypatch.setattr(pi_guard, "signal", Seam(signal, signal=ignore))
        monkeypatch.setattr(pi_guard, "claim", claim)
        monkeypatch.setattr(pi_guard, "guarded", lambda _: Guarded(made, None, self.out))
        return pi_guard.main([json.dumps(made._asdict())])


NEUTRAL = (1500.0, 1500.0)


def word(*pulses: float) -> bytes:
    return pulses_in(setup(), pulses)


def test_a_message_has_tenths_of_a_microsecond_for_each_channel() -> None:
    assert word(1500.0, 1234.56) == (15000).to_bytes(2, "little") + (12346).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("events", "put"),
    [
        ((), ()),
        ((word(1600, 1400),), ((1600, 1400),)),
        ((word(1600, 1400), word(1700, 1400)), ((1600, 1400), (1700, 1400))),
        ((word(1600, 1400) + word(1650, 1400) + word(1700, 1300),), ((1700, 1300),)),  # the newest alone
        ((word(1600, 1400)[:3], word(1600, 1400)[3:]), ((1600, 1400),)),
        ((word(1600, 1400) + word(1700, 1300)[:1], word(1700, 1300)[1:]), ((1600, 1400), (1700, 1300))),
        ((word(1600, 1400)[:3],), ()),
        ((word(1600, 1400), None, word(1700, 1300)), ((1600, 1400), NEUTRAL, (1700, 1300))),  # silence
        ((None, None), (NEUTRAL, NEUTRAL)),
        ((word(1600, 1400), GONE, word(1700, 1300)), ((1600, 1400),)),  # what a dead host has left is old
        ((GONE, word(1700, 1300), word(1800, 1300)), ()),
    ],
)
def test_the_guard_puts_out_the_newest_pulses_and_neutral_in_silence_and_at_its_end(
    events: tuple[bytes | int | None, ...], put: tuple[tuple[float, ...], ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    host = Host(*events)
    assert host.run(monkeypatch, setup()) == 0
    # neutral before the first word and with it, and at the end
    assert host.out.pulses == [pytest.approx(each) for each in (NEUTRAL, NEUTRAL, *put, NEUTRAL)]
    asked = sum(each != NEUTRAL for each in put)
    assert host.answers == [(True, -1.0, 0, 0)] * (1 + asked)
    assert host.blocks == {1: False}
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE)
    assert host.ignored == dict.fromkeys(numbers, signal.SIG_IGN), "a signal that ends the host leaves its guard time"
    assert host.claimed == [15], "3 s for the previous guard"


def test_a_host_that_ends_in_silence_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    host = Host(word(1600, 1400), None)
    poll = host.poll

    def gone(milliseconds: int | None = None) -> Any:
        found = poll(milliseconds)
        if found == []:
            host.parent = GONE
        return found

    monkeypatch.setattr(host, "poll", gone)
    monkeypatch.setattr(host, "read", lambda *_: word(1700, 1300) if host.answers else b"")
    host.events[0] = word(1600, 1400)
    host.events = [None]
    assert host.run(monkeypatch, setup()) == 0
    assert host.out.pulses == [NEUTRAL] * 4


def test_a_host_that_does_not_read_its_answers_is_served(monkeypatch: pytest.MonkeyPatch) -> None:
    host = Host(word(1600, 1400), word(1700, 1300))
    write = host.write

    def full(descriptor: int, data: bytes) -> None:
        write(descriptor, data)
        host.deaf = True

    monkeypatch.setattr(host, "write", full)
    assert host.run(monkeypatch, setup()) == 0
    assert host.out.pulses[2:4] == [pytest.approx((1600, 1400)), pytest.approx((1700, 1300))]


@pytest.mark.parametrize(("fails", "code", "waits"), [(0, 0, 0), (19, 0, 0), (20, 0, 1), (45, 0, 2), (10**6, 1, 300)])
def test_a_guard_without_a_host_tries_to_put_out_neutral_for_a_minute(
    fails: int, code: int, waits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    host = Host()
    host.out.fails = [0, 0] + [1] * min(fails, 7000)
    assert host.run(monkeypatch, setup()) == code
    assert host.waits == [0.2] * waits
    assert (host.out.pulses[2:] == [NEUTRAL]) is (code == 0)
    assert host.out.tries == 2 + (20 * 300 if code else fails + 1)


def test_a_guard_that_cannot_begin_puts_nothing_out_and_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    host = Host()
    host.out.fails = [1]
    assert host.run(monkeypatch, setup()) == 1
    assert capsys.readouterr().err == "OSError: [Errno 121] Remote I/O error\n"
    assert (host.answers, host.out.pulses, host.out.tries) == ([], [], 1)


# -- the host's side ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "options", "remedy"),
    [
        ("strange", {}, "see txt1 doctor --hal pi: the outputs on I2C bus 1 cannot be opened (strange)"),
        ("strange", {"output": "gpio", "motor": (12,)}, "see txt1 doctor --hal pi: the outputs on GPIO cannot"),
        ("FileNotFoundError: No such file", {}, "switch I2C on (sudo raspi-config, Interface Options) and check hal"),
        ("PermissionError: Permission denied", {}, "sudo usermod -aG i2c,gpio $USER, then log out and in again"),
        ("OSError: Remote I/O error", {}, "nothing answers at 0x40: check wiring, power and hal_options.address"),
        ("OSError: [Errno 121]", {"address": 0x41}, "nothing answers at 0x41: check wiring, power and hal_options"),
        ("OSError: another robot drives", {}, "end it first: one robot drives a servo board"),
        ("lgpio.error: 'GPIO busy'", {}, "another program has the pins: end it"),
        ("ImportError: No module named 'smbus2'", {}, f"{installs('devices')}"),
        ("ImportError: No module named 'lgpio'", {}, f"{installs('devices')}; from Python 3.13 on"),
    ],
)
def test_each_reason_why_a_guard_cannot_begin_has_its_remedy(error: str, options: dict[str, Any], remedy: str) -> None:
    told = driver.explain(setup(**options), error)
    assert told.startswith(remedy)
    assert ("lgpio has no wheel" in told) == ("'lgpio'" in error)


MISSING = {"smbus2": "the HAL 'pi' needs the extra", "lgpio": "hal_options: pins need lgpio"}
PINS = ("hal_options.output=gpio", "hal_options.motor=[12]", "hal_options.steering=[13]")


@pytest.mark.parametrize(
    ("words", "needs"),
    [
        (("bus=1",), {"smbus2"}),
        (("bus=1", "battery=ina219"), {"smbus2"}),
        (("bus=1", "watchdog=22"), {"smbus2", "lgpio"}),
        (("bus=1", "encoders=[[17, 27]]"), {"smbus2", "lgpio"}),
        (("bus=1", "output=gpio"), {"lgpio"}),
        (("bus=1", "output=gpio", "battery=ina219"), {"smbus2", "lgpio"}),
        (("bus=FILE",), set()),
        (("bus=FILE", "watchdog=22"), set()),
        (("bus=FILE", "battery=ina219"), set()),
        (("bus=FILE", "encoders=[[17, 27]]"), {"lgpio"}),
        (("bus=FILE", "output=gpio"), {"lgpio"}),
        (("bus=virtual", "encoders=[[17, 27]]", "watchdog=22"), set()),
    ],
)
def test_a_library_that_the_hardware_needs_and_that_is_missing_is_named(
    words: tuple[str, ...], needs: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = config("f1tenth", *(f"hal_options.{each}" for each in words))
    monkeypatch.setattr(driver, "find_spec", {"smbus2": 1, "lgpio": 1}.get)
    hal = create(made)
    assert hal.capabilities.simulated == ("bus=virtual" in words)
    for library, text in MISSING.items():
        present = {each: 1 for each in MISSING if each != library}
        monkeypatch.setattr(driver, "find_spec", present.get)
        if library in needs:
            with pytest.raises(Txt1Error, match=text):
                create(made)
        else:
            create(made)


def test_the_settings_are_those_of_an_ordinary_servo_board_unless_others_are_given() -> None:
    channels = (0, 1), (1500.0, 1500.0)
    expected = GuardSetup(1, "pca9685", 0x40, 50.0, 25e6, *channels, (), "none", 0, 0, 1.0, None)
    assert setup_of(PiOptions(), FRONT) == expected
    assert expected.watchdog is setup().watchdog is None
    full = Outputs(motor=24000, front=-18000, rear=18000)
    both = checked(PiOptions, {"steering": (1, 2)}, "x")
    assert pulses_of(full, both, BOTH) == (2000.0, 1900.0, 1900.0)
    assert pulses_of(Outputs(), both, BOTH) == (1500.0, 1500.0, 1500.0)
    assert (setup_of(both, BOTH).channels, setup_of(both, BOTH).neutral) == ((0, 1, 2), (1500.0, 1500.0, 1500.0))
    assert setup_of(checked(PiOptions, {"motor": (3, 4)}, "x"), SKID).channels == (3, 4)
    assert [setup(battery=each).battery_address for each in ("ina219", "ads1115")] == [0x41, 0x48]
    assert setup(battery="ina219", battery_address=0x45).battery_address == 0x45
    assert setup(encoders=((17,),)).encoders == ((17,),)


@pytest.mark.parametrize(
    ("outputs", "options", "geometry", "pulses"),
    [
        (Outputs(motor=48000), {}, FRONT, (2000.0, 1500.0)),
        (Outputs(motor=-48000), {}, FRONT, (1000.0, 1500.0)),
        (Outputs(motor=24000), {"motor_range": 1100.0}, FRONT, (2500.0, 1500.0)),
        (Outputs(motor=-24000), {"motor_range": 1100.0}, FRONT, (500.0, 1500.0)),
        (Outputs(front=-18000), {"steering_range": 1100.0}, FRONT, (1500.0, 2500.0)),
        (Outputs(front=18000), {"steering_range": 1100.0}, FRONT, (1500.0, 500.0)),
        (Outputs(rear=18000), {"rear_range": -1100.0, "steering": (1, 2)}, BOTH, (1500.0, 1500.0, 500.0)),
        (Outputs(motor=24000, rear=18000), {"motor": (0, 1)}, SKID, (2000.0, 1875.0)),
    ],
)
def test_no_output_leaves_the_limits_of_its_pulses(
    outputs: Outputs, options: dict[str, Any], geometry: Geometry, pulses: tuple[float, ...]
) -> None:
    assert pulses_of(outputs, checked(PiOptions, options, "x"), geometry) == pytest.approx(pulses)


@pytest.mark.parametrize(
    ("name", "low", "high", "step"),
    [("motor_neutral", 500.0, 2500.0, 0.1), ("straight", 500.0, 2500.0, 0.1), ("watchdog", 0, 27, 1)],
)
def test_pulses_and_pins_outside_their_limits_are_refused(name: str, low: float, high: float, step: float) -> None:
    for value in (low, high):
        setup(**{name: value})
    for value in (low - step, high + step):
        with pytest.raises(ConfigError, match=name):
            setup(**{name: value})


@pytest.mark.parametrize(
    ("options", "geometry", "message"),
    [
        ({"motor": (0, 1)}, FRONT, "hal_options.motor: 2 of them; a car with geometry.steering 'front' has 1:"),
        ({"motor": (0, 1), "steering": (2, 3)}, BOTH, "hal_options.motor: 2 of them"),
        ({"motor": (0, 1, 2)}, SKID, "hal_options.motor: 3 of them"),
        (
            {},
            BOTH,
            "hal_options.steering: 1 of them; a car with geometry.steering 'both' has 2: give as many, or choose",
        ),
        ({"steering": (1, 2, 3)}, BOTH, "hal_options.steering: 3 of them"),
        ({"steering": ()}, FRONT, "hal_options.steering: 0 of them"),
        ({"encoders": ((1, 2, 3),)}, FRONT, "at most two, of one or two pins each"),
        ({"encoders": ((),)}, FRONT, "at most two, of one or two pins each"),
        ({"encoders": ((1, 2), (3, 4), (5, 6))}, FRONT, "at most two, of one or two pins each"),
        ({"encoders": ((1, 2), (3, 4), (5, 6)), "motor": (0, 1)}, SKID, "at most two, of one or two pins each"),
        ({"encoders": ((1, 2), (3,))}, FRONT, "two pins each"),
        ({"encoders": ((1,), (3, 4))}, FRONT, "two pins each"),
        ({"output": "gpio", "watchdog": 3}, FRONT, "hal_options.watchdog: it is for output pca9685"),
    ],
)
def test_channels_and_encoders_that_no_car_has_are_refused(
    options: dict[str, Any], geometry: Geometry, message: str
) -> None:
    with pytest.raises(ConfigError, match=message.replace(".", r"\.")):
        setup(geometry, **options)


@pytest.mark.parametrize(
    ("options", "geometry"),
    [
        ({"encoders": ((1,),)}, FRONT),
        ({"encoders": ((1, 2),)}, FRONT),
        ({"encoders": ((1, 2), (3, 4))}, FRONT),
        ({"encoders": ((1, 2), (3, 4)), "motor": (0, 1)}, SKID),
        ({"motor": (0, 1)}, Geometry(steering="skid", counts_per_rev=0)),
        ({"motor": (0, 1), "steering": (2, 3, 4)}, SKID),  # a rover's servos are not there
        ({"output": "gpio"}, FRONT),
        ({"watchdog": 3}, FRONT),
    ],
)
def test_what_goes_together_is_taken(options: dict[str, Any], geometry: Geometry) -> None:
    setup(geometry, **options)


def test_trims_of_calibration_hold_both_kinds_of_cars_still() -> None:
    channels = Channels(right=Channel(trim=480.0), left=Channel(trim=-960.0))
    made = setup_of(checked(PiOptions, {"motor": (0, 1)}, "x"), SKID, channels)
    assert made.neutral == pytest.approx((1510.0, 1480.0), abs=0.1)


@pytest.mark.parametrize(("voltage", "told"), [(-1.0, None), (0.0, 0.0), (0.5, 0.5), (12.0, 12.0)])
def test_an_unknown_voltage_is_none_and_no_voltage_is_0(voltage: float, told: float | None) -> None:
    assert driver.answer_of(pi_guard.ANSWER.pack(True, voltage, 3, -4)) == GuardAnswer(True, told, (3, -4))


class Holding(Scripted):
    """A guard that answers as told, and keeps what it is to put out."""

    def __init__(self, *answers: GuardAnswer | HalError | None) -> None:
        super().__init__(*answers)  # type: ignore[arg-type]
        self.out: list[tuple[float, ...]] = []
        self.calls: list[str] = []

    async def open(self) -> None:
        self.calls.append("open")

    async def close(self) -> None:
        self.calls.append("close")

    def put(self, pulses: Sequence[float], now: float) -> None:
        self.out.append(tuple(pulses))


FINE, FAILED = GuardAnswer(True, None, (0, 0)), GuardAnswer(False, None, (0, 0))


def car(*answers: GuardAnswer | HalError | None, geometry: Geometry = FRONT, **options: Any) -> tuple[PiHal, Holding]:
    guard = Holding(*answers)
    return PiHal(guard, checked(PiOptions, options, "x"), geometry), guard


def link_of(hal: PiHal, now: float) -> BoardLink:
    link = hal.read(now).link
    assert link is not None
    return link


def test_outputs_are_neutral_for_a_second_after_each_beginning() -> None:
    answers = [None, FINE, FINE, FINE, FINE, FINE, None, None, FINE, FINE, FINE]
    hal, guard = car(*answers)
    driven = []
    for now in (0.0, 0.02, 0.3, 0.6, 1.0, 1.02, 1.3, 1.33, 1.34, 2.33, 2.36):
        link = link_of(hal, now)
        hal.write(Outputs(motor=12000), now)
        driven.append(guard.out[-1] == (1750.0, 1500.0))
        assert driven[-1] or guard.out[-1] == (1500.0, 1500.0)
        assert link.ready is driven[-1]
    assert driven == [False, False, False, False, False, True, True, False, False, False, True]


def test_outputs_that_the_bus_does_not_take_are_counted_and_lost_after_0_3_s() -> None:
    hal, _ = car(FINE, FAILED, FAILED, None, FAILED, FAILED, FINE, FAILED, FAILED)
    seen = [link_of(hal, now) for now in (0.0, 0.1, 0.3, 0.3, 0.31, 0.4, 0.5, 0.6, 0.9)]
    assert [each.faults["bus_failures"] for each in seen] == [0, 1, 2, 2, 3, 4, 4, 5, 6]
    assert [each.losses for each in seen] == [0, 0, 0, 0, 1, 1, 1, 1, 2]
    reason = "the outputs are lost: the bus fails, or their guard hangs"
    assert [each.text == reason for each in seen] == [False] * 4 + [True, True, False, False, True]
    assert seen[6].text == "the guard puts the outputs out; it puts them to neutral when nothing comes for 0.2 s"
    assert seen[6].reason == reason


def test_a_guard_that_never_answers_is_waited_for_and_is_no_loss() -> None:
    hal, _ = car(None, None, FAILED, HalError("their guard has ended"))
    for now in (0.0, 0.5, 5.0, 5.1):
        told = hal.read(now)
        assert told.link is not None
        assert (told.link.ready, told.link.losses, told.link.reason) == (False, 0, "")
        assert told.link.text == "waiting for the guard of the outputs"
        assert told.odometry_time == 0.0


def test_counts_begin_at_0_behind_a_guard_that_never_answered() -> None:
    hal, _ = car(
        HalError("ended"), GuardAnswer(True, None, (3, 4)), geometry=SKID, motor=(0, 1), encoders=((17, 27), (22, 23))
    )
    assert [hal.read(now).ticks for now in (0.0, 0.1)] == [(0, 0), (3, 4)]


def test_another_run_begins_anew() -> None:
    hal, guard = car(FINE, FAILED, HalError("gone"), None, geometry=FRONT)
    for now in (0.0, 0.1, 0.2):
        before = link_of(hal, now)
    assert (before.losses, before.reason, before.faults["bus_failures"]) == (1, "gone", 1)

    async def again() -> None:
        await hal.open()
        await hal.close()

    run(again())
    assert guard.calls == ["open", "close"]
    told = link_of(hal, 0.0)
    assert (told.losses, told.reason, told.faults["bus_failures"]) == (0, "", 0)


@pytest.mark.parametrize(
    ("options", "voltage", "told"),
    [
        ({"battery": "ina219"}, 11.1, (11.1, 0.0)),
        ({"battery": "ads1115"}, 0.0, (0.0, 0.0)),
        ({"battery": "ina219"}, None, None),
        ({}, 11.1, None),
    ],
)
def test_the_battery_is_the_first_pack_if_there_is_a_sensor(
    options: dict[str, Any], voltage: float | None, told: tuple[float, float] | None
) -> None:
    hal, _ = car(GuardAnswer(True, voltage, (0, 0)), **options)
    assert hal.read(0.0).batteries == told
    assert hal.capabilities.battery is bool(options)


@pytest.mark.parametrize(
    ("encoders", "ticks", "odometry"),
    [((), False, False), (((17, 27),), False, True), (((17, 27), (22, 23)), True, False)],
)
def test_one_encoder_is_odometry_and_two_are_ticks(
    encoders: tuple[tuple[int, ...], ...], ticks: bool, odometry: bool
) -> None:
    hal, _ = car(None, encoders=encoders)
    can, told = hal.capabilities, hal.read(0.0)
    assert (can.ticks, can.odometry, can.pwm, can.simulated) == (ticks, odometry, True, False)
    assert (told.ticks, told.odometry) == ((0, 0) if ticks else None, Odometry() if odometry else None)


COUNT = FRONT.count_length


@pytest.mark.parametrize(
    ("pins", "motors", "counts", "moved"),
    [
        ((17, 27), (0, 0, 0), (0, 5, 3), (0, 5, -2)),  # it shows the direction itself
        ((17, 27), (9, -9, -9), (0, 5, 3), (0, 5, -2)),
        ((17,), (0, 0, 0), (0, 5, 8), (0, 5, 3)),  # forward at first
        ((17,), (1, 1, 1), (0, 5, 8), (0, 5, 3)),
        ((17,), (9, -9, 0), (0, 5, 8), (0, -5, -3)),  # it rolls on as it was driven
        ((17,), (-9, 0, 9), (0, 5, 8), (0, -5, 3)),
    ],
)
def test_an_encoder_of_one_pin_counts_in_the_direction_of_the_motor(
    pins: tuple[int, ...], motors: tuple[int, ...], counts: tuple[int, ...], moved: tuple[int, ...]
) -> None:
    hal, _ = car(*(GuardAnswer(True, None, (count, 0)) for count in counts), encoders=(pins,), reverse="direct")
    x = 0.0
    for step, (motor, far) in enumerate(zip(motors, moved, strict=True)):
        now = 0.1 * step
        hal.write(Outputs(motor=motor), now)
        told = hal.read(now)
        assert told.odometry is not None
        x += far * COUNT
        assert (told.odometry.x, told.odometry_time) == (pytest.approx(x), now)
        assert told.odometry.v == pytest.approx(10.0 * far * COUNT)


@pytest.mark.parametrize(("front", "share"), [(-9000, 0.5), (18000, -1.0), (-24000, 1.0), (24000, -1.0), (0, 0.0)])
def test_the_path_turns_with_the_steering(front: int, share: float) -> None:
    hal, _ = car(*(GuardAnswer(True, None, (count, 0)) for count in (0, 10)), encoders=((17, 27),))
    hal.write(Outputs(front=front), 0.0)
    hal.read(0.0)
    told = hal.read(0.1).odometry
    assert told is not None
    assert told.theta == pytest.approx(10 * COUNT * FRONT.curvature(share))


def test_what_rolled_while_the_outputs_were_lost_is_not_taken_for_a_leap() -> None:
    answers = [GuardAnswer(True, None, (10, 0)), HalError("ended"), GuardAnswer(True, None, (50, 0))]
    hal, _ = car(*answers, GuardAnswer(True, None, (60, 0)), GuardAnswer(True, None, (70, 0)), encoders=((17, 27),))
    xs = []
    for now in (0.0, 0.1, 0.2, 0.3, 0.3):
        told = hal.read(now).odometry
        assert told is not None
        xs.append(told.x)
    assert xs == pytest.approx([0.0, 0.0, 0.0, 10 * COUNT, 10 * COUNT]), "and no two answers at once are a speed"


def test_wires_that_calibration_found_the_other_way_round_turn_odometry_as_well() -> None:
    guard = Holding(*(GuardAnswer(True, None, (count, 0)) for count in (0, 10)))
    options = checked(PiOptions, {"encoders": ((17,),), "reverse": "direct"}, "x")
    hal = PiHal(guard, options, FRONT, Channels(motor=Channel(direction=-1), front=Channel(trim=9000.0)))
    hal.write(Outputs(motor=9000, front=9000), 0.0)
    hal.read(0.0)
    told = hal.read(0.1).odometry
    assert told is not None
    assert (told.x, told.theta) == (pytest.approx(-10 * COUNT), 0.0)
    assert guard.out == [(1500.0, 1300.0)], "neutral is the trim"


# -- guards that are only made for a test ------------------------------------------------------------------------------

ANSWERS = "import os, struct, sys, time; os.write(1, struct.pack('<?dqq', True, -1.0, 0, 0)); "


def pretends(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Process:
    """A process with this program for its guard."""
    (tmp_path / "guard.py").write_text(program)
    monkeypatch.setattr(pi_guard, "__file__", str(tmp_path / "guard.py"))
    return Process(setup(bus=str(tmp_path / "registers")))


FAILS = """
import os, struct
os.write(1, struct.pack("<?dqq", True, -1.0, 0, 0))
while os.read(0, 4096):
    os.write(1, struct.pack("<?dqq", False, -1.0, 0, 0))
"""


def test_a_bus_that_fails_is_opened_again_by_another_guard_with_growing_pauses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process, registers = pretends(FAILS, tmp_path, monkeypatch), tmp_path / "registers"

    async def body() -> None:
        async def answer(now: float) -> bool:
            given: list[Any] = []

            def told() -> bool:
                # a guard that is just starting takes no pulses yet
                process.put((1500.0, 1500.0), now)
                given.append(process.heard(now))
                return given[-1] is not None

            await until(told)
            return bool(given[-1].done)

        await process.open()
        for now, ends in ((0.0, 2.1), (2.2, 4.2), (4.3, 8.3), (8.4, 16.4), (16.5, 26.5)):
            guards = processes_of(registers)
            for at in (now, ends - 0.2):
                assert not await answer(at)
            with pytest.raises(HalError, match="their guard was ended, as the bus fails"):
                await answer(ends)
            await until(lambda before=guards: processes_of(registers) not in ([], before))
        await process.close()

    run(body())


@pytest.mark.parametrize(
    ("program", "error"),
    [
        ("import time; time.sleep(5)", "nothing within 0.2 s"),
        ("import sys; sys.exit('strange')", r"\(strange\)"),
        ("import sys; sys.exit(0)", r"\(it ended\)"),
        ("import os; os.write(1, b'half')", r"\(it ended\)"),
        ("import os; os.write(2, b'first\\nlast\\n')", r"\(last\)"),
    ],
)
def test_a_guard_that_does_not_begin_is_told_and_leaves_no_process(
    program: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "sleep" in program:
        monkeypatch.setattr(driver, "GUARD_START_TIME", 0.2)
    process = pretends(program, tmp_path, monkeypatch)
    before = opened()
    with pytest.raises(HalError, match=error) as told:
        run(process.open())
    assert (processes_of(tmp_path / "registers"), opened()) == ([], before), told


def test_a_guard_that_starts_slowly_has_more_time_at_the_next_attempt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "GUARD_START_TIME", 0.05)
    process = pretends("import time; time.sleep(60)", tmp_path, monkeypatch)

    async def told() -> str:
        with pytest.raises(HalError) as refused:
            await process.open()
        return str(refused.value)

    async def body() -> list[str]:
        return [await told() for _ in range(3)]

    for said, patience in zip(run(body()), ("0.05", "0.1", "0.2"), strict=True):
        assert f"nothing within {patience} s" in said


@pytest.mark.parametrize(
    ("program", "neutral", "asked", "fails"),
    [
        ("sys.stdin.read()", True, 0, False),  # it has put out neutral itself
        ("sys.stdin.read(); sys.exit(1)", True, 1, False),
        ("sys.stdin.read(); sys.exit(1)", False, 1, True),
        ("time.sleep(5)", True, 1, False),  # it hangs, and is killed
        ("time.sleep(5)", False, 1, True),
    ],
)
def test_outputs_are_put_to_neutral_in_place_of_each_guard_that_did_not_end_well(
    program: str, neutral: bool, asked: int, fails: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[GuardSetup] = []

    def without(made: GuardSetup) -> bool:
        assert processes_of(tmp_path / "registers") == [], "never two at once"
        calls.append(made)
        return neutral

    monkeypatch.setattr(pi_guard, "neutral_without_guard", without)
    if "sleep" in program:
        monkeypatch.setattr(driver, "ENDS", 0.05)
    else:
        monkeypatch.setattr(driver, "ENDS", LIMIT)
    process = pretends(ANSWERS + program, tmp_path, monkeypatch)

    async def body() -> None:
        await process.open()
        (guard,) = processes_of(tmp_path / "registers")
        assert os.getsid(guard) == guard, "no signal of the terminal reaches it"
        await process.close()
        await process.close()  # nothing more to close

    if fails:
        with pytest.raises(HalError, match="perhaps not neutral"):
            run(body())
    else:
        run(body())
    assert len(calls) == asked
    assert processes_of(tmp_path / "registers") == []


@pytest.mark.parametrize(("options", "imported"), [({}, True), ({"output": "gpio"}, False)])
def test_what_is_needed_to_put_out_neutral_is_imported_before_a_guard_runs(
    options: dict[str, Any], imported: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[GuardSetup] = []
    monkeypatch.setattr(pi_guard, "bus_class", asked.append)
    pretends("", tmp_path, monkeypatch)
    with pytest.raises(HalError):
        run(Process(setup(**options)).open())
    assert bool(asked) is imported


def test_answers_that_come_in_parts_are_put_together_and_the_newest_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two, three = (pi_guard.ANSWER.pack(True, float(each), each, 0) for each in (1, 2, 3))
    come: list[bytes | None] = [one, None, one[:7], one[7:] + two[:3], two[3:] + three + one[:2], one[2:], None]
    expected = [1, None, None, 1, 3, 1, None]

    def read(descriptor: int, count: int) -> bytes:
        assert count >= 4096
        part = come.pop(0)
        if part is None:
            raise BlockingIOError
        return part

    process = pretends(ANSWERS + "sys.stdin.read()", tmp_path, monkeypatch)

    async def body() -> None:
        assert process.heard(0.0) is None, "it is not open"
        process.put((1500.0, 1500.0), 0.0)
        await process.open()
        with monkeypatch.context() as patch:
            patch.setattr(driver, "os", Seam(os, read=read))
            for each in expected:
                heard = process.heard(0.0)
                assert heard == (None if each is None else GuardAnswer(True, float(each), (each, 0)))
        await process.close()
        assert process.heard(0.0) is None

    run(body())


def test_a_guard_hangs_when_pulses_are_unanswered_for_0_2_s_from_the_first_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pi_guard, "neutral_without_guard", lambda _: True)
    process = pretends(ANSWERS + "sys.stdin.read()", tmp_path, monkeypatch)

    async def body() -> None:
        await process.open()
        assert process.heard(99.0) is None, "nothing was asked"
        for now in (100.0, 100.1, 100.19):
            process.put((1500.0, 1500.0), now)
            assert process.heard(now) is None
        with pytest.raises(HalError, match="the outputs are lost: their guard hung, so it was killed"):
            process.heard(100.21)
        process.put((1500.0, 1500.0), 100.21)
        assert process.heard(100.22) is None, "told once"
        await process.close()
        assert processes_of(tmp_path / "registers") == []

    run(body())


class Pretended:
    """A guard's process that is none: its pipes lead to the test."""

    def __init__(self) -> None:
        words, stdin = os.pipe()
        stdout, self.answers = os.pipe()
        os.set_blocking(stdout, False)
        self.words, self.stdin, self.stdout, self.stderr = (
            words,
            os.fdopen(stdin, "wb", 0),
            os.fdopen(stdout, "rb", 0),
            None,
        )
        self.killed, self.waits = False, 0
        self.returncode: int | None = None

    def kill(self) -> None:
        self.killed = True

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float) -> None:
        self.waits += 1
        self.returncode = -9 if self.killed else 0

    def end(self) -> None:
        os.close(self.answers)


def test_a_guard_that_is_lost_is_replaced_at_once_then_with_growing_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    one, two, three = Pretended(), Pretended(), Pretended()
    comes, may_begin = threading.Event(), threading.Event()
    starts: list[Pretended | HalError] = []
    outcomes: list[Pretended | HalError] = [one, two, HalError("no power"), HalError("no power"), three]

    def start(_: GuardSetup, patience: float) -> Pretended:
        outcome = outcomes[len(starts)]
        starts.append(outcome)
        if isinstance(outcome, HalError):
            raise outcome
        if outcome is three:
            comes.set()
            assert may_begin.wait(LIMIT)
        return outcome

    monkeypatch.setattr(driver, "_start", start)
    monkeypatch.setattr(pi_guard, "neutral_without_guard", lambda _: True)

    async def body() -> None:
        process = Process(setup())
        await process.close()  # nothing is open yet

        async def begun(now: float) -> int:
            """How many guards were started, once no other is about to be."""
            assert process.heard(now) is None
            began = len(starts)
            for _ in range(20):
                await asyncio.sleep(0.001)
                began = len(starts)
            return began

        await process.open()
        process.put(NEUTRAL, 10.0)
        assert os.read(one.words, 100) == word(*NEUTRAL)
        with pytest.raises(HalError, match="hung"):
            process.heard(10.3)
        assert one.killed
        assert await begun(10.31) == 2
        assert process.heard(12.0) is None, "what the first guard was asked does not count for the second"
        os.write(two.answers, pi_guard.ANSWER.pack(True, 1.0, 2, 3))
        assert process.heard(12.0) == GuardAnswer(True, 1.0, (2, 3))
        two.end()
        with pytest.raises(HalError, match="has ended"):
            process.heard(20.0)
        assert await begun(20.01) == 3
        assert await begun(21.9) == 3
        assert await begun(22.0) == 4
        assert await begun(25.9) == 4
        assert await begun(26.0) == 5
        assert comes.wait(LIMIT)
        assert await begun(35.0) == 5, "one at a time"
        may_begin.set()
        while process.heard(35.0) is None:
            process.put(NEUTRAL, 35.0)
            await asyncio.sleep(0.001)
            if select.select([three.words], [], [], 0.0)[0]:
                os.write(three.answers, pi_guard.ANSWER.pack(True, 1.0, 4, 5))
        assert (one.waits, two.waits, three.waits) == (1, 1, 0), "each is ended once"
        await process.close()
        assert (one.killed, two.killed, three.killed, three.waits) == (True, False, False, 1)

    run(body())
    for guard in (one, two, three):
        os.close(guard.words)
    os.close(one.answers)
    os.close(three.answers)
