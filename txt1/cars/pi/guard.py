"""The process that owns a Raspberry Pi's I2C bus or GPIO pins, and puts the outputs to neutral when its host is gone.

Neither a servo board nor a pin has a time-out of its own: the last output stays. So the host puts nothing out itself.
It sends pulses to this process 50 times a second, and this process puts them out. After 0.2 s without pulses, or after
any end of the host, the outputs are neutral. This process must start quickly, so it imports little. Only if this
process was killed, the host itself puts out neutral, before it starts a new guard.

A process that writes to a servo board holds a lock on it. So two hosts never drive the same board, and no process
writes while the kernel still holds a killed guard. With a watchdog on the board's output-enable pin, this process turns
a GPIO pin over after each pulse that it has put out. When the turning ends for any reason, the watchdog switches the
outputs off. No thread and no timer turns the pin, because both would go on while this process hangs in the bus.
"""

import errno
import fcntl
import json
import os
import select
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from struct import Struct
from tempfile import mkdtemp
from typing import Any, Final, NamedTuple, Protocol

# ms without pulses after which the outputs become neutral
SILENCE_MS: Final = 200
# attempts to put out neutral when a bus fails
NEUTRAL_TRIES: Final = 20
# factor on these attempts after the host has gone, which takes a minute
LAST_TRIES: Final = 300
# units of 10 ms after which Linux gives up a transfer; by default it waits for a second
TRANSFER_MAX: Final = 5
# Linux's request that sets this time
I2C_TIMEOUT: Final = 0x0702
# number of waits of SILENCE_MS for the previous guard, which is about to end
TAKEN: Final = 15
# whether the pulses were put out, the voltage (V, -1: unknown), two encoders' counts
ANSWER: Final = Struct("<?dqq")
# answers
VOLTAGE_EVERY: Final = 50
# us, the unit of pulses in a message
PULSE: Final = 0.1
# Linux's struct flock with 64 bits: type, whence, start, length, process
LOCK: Final = Struct("hhqqi4x")

# first register of the first output; each output has four: times of on and off, low byte first
LED0: Final = 0x06
MODE1: Final = 0x00
MODE2: Final = 0x01
PRESCALE: Final = 0xFE
SLEEP: Final = 0x10
# the register advances with each byte
AUTO: Final = 0x20
TOTEM_POLE: Final = 0x04
# counts of a period
STEPS: Final = 4096


class I2cBus(Protocol):
    """An I2C bus with the interface of smbus2; raises OSError if a chip does not answer."""

    def write_i2c_block_data(self, address: int, register: int, data: Sequence[int], /) -> None:
        """Write bytes, starting at a register."""

    def read_i2c_block_data(self, address: int, register: int, count: int, /) -> Sequence[int]:
        """Read bytes, starting at a register."""

    def close(self) -> None:
        """Close the bus."""


class GuardSetup(NamedTuple):
    """The guard's setup, as the host sends it."""

    # number of the I2C bus, or the file of a virtual bus
    bus: int | str
    # "pca9685" or "gpio"
    output: str
    # address of the servo board
    address: int
    # frequency of the pulses, Hz
    frequency: float
    # oscillator of the servo board, Hz
    oscillator: float
    # channels of the servo board, or GPIO numbers
    channels: Sequence[int]
    # pulses, us
    neutral: Sequence[float]
    # GPIO numbers A and B, or A alone
    encoders: Sequence[Sequence[int]]
    # "none", "ina219" or "ads1115"
    battery: str
    battery_address: int
    # input of an ADS1115
    battery_channel: int
    # battery's voltage over the measured voltage
    divider: float
    # GPIO number of the pin that feeds the watchdog of the servo board's outputs
    watchdog: int | None = None

    @property
    def pulses(self) -> Struct:
        """The format of a message with a pulse for every channel."""
        return Struct(f"<{len(self.channels)}H")


