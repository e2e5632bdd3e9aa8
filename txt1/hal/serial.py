"""The real board as a HAL: the protocol's client, over any byte link (thesis 3.5).

How it works
------------

The board closes the velocity loops. This host sends it set-points, and receives measured speeds. The line between them
loses bytes, delays them or is cut, and no message reports a loss. So almost every message is repeated, and almost every
value is valid for a short time only.

*Receiving.* Bytes go from the line (`txt1.hal.line`) to the receiver, which finds messages in them. Odometry comes 20
times a second. It is the board's sign of life: silent for BOARD_LOST, the board is gone. Battery levels come once a
second, and an answer comes to each PID set.

*Sending.* `write` is called at every tick, 50 times a second, and sends what is due: Velocity 20 times a second, at
once on a stop, and at every tick while the line loses frames. Servo positions and "ESC off" are sent once a second, as
a board may have missed them; while the robot does not stop, "ESC off" goes with each PWM test of zeros. Gains are sent
once a second until the board acknowledges them (`txt1.hal.acknowledged_gains`). The command "ESC on" and the commands
of the ATX supply are sent only once: a command that can move the robot is not repeated.

*When the board has been away.* It may have restarted, and then it has no gains. `txt1.hal.restarts` recognises a
restart. Each loss disarms the robot. A board that was found again gets zeros until it has ODOMETRY_SETTLED, and until
it has acknowledged its gains.

*When the ESC was off.* The board's loops are in velocity form: their output stays wound up as long as zeros come, and
with the ESC back the vehicle would lurch. Only silence clears the loops, by the board's own link rule. So before the
ESC comes on there are LAST_ZEROS of zeros, ESC_SILENCE of nothing, and ESC_ZEROS of zeros again. Meanwhile the board is
not ready. A line that stalls keeps zeros for later, and so breaks the silence. So the silence begins again after a
pause of the odometry in its first ALIVE s, and whenever there is none at its end. Later pauses are harmless: boards of
ours fall silent with their host.

There are two clocks. `now` is the time of the run, for the tasks. `line.time()` is the time of the event loop, for
bytes, which may arrive before the run.
"""

from collections.abc import Callable
from math import cos, inf, sin
from typing import Final, Literal

from txt1.config import Config
from txt1.errors import EncodeError
from txt1.hal.acknowledged_gains import AcknowledgedGains
from txt1.hal.base import Capabilities, Inputs, Outputs
from txt1.hal.line import Line
from txt1.hal.plain_hal import PlainHal
from txt1.hal.registry import faults_of, is_simulated, port_of
from txt1.hal.restarts import restarted, started_again
from txt1.link.base import End, Port
from txt1.link.receiver import Receiver
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.protocol.decoder import Event, FrameFault, Reason
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
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
from txt1.protocol.radio_control import RcPermit, RcReport

# s between two Velocity messages: 20 Hz, all the time (the original driver: 10 Hz)
SEND_PERIOD: Final = 0.05
# shortest s between two combined odometry messages: more would crowd the line
COMBINED_PERIOD: Final = 0.02
# s of age at which odometry means that the board is lost: noticed within 0.5 s, including the wait for the next tick
BOARD_LOST: Final = 0.45
# s of odometry before the first set-point. Boards judge the link once a second; by then they have found it alive, and
# the first step of their loops, which takes the whole outage for its period, has had a set-point of 0.
ODOMETRY_SETTLED: Final = 1.2
# s between two odometry messages (20 Hz) that mean a lost message
LOST_MESSAGE_GAP: Final = 0.08
# s for which a line that lost a frame gets Velocity at every tick, so that the board's time-out sees enough
LOSSY: Final = 5.0
# s after which servos and an ESC that is off are sent again: nothing else mends a lost frame, or a restart. No switch
# is ever turned on again, and the ATX supply is never switched twice.
REPEAT_PERIOD: Final = 1.0
# s between two odometry messages after which a line has stalled: what was sent may still be on its way
STALL_GAP: Final = 0.2
# s of silence that no board notices: its link rule counts the messages of a second
ALIVE: Final = 0.8
# s of zeros before the board's loops are cleared: the set-point is then 0 even if the line loses a frame
LAST_ZEROS: Final = 0.15
# s without Velocity before the ESC may come on: by the link rule of 1 to 2 s the board clears its loops ...
ESC_SILENCE: Final = 2.2
# ... and s of zeros after them, so that the board hears its host again
ESC_ZEROS: Final = 1.05


