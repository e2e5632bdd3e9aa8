"""The board of the original laboratory, as observed: its framer and its tasks (thesis 3.3.3, 3.5).

Hosts have to cope with these habits, which txt1's own firmware does not have:

- The controller runs at 20 Hz. After an outage its first period is the whole outage.
- Speeds read 6.3 % low, and slow speeds read 0.
- There is no safety gate. Only the link rule stops it, after 1 to 2 s.
- In manual mode the last PWM stays for ever. A PWM test is obeyed in every mode. In controller mode the next step of
  the loops overwrites it; without a link, neutral does, which is written every 20 ms.
- The length of a PID set is counted in whole integers of four bytes, so up to three bytes too many are ignored; a PID
  set longer than a full one is.
- A frame is looked at once, as a whole: what is wrong with it takes all of it along, a sound frame inside included. A
  header with an impossible length takes 255 bytes along, with itself.
- Neither the mode nor the switches are reported.
"""

from collections import deque
from collections.abc import Callable, Iterable
from math import pi
from typing import Final

from txt1.control.limits import Outputs, clip
from txt1.control.pid import CLEAR, Gains, Past, errors
from txt1.control.schedule import GainSet, Schedule
from txt1.hal.base import Button, Hal
from txt1.kernel.scheduler import TaskRow
from txt1.kernel.ticks import Ticks
from txt1.model.battery import remaining_time
from txt1.model.odometry import Odometry, advance
from txt1.model.vehicle import PWM_MAX, STEERING_MAX
from txt1.protocol.decoder import DATA_MAX, OVERHEAD, Decoder, Event, receivable
from txt1.protocol.layout import HEADER, SETS_MAX, Role, checksum
from txt1.protocol.messages import (
    BatteryLevels,
    BoardMessage,
    CombinedOdometry,
    EncoderOdometry,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Velocity,
)
from txt1.tasks.battery import BATTERY_PERIOD, OLD_WEIGHT, judge
from txt1.tasks.encoder import ODOMETRY_PERIOD
from txt1.tasks.fields import Battery, Control, Encoders, GainTable, LinkState, Source
from txt1.tasks.mode import MODE_PERIOD
from txt1.tasks.panel import PANEL_PERIOD, press
from txt1.tasks.serial import Inbox
from txt1.tasks.state import State

# s, period of the controller
CONTROL_PERIOD: Final = 0.05
# s between two writings of neutral while there is no link
NEUTRAL_PERIOD: Final = 0.02
# s, period of the encoder task
ENCODER_PERIOD: Final = 0.02
# m/s for a tick in a period; the true value is 16.0 mm/s, so speeds read 6.3 % low
TICK_SPEED: Final = 0.015
# ticks in a period that count as 0: speeds below 0.045 m/s read 0
TICKS_IGNORED: Final = 2
# m/s, to which set-points are clipped
V_MAX: Final = 1.5
# command of a PID set, and of its answer
PID_SET: Final = 0x70
# bytes that a false header with an impossible length takes along, itself included
SWALLOWED: Final = 255
# bytes of an integer of a PID set, and of a full set
INTEGER, FULL = 4, 12 + 16 * SETS_MAX
# s without power after which an original board runs again; a host may not notice
OUTAGE: Final = 0.2
# m between the encoder wheels
TRACK_WIDTH: Final = 0.25


class Framer:
    """The original search for frames. It looks at no byte twice and has no time-out, so a stray 0xFA costs a frame."""

    def __init__(self, take: Callable[[Event], None]) -> None:
        self.take = take
        self._table = receivable(Role.BOARD)
        self._frame = bytearray()

    def feed(self, data: bytes) -> None:
        """Take bytes, and pass on every message in them."""
        for byte in data:
            frame = self._frame
            frame.append(byte)
            size = len(frame)
            if size <= len(HEADER):
                # a header that begins in here is missed
                if byte != HEADER[size - 1]:
                    frame.clear()
            elif size == (frame[2] + OVERHEAD if frame[2] <= DATA_MAX else SWALLOWED):
                if frame[2] <= DATA_MAX:
                    # the first event is that of the whole frame; the others lie inside
                    self.take(Decoder(Role.BOARD, self._table).feed(_understood(bytes(frame)))[0])
                frame.clear()

    def close(self) -> None:
        """Do nothing: an unfinished frame stays."""


def _understood(frame: bytes) -> bytes:
    """Return a frame as the original reads it: of a PID set it ignores an unfinished integer at the end."""
    body = frame[3:-2]
    excess = frame[2] % INTEGER
    if not excess or frame[2] > FULL or body[0] != PID_SET or checksum(body) != int.from_bytes(frame[-2:], "big"):
        return frame
    body = body[:-excess]
    return bytes((*HEADER, frame[2] - excess, *body, *checksum(body).to_bytes(2, "big")))


