"""The virtual board: the board's tasks over the simulated vehicle, behind a line (thesis 3.3.3, 3.5).

To a host it is the real board. It starts as the spec of the firmware says: link lost, all gains 0, and nothing moves
before a PID set and Velocity have come. It knows no arming from outside, as no message of the protocol arms: the link
opens the safety gate, and a stop for any other reason ends when the host has asked for nothing for a second. Headings
go out between -3.142 and 3.142; the originals count 0 to 6.283, and hosts have to take both.

With `board.habits=original` it is a board of 2011, as those were seen to work (`txt1.board.original`).
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from typing import Final, NamedTuple, Protocol

from txt1.board.far_end import far_end
from txt1.board.original import PID_SET, Framer, OriginalFirmware
from txt1.board.settings import BoardConfig
from txt1.config import Config
from txt1.errors import CommandRefused, EncodeError, HalError, LinkLost, NotArmed
from txt1.hal.base import LINK, Button
from txt1.hal.registry import create_sim
from txt1.kernel.ticks import Ticks
from txt1.link.base import End, Link, connect
from txt1.link.device import open_link
from txt1.link.impairments import paced
from txt1.link.receiver import Receiver
from txt1.protocol.decoder import Event, FrameFault, Reason
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import BoardMessage, HostMessage, PidResponse, PowerControl, PwmTest, Switch, Velocity
from txt1.runtime import Runtime
from txt1.telemetry.snapshot import Snapshot

# s in which the host has asked for nothing, after which the board obeys again
LET_GO: Final = 1.0

# s after which a serial device that has gone is tried again
REOPEN: Final = 0.5

SPACER: Final = b"\x00"
"""Between frames back to back: original hosts lose the byte that follows a frame when it is there already."""

# s of silence on the line after which a frame needs no spacer
SPACING: Final = 0.02


EVENTS: Final = ("centre", "restart", "esc", "battery")


class BoardEvent(NamedTuple):
    """Something that happens to a board, one of EVENTS.

    centre: somebody presses the button; restart: it is without power for `value` s; esc: an earlier host's command puts
    the switch to on (1) or off (0); battery: each pack reads `value` V, None: as charged.
    """

    name: str
    value: float | None = None


class Framing(Protocol):
    """Makes events of a host's bytes."""

    def feed(self, data: bytes) -> None:
        """Take bytes."""

    def close(self) -> None:
        """Forget what is half there."""


@dataclass(frozen=True)
class Habits:
    """How a board behaves where the protocol is silent."""

    # finds the frames, and hands on what is in them
    framing: Callable[[Callable[[Event], None]], Framing]
    # between frames back to back
    spacer: bytes
    # it has our tasks and safety gate, else those of the originals
    gated: bool


HABITS: Final = {
    "ours": Habits(lambda take: Receiver(Role.BOARD, take), SPACER, gated=True),
    "original": Habits(Framer, b"", gated=False),
}


