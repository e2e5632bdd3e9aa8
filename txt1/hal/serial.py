"""The real board as a HAL: the protocol's client, over any byte link (thesis 3.5).

It sends Velocity all the time it is connected, repeats a PID set until the board acknowledges it, takes odometry and
battery levels as they come, notices when the board is gone, and finds it again.
"""

import asyncio
import os
from collections.abc import Callable
from math import cos, hypot, inf, sin
from typing import Final, Literal, Protocol

from txt1.errors import ConfigError, EncodeError, HalError, LinkLost, NotCapable
from txt1.hal.base import BoardLink, Capabilities, Indicators, Inputs, Outputs
from txt1.link.base import End, Link
from txt1.link.device import open_link
from txt1.link.ports import only_candidate
from txt1.link.pty import is_left_behind
from txt1.link.receiver import Receiver
from txt1.link.tcp import BOARD
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.protocol.decoder import Event, FrameFault, Reason
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
    PID_SET_PERIOD,
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    HostMessage,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)

SEND_PERIOD: Final = 0.05  # s between two Velocity messages: 20 Hz, all the time (the original driver: 10 Hz)

REJECTIONS_MAX: Final = 3  # answers "rejected" that are believed: a damaged PID set gets one, too

COMBINED_PERIOD: Final = 0.02  # shortest s between two combined odometry messages: more would crowd the line

LOST: Final = 0.45
"""Age in s at which odometry means that the board is lost: noticed within 0.5 s, waiting for the next tick included."""

SETTLED: Final = 1.2
"""s of odometry before the first set-point. Boards judge the link once a second; by then they have found it alive, and
the first step of their loops, which takes the whole outage for its period, has had a set-point of 0."""

LATE: Final = 0.08  # s between two odometry messages (20 Hz) that mean that one was lost

LOSSY: Final = 5.0
"""s for which a line that lost a frame is sent Velocity at every tick, so that the board's time-out sees enough."""

JUMP_TIME: Final = 0.5
"""s of motion by which two poses in a row may be further apart than the time between their arrivals explains ..."""

JUMP_SPEED: Final = 0.3  # ... at so many m/s more than either of them reports ...

JUMP_ANGLE: Final = 1.5  # ... and so many rad.

AT_ONCE: Final = 0.1
"""The same for a pose of exactly 0, 0, 0 at rest, where boards begin: s of motion ..."""

NEAR: Final = 0.003  # ... and so many m, or rad, which rounding explains.

PAUSE: Final = 0.205
"""s without odometry behind which such a pose may be that of a board that restarted: nothing tells it from a pause."""

STARTS_AGAIN: Final = (0.3, 0.5)
"""Shares of a battery level, within which the next one comes of a filter that has started again at 0 (weight 0.4)."""

BACKOFF_MIN: Final = 0.1
BACKOFF_MAX: Final = 0.9
"""s before the first and between the later attempts to reconnect: within a second of the board's return."""

REPEAT_PERIOD: Final = 1.0
"""s after which servos and an ESC that is off are sent again: nothing else mends a lost frame, or a restart.

No switch is ever turned on again, and the ATX supply is never switched twice.
"""

HEAL_PERIOD: Final = 10.0
"""s after which acknowledged gains are sent again, while Velocity is zero: a board may have restarted unnoticed."""

LAST_ZEROS: Final = 0.15
"""s of zeros before the board's loops are cleared: the set-point is 0 meanwhile, even if the line loses a frame."""

ESC_SILENCE: Final = 2.2
"""s without Velocity before the ESC may come on: by the link rule of 1 to 2 s the board clears its loops."""

ESC_ZEROS: Final = 1.05
"""s of zeros after them, so that the board hears its host again ..."""

FAREWELLS: Final = 3  # zero set-points with which the board is left


class Port(Protocol):
    """Where the board is found."""

    @property
    def address(self) -> str:
        """For people."""

    async def open(self, end: End) -> Link:
        """A link to it, up; raises HalError, which says what to do. Another error ends the run."""

    async def close(self) -> None:
        """Let go of what was needed for it."""


