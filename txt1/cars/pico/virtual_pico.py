"""The Pico's firmware under MicroPython's unix port, with a simulated vehicle behind its pins.

The firmware is a process of its own. Every 20 ms of the loop's time it gets its counters, voltages and buttons, and
answers with its outputs. The host's bytes are passed on as they come. So it runs in virtual time as well as in real
time. firmware/pico/desk.py describes the record of a cycle.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from struct import Struct
from typing import IO, Final, NamedTuple

from txt1.board.line_faults import far_end
from txt1.cars.pico.installer import folder
from txt1.config import Config
from txt1.errors import HalError, MissingExtra
from txt1.hal.base import Button, Hal, Outputs
from txt1.hal.registry import create
from txt1.hal.simulated_controller import ControllerPort
from txt1.link.impairments import paced
from txt1.link.virtual_device import VirtualDevice
from txt1.protocol.messages import Switch
from txt1.rc.settings import BOARD, RcParameters, firmware_settings
from txt1.rc.virtual_receiver import STEERING, SWITCH, THROTTLE, VirtualReceiver

CYCLE_PERIOD: Final = 0.02
REQUEST: Final = Struct("<BBhhHHHH")
REPLY: Final = Struct("<iiiiiBBBBH")
CHUNK: Final = 1000


class CycleReport(NamedTuple):
    """The firmware's report after a cycle.

    Attributes:
        outputs: PWM counts of motor, front, rear and the two free servos.
        atx: the ATX supply is on.
        esc: the ESC is on.
        armed: its safety gate is open.
        link: it hears its host.
        manual: it is in manual mode.
        buzzer: its buzzer sounds.
        reason: why the gate is closed, an index of `txt1pico.core.REASONS`.
        screen: which screen its display shows.

    """

    outputs: tuple[int, int, int, int, int] = (0, 0, 0, 0, 0)
    atx: bool = True
    esc: bool = True
    armed: bool = False
    link: bool = False
    manual: bool = False
    buzzer: bool = True
    reason: int = 1
    screen: int = 0


def interpreter() -> str:
    """Return the path of MicroPython's unix port.

    Raises:
        MissingExtra: it is not installed.

    """
    beside = Path(sys.executable).with_name("micropython")
    found = str(beside) if beside.exists() else shutil.which("micropython")
    if found is None:
        raise MissingExtra("the Pico's firmware on this computer", "devices")
    return found


class Pico(VirtualDevice):
    """A board with txt1's firmware, the `End` of the host's link.

    Args:
        config: configuration of the simulated vehicle.

    """

    def __init__(self, config: Config) -> None:
        self.hal: Hal = create(config.model_copy(update={"hal": "sim"}))
        self.line = paced(far_end(self, config), config.serial.baud)
        """The board's end of the line, with the configured baud rate and faults."""
        self.state = CycleReport()
        self.buttons = Button.NONE
        """The joystick's buttons that are held down."""
        self.radio: VirtualReceiver | None = None
        """A virtual receiver of a radio control, if `rc.port` is board."""
        given = config.section(RcParameters)
        self._protocol = given.protocol
        if given.port == BOARD:
            self.radio = VirtualReceiver(given.protocol)
        self._process: subprocess.Popen[bytes] | None = None
        self._cycles: asyncio.Task[None] | None = None
        self._counts = (0, 0)
        self._began = 0.0

    async def power_up(self) -> None:
        """Start the firmware; raises MissingExtra or HalError."""
        await self.hal.open()
        self._began = asyncio.get_running_loop().time()
        self._process = await asyncio.to_thread(_start, self._words)
        if self.radio is not None:
            await self.radio.open(_OfRadio(self._radioed))
        counts = self.hal.read(0.0).ticks
        assert counts is not None
        self._counts = counts
        self._cycles = asyncio.create_task(self._run())

    async def power_down(self) -> None:
        """End the firmware and leave the vehicle's outputs neutral; harmless when it has ended already."""
        self.hang_up()
        if self._cycles is not None:
            self._cycles.cancel()
            with suppress(asyncio.CancelledError):
                await self._cycles
            self._cycles = None
        if self.radio is not None:
            self.radio.hang_up()
            await self.radio.close()
        await self._end_process()
        await self.hal.close()

    async def ended(self, duration: float | None = None) -> None:
        """Wait for the end of the firmware, at most `duration` s; raises HalError if it ended by itself."""
        assert self._cycles is not None
        with suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(self._cycles), duration)

    async def restart(self, off: float = 0.2) -> None:
        """Take the power away for `off` s: the outputs go low, and the firmware starts from nothing."""
        assert self._cycles is not None
        self._cycles.cancel()
        await self._end_process()
        self._put(CycleReport())
        await asyncio.sleep(off)
        self._process = await asyncio.to_thread(_start, self._words)
        self._cycles = asyncio.create_task(self._run())

    @property
    def _words(self) -> list[str]:
        """The settings of the receiver, for the firmware."""
        if self.radio is None:
            return []
        sticks = THROTTLE, STEERING, SWITCH
        if self._protocol == "pwm":
            # its inputs, in the order of the setting
            sticks = replace(THROTTLE, channel=1), replace(STEERING, channel=2), replace(SWITCH, channel=3)
        return [json.dumps(firmware_settings(*sticks, self._protocol))]

    def _radioed(self, data: bytes) -> None:
        self._exchange(0, (0, 0), (0, 0), b"", data)

    async def _end_process(self) -> None:
        if self._process is not None:
            process, self._process = self._process, None
            await asyncio.to_thread(_end, process)

    @property
    def now(self) -> float:
        """Seconds since power-up."""
        return asyncio.get_running_loop().time() - self._began

    async def _run(self) -> None:
        """Run the firmware's cycles at their times; late cycles count as missed periods."""
        cycle = round(self.now / CYCLE_PERIOD)
        while True:
            await asyncio.sleep(cycle * CYCLE_PERIOD - self.now)
            due = max(cycle, int(self.now / CYCLE_PERIOD))
            self._cycle(min(due - cycle + 1, 250))
            cycle = due + 1

    def _cycle(self, periods: int) -> None:
        now = self.now
        inputs = self.hal.read(now)
        right, left = inputs.ticks or self._counts
        one, two = (round(1000.0 * volts) for volts in inputs.batteries or (0.0, 0.0))
        moved = _of_16_bits(right - self._counts[0]), _of_16_bits(left - self._counts[1])
        self._counts = right, left
        self._exchange(periods, moved, (one, two), b"")

    def _exchange(
        self, periods: int, moved: tuple[int, int], voltages: tuple[int, int], data: bytes, radioed: bytes = b""
    ) -> None:
        """Send the firmware a record, and carry out its answer."""
        process = self._process
        if process is None:
            return
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(
                REQUEST.pack(periods, self.buttons, *moved, *voltages, len(data), len(radioed)) + data + radioed
            )
            process.stdin.flush()
            *outputs, switches, bits, reason, screen, count = REPLY.unpack(_read(process.stdout, REPLY.size))
            sent = _read(process.stdout, count)
        except (OSError, EOFError) as error:
            raise HalError(f"the Pico's firmware has ended: {error or 'no answer'}; see its output above") from error
        motor, front, rear, pwm4, pwm5 = outputs
        armed, link, manual, buzzer = (bool(bits >> bit & 1) for bit in range(4))
        self._put(
            CycleReport(
                (motor, front, rear, pwm4, pwm5),
                bool(switches & 1),
                bool(switches & 2),
                armed,
                link,
                manual,
                buzzer,
                reason,
                screen,
            )
        )
        self.send(sent)

    def _put(self, state: CycleReport) -> None:
        """Put out the firmware's outputs."""
        now, before = self.now, self.state
        if state.atx is not before.atx:
            self.hal.switch(Switch.ATX, state.atx, now)
        if state.esc is not before.esc:
            self.hal.switch(Switch.ESC, state.esc, now)
        if state.outputs != before.outputs:
            self.hal.write(Outputs(*state.outputs), now)
        self.state = state

    # -- the link's end --------------------------------------------------------------------------------------------

    def received(self, data: bytes) -> None:
        """Pass the host's bytes to the firmware."""
        for start in range(0, len(data), CHUNK):
            self._exchange(0, (0, 0), (0, 0), data[start : start + CHUNK])


class _OfRadio(VirtualDevice):
    """The firmware's end of the line to its receiver."""

    def __init__(self, take: Callable[[bytes], None]) -> None:
        self._take = take

    def received(self, data: bytes) -> None:
        """Pass bytes on."""
        self._take(data)


def _of_16_bits(counts: int) -> int:
    """Return counts as a 16-bit number tells them, so as far as it can."""
    return min(max(counts, -0x8000), 0x7FFF)


def _start(words: list[str]) -> subprocess.Popen[bytes]:
    """Start the firmware; called in a thread."""
    return subprocess.Popen(  # noqa: S603 - our own program
        [interpreter(), "desk.py", *words], cwd=folder(), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the firmware and wait for it; called in a thread."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


def _read(pipe: IO[bytes], size: int) -> bytes:
    """Read exactly `size` bytes."""
    data = pipe.read(size)
    if len(data) < size:
        raise EOFError
    return data


def port(config: Config) -> ControllerPort[Pico]:
    """Return a port with a Pico behind it: ``serial.port: pico``. Opening it raises MissingExtra or HalError."""
    return ControllerPort("pico", lambda: Pico(config))