class Board:
    """A virtual board, the `End` of its host's link; `manual`: it obeys PWM test instead of Velocity at first."""

    def __init__(self, config: Config, *, manual: bool = False) -> None:
        settings = config.section(BoardConfig)
        timeout = settings.link_timeout
        limits = replace(config.limits(), command_timeout=inf if timeout is None else timeout)
        own = config.model_copy(update={"hal": "sim"})
        self.habits: Final = HABITS[settings.habits]
        # an original had both packs
        if not self.habits.gated and own.sim.battery.used_2 is None:
            packs = replace(own.sim.battery, used_2=own.sim.battery.used_1)
            own = own.model_copy(update={"sim": own.sim.model_copy(update={"battery": packs})})
        tasks = None if self.habits.gated else lambda runtime: self._original(runtime).tasks()
        hal = create_sim(own)
        self.vehicle: Final = hal.vehicle
        """The simulated vehicle that it is on."""
        self.runtime = Runtime(own, self.send, hal, limits=limits, name="board", tasks=tasks)
        self.original: OriginalFirmware | None = None
        """The firmware of an original board, once it has power."""
        if manual:
            self.runtime.press(Button.CENTRE)
        self.receiver: Final = self.habits.framing(self._take)
        self.faulty: Final = far_end(self, config)
        """The board behind the configured faults of its line."""
        self.paced: Final = paced(self.faulty, config.serial.baud)
        """The same at the line's baud rate: for a line that does not pace the bytes itself."""
        self._loop = asyncio.get_running_loop()
        self.link: Link | None = None
        # loop time at which the line falls silent
        self._busy_until = -inf
        self._byte_time = 10.0 / config.serial.baud
        # run time when the host last asked for motion
        self._wanted = -inf
        self._may_arm = True

    async def power_up(self) -> None:
        """Start the tasks; raises what `Runtime.start` raises."""
        await self.runtime.start()
        if self.habits.gated:
            self.runtime.add_task("arming", 2, 0.1, self._arming)
        else:
            # it has none: nothing keeps its outputs from the motors
            self.runtime.gate.arm(self.now)

    def _original(self, runtime: Runtime) -> OriginalFirmware:
        self.original = OriginalFirmware(runtime.state, runtime.hal, runtime.inbox, runtime.presses, self.send)
        return self.original

    async def power_down(self) -> None:
        """Stop the vehicle and the tasks; harmless when that is done already."""
        self.hang_up()
        await self.runtime.stop()

    def hang_up(self) -> None:
        """Let go of the line."""
        self.receiver.close()
        if self.link is not None:
            self.link.close()
            self.link = None

    def connected(self, link: Link) -> None:
        """A host may be at the other side."""
        self.link = link
        # nothing of what an earlier host sent counts
        self.receiver.close()
        self.tell(f"line {link.address} open")

    def lost(self, reason: str) -> None:
        """The line is gone; the link rule does the rest."""
        self.link = None
        self.receiver.close()
        self.tell(f"line lost: {reason}")

    def received(self, data: bytes) -> None:
        """Hand the serial task what the host sent."""
        self.runtime.bus.publish(LINK, ("in", data), self.runtime.now)
        self.receiver.feed(data)

    def _take(self, event: Event) -> None:
        now = self.runtime.now
        if not self.habits.gated:
            if isinstance(event, HostMessage):
                self.runtime.post(event, now)
            return
        match event:
            case FrameFault():
                self.runtime.state.count_on_line(event.reason.name.lower())
                # a malformed PID set is answered; the answer itself, echoed, is not
                if event.reason is Reason.BAD_LENGTH and event.head[3] == PID_SET and event.head[2] != 1:
                    self.send(PidResponse(False))
                return
            case Velocity(v, omega) if v or omega:
                self._wanted = now
            case PwmTest(motor) if motor:
                self._wanted = now
            case PowerControl(Switch.ATX, False) if now - self._wanted >= LET_GO and self.runtime.stands(now):
                self.runtime.gate.disarm("the host has switched the ATX supply off")
        self.runtime.post(event, now)

    def send(self, message: BoardMessage) -> None:
        """Put a message on the line; it is lost when there is none."""
        if self.link is None:
            return
        try:
            frame = encode(message)
        except EncodeError:
            # farther away than 2000 km
            return
        time = self._loop.time()
        if time < self._busy_until + SPACING:
            frame = self.habits.spacer + frame
        self._busy_until = max(time, self._busy_until) + len(frame) * self._byte_time
        self.runtime.bus.publish(LINK, ("out", frame), self.runtime.now)
        # `lost` is on its way
        with suppress(LinkLost):
            self.link.write(frame)

    async def _arming(self, ticks: Ticks) -> None:
        """Open the gate with the link, and after any other stop when the host has let go."""
        runtime = self.runtime
        async for now in ticks:
            if not runtime.state.link.alive or now - self._wanted >= LET_GO:
                self._may_arm = True
            if runtime.gate.armed:
                self._may_arm = False
            elif self._may_arm and runtime.state.link.alive and not runtime.gate.stopped:
                with suppress(NotArmed):
                    runtime.arm()

    @property
    def snapshot(self) -> Snapshot:
        """Everything that the board tells, by topic, as it is now."""
        return self.runtime.snapshot()

    @property
    def now(self) -> float:
        """Seconds since power-up."""
        return self.runtime.now

    def arm(self) -> None:
        """Release the emergency stop, or obey again at once; raises NotArmed, which says why it may not."""
        if self.habits.gated:
            self.runtime.arm()

    def disarm(self, reason: str) -> None:
        """Stop, until the host has let go for a second from now."""
        self._wanted, self._may_arm = self.runtime.now, False
        self.runtime.disarm(reason)

    def stop(self) -> None:
        """Emergency stop: neutral outputs at once, latched until armed again; an original board has none."""
        if self.habits.gated:
            self.runtime.emergency_stop()
        else:
            self.tell("an original board has no emergency stop: its host has to stop it")

    def happen(self, event: BoardEvent) -> None:
        """Let something happen to the board; raises CommandRefused when it cannot happen to this one."""
        name, value = event
        match name:
            case "centre":
                self.press(Button.CENTRE)
            case "esc":
                self.runtime.post(PowerControl(Switch.ESC, bool(value)), self.now)
            case "battery":
                self.vehicle.faults = replace(self.vehicle.faults, voltage=value)
            case "restart":
                if self.original is None:
                    raise CommandRefused("only a board with the habits of an original restarts here: --as original")
                self.original.restart(self.now, value or 0.0)

    def press(self, button: Button) -> None:
        """Press a button of the joystick."""
        self.runtime.press(button)

    def tell(self, text: str) -> None:
        """Add a line to the event log."""
        self.runtime.state.tell(self.runtime.now, text)


class DevicePlace:
    """A board's place on a serial device, which may be unplugged and come back."""

    def __init__(self, board: Board, device: str) -> None:
        self.address = device
        self._board = board
        self._link: Link | None = None
        self._keeper: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Open the device, and again whenever it was lost; raises HalError if it cannot be opened the first time."""
        await self._open()
        self._keeper = asyncio.ensure_future(self._keep())

    async def _open(self) -> None:
        self._link = await open_link(self.address, self._board.faulty, self._board.runtime.config.serial.baud)

    async def _keep(self) -> None:
        while True:
            await asyncio.sleep(REOPEN)
            if self._board.link is None:
                # not back yet
                with suppress(HalError):
                    await self._open()

    def close(self) -> None:
        """Let go of it."""
        if self._keeper is not None:
            self._keeper.cancel()
        if self._link is not None:
            self._link.close()


class VirtualPort:
    """A port with a virtual board behind it, in the same process and in the same time."""

    address = "virtual"

    def __init__(self, config: Config) -> None:
        self._config = config
        self.board: Board | None = None

    async def open(self, end: End) -> Link:
        """A link to the board, powered up first if need be; raises TaskFault when a task of the board has failed."""
        if self.board is None:
            self.board = board = Board(self._config, manual=self._config.serial.control == "host")
            await board.power_up()
            # a board that fails hangs up, and the host finds the reason when it tries again
            board.runtime.scheduler.ended.add_done_callback(lambda _: board.hang_up())
        ended = self.board.runtime.scheduler.ended
        if ended.done():
            ended.result()
        return connect(end, self.board.paced)[0]

    async def close(self) -> None:
        """Power the board down."""
        if self.board is not None:
            board, self.board = self.board, None
            await board.power_down()
            # raises the TaskFault, if there was one
            await board.runtime.scheduler.ended