class DevicePort:
    """A serial device, or socket://host:port; None: the only device there is, wherever it turns up when plugged in.

    The first line of `secret_file` is the secret of a board on a network;
    `behind` is the command that serves such a port.
    """

    def __init__(self, address: str | None, baud: int, secret_file: str | None = None, behind: str = BOARD) -> None:
        self._wanted = address
        self._behind = behind
        self._secret_file = secret_file
        self._baud = baud
        self._spent: tuple[int, int] | None = None
        self.address = address or "the serial port"

    async def open(self, end: End) -> Link:
        """A link to it."""
        if self._wanted is None:
            self.address = await asyncio.to_thread(only_candidate)
        # A board that was killed leaves its link to a pseudo-terminal behind, whose name may be a stranger's by now.
        made = await asyncio.to_thread(_link_made, self.address)
        left = await asyncio.to_thread(is_left_behind, self.address)
        if left or (left is None and made is not None and made == self._spent):
            raise HalError(f"{self.address} was left behind by a board that is gone; waiting for a new one")
        secret = None if self._secret_file is None else await asyncio.to_thread(_secret_in, self._secret_file)
        link = await open_link(self.address, end, self._baud, secret, self._behind)
        self._spent = made
        return link

    async def close(self) -> None:
        """Nothing is left to let go of."""


def _secret_in(file: str) -> bytes:
    """Return the first line of a file."""
    try:
        with open(file, "rb") as lines:
            secret = lines.readline().strip()
    except OSError as error:
        raise ConfigError(f"serial.secret_file: {file}: {error.strerror}; write the board's secret there") from None
    if not secret:
        raise ConfigError(f"serial.secret_file: {file} is empty; write the board's secret there")
    return secret


def _link_made(address: str) -> tuple[int, int] | None:
    """Which link to a pseudo-terminal this is: its inode and when it was made, ns; None for anything else."""
    try:
        if not os.readlink(address).startswith("/dev/pts/"):
            return None
        status = os.lstat(address)
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns


