"""The virtual board: the board's tasks over the simulated vehicle, behind a line (thesis 3.3.3, 3.5).

To a host it is the real board. It starts as the spec of the firmware says: link lost, all gains 0, and nothing moves
before a PID set and Velocity have come. The protocol has no message that arms. So the link opens the safety gate, and a
stop for any other reason ends when the host has commanded no motion for a second. Headings go out between -3.142 and
3.142; the originals count 0 to 6.283, and hosts have to take both.

With `board.habits=original` it behaves like a board of 2011 (`txt1.board.original`).
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from typing import Final, NamedTuple, Protocol

from txt1.board.line_faults import far_end
from txt1.board.original import PID_SET, Framer, OriginalFirmware
from txt1.board.settings import BoardConfig
from txt1.config import Config
from txt1.errors import CommandRefused, EncodeError, LinkLost, NotArmed
from txt1.hal.base import LINK, Button
from txt1.hal.registry import create_sim
from txt1.kernel.ticks import Ticks
from txt1.link.base import End, Link, connect
from txt1.link.device import DevicePort
from txt1.link.impairments import paced
from txt1.link.receiver import Receiver
from txt1.link.silence import Watched
from txt1.protocol.decoder import Event, FrameFault, Reason
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import BoardMessage, HostMessage, PidResponse, PowerControl, PwmTest, Switch, Velocity
from txt1.runtime import Runtime
from txt1.telemetry.snapshot import Snapshot

# s without a commanded motion after which the board obeys again
LET_GO: Final = 1.0

SPACER: Final = b"\x00"
"""Sent between frames back to back: original hosts lose the byte that follows a frame if it has already arrived."""

# s of silence on the line after which a frame needs no spacer
SPACER_SILENCE: Final = 0.02


ENCODERS: Final = {"encoders": ("right", "left"), "right_encoder": ("right",), "left_encoder": ("left",)}
"""The events of the encoders, and the sides that lose their power."""

EVENTS: Final = ("centre", "restart", "esc", "battery", *ENCODERS)


class BoardEvent(NamedTuple):
    """An event at a board, one of EVENTS.

    centre: the button is pressed. restart: the board is without power for `value` s. esc: an earlier host's command
    turns the switch on (1) or off (0). battery: each pack reads `value` V; None: its charge. encoders, right_encoder,
    left_encoder: their counters stand still (0), or count again (1).
    """

    name: str
    value: float | None = None


class Framing(Protocol):
    """Makes events from a host's bytes."""

    def feed(self, data: bytes) -> None:
        """Take bytes."""

    def close(self) -> None:
        """Discard an unfinished frame."""


@dataclass(frozen=True)
class Habits:
    """The behaviour of a board where the protocol is silent."""

    # finds the frames, and passes on their messages
    framing: Callable[[Callable[[Event], None]], Framing]
    # sent between frames back to back
    spacer: bytes
    # whether it has txt1's tasks and safety gate, or those of the originals
    gated: bool


HABITS: Final = {
    "ours": Habits(lambda take: Receiver(Role.BOARD, take), SPACER, gated=True),
    "original": Habits(Framer, b"", gated=False),
}


