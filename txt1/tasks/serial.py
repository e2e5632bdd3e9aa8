"""The serial task: takes the host's messages as they arrive. Priority 4 (thesis 3.3.3, 3.5).

In simulation a message arrives as the host's own object. Behind a wire a decoder makes equal objects from bytes.
"""

from collections import deque
from collections.abc import Callable
from typing import Any, Final

from txt1.control.limits import LARGEST, Fault, Gate
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet, Schedule
from txt1.hal.base import Hal
from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import (
    BoardMessage,
    CombinedOdometry,
    Message,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)
from txt1.tasks.fields import CombinedSample, Command, GainTable, ManualPwm
from txt1.tasks.state import State
from txt1.units import new

# s; older odometry is too old to be combined
ODOMETRY_AGE_MAX: Final = 0.3
# messages that may wait for the task; when more come, the oldest are lost
INBOX_MAX: Final = 1000
Inbox = deque[tuple[Message, float, int]]
"""Messages from the host, each with the time of its origin (s of the run) and the gate's epoch at that time.

With a board behind a line, its answers to a PID set arrive here as well.
"""


def stands(state: State) -> bool:
    """Return whether no motion is commanded and the encoders see none.

    A board then gets no combined odometry, because its loops would drive against its noise.
    """
    control, odometry = state.control, state.odometry
    return not (control.v or control.omega or odometry.v or odometry.omega)


async def serial(
    arrivals: Ticks,
    inbox: Inbox,
    state: State,
    hal: Hal,
    gate: Gate,
    send: Callable[[BoardMessage], None],
    answered: Callable[[bool], None],
    reason_not_to_switch: Callable[[Switch, bool, float], str | None],
    gain_limits: Callable[[], Any],
) -> None:
    """Carry out every message that has arrived, in order.

    `answered` is for a HAL that closes its own loops: it is called with whether they accept the gains, and posts a
    PidResponse here. Gains beyond `gain_limits` (a `txt1.control.gains.GainLimits`) are refused. `reason_not_to_switch`
    returns why a supply may not be turned on or off at a time, s of the run; None if it may.
    """
    async for now in arrivals:
        while inbox:
            message, time, epoch = inbox.popleft()
            state.received += 1
            # the commonest message; CPython matches a class slowly
            if isinstance(message, Velocity):
                state.velocity_count += 1
                limited = gate.admit_velocity(message.v, message.omega)
                if limited is not None:
                    state.command = new(Command, (*limited, time, epoch))
                continue
            match message:
                case CombinedOdometry():
                    if gate.admit_finite(message.v, message.omega):
                        # older odometry is from before a loss of the line
                        seen = now - state.odometry_time <= ODOMETRY_AGE_MAX
                        if hal.capabilities.combined and seen and not stands(state):
                            hal.offer_odometry(message, now)
                        state.combined_count += 1
                        state.combined = CombinedSample(message.v, message.omega, time)
                case PwmTest(motor, front, rear, pwm4, pwm5):
                    pwm = gate.admit_pwm(motor, front, rear, pwm4, pwm5)
                    if not state.panel.manual:
                        gate.count(Fault.NOT_MANUAL)
                    elif pwm is not None:
                        state.manual_pwm = ManualPwm(pwm[0], pwm[1], pwm[2], time, epoch)
                        if gate.armed and epoch == gate.epoch:
                            state.servos = pwm[3], pwm[4]
                case PwmCommand(pwm4, pwm5):
                    servos = gate.admit_pwm(pwm4, pwm5)
                    # commands from before arming do not count
                    if servos is not None and gate.armed and epoch == gate.epoch:
                        state.servos = servos[0], servos[1]
                case PowerControl() if not hal.capabilities.power:
                    gate.count(Fault.POWER)
                case PowerControl(switch, on):
                    reason = reason_not_to_switch(switch, on, now)
                    if reason is not None:
                        gate.count(Fault.POWER)
                        state.tell(now, reason)
                        continue
                    if switch is Switch.ATX and not on and not hal.capabilities.power_known:
                        # the board's loops would drive against encoders that say 0
                        switch_power(state, hal, Switch.ESC, False, now)
                    switch_power(state, hal, switch, on, now)
                case PidSet():
                    table = gain_table(message)
                    if table and (wrong := gain_limits().refused(table.linear, table.angular.sets)):
                        state.tell(now, "gains refused: " + ": ".join(map(str, wrong)))
                        table = None
                    if table is not None and hal.capabilities.gains:
                        if table[:2] != state.gains[:2]:
                            state.gains = table._replace(loaded=False)
                        hal.load_gains(message, answered)
                        continue
                    if table is None:
                        gate.count(Fault.GAINS)
                    else:
                        state.gains = table
                    send(PidResponse(table is not None))
                case PidResponse(accepted):
                    if not accepted:
                        gate.count(Fault.GAINS)
                    state.gains = state.gains._replace(loaded=accepted)
                    send(message)


def switch_power(state: State, hal: Hal, switch: Switch, on: bool, now: float) -> None:
    """Turn a power supply on or off."""
    hal.switch(switch, on, now)
    if switch is Switch.ATX and on:
        state.atx_time = now
    power = state.power._replace(**{switch.name.lower(): on})
    # hosts repeat the request
    if power != state.power:
        state.power = power
        state.tell(now, f"{switch.name} {'on' if on else 'off'}{'' if power.confirmed else ' (asked, not confirmed)'}")


def gain_table(message: PidSet) -> GainTable | None:
    """Return the gains of a PID set; None if a gain is not finite, or v_max does not rise."""
    values = (*message.linear, *(value for each in message.angular for value in each))
    if not all(-LARGEST <= value <= LARGEST for value in values):
        return None
    try:
        schedule = Schedule(tuple(GainSet(v_max, Gains(kp, ki, kd)) for v_max, kp, ki, kd in message.angular))
    except ValueError:
        return None
    return GainTable(Gains(*message.linear), schedule, loaded=True)