class SerialHal:
    """A TXT-1 board behind a line, which `wrap` may put faults on.

    `control` closes the velocity loops: the board, or (experimental) this host with PWM test messages, to a board in
    manual mode. `scale` is of the board's lengths and angles; original boards read 6.3 % low. `simulated`: nothing real
    is behind the port.
    """

    name = "serial"

    def __init__(
        self,
        port: Port,
        wrap: Callable[[End], End] | None = None,
        control: Literal["board", "host"] = "board",
        scale: float = 1.0,
        simulated: bool = False,
    ) -> None:
        self.port = port
        self.receiver = Receiver(Role.HOST, self._take)
        on_board = control == "board"
        self.capabilities = Capabilities(
            odometry=True, pwm=not on_board, gains=on_board, combined=on_board, battery=True, smoothed=True, power=True,
            servos=True, halt=True, simulated=simulated,
        )  # fmt: skip
        self._end: End = self if wrap is None else wrap(self)
        self._scale = scale
        self.link: Link | None = None
        self._reconnecting: asyncio.Task[None] | None = None
        self._failure: Exception | None = None
        self._time: Callable[[], float] = lambda: 0.0  # the loop's
        self._origin = inf  # loop time of the run's start
        self._closed = True
        # what the board said
        self._pose: EncoderOdometry  # as it was sent, once it was
        self._odometry: Odometry | None = None
        self._heard = -inf  # loop time of the last odometry
        self._heard_since = inf  # ... and of the first since the board was lost
        self._batteries: tuple[float, float] | None = None
        self._batteries_heard = -inf
        self._levels: tuple[float, float] | None = None  # the last since the board was found
        # what it is told
        self._outputs: Outputs
        self._due: float  # run time, as those that follow
        self._combined_due: float
        self._pid_due: float
        self._repeat_due: float
        self._lossy_until = -inf  # loop time
        self._pid_set: bytes | None = None
        self._asked = False  # sent, and not answered yet
        self._rejections: int
        self._heal_due = inf  # loop time
        self._gains_missing = False  # sent to a board that was found again, and not acknowledged yet
        self._answered: Callable[[bool], None]
        self._servos: PwmCommand | None = None
        self._esc_off = False  # asked for, so it is asked for again and again
        self._esc_comes_on = False  # asked for, so it is switched on when the board's loops are cleared
        self._clearing_since = -inf  # run time since when the board's loops are being cleared
        # what happened
        self._text = f"connecting to {port.address}"
        self._pause: float  # s before the line is opened again
        self._overflows = 0  # of links that are gone
        self._losses = 0
        self._reason = ""
        self._connections = 0
        self._refused = 0
        self._lost_frames = 0
        self._report: BoardLink | None = None
        self._tap: Callable[[str, bytes], None] = lambda direction, data: None

    def tap_line(self, tap: Callable[[str, bytes], None]) -> None:
        """Let all bytes be known to `tap` as they come ("in") and go ("out")."""
        self._tap = tap

    async def open(self) -> None:
        """Open the port; from then on a lost link is opened again until `close`."""
        self._time = asyncio.get_running_loop().time
        self._origin = inf
        self._outputs = Outputs()
        self._combined_due = -inf  # the others when it is connected
        self._pause = BACKOFF_MIN
        self._closed = False
        try:
            await self.port.open(self._end)
        except BaseException:
            self._closed = True
            await self.port.close()
            raise

    async def close(self) -> None:
        """Tell the board to stop, more than once as lines lose frames, and let go of it."""
        if self._closed:
            return
        self._closed = True
        if self._reconnecting is not None:
            self._reconnecting.cancel()
        for _ in range(FAREWELLS):
            if self.link is not None:
                self._send_outputs(Outputs(0, 0, 0, *self._outputs[3:5]))
                await asyncio.sleep(SEND_PERIOD)
        self.receiver.close()
        if self.link is not None:
            self.link.close()
            self.link = None
        self._down("closed")
        await self.port.close()

    async def _reconnect(self) -> None:
        """Open the port again as soon as it can be; what hangs up before it was heard makes the pauses longer, too."""
        while True:
            await asyncio.sleep(self._pause)
            self._pause = min(2.0 * self._pause, BACKOFF_MAX)
            try:
                await self.port.open(self._end)
                return
            except HalError as error:
                if str(error) != self._text:
                    self._tell(str(error))
            except Exception as error:
                self._failure = error
                return

    def connected(self, link: Link) -> None:
        """A fresh line: nothing of what came before counts."""
        self.link = link
        self._connections += 1
        self._pid_due = self._due = self._repeat_due = -inf
        self._tell(f"connected to {link.address}, waiting for odometry")

    def lost(self, reason: str) -> None:
        """The link is gone; look for it."""
        self._drop_link()
        self.receiver.close()
        self._down(f"link lost: {reason}")
        if not self._closed and (self._reconnecting is None or self._reconnecting.done()):
            self._reconnecting = asyncio.ensure_future(self._reconnect())

    def received(self, data: bytes) -> None:
        """Take what the board sent."""
        self._tap("in", data)
        self.receiver.feed(data)

    def _take(self, event: Event) -> None:
        try:
            match event:
                case EncoderOdometry():
                    self._take_odometry(event)
                case BatteryLevels(one, two):
                    if self._levels is not None and started_again(self._levels, (one, two)):
                        self._down("the board restarted: its battery filter started again")
                    self._levels = self._batteries = one, two
                    self._batteries_heard = self._time()
                case PidResponse(accepted):
                    self._take_answer(accepted)
                case FrameFault(reason):
                    if reason is not Reason.OLD_COMMAND:  # which says nothing about the line
                        self._lossy_until = self._time() + LOSSY
                    self._report = None
        except Exception as error:  # the event loop would only log it; `read` raises it
            self._failure = error

    def _take_odometry(self, pose: EncoderOdometry) -> None:
        time = self._time()
        since = time - self._heard
        if since > LOST:
            self._down(f"link lost: no odometry for {since:.2f} s")
        elif jumped(self._pose, pose, since):
            self._down("the board restarted: its odometry jumped")
        elif since >= PAUSE and at_origin(pose):
            self._down(f"the board paused for {since:.2f} s, and may have restarted")
        if LATE < since <= LOST:
            self._lost_frames += round(since / SEND_PERIOD) - 1
            self._lossy_until = time + LOSSY
            self._report = None
        if self._heard_since == inf:
            self._heard_since = time
            self._pose, self._odometry = pose, None
            self._pid_due = self._repeat_due = -inf  # it may have forgotten everything
            self._heal_due, self._rejections = inf, 0
            self._pause = BACKOFF_MIN
            self._tell(f"the board answers on {self.port.address}")
        self._odometry = follow(self._odometry, self._pose, pose, self._scale)
        self._pose, self._heard = pose, time

    def _take_answer(self, accepted: bool) -> None:
        if not self._asked:
            return  # somebody else's, or a late one
        self._rejections += not accepted
        self._gains_missing &= not accepted
        self._report = None
        if accepted or self._rejections >= REJECTIONS_MAX:  # else it is sent again
            self._asked, self._rejections, self._pid_due = False, 0, inf
            self._heal_due = self._time() + HEAL_PERIOD if accepted else inf
            self._answered(accepted)

    def _down(self, reason: str) -> None:
        """The board is lost, if it was there; else this only is what happened last."""
        if self._heard_since < inf:
            self._losses += 1
            self._reason = reason
        self._heard_since = inf
        self._levels = None
        self._gains_missing = self._pid_set is not None
        self._tell(reason)

    def _drop_link(self) -> None:
        if self.link is not None:
            self._overflows += self.link.overflows
            self.link = None
            self._report = None

    def _tell(self, text: str) -> None:
        self._text = text
        self._report = None

    def _run_time(self, time: float) -> float:
        """Seconds since the run started, to the ns, at a time of the loop's; 0 before."""
        return round(max(0.0, time - self._origin), 9)

    def read(self, now: float) -> Inputs:
        """The newest odometry and battery levels that have arrived."""
        if self._failure is not None:
            raise HalError(f"the link to {self.port.address} failed: {self._failure!r}") from self._failure
        time = self._time()
        self._origin = min(self._origin, time - now)
        if time - self._heard > LOST and self._heard_since < inf:
            self._down(f"link lost: no odometry for {LOST:g} s")
        report = self._report
        ready = time - self._heard_since >= SETTLED and not self._clearing
        if report is None or report.ready is not ready:
            gains, connected = not self._gains_missing, self.link is not None
            told = ready, self._losses, self._reason, self._text, self._counts(), gains, connected
            report = self._report = BoardLink(*told)
        return Inputs(
            odometry=self._odometry, odometry_time=self._run_time(self._heard),
            batteries=self._batteries, battery_time=self._run_time(self._batteries_heard), link=report,
        )  # fmt: skip

    def write(self, outputs: Outputs, now: float) -> None:
        """Send what is due: the set-point 20 times a second and at once on a stop, servos when they move, gains."""
        before, self._outputs = self._outputs, outputs
        if outputs[3:5] != before[3:5]:
            self._servos = PwmCommand(outputs.pwm4, outputs.pwm5)
            self._repeat_due = -inf
        if self._clearing and now >= self._clearing_since + ESC_SILENCE + ESC_ZEROS:
            self._end_clearing()
        if self.link is None:
            return
        if now >= self._repeat_due:
            self._repeat_due = now + REPEAT_PERIOD
            self._repeat()
        stops = not moves(outputs) and moves(before)
        if now >= self._due - 1e-9 or stops or self._time() < self._lossy_until:
            if now >= self._due - 1e-9:
                self._due = (now if self._due < now - SEND_PERIOD else self._due) + SEND_PERIOD
            if not self._clearing_since <= now < self._clearing_since + ESC_SILENCE:
                self._send_outputs(outputs)
        heals = self._time() >= self._heal_due and not moves(outputs)
        if self._pid_set is not None and (now >= self._pid_due or heals):
            if heals:
                self._heal_due = self._time() + HEAL_PERIOD
            else:
                self._pid_due = now + PID_SET_PERIOD
            self._asked = True
            self._send_bytes(self._pid_set)

    def load_gains(self, gains: PidSet, answered: Callable[[bool], None]) -> None:
        """Send the gains once a second until the board acknowledges them, and again whenever it has been away."""
        self._require("gains")
        frame = encode(gains)
        self._answered = answered
        if frame == self._pid_set and self._pid_due < inf:
            return  # under way
        # the answer to other gains that are under way must not pass for the answer to these: they wait for their turn
        self._pid_due = -inf if self._pid_due == inf else self._pid_due
        self._pid_set, self._asked, self._rejections = frame, False, 0

    def offer_odometry(self, combined: CombinedOdometry, now: float) -> None:
        """Send combined odometry, 50 times a second at most."""
        self._require("combined")
        if now >= self._combined_due - 1e-9:
            self._combined_due = now + COMBINED_PERIOD
            self._send(combined)

    def halt(self, outputs: Outputs, now: float) -> None:
        """Send a PWM test of zeros, which original boards obey in manual mode, too; it keeps channels 4 and 5."""
        self._send(PwmTest(0, 0, 0, *outputs[3:5]))

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Send a power switch's new state: "ESC off" again and again, everything else once.

        Before the ESC comes on, the board's loops are cleared: first comes silence, then zeros, and the switch 3.2 s
        after it was asked for. Meanwhile the board is not ready.
        """
        if switch is Switch.ESC:
            self._esc_off, self._esc_comes_on = not on, on
            if on:
                self._clearing_since = now
                self._tell(f"the ESC comes on in {ESC_SILENCE + ESC_ZEROS:.1f} s, when the board's loops are cleared")
                return
        self._send(PowerControl(switch, on))

    def clear_loops(self, now: float) -> None:
        """Have the board's loops forget what they wound up while nothing moved: somebody may switch its ESC on.

        They keep it as long as zeros come, so silence follows, then zeros again. Meanwhile the board is not ready.
        """
        if not self.capabilities.pwm:  # else the loops are this host's
            self._clearing_since = now + LAST_ZEROS
            self._tell(f"silence clears the board's loops; that takes {LAST_ZEROS + ESC_SILENCE + ESC_ZEROS:.1f} s")

    @property
    def _clearing(self) -> bool:
        return self._clearing_since > -inf

    def _end_clearing(self) -> None:
        self._clearing_since = -inf
        if self._esc_comes_on:
            self._esc_comes_on = False
            self._tell("the ESC was told to come on")
            self._send(PowerControl(Switch.ESC, True))
        else:
            self._tell("the silence that clears the board's loops is over")

    def indicate(self, indicators: Indicators) -> None:
        """Buzzer and LEDs are the board's own affair."""

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        """Nobody can lift a real robot from here."""
        self._require("place")

    def _require(self, capability: str) -> None:
        if not getattr(self.capabilities, capability):
            raise NotCapable(self.name, capability)

    def _send_outputs(self, outputs: Outputs) -> None:
        """Send a set-point, 0 as long as the board has not settled; or PWM counts, and 0 to keep the link alive."""
        if self._time() - self._heard_since < SETTLED or self._clearing or self._gains_missing:
            outputs = Outputs(0, 0, 0, *outputs[3:5])
        if self.capabilities.pwm:
            self._send(Velocity(0.0, 0.0))
            self._send(PwmTest(*outputs[:5]))
        else:  # a board that reads low drives too fast by as much
            self._send(Velocity(outputs.v / self._scale, outputs.omega / self._scale))

    def _repeat(self) -> None:
        """Send what holds until it is changed."""
        if self._servos is not None:
            self._send(self._servos)
        if self._esc_off:
            self._send(PowerControl(Switch.ESC, False))

    def _send(self, message: HostMessage) -> None:
        try:
            frame = encode(message)
        except EncodeError:  # combined odometry far outside the world
            self._refused += 1
            self._report = None
            return
        self._send_bytes(frame)

    def _send_bytes(self, frame: bytes) -> None:
        if self.link is not None:
            self._tap("out", frame)
            try:
                self.link.write(frame)
            except LinkLost:
                self._drop_link()  # `lost` is on its way

    def _counts(self) -> dict[str, int]:
        counts = {f"line_{reason.name.lower()}": count for reason, count in self.receiver.decoder.faults.items()}
        counts["line_late_odometry"] = self._lost_frames
        counts["line_not_encodable"] = self._refused
        counts["line_overflows"] = self._overflows + (0 if self.link is None else self.link.overflows)
        counts["reconnects"] = max(0, self._connections - 1)
        return counts