class ByHand(Capabilities):
    """The state of manual mode: PWM counts go to a board whose own button has set this mode, which no message
    reports.
    """

    by_hand = True


class SerialHal(PlainHal):
    """A TXT-1 board behind a line, which `wrap` may put faults on.

    `control` closes the velocity loops: the board, or (experimental) this host with PWM test messages, to a board in
    manual mode. `scale` is a factor on the board's lengths and angles; original boards read 6.3 % low. `simulated`: the
    board behind the port is virtual. `by_hand`: the user's PWM counts are passed on to a board in manual mode.
    """

    name = "serial"

    def __init__(
        self,
        port: Port,
        wrap: Callable[[End], End] = lambda end: end,
        control: Literal["board", "host"] = "board",
        scale: float = 1.0,
        simulated: bool = False,
        by_hand: bool = False,
    ) -> None:
        self.port = port
        self.receiver = Receiver(Role.HOST, self._take)
        self.line = Line(
            port,
            wrap,
            "odometry",
            self._greet,
            self.receiver.feed,
            BOARD_LOST,
            ODOMETRY_SETTLED,
            self._forget,
            "serial",
        )
        on_board = control == "board"
        self._passes_pwm = by_hand and on_board
        self.capabilities = (ByHand if self._passes_pwm else Capabilities)(
            odometry=True,
            pwm=not on_board,
            gains=on_board,
            combined=on_board,
            battery=True,
            smoothed=True,
            power=True,
            servos=True,
            halt=True,
            simulated=simulated,
        )
        self._scale = scale
        self._gains = AcknowledgedGains()
        # the board's last reports
        # the newest pose as sent by the board; None before the first
        self._pose: EncoderOdometry
        self._odometry: Odometry | None = None
        self._batteries: tuple[float, float] | None = None
        # loop time
        self._batteries_heard = -inf
        # the last battery message since the board was found
        self._levels: tuple[float, float] | None = None
        # the last set-point sent, and its time, s of the run
        self._outputs = Outputs()
        # whether PWM counts moved it last: zeros have to follow them
        self._by_hand = False
        self._due = self._combined_due = self._repeat_due = -inf
        self._servos: PwmCommand | None = None
        # "ESC off" was requested, so it is sent again and again
        self._esc_off = False
        # "ESC on" was requested, so it is sent when the board's loops are cleared
        self._esc_comes_on = False
        # time since which the board's loops are being cleared
        self._clearing_since = -inf
        # counts of faults on the line
        # loop time
        self._lossy_until = -inf
        self._lost_frames = self._refused = 0
        self.rc: tuple[RcReport, float] | None = None
        """The last report of a radio control at the board, and the loop time of its arrival."""

    def tap_line(self, tap: Callable[[str, bytes], None]) -> bool:
        """Call `tap` with all bytes as they come ("in") and go ("out")."""
        self.line.tap = tap
        return True

    async def open(self) -> None:
        """Open the port; from then on a lost link is opened again until `close`."""
        self._outputs, self._combined_due = Outputs(), -inf
        await self.line.open()

    async def close(self) -> None:
        """Tell the board to stop, repeated as lines lose frames, and close the line."""
        await self.line.close(*map(encode, self._set_point(Outputs(0, 0, 0, *self._outputs[3:5]))), pause=SEND_PERIOD)

    def _greet(self) -> None:
        """Send all present settings at once on a new line."""
        self._due = self._repeat_due = -inf
        self._gains.send_anew()

    def _forget(self) -> None:
        """Discard the board's state: it is lost, or has restarted."""
        self._levels = None
        self._gains.lost()
        # an unfinished frame is the old line's
        if self.line.link is None:
            self.receiver.close()

    def _take(self, event: Event) -> None:
        match event:
            case EncoderOdometry():
                self._take_odometry(event)
            case BatteryLevels(one, two):
                if self._levels is not None and started_again(self._levels, (one, two)):
                    self.line.down("the board restarted: its battery filter started again")
                self._levels = self._batteries = one, two
                self._batteries_heard = self.line.time()
            case RcReport():
                self.rc = event, self.line.time()
            case PidResponse(accepted):
                self._gains.take(accepted, self.line.time())
            case FrameFault(reason) if reason is not Reason.OLD_COMMAND:
                # an answer to a PID set says nothing about the line
                self._lossy_until = self.line.time() + LOSSY

    def _take_odometry(self, pose: EncoderOdometry) -> None:
        time = self.line.time()
        since = time - self.line.last
        if since > BOARD_LOST:
            self.line.down(f"link lost: no odometry for {since:.2f} s")
        elif reason := restarted(self._pose, pose, since):
            self.line.down(reason)
        if LOST_MESSAGE_GAP < since <= BOARD_LOST:
            self._lost_frames += round(since / SEND_PERIOD) - 1
            self._lossy_until = time + LOSSY
        if self._clearing and since > STALL_GAP and self.line.run_time(self.line.last) < self._clearing_since + ALIVE:
            # zeros from before the silence may have come only now
            self._clearing_since = max(self._clearing_since, self.line.run_time(time))
        if self.line.heard():
            self._pose, self._odometry = pose, None
            # the board may have lost everything
            self._repeat_due = -inf
            self._gains.found()
            self.line.tell(f"the board answers on {self.port.address}")
        self._odometry = follow(self._odometry, self._pose, pose, self._scale)
        self._pose = pose

    def read(self, now: float) -> Inputs:
        """Return the newest odometry and battery levels that have arrived."""
        counts = {f"line_{reason.name.lower()}": count for reason, count in self.receiver.decoder.faults.items()}
        counts |= {"line_late_odometry": self._lost_frames, "line_not_encodable": self._refused}
        link = self.line.report(now, counts, self._clearing, not self._gains.missing)
        return Inputs(
            odometry=self._odometry,
            odometry_time=self.line.run_time(self.line.last),
            batteries=self._batteries,
            battery_time=self.line.run_time(self._batteries_heard),
            link=link,
        )

    def write(self, outputs: Outputs, now: float) -> None:
        """Send the due messages: the set-point 20 times a second and at once on a stop, servos when they move,
        gains.
        """
        before, self._outputs = self._outputs, outputs
        if outputs[3:5] != before[3:5]:
            self._servos = PwmCommand(outputs.pwm4, outputs.pwm5)
            self._repeat_due = -inf
        if self._clearing and now >= self._clearing_since + ESC_SILENCE + ESC_ZEROS:
            if self.line.time() - self.line.last > STALL_GAP:
                self._clearing_since = now
            else:
                self._end_clearing()
        if self.line.link is None:
            return
        if now >= self._repeat_due:
            self._repeat_due = now + REPEAT_PERIOD
            self._repeat()
        time, due = self.line.time(), now >= self._due - 1e-9
        if due:
            self._due = (now if self._due < now - SEND_PERIOD else self._due) + SEND_PERIOD
        stops = moves(before) and not moves(outputs)
        silent = self._clearing_since <= now < self._clearing_since + ESC_SILENCE
        if (due or stops or time < self._lossy_until) and not silent:
            self._send_outputs(outputs)
        if self._clearing and now < self._clearing_since + ESC_SILENCE:
            self.halt(outputs, now)
        gains = self._gains.to_send(now, time, moves(outputs))
        if gains is not None:
            self.line.send(gains)

    def load_gains(self, gains: PidSet, answered: Callable[[bool], None]) -> None:
        """Send the gains once a second until the board acknowledges them, and again whenever it has been away."""
        if not self.capabilities.gains:
            self._refuse("gains")
        self._gains.load(encode(gains), answered)

    def offer_odometry(self, combined: CombinedOdometry, now: float) -> None:
        """Send combined odometry, 50 times a second at most; none while the board's loops are being cleared.

        A board uses the last one for up to a second, and would wind its loops up by it before the ESC comes on.
        """
        if not self.capabilities.combined:
            self._refuse("combined")
        if now >= self._combined_due - 1e-9 and not self._clearing:
            self._combined_due = now + COMBINED_PERIOD
            self._send(combined)

    def halt(self, outputs: Outputs, now: float) -> None:
        """Send a PWM test of zeros, which original boards obey in manual mode, too; it keeps channels 4 and 5.

        "ESC off" goes with it, if it was requested: a line that damages frames may have lost it.
        """
        self._send(PwmTest(0, 0, 0, *outputs[3:5]))
        if self._esc_off:
            self._send(PowerControl(Switch.ESC, False))

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Send a power switch's new state: "ESC off" again and again, everything else once.

        Before the ESC comes on, the board's loops are cleared by silence, then zeros. The switch follows 3.2 s after
        the request, later on a line that stalls. Meanwhile the board is not ready.
        """
        if switch is Switch.ESC:
            self._esc_off, self._esc_comes_on = not on, on
            if on:
                self._clearing_since = now
                self.line.tell(
                    f"the ESC comes on in {ESC_SILENCE + ESC_ZEROS:.1f} s, when the board's loops are cleared"
                )
                return
        self._send(PowerControl(switch, on))

    def permit_hand(self, on: bool, stopped: bool) -> None:
        """Let the hand at a radio control at the board drive, or not; the board keeps it when this host dies."""
        self._send(RcPermit(on, stopped))

    def clear_loops(self, now: float) -> None:
        """Clear the integral that the board's loops wound up while nothing moved: its ESC may be switched on.

        The loops keep it as long as zeros come. So silence follows, then zeros again. Meanwhile the board is not ready.
        Each cycle sends a PWM test of zeros: it does not count as a sign of the host, but replaces the loops' outputs
        until their next step.
        """
        # otherwise the loops run in this host
        if not self.capabilities.pwm:
            self._clearing_since = now + LAST_ZEROS
            self.line.tell(f"silence clears the board's loops; that takes {LAST_ZEROS + ESC_SILENCE + ESC_ZEROS:.1f} s")

    @property
    def _clearing(self) -> bool:
        return self._clearing_since > -inf

    def _end_clearing(self) -> None:
        self._clearing_since = -inf
        if self._esc_comes_on:
            self._esc_comes_on = False
            self.line.tell("the ESC is being switched on")
            self._send(PowerControl(Switch.ESC, True))
        else:
            self.line.tell("the silence that clears the board's loops is over")

    def _send_outputs(self, outputs: Outputs) -> None:
        """Send a set-point; 0 until the board has settled."""
        if not self.line.ready or self._clearing or self._gains.missing:
            outputs = Outputs(0, 0, 0, *outputs[3:5])
        for message in self._set_point(outputs):
            self._send(message)

    def _set_point(self, outputs: Outputs) -> tuple[HostMessage, ...]:
        """Return the messages for a set-point; or for PWM counts, with a Velocity of 0 that keeps the link alive."""
        if moves(outputs):
            self._by_hand = not (outputs.v or outputs.omega)
        if self.capabilities.pwm or (self._by_hand and self._passes_pwm):
            return Velocity(0.0, 0.0), PwmTest(*outputs[:5])
        # a board that reads low drives too fast by the same factor
        return (Velocity(outputs.v / self._scale, outputs.omega / self._scale),)

    def _repeat(self) -> None:
        """Repeat the messages whose values still hold."""
        if self._servos is not None:
            self._send(self._servos)
        if self._esc_off:
            self._send(PowerControl(Switch.ESC, False))

    def _send(self, message: HostMessage) -> None:
        try:
            self.line.send(encode(message))
        except EncodeError:
            # combined odometry is far outside the world
            self._refused += 1


def moves(outputs: Outputs) -> bool:
    """Return whether the outputs move the vehicle."""
    return bool(outputs.motor or outputs.v or outputs.omega)


def follow(odometry: Odometry | None, before: EncoderOdometry, after: EncoderOdometry, scale: float) -> Odometry:
    """Return the odometry after a change of the board's pose, with lengths and angles multiplied by `scale`.

    The board's wheel speeds are wrong by a factor, and so are its distances and its heading. The path is recomputed
    from both.
    """
    if scale == 1.0 or odometry is None:
        return Odometry(after.x, after.y, wrap_angle(after.theta), scale * after.v, scale * after.omega)
    turned = wrap_angle(after.theta - before.theta)
    # the step as the board saw it, turned from the board's mean heading to the corrected heading
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


def create(config: Config) -> SerialHal:
    """Make the board behind the configured line."""
    line, scale = config.serial, config.odometry.scale
    return SerialHal(port_of(config), faults_of(config), line.control, scale, is_simulated(config), line.allow_host)