class Board:
    """A virtual board, the `End` of its host's link; `manual`: it starts in manual mode and obeys PWM test."""

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
        """The board's simulated vehicle."""
        self.runtime = Runtime(own, self.send, hal, limits=limits, name="board", tasks=tasks)
        self.original: OriginalFirmware | None = None
        """The firmware of an original board, while it has power."""
        if manual:
            self.runtime.press(Button.CENTRE)
        self.receiver: Final = self.habits.framing(self._take)
        self.faulty: Final = far_end(self, config)
        """The board behind the configured faults of its line."""
        self.paced: Final = paced(self.faulty, config.serial.baud)
        """The same board with the line's baud rate, for a line that does not pace the bytes itself."""
        self._loop = asyncio.get_running_loop()
        self.link: Link | None = None
        # loop time at which the line falls silent
        self._busy_until = -inf
        self._byte_time = 10.0 / config.serial.baud
        # run time of the host's last command to move
        self._wanted = -inf
        self._may_arm = True

    async def power_up(self) -> None:
        """Start the tasks; raises as `Runtime.start`."""
        await self.runtime.start()
        if self.habits.gated:
            self.runtime.add_task("arming", 2, 0.1, self._arming)
        else:
            # it has no safety gate: nothing keeps its outputs from the motors
            self.runtime.gate.arm(self.now)

    def _original(self, runtime: Runtime) -> OriginalFirmware:
        self.original = OriginalFirmware(runtime.state, runtime.hal, runtime.inbox, runtime.presses, self.send)
        return self.original

    async def power_down(self) -> None:
        """Stop the vehicle and the tasks; harmless when it has no power."""
        self.hang_up()
        await self.runtime.stop()

    def hang_up(self) -> None:
        """Close the line."""
        self.receiver.close()
        if self.link is not None:
            self.link.close()
            self.link = None

    def connected(self, link: Link) -> None:
        """Take the line; a host may be at its other end."""
        self.link = link
        # bytes of an earlier host do not count
        self.receiver.close()
        self.tell(f"line {link.address} open")

    def lost(self, reason: str) -> None:
        """Take the loss of the line; the link rule then stops the vehicle."""
        self.link = None
        self.receiver.close()
        self.tell(f"line lost: {reason}")

    def received(self, data: bytes) -> None:
        """Pass the host's bytes to the serial task."""
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
                # a malformed PID set is answered; an echo of the board's own answer is not
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
        """Put a message on the line; without a line it is lost."""
        if self.link is None:
            return
        try:
            frame = encode(message)
        except EncodeError:
            # farther away than 2000 km, beyond the message's range
            return
        time = self._loop.time()
        if time < self._busy_until + SPACER_SILENCE:
            frame = self.habits.spacer + frame
        self._busy_until = max(time, self._busy_until) + len(frame) * self._byte_time
        self.runtime.bus.publish(LINK, ("out", frame), self.runtime.now)
        # the link calls `lost` next
        with suppress(LinkLost):
            self.link.write(frame)

    async def _arming(self, ticks: Ticks) -> None:
        """Open the gate when the link comes up, and after any other stop when the host commands no motion."""
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
        """Return the present telemetry of the board."""
        return self.runtime.snapshot()

    @property
    def now(self) -> float:
        """Seconds since power-up."""
        return self.runtime.now

    def arm(self) -> None:
        """Release the emergency stop, or obey again at once; raises NotArmed with the reason."""
        if self.habits.gated:
            self.runtime.arm()

    def disarm(self, reason: str) -> None:
        """Stop, until the host has commanded no motion for a second from now."""
        self._wanted, self._may_arm = self.runtime.now, False
        self.runtime.disarm(reason)

    def stop(self) -> None:
        """Emergency stop: neutral outputs at once, latched until armed again.

        An original board has none and raises an error.
        """
        if self.habits.gated:
            self.runtime.emergency_stop()
        else:
            self.tell("an original board has no emergency stop: its host has to stop it")

    def happen(self, event: BoardEvent) -> None:
        """Let an event happen to the board; raises CommandRefused if it cannot happen to this kind of board."""
        name, value = event
        match name:
            case "centre":
                self.press(Button.CENTRE)
            case "esc":
                self.runtime.post(PowerControl(Switch.ESC, bool(value)), self.now)
            case "battery":
                self.vehicle.faults = replace(self.vehicle.faults, voltage=value)
            case "encoders" | "right_encoder" | "left_encoder":
                dead = {f"{side}_encoder": not value for side in ENCODERS[name]}
                self.vehicle.faults = replace(self.vehicle.faults, **dead)
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
    """A board's serial device, which may be unplugged and come back, also on another name."""

    def __init__(self, board: Board, device: str) -> None:
        self.address = device
        self._board = board
        port = DevicePort(device, board.runtime.config.serial.baud)
        # a host may be silent for ever
        self._watched = Watched(port, board.faulty, inf, None, board.tell, lambda error: board.tell(str(error)))

    async def open(self) -> None:
        """Open the device, and open it again whenever it is lost. Raises HalError if the first attempt fails."""
        await self._watched.open()

    def close(self) -> None:
        """Close the device."""
        self._watched.close()
        if self._board.link is not None:
            self._board.link.close()


class VirtualPort:
    """A port with a virtual board behind it, in the same process and on the same clock."""

    address = "virtual"

    def __init__(self, config: Config) -> None:
        self._config = config
        self.board: Board | None = None

    async def open(self, end: End) -> Link:
        """Return a link to the board, and power the board up first if needed; raises TaskFault if a task of the
        board failed.
        """
        if self.board is None:
            self.board = board = Board(self._config, manual=self._config.serial.control == "host")
            await board.power_up()
            # a failed board hangs up, and the host finds the reason at its next attempt
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