def moves(outputs: Outputs) -> bool:
    """Whether the outputs move the vehicle."""
    return bool(outputs.motor or outputs.v or outputs.omega)


def jumped(before: EncoderOdometry, after: EncoderOdometry, dt: float) -> bool:
    """Whether no motion leads from one pose to the other within dt s of receiving them: the board has restarted.

    What a line held back arrives in a bunch, so the time between two arrivals may be half a second too short. A board
    that restarts begins at exactly 0, 0, 0, and at rest: what comes there by driving was near it, or had the speed.
    """
    if at_origin(after):
        near = hypot(before.x, before.y) <= abs(before.v) * (dt + AT_ONCE) + NEAR
        straight = abs(wrap_angle(before.theta)) <= abs(before.omega) * (dt + AT_ONCE) + NEAR
        return not (near and straight)
    reach = (max(abs(before.v), abs(after.v)) + JUMP_SPEED) * (dt + JUMP_TIME)
    turn = max(abs(before.omega), abs(after.omega)) * (dt + JUMP_TIME) + JUMP_ANGLE
    return hypot(after.x - before.x, after.y - before.y) > reach or abs(wrap_angle(after.theta - before.theta)) > turn


def at_origin(pose: EncoderOdometry) -> bool:
    """Whether the pose is exactly that at power-up."""
    return pose.x == pose.y == pose.theta == pose.v == pose.omega == 0.0