class Pca9685:
    """A servo board; its chip repeats its last pulses for ever."""

    def __init__(self, bus: I2cBus, setup: GuardSetup) -> None:
        self._bus, self._setup = bus, setup
        divisor = round(setup.oscillator / (STEPS * setup.frequency))
        self._steps_per_us = setup.oscillator / divisor / 1e6
        self._prescale = min(max(divisor - 1, 3), 255)
        self._ready = False

    def _begin(self) -> None:
        """Set the frequency, for which the chip has to sleep; a chip that has it already goes on without a gap."""
        bus, address = self._bus, self._setup.address
        mode = bus.read_i2c_block_data(address, MODE1, 1)[0]
        if mode & SLEEP or bus.read_i2c_block_data(address, PRESCALE, 1)[0] != self._prescale:
            bus.write_i2c_block_data(address, MODE1, [SLEEP | AUTO])
            bus.write_i2c_block_data(address, PRESCALE, [self._prescale])
        # also sets: outputs are low while output-enable is high; another program may have changed this
        bus.write_i2c_block_data(address, MODE2, [TOTEM_POLE])
        bus.write_i2c_block_data(address, MODE1, [AUTO])
        self._ready = True

    def put(self, pulses: Sequence[float]) -> None:
        """Put out a pulse on every channel, us."""
        try:
            if not self._ready:
                self._begin()
            for channel, pulse in zip(self._setup.channels, pulses, strict=True):
                off = min(round(pulse * self._steps_per_us), STEPS - 1)
                data = [0, 0, off & 0xFF, off >> 8]
                self._bus.write_i2c_block_data(self._setup.address, LED0 + 4 * channel, data)
        except OSError:
            # the chip may have lost its power, and with it the frequency
            self._ready = False
            raise


class GpioPulses:
    """Pulses from GPIO pins, made by lgpio; they end with this process."""

    def __init__(self, lgpio: Any, chip: int, setup: GuardSetup) -> None:
        self._lgpio, self._chip, self._setup = lgpio, chip, setup
        for pin in setup.channels:
            lgpio.gpio_claim_output(chip, pin, 0)

    def put(self, pulses: Sequence[float]) -> None:
        """Put out a pulse on every pin, us."""
        for pin, pulse in zip(self._setup.channels, pulses, strict=True):
            self._lgpio.tx_servo(self._chip, pin, round(pulse), round(self._setup.frequency))


class Output(Protocol):
    """An output of pulses."""

    def put(self, pulses: Sequence[float]) -> None:
        """Put out a pulse on every channel, us; raises OSError if that fails."""


def ina219_voltage(bus: I2cBus, setup: GuardSetup) -> float:
    """Return the bus voltage of an INA219, V: 4 mV in the upper 13 bits."""
    high, low = bus.read_i2c_block_data(setup.battery_address, 0x02, 2)
    return ((high << 8 | low) >> 3) * 0.004 * setup.divider


class Ads1115:
    """A converter that starts a conversion and is read a second later: a conversion takes 8 ms."""

    def __init__(self) -> None:
        self._asked = False

    def voltage(self, bus: I2cBus, setup: GuardSetup) -> float:
        """Return the last voltage, V; -1 before the first.

        The converter makes single shots, 128 a second, with 125 uV a count at +-4.096 V.
        """
        value = -1.0
        if self._asked:
            high, low = bus.read_i2c_block_data(setup.battery_address, 0x00, 2)
            count = high << 8 | low
            value = max(0.0, (count - 65536 if count >= 32768 else count) * 0.000125 * setup.divider)
        bus.write_i2c_block_data(setup.battery_address, 0x01, [0xC3 | setup.battery_channel << 4, 0x83])
        self._asked = True
        return value


class Quadrature:
    """Counts the edges of an encoder's two signals, forward positive: A before B.

    With a single signal it counts all edges.
    """

    # by the levels AB before and after
    STEP: Final = (0, 1, -1, 0, -1, 0, 0, 1, 1, 0, 0, -1, 0, -1, 1, 0)

    def __init__(self, pins: Sequence[int]) -> None:
        self._pins = pins
        self._levels = 0
        self.count = 0

    def edge(self, pin: int, level: int) -> None:
        """Count a change of a signal."""
        if len(self._pins) == 1:
            self.count += 1
            return
        bit = 2 if pin == self._pins[0] else 1
        before = self._levels
        self._levels = before | bit if level else before & ~bit
        self.count -= self.STEP[before << 2 | self._levels]