class OriginalFirmware:
    """The tasks and their memory while the board has power."""

    def __init__(
        self, state: State, hal: Hal, inbox: Inbox, presses: deque[Button], send: Callable[[BoardMessage], None]
    ) -> None:
        self.state, self.hal = state, hal
        self._inbox, self._presses, self._send = inbox, presses, send
        self._off_until = 0.0  # s of the run
        # the wall that was reported
        self._blocked: str | None = None
        self._forget()

    def _forget(self) -> None:
        """Reset the memory as at power-up. The switches belong to the power board and stay as they are."""
        state = self.state
        state.gains = GainTable()
        state.panel = state.panel._replace(manual=False)
        state.link = LinkState()
        state.odometry, state.odometry_time = Odometry(), 0.0
        state.control, state.battery = Control(), Battery()
        self._sets: tuple[GainSet, ...] = ()
        self._command = Velocity(0.0, 0.0)
        self._combined = Velocity(0.0, 0.0)
        self._velocities = self._combineds = 0
        self._outputs = Outputs()
        self._linear: Past = CLEAR
        self._angular: Past = CLEAR
        # time of the loops' last step, s of the run
        self._stepped = self._off_until
        self._counts: tuple[int, int] | None = None
        self._volts = (0.0, 0.0)

    def tasks(self) -> Iterable[TaskRow]:
        """Return the tasks: name, priority, period and coroutine."""
        return (
            ("controller", 4, CONTROL_PERIOD, self.controller),
            ("neutral", 4, NEUTRAL_PERIOD, self.neutral),
            ("serial", 4, None, self.serial),
            ("encoder", 3, ENCODER_PERIOD, self.encoder),
            ("mode", 2, MODE_PERIOD, self.mode),
            ("odometry", 2, ODOMETRY_PERIOD, self.odometry),
            ("battery", 1, BATTERY_PERIOD, self.battery),
            ("button", 1, PANEL_PERIOD, self.button),
        )

    def restart(self, now: float, off: float) -> None:
        """Take its power away for `off` s: no pulses meanwhile, and its memory is lost."""
        self._off_until = now + off
        self._forget()
        self._put(now, 0, 0, 0, 0, 0)
        self.state.tell(now, f"the board restarts, {off:g} s without power")

    async def serial(self, arrivals: Ticks) -> None:
        """Carry out every message that has arrived."""
        state = self.state
        async for now in arrivals:
            while self._inbox:
                message = self._inbox.popleft()[0]
                if now < self._off_until:
                    continue
                state.received += 1
                match message:
                    case Velocity(v, omega):
                        self._velocities += 1
                        self._command = Velocity(clip(v, V_MAX), omega)
                    case CombinedOdometry():
                        self._combineds += 1
                        self._combined = Velocity(message.v, message.omega)
                    case PwmTest(motor, front, rear, pwm4, pwm5):
                        self._put(now, motor, front, rear, pwm4, pwm5)
                    case PwmCommand(pwm4, pwm5):
                        self._put(now, *self._outputs[:3], pwm4, pwm5)
                    case PowerControl(switch, on):
                        self.hal.switch(switch, on, now)
                        state.power = state.power._replace(**{switch.name.lower(): on})
                    case PidSet(linear, angular):
                        self._sets = tuple(GainSet(v_max, Gains(*gains)) for v_max, *gains in angular)
                        rising = sorted(self._sets, key=lambda each: each.v_max)
                        distinct = {each.v_max: each for each in rising}.values()
                        state.gains = GainTable(Gains(*linear), Schedule(tuple(distinct)), loaded=True)
                        self._send(PidResponse(True))

    async def controller(self, ticks: Ticks) -> None:
        """Step both loops, unless the link is lost or the mode is manual.

        The loops' period is the time since their last step.
        """
        state = self.state
        async for now in ticks:
            if now < self._off_until or state.panel.manual or not state.link.alive:
                continue
            dt, self._stepped = now - self._stepped, now
            chosen = self._combined if state.link.combined else state.odometry
            error, yaw_error = errors(self._command.v, self._command.omega, chosen.v, chosen.omega)
            self._linear = step(self._linear, error, state.gains.linear, dt, PWM_MAX)
            gains = Gains()
            # otherwise the steering stays as it is
            if self._sets:
                gains = next((each.gains for each in self._sets if each.v_max >= chosen.v), self._sets[-1].gains)
                self._angular = step(self._angular, yaw_error, gains, dt, STEERING_MAX)
            motor, steering = self._linear[0], self._angular[0]
            source = Source.COMBINED if state.link.combined else Source.ENCODER
            self._put(now, motor, -steering, steering, *self._outputs[3:5], source=source, gains=gains)

    async def neutral(self, ticks: Ticks) -> None:
        """Write neutral while there is no link in controller mode."""
        state = self.state
        async for now in ticks:
            if not (now < self._off_until or state.panel.manual or state.link.alive):
                self._put(now, 0, 0, 0, *self._outputs[3:5])

    def _put(
        self,
        now: float,
        *counts: float,
        source: Source = Source.ENCODER,
        gains: Gains = Gains(),  # noqa: B008
    ) -> None:
        """Put PWM counts on the five channels; only the pulse's range limits them."""
        motor, front, rear, pwm4, pwm5 = (int(clip(each, PWM_MAX)) for each in counts)
        self._outputs = Outputs(motor, front, rear, pwm4, pwm5)
        self.hal.write(self._outputs, now)
        self.state.servos = pwm4, pwm5
        self.state.control = Control(self._outputs, self._command.v, self._command.omega, source, gains)

    async def encoder(self, ticks: Ticks) -> None:
        """Compute wheel speeds from ticks, and odometry from the speeds."""
        state = self.state
        async for now in ticks:
            inputs = self.hal.read(now)
            state.pose, state.backlight = inputs.pose, inputs.backlight
            counts, before = inputs.ticks, self._counts
            if counts is None or now < self._off_until:
                continue
            self._counts = counts
            if before is None:
                continue
            right, left = counts[0] - before[0], counts[1] - before[1]
            state.encoders = Encoders(right, left)
            v_right, v_left = (0.0 if abs(each) <= TICKS_IGNORED else TICK_SPEED * each for each in (right, left))
            v, omega = (v_right + v_left) / 2.0, (v_right - v_left) / TRACK_WIDTH
            state.odometry, state.odometry_time = advance(state.odometry, v, omega, ENCODER_PERIOD), now

    async def odometry(self, ticks: Ticks) -> None:
        """Send the odometry: headings from 0 to 6283 mrad, all values truncated towards zero."""
        async for now in ticks:
            if now >= self._off_until:
                x, y, theta, v, omega = self.state.odometry
                self._send(EncoderOdometry(*map(truncated, (x, y, theta % (2.0 * pi), v, omega))))
                self.state.transmitted += 1

    async def mode(self, ticks: Ticks) -> None:
        """Judge the link by the messages of the last second; in manual mode the link does not count.

        The board does not know of walls, but a spectator sees them, so a collision is reported.
        """
        state = self.state
        async for now in ticks:
            blocked = self.hal.blocked_by() if self._outputs.motor else None
            if blocked not in (None, self._blocked):
                state.tell(now, f"the vehicle gets no further: it is at {blocked}")
            self._blocked = blocked
            alive = self._velocities > 1 or state.panel.manual is True
            combined = self._combineds > 2
            self._velocities = self._combineds = 0
            if now < self._off_until:
                continue
            if not alive:
                self._linear = self._angular = CLEAR
                self._put(now, 0, 0, 0, *self._outputs[3:5])
            if alive is not state.link.alive:
                state.tell(now, "link alive" if alive else "link lost")
            state.link = LinkState(alive, combined)

    async def battery(self, ticks: Ticks) -> None:
        """Smooth the voltages from zero on, and send them."""
        async for now in ticks:
            volts = self.hal.read(now).batteries
            if volts is None or now < self._off_until:
                continue
            one, two = self._volts = smooth(self._volts[0], volts[0]), smooth(self._volts[1], volts[1])
            self.state.battery = Battery(one, two, judge(one, two), remaining_time(max(one, two)), now)
            self._send(BatteryLevels(one, two))

    async def button(self, ticks: Ticks) -> None:
        """Act on every press, once."""
        state = self.state
        async for now in ticks:
            panel = state.panel
            while self._presses:
                panel = press(panel, self._presses.popleft(), rows=len(state.gains.angular.sets), has_pwm=True)
            if panel.manual is not state.panel.manual:
                state.tell(now, "manual mode" if panel.manual else "controller mode")
            state.panel = panel


def smooth(old: float, new: float) -> float:
    """Return the smoothed voltage, V."""
    return OLD_WEIGHT * old + (1.0 - OLD_WEIGHT) * new


def truncated(value: float) -> float:
    """Return a value as the board stores it, in whole thousandths truncated towards zero (a tick counts 15 mm/s)."""
    return int(round(1000.0 * value, 6)) / 1000.0


def step(past: Past, error: float, gains: Gains, dt: float, limit: float) -> Past:
    """The velocity form (4.7) with a trapezoidal integral and a truncated output; dt is the time since the last step.

    u(k) = u(k-1) + K_P [e(k) - e(k-1)] + K_I dt [e(k) + e(k-1)]/2 + K_D/dt [e(k) - 2 e(k-1) + e(k-2)]
    """
    output, e1, e2 = past
    kp, ki, kd = gains
    u = output + kp * (error - e1) + ki * dt * 0.5 * (error + e1) + kd / dt * (error - 2.0 * e1 + e2)
    return float(int(clip(u, limit))), error, e1
