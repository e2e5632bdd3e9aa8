"""The standstill task: verifies every stop, 20 Hz.

It runs if the velocity loops are at the far end of a line and may not obey.

It also notices a vehicle that is commanded to drive and does not move.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from txt1.control.limits import Fault, Gate
from txt1.control.obedience import Obedience
from txt1.control.sight import time_unseen
from txt1.control.standstill import DELAY, STANDS_AFTER, STILL_SPEED, UNOBEYED, Standstill, Stop
from txt1.errors import HalError
from txt1.hal.base import Capabilities, Hal, Outputs
from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import Switch
from txt1.tasks import encoder
from txt1.tasks.fields import BatteryState
from txt1.tasks.state import State
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

STANDSTILL_PERIOD: Final = 0.05
# s of age from which a speed counts as unknown
SPEED_AGE_MAX: Final = 0.3
# s after which a PWM test of zeros is repeated, because lines lose frames
HALT_AGAIN: Final = 0.1
# m/s that have to be commanded ...
COMMAND_MIN: Final = 0.1
# ... while less than this is measured: original boards read 0 below 0.045 m/s
UNMOVED_SPEED: Final = 0.03
# m that it may go meanwhile if its encoders are dead
UNMOVED_WAY: Final = 0.3
# s of zeros that a board gets that did not obey for a moment: it judges its link once a second
ZEROS_HELD: Final = 1.2
# s after which a board's loops have certainly lost their wound-up integral
FULL: Final = 3.4
# s that the end of a run waits at most
END: Final = 3.0
CAUSES: Final = "ESC off, gains lost, board in manual mode, wheel blocked, or a wall"

STOP: Final = declare(
    Topic(
        "/stop",
        Stop,
        "",
        define("txt1_msgs/Stop", "std_msgs/Header header\nstring state"),
        Rule.CHANGE,
        "how the last stop is going, where it has to be verified",
        make=lambda stop: {"state": stop.value},
    )
)
_TOLD: Final = {
    Stop.PWM_ZEROS: "the robot does not stop: a PWM test of zeros follows",
    Stop.ESC_OFF: "the robot does not stop: the ESC is switched off",
    Stop.UNASKED: "the robot moves without a command (pushed, carried, or manual mode): a PWM test of zeros follows",
}


class Watch:
    """Watches a stop until the robot stands, and escalates by the means of the hardware layer.

    `switch` is called to switch power.
    """

    def __init__(
        self, state: State, hal: Hal, gate: Gate, track_width: float, switch: Callable[[Switch, bool, float], None]
    ) -> None:
        self.state, self.hal, self.gate = state, hal, gate
        self._track_width = track_width
        self.standstill = Standstill(gate.limits.runaway_speed)
        self._switch = switch
        self._halt_due = 0.0
        # s of the run; until then the board's loops may be wound up
        self._full_until = 0.0
        # the speed that was commanded without a break ...
        self._asked = 0.0
        # ... and without a motion, since this time, s of the run
        self._unmoved_since: float
        # the epoch of these commands; it changes when the robot is armed again
        self._epoch: int
        # when it was lost sight of, if no motion was seen since, s of the run
        self._lost_time = 0.0
        self._obedience = Obedience()
        # until when a board that did not obey for a moment gets zeros at least, s of the run
        self._held_until: float

    def step(self, now: float, outputs: Outputs) -> Stop:
        """Judge the speed after these outputs, and take the next measure of the stop."""
        state, watch = self.state, self.standstill
        before = watch.stop
        known = sees(state, now)
        v = state.odometry.v if known else None
        # the faster wheel's: if an encoder counts backwards, the odometry of a fast car looks like a turn
        wheel = None if v is None else abs(v) + 0.5 * self._track_width * abs(state.odometry.omega)
        if wheel:
            self._lost_time = 0.0
        stop = watch.step(
            now,
            wheel,
            commanded=bool(outputs.motor or outputs.v or outputs.omega),
            armed=self.gate.armed,
            connected=state.board is None or state.board.connected,
            fell=self._fell,
        )
        if stop is not before:
            self._enter(stop, before, now, blind=v is None)
        if stop in (*UNOBEYED, Stop.UNASKED) and now >= self._halt_due - 1e-9:
            self._halt_due = now + HALT_AGAIN
            self.hal.halt(self.gate.neutral(state.servos), now)
        self._check_obedience(now, v, outputs)
        self._check_slowing(now, v, outputs.v)
        full = now < self._full_until and not self.gate.armed and self.hal.capabilities.power
        if full and wheel is not None and wheel > STILL_SPEED:
            # the ESC was switched on too soon: full loops would drive the car whatever the commands are
            self._full_until = 0.0
            state.tell(now, "the ESC came back before the board's loops were cleared: it is switched off")
            self._switch(Switch.ESC, False, now)
        return stop

    def _enter(self, stop: Stop, before: Stop, now: float, blind: bool) -> None:
        told = _TOLD.get(stop)
        if told is not None:
            self.state.tell(now, f"{told}{' (not seen: no odometry)' if blind else ''}")
        elif stop is Stop.STANDING and before in (*UNOBEYED, Stop.UNASKED):
            self.state.tell(now, "the robot stands")
        elif stop is Stop.UNSEEN and self._fell:
            causes = "a wall, wheels that spun, or encoders without power"
            self.state.tell(now, f"the speed fell faster than it can: {causes}; look at the robot")
            # the loops drive on against a speed that they do not see
            self.hal.clear_loops(now)
        if stop in UNOBEYED:
            self.gate.disarm("the robot did not stop when told to", Fault.STOP_UNOBEYED)
        if stop is Stop.ESC_OFF and self.hal.capabilities.power:
            self._switch(Switch.ESC, False, now)

    def lose_sight(self, now: float) -> None:
        """Take the strongest means at once: what drives it does not show in its speed."""
        self._lost_time = now
        if self.hal.capabilities.power:
            self._switch(Switch.ESC, False, now)
        self.hal.clear_loops(now)

    def _check_obedience(self, now: float, v: float | None, outputs: Outputs) -> None:
        """Disarm if a speed is commanded, everything is ready, and the robot has not moved for too long."""
        state = self.state
        board = state.board
        ready = self.gate.armed and state.gains.loaded and board is not None and board.ready and board.gains
        asked = outputs.v if ready and abs(outputs.v) >= COMMAND_MIN - 1e-9 else 0.0
        unmoved = v is not None and abs(v) < UNMOVED_SPEED
        begins = asked * self._asked <= 0.0
        if begins or not unmoved or self.gate.epoch != self._epoch:
            self._unmoved_since, self._epoch = now, self.gate.epoch
        self._asked = asked
        if asked and now - self._unmoved_since >= DELAY + time_unseen(UNMOVED_WAY, asked) - 1e-9:
            low = state.battery.state in (BatteryState.WARNING, BatteryState.BAD)
            causes = f"battery empty, {CAUSES}" if low else CAUSES
            self.gate.disarm(f"commanded and not moving: {causes}", Fault.UNMOVED)
            # the board's loops are full: an ESC that comes back would move the robot
            self.hal.clear_loops(now)
            self._full_until = now + FULL

    def _check_slowing(self, now: float, v: float | None, asked: float) -> None:
        """Hold zeros if the car slows down under a constant command, until it stands and its board has settled."""
        gate, board = self.gate, self.state.board
        if gate.held:
            if now >= self._held_until and self.standstill.stands(now):
                gate.held = False
                self.state.tell(now, "the board has settled")
        elif v is None or not gate.armed:
            self._obedience.clear()
        elif not gate.sight.unseen and self._obedience.fails(now, v, asked):
            self._obedience.clear()
            if board is None or board.ready:
                gate.held, self._held_until = True, now + ZEROS_HELD
                self.state.tell(now, "the car slows down under a constant command: zeros until its board has settled")

    @property
    def _fell(self) -> bool:
        """Whether a speed of 0 does not show that it stands: it fell faster than brakes allow, or sight was lost.

        Motion that is seen, and power for the encoders, end this.
        """
        return max(self.state.fell_time, self._lost_time) > self.state.atx_time

    @property
    def settled(self) -> bool:
        """Whether the robot stands after everything that this run has driven."""
        stop = self.standstill.stop
        return not self.standstill.drove or stop is Stop.STANDING or (stop is Stop.UNSEEN and not self._fell)

    @property
    def trouble(self) -> str:
        """Why a stop of this run failed; "" if zeros were enough each time."""
        watch = self.standstill
        if watch.failed is Stop.NONE and self.settled:
            return ""
        blind = ", and this was not seen: there was no odometry" if watch.blind else ""
        if not self.settled:
            return f"the robot was not seen to stand ({watch.stop.value}{blind}): look at it"
        means = "a PWM test of zeros" if watch.failed is Stop.PWM_ZEROS else "switching the ESC off"
        return (
            f"the robot did not stop when told to; it took {means}{blind}; is the board in manual mode, or did the "
            "wheels spin?"
        )


def sees(state: State, now: float) -> bool:
    """Return whether the robot's speed is known: odometry is recent, from encoders with power (the ATX supply's)."""
    return state.power.atx is not False and state.odometry_time > 0.0 and now - state.odometry_time <= SPEED_AGE_MAX


def stands(state: State, watch: Watch | None, now: float) -> bool:
    """Return whether the robot was seen to stand, and still stands; without a watch the encoders decide."""
    if watch is not None:
        return watch.standstill.stands(now)
    return sees(state, now) and state.odometry_time - state.moved_time >= STANDS_AFTER - 1e-9


def reason_not_to_switch(
    switch: Switch, on: bool, state: State, can: Capabilities, gate: Gate, watch: Watch | None, stands: bool
) -> str | None:
    """Return why a supply may not be turned on or off now, with the remedy; None if it may.

    The ATX supply feeds the encoders, so it stays on until the robot was seen to stand (`stands`). The ESC behind a
    line comes on only while the robot is disarmed, its encoders have power, and no stop has failed: loops that are
    wound up would move it.
    """
    esc = switch is Switch.ESC
    if (not on or can.power_known) if esc else (on or state.power.atx is False):
        return None
    failed = watch is not None and watch.standstill.stop in UNOBEYED
    reasons = (
        (esc and gate.armed, "the ESC can come on only while the robot is disarmed: disarm first (m, or Robot.disarm)"),
        (
            esc and state.power.atx is False,
            "the ESC stays off: without the ATX supply the encoders see nothing; switch that on first",
        ),
        (esc and failed, "the ESC stays off: the robot did not stop when told to; ask again when it was seen to stand"),
        (
            not esc and gate.armed,
            "the ATX supply feeds encoders and computer, so it stays on: disarm first (m, or Robot.disarm)",
        ),
        (
            not esc and can.blind,
            "the ATX supply stays on: there are no encoders that see the robot stand; switch it off at the robot",
        ),
        (
            not esc and not stands,
            "the ATX supply feeds the encoders, so it stays on until they have seen the robot stand: ask again then",
        ),
    )
    return next((reason for holds, reason in reasons if holds), None)


async def standstill(ticks: Ticks, watch: Watch) -> None:
    """Verify every stop."""
    async for now in ticks:
        watch.step(now, watch.state.control.outputs)


async def settle(watch: Watch, io: Hal, clock: Callable[[], float]) -> None:
    """Wait until the robot stands, for at most `END` s, and escalate if needed.

    `io` is the hardware layer as the tasks use it, `clock` returns s of the run.
    """
    ends = clock() + END
    # without odometry it cannot be seen to stand
    with suppress(HalError):
        while not watch.settled and clock() < ends:
            await asyncio.sleep(STANDSTILL_PERIOD)
            now, neutral = clock(), watch.gate.neutral(watch.state.servos)
            encoder.take_odometry(watch.state, io.read(now), now)
            io.write(neutral, now)
            watch.step(now, neutral)