class Guarded:
    """Outputs and sensors of a setup; `feed` sets the level of the pin that feeds a watchdog of the outputs."""

    def __init__(
        self,
        setup: GuardSetup,
        bus: I2cBus | None,
        output: Output,
        encoders: Sequence[Quadrature] = (),
        feed: Callable[[int], object] = int,
    ) -> None:
        self.setup, self.output, self.encoders = setup, output, encoders
        self._bus, self._feed, self._level = bus, feed, 0
        self._read: Callable[[I2cBus, GuardSetup], float] | None = {
            "ina219": ina219_voltage,
            "ads1115": Ads1115().voltage,
        }.get(setup.battery)
        self._answers, self._voltage = 0, -1.0

    def answer(self, pulses: Sequence[float]) -> bytes:
        """Put out pulses, and return the answer to the host."""
        done = True
        try:
            self.output.put(pulses)
            self._level ^= 1
            self._feed(self._level)
            if self._read is not None and self._bus is not None and self._answers % VOLTAGE_EVERY == 0:
                self._voltage = self._read(self._bus, self.setup)
        except OSError:
            done = False
        self._answers += 1
        counts = [encoder.count for encoder in self.encoders]
        return ANSWER.pack(done, self._voltage, *[*counts, 0, 0][:2])

    def neutral(self) -> bool:
        """Put out neutral pulses, again and again while the bus fails; return whether it succeeded."""
        for _ in range(NEUTRAL_TRIES):
            with suppress(OSError):
                self.output.put(self.setup.neutral)
                return True
        return False


def bus_class(setup: GuardSetup) -> Callable[[Any], Any]:
    """Import the class that opens the I2C bus of a setup."""
    if isinstance(setup.bus, str):
        # for a virtual bus only
        from txt1.cars.pi.chips import FileBus

        return FileBus
    # not installed on every host
    from smbus2 import SMBus

    made: Callable[[Any], Any] = SMBus
    return made


def open_bus(setup: GuardSetup) -> I2cBus | None:
    """Return the I2C bus of a setup; None if it needs none."""
    if setup.output != "pca9685" and setup.battery == "none":
        return None
    bus = bus_class(setup)(setup.bus)
    if not isinstance(setup.bus, str):
        # not every adapter supports it
        with suppress(OSError):
            fcntl.ioctl(bus.fd, I2C_TIMEOUT, TRANSFER_MAX)
    opened: I2cBus = bus
    return opened


def claim(setup: GuardSetup, patience: int = 0) -> int:
    """Lock the servo board, and return the descriptor that holds the lock; -1 if pins are the outputs.

    The lock is a byte of the bus device, at the board's address, so each board on a bus has its own lock. It ends with
    this process, even if the process is killed. For pins no lock is needed: Linux gives a pin to a single process.
    Raises OSError EBUSY when another process holds it for `patience` times `SILENCE_MS`.
    """
    if setup.output != "pca9685":
        return -1
    if isinstance(setup.bus, str):
        held = os.open(setup.bus, os.O_RDWR | os.O_CLOEXEC | os.O_CREAT, 0o666)
    else:
        held = os.open(f"/dev/i2c-{setup.bus}", os.O_RDWR | os.O_CLOEXEC)
    wanted = LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, setup.address, 1, 0)
    while True:
        try:
            fcntl.fcntl(held, fcntl.F_OFD_SETLK, wanted)
            return held
        except OSError:
            if patience <= 0:
                os.close(held)
                raise OSError(errno.EBUSY, "another robot drives this servo board") from None
        patience -= 1
        select.select([], [], [], SILENCE_MS / 1000.0)


def pins_library() -> Any:
    """Return lgpio. It makes a pipe in LG_WD, or else in the present folder, which may be read-only."""
    if "LG_WD" not in os.environ:
        os.environ["LG_WD"] = mkdtemp(prefix="txt1-")
    import lgpio  # type: ignore[import-untyped]  # where pins are used only

    return lgpio