def started_again(before: tuple[float, float], after: tuple[float, float]) -> bool:
    """Whether a board's battery filter has started again at 0 V, from the levels of two messages in a row.

    The filter's first output is 0.4 of the voltage; a pack that is pulled out leaves 0.6 of its level.
    """
    low, high = STARTS_AGAIN
    fitted = [(old, new) for old, new in zip(before, after, strict=True) if old > 1.0]
    return bool(fitted) and all(low * old < new < high * old for old, new in fitted)


def follow(odometry: Odometry | None, before: EncoderOdometry, after: EncoderOdometry, scale: float) -> Odometry:
    """The odometry after a board's pose has changed, with the board's lengths and angles multiplied by `scale`.

    Its wheels' speeds are off by one factor, so are its distances and its heading; the path is made anew from both.
    """
    if scale == 1.0 or odometry is None:
        return Odometry(after.x, after.y, wrap_angle(after.theta), scale * after.v, scale * after.omega)
    turned = wrap_angle(after.theta - before.theta)
    # the step as the board saw it, from its own mean heading to ours
    rotation = odometry.theta - before.theta + 0.5 * (scale - 1.0) * turned
    dx, dy = scale * (after.x - before.x), scale * (after.y - before.y)
    c, s = cos(rotation), sin(rotation)
    return Odometry(
        odometry.x + c * dx - s * dy,
        odometry.y + s * dx + c * dy,
        wrap_angle(odometry.theta + scale * turned),
        scale * after.v,
        scale * after.omega,
    )
