"""A Raspberry Pi on a car: registers byte by byte, pulses, encoders, and the guard that owns the outputs."""

import asyncio
import inspect
import json
import os
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

from tests.patience import LIMIT, wait_until
from txt1.config import Config, checked, load
from txt1.control.limits import Outputs
from txt1.errors import ConfigError, HalError
from txt1.hal.pi import driver
from txt1.hal.pi import guard as pi_guard
from txt1.hal.pi.double import FakeBus, FileBus, Pca9685Chip, PiDouble, pulse_of
from txt1.hal.pi.driver import GuardAnswer, PiHal, PiOptions, Process, pulses_of, setup_of
from txt1.hal.pi.guard import Ads1115, Guarded, GuardSetup, Pca9685, Quadrature, guarded, ina219_voltage, pulses_in
from txt1.hal.registry import create
from txt1.kernel.loop import run
from txt1.model.channels import Channel, Channels
from txt1.model.vehicle import Geometry
from txt1.robot import Robot

FRONT, SKID, BOTH = Geometry(steering="front"), Geometry(steering="skid"), Geometry()


class Recorder:
    """A bus that keeps what is written, and reads what it is given."""

    def __init__(self, *answers: Sequence[int]) -> None:
        self.written: list[tuple[int, int, list[int]]] = []
        self.answers = list(answers)

    def write_i2c_block_data(self, address: int, register: int, data: Sequence[int]) -> None:
        self.written.append((address, register, list(data)))

    def read_i2c_block_data(self, address: int, register: int, count: int) -> Sequence[int]:
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
        self.levels: list[tuple[int, int]] = []
        self.calls: dict[int, Callable[..., None]] = {}

    def gpiochip_open(self, number: int) -> int:
        return number

    def gpiochip_close(self, chip: int) -> None:
        assert chip == 0

    def gpio_get_chip_info(self, chip: int) -> tuple[int, int, str, str]:
        return (0, 54, f"gpiochip{chip}", "pinctrl-rp1" if chip == 4 else "gpio-brcmstb@107d508500")

    def gpio_claim_output(self, chip: int, pin: int, level: int) -> None:
        self.claimed.append(pin)

    def gpio_claim_alert(self, chip: int, pin: int, edges: int, flags: int) -> None:
        self.claimed.append(pin)

    def callback(self, chip: int, pin: int, edges: int, call: Callable[..., None]) -> None:
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
    return pytest.importorskip("gpiozero", reason="not installed: the extra 'dev' has it")


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
    settings = [f"vehicle={vehicle}", "hal_options.bus=desk", "sim.room.length=.inf", "sim.room.width=.inf", *words]
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
    desk = PiDouble(made, setup_of(options, made.geometry))
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
    desk = PiDouble(made, setup_of(options, made.geometry))
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


def test_a_guard_that_has_ended_is_a_loss_however_soon_another_one_answers_and_its_counts_go_on() -> None:
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
    for name in ("LOST", "HANGS"):  # a stall of the machine is not to be taken for another loss
        monkeypatch.setattr(f"txt1.hal.pi.driver.{name}", LIMIT)
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
    monkeypatch.setattr(pi_guard, "open_bus", lambda _: FakeBus({}))  # nothing answers there

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
    blocks.set()


@pytest.mark.long
def test_a_servo_board_is_driven_by_one_robot_at_a_time(tmp_path: Path) -> None:
    bus = str(tmp_path / "registers")

    async def body() -> None:
        one, two, next_to_it = Process(setup(bus=bus)), Process(setup(bus=bus)), Process(setup(bus=bus, address=0x41))
        await one.open()
        try:
            assert not pi_guard.neutral_without_guard(setup(bus=bus)), "nor written to beside its guard"
            with pytest.raises(HalError, match=r"another robot.*end it first"):
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
    bus = FakeBus({0x40: Pca9685Chip()})
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
    monkeypatch.setattr(pi_guard, "open_bus", lambda _: FakeBus({0x40: Pca9685Chip()}))
    guard = guarded(setup(watchdog=22))
    guard.answer(guard.setup.neutral)
    guard.answer(guard.setup.neutral)
    assert (header.claimed, header.levels) == ([22], [(22, 1), (22, 0)])
    with pytest.raises(ConfigError, match="for output pca9685"):
        setup(output="gpio", watchdog=22)


@pytest.mark.parametrize("watched", [True, False])
def test_a_car_whose_guard_hangs_in_the_bus_stands_if_it_has_a_watchdog(watched: bool) -> None:
    made = config("donkeycar", *["hal_options.watchdog=22"] * watched)
    desk = PiDouble(made, setup_of(checked(PiOptions, made.hal_options, "x"), made.geometry))
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

    with pytest.raises(HalError, match=r"No such file.*raspi-config"):
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