def open_chip(lgpio: Any) -> int:
    """Return a handle of the chip with the header's pins; its number depends on the Raspberry Pi and its kernel."""
    for number in (0, 4):
        with suppress(lgpio.error):
            chip: int = lgpio.gpiochip_open(number)
            if "pinctrl" in lgpio.gpio_get_chip_info(chip)[-1]:
                return chip
            lgpio.gpiochip_close(chip)
    raise OSError("there is no GPIO header: is this a Raspberry Pi?")


def guarded(setup: GuardSetup) -> Guarded:
    """Return outputs and sensors, opened; raises OSError or ImportError."""
    bus = open_bus(setup)
    encoders = [Quadrature(pins) for pins in setup.encoders]
    chip, lgpio, on_desk = 0, None, isinstance(setup.bus, str)
    feed: Callable[[int], object] = int
    if setup.output == "gpio" or encoders or (setup.watchdog is not None and not on_desk):
        lgpio = pins_library()
        chip = open_chip(lgpio)
    for encoder, pins in zip(encoders, setup.encoders, strict=True):
        assert lgpio is not None
        for pin in pins:
            lgpio.gpio_claim_alert(chip, pin, lgpio.BOTH_EDGES, lgpio.SET_PULL_UP)
            lgpio.callback(chip, pin, lgpio.BOTH_EDGES, lambda _, gpio, level, __, e=encoder: e.edge(gpio, level))
    if setup.output == "gpio":
        return Guarded(setup, bus, GpioPulses(lgpio, chip, setup), encoders)
    assert bus is not None
    if setup.watchdog is not None and on_desk:
        from txt1.cars.pi.chips import FilePin

        feed = FilePin(f"{setup.bus}.watchdog").set
    elif setup.watchdog is not None:
        assert lgpio is not None
        lgpio.gpio_claim_output(chip, setup.watchdog, 0)
        feed = partial(lgpio.gpio_write, chip, setup.watchdog)
    return Guarded(setup, bus, Pca9685(bus, setup), encoders, feed)


def neutral_without_guard(setup: GuardSetup) -> bool:
    """Put out neutral in place of a killed guard; return whether the outputs are neutral.

    No guard may run meanwhile. Pulses from pins have ended with the guard, but a servo board repeats the last pulse.
    """
    if setup.output != "pca9685":
        return True
    with suppress(OSError, ImportError):
        held = claim(setup)
        try:
            bus = open_bus(setup)
            assert bus is not None
            try:
                return Guarded(setup, bus, Pca9685(bus, setup)).neutral()
            finally:
                bus.close()
        finally:
            os.close(held)
    return False


def pulses_in(setup: GuardSetup, pulses: Sequence[float]) -> bytes:
    """Return the message with these pulses, us."""
    return setup.pulses.pack(*(round(pulse / PULSE) for pulse in pulses))


def main(words: Sequence[str]) -> int:
    """Guard the outputs until the host has ended."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE):
        # the guard ends with its host
        signal.signal(number, signal.SIG_IGN)
    setup = GuardSetup(**json.loads(words[0]))
    try:
        claim(setup, TAKEN)
        guard = guarded(setup)
        guard.output.put(setup.neutral)
    except (OSError, ImportError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    host, stdin, stdout = os.getppid(), 0, 1
    os.set_blocking(stdout, False)
    os.write(stdout, guard.answer(setup.neutral))
    looking, rest, size = select.poll(), b"", setup.pulses.size
    looking.register(stdin, select.POLLIN)
    while os.getppid() == host:
        if not looking.poll(SILENCE_MS):
            guard.neutral()
            continue
        data = os.read(stdin, 4096)
        # pulses that a dead host has left in the pipe are old
        if not data or os.getppid() != host:
            break
        rest += data
        whole = len(rest) // size * size
        if whole:
            newest, rest = rest[whole - size : whole], rest[whole:]
            # the host does not read
            with suppress(OSError):
                os.write(stdout, guard.answer([PULSE * count for count in setup.pulses.unpack(newest)]))
    for _ in range(LAST_TRIES):
        if guard.neutral():
            return 0
        select.select([], [], [], SILENCE_MS / 1000.0)
    return 1


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stderr.flush()
    # the host waits for this end, and Python's own exit takes longer than all the rest
    os._exit(code)
