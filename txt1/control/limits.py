"""The safety gate: every value for an actuator passes it last, whatever its source.

A value reaches the hardware only if the gate is armed, its command is fresh, and it is finite. Then it is brought
inside the limits. Everything that is refused or clipped is counted:

* A command that is not finite is refused as a whole and does not refresh the time-out.
* A set-point is clipped to abs(v) <= v_max, then to abs(omega) <= abs(v) / R_min (2.16), so to 0 at standstill. For a
  rover that turns in place the second limit is omega_max.
* PWM is clipped to +-24000, the motor further to motor_max and the steering to +-18000 (thesis 4.3).
* Guards, such as the obstacle stop, then see every set-point and may lower it further.
* A command older than command_timeout means neutral; the gate stays armed and the next fresh command resumes.
* A lost link, missed ticks, a computer that slept, bad batteries, a runaway or a task fault disarm. `Gate.arm` is the
  only way back.
* The emergency stop disarms and latches: it, too, ends with an explicit `Gate.arm`.
"""

import sys
from collections.abc import Callable, Mapping
from enum import StrEnum
from math import inf, isfinite
from typing import Final, NamedTuple

from txt1.control.parameters import Limits
from txt1.control.sight import WheelSight
from txt1.model.vehicle import PWM_MAX, STEERING_LIMIT, STEERING_MAX
from txt1.units import new

# s; readings that the geometry forbids are believed when they last this long
PERSISTS: Final = 0.1
# counts per period that a wheel at rest may show
NOISE_COUNTS: Final = 3
# s by which a command may seem to come from the future, as a late tick has an early time
AHEAD: Final = 0.1
# m/s; slip does not explain a larger difference between combined odometry and the encoders
DISAGREEMENT: Final = 0.5
# a whole number beyond it is no float, so it is not finite either
LARGEST: Final = sys.float_info.max
LOST: Final = "not seen any more: a wall, an obstacle, or dead encoders"
BLOCKED: Final = "blocked: a wall or an obstacle, or dead encoders"


class Fault(StrEnum):
    """Faults that the gate and the tasks count."""

    NOT_FINITE = "command_not_finite"
    SPEED = "speed_clipped"
    YAW_RATE = "yaw_rate_clipped"
    PWM = "pwm_clipped"
    MOTOR = "motor_limited"
    STEERING = "steering_limited"
    STALE = "command_stale"
    MEASURED = "measurement_not_finite"
    NOT_MANUAL = "pwm_test_refused"
    POWER = "power_control_refused"
    GAINS = "gains_refused"
    OVERFLOW = "messages_dropped"
    LINK = "link_lost"
    MISSED = "missed_ticks"
    SLEPT = "computer_slept"
    RUNAWAY = "runaway"
    ODOMETRY = "odometry_lost"
    BATTERY = "battery_bad"
    TASK = "task_fault"
    STOP = "emergency_stop"
    UNMOVED = "commanded_not_moving"
    STOP_UNOBEYED = "stop_not_obeyed"
    OBSTACLE = "slowed_for_obstacle"


WAY_BACK: Final = "look what is in its way, arm (m), drive back (s)"
REMEDIES: Final[Mapping[Fault, str]] = {
    Fault.LINK: "look at the board, its power and its cable, then arm (m)",
    Fault.MISSED: "end other programs, then arm (m)",
    Fault.SLEPT: "look where it stands, then arm (m)",
    Fault.RUNAWAY: "look at the robot and its encoders, then arm (m)",
    Fault.ODOMETRY: "look at the board and its encoders, then arm (m)",
    Fault.BATTERY: "change the batteries, then arm (m)",
    Fault.UNMOVED: "look at motor, ESC and battery, then arm (m)",
    Fault.STOP_UNOBEYED: "hold it by hand, look at ESC and board, then arm (m)",
    Fault.TASK: "read the log, then start it again",
}
"""For each fault that disarms: what to look at or to mend, then how to go on."""


class Outputs(NamedTuple):
    """Outputs to the actuators; only the safety gate makes them.

    A HAL with the capability `pwm` obeys the PWM counts: motor forward, front steering right and rear steering left are
    positive, and there are two free servos. Any other HAL obeys the set-point v (m/s), omega (rad/s). If no wheel
    steers, the counts of the two sides are `txt1.model.vehicle.sides(motor, rear)`.
    """

    motor: int = 0
    front: int = 0
    rear: int = 0
    pwm4: int = 0
    pwm5: int = 0
    v: float = 0.0
    omega: float = 0.0


def clip(value: float, limit: float) -> float:
    """Return the value limited to +-limit."""
    return min(max(value, -limit), limit)


class SetpointBounds:
    """The set-points that a vehicle may get: its limits of speed and yaw rate, looked up once."""

    def __init__(self, limits: Limits) -> None:
        self.v_max, self.omega_max = limits.v_max, limits.omega_max
        self.dead_band, self.radius_min = limits.v_dead_band, limits.radius_min

    def nearest(self, v: float, omega: float) -> tuple[float, float]:
        """Return the nearest allowed set-point (v, omega): speed first, then yaw rate by (2.16)."""
        speed = abs(v)
        if not speed <= self.v_max:
            v, speed = clip(v, self.v_max), self.v_max
        if speed < self.dead_band:
            v = speed = 0.0
        omega_max, radius_min = self.omega_max, self.radius_min
        # never true for a vehicle that turns in place
        if speed < omega_max * radius_min:
            omega_max = speed / radius_min
        if not abs(omega) <= omega_max:
            omega = clip(omega, omega_max)
        return v, omega


class RunawayWatch:
    """Notices from encoders, and combined odometry in use, that the robot does not follow the outputs.

    At full lock the inner wheel turns at 0.63 of the outer wheel's speed, so it is never silent for long. A rover that
    turns in place may have a silent wheel, or wheels that turn against each other, without a fault.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._fastest, self._strongest = limits.runaway_speed, float(limits.runaway_motor)
        # so its sides may stand or turn against each other
        self._pivots = limits.radius_min == 0.0
        self.clear()

    def clear(self) -> None:
        """Forget all suspicions."""
        self._calm = True
        # how long each wheel has been silent under power, s
        self._silent = [0.0, 0.0]
        # counts of the other wheel meanwhile
        self._passed = [0, 0]
        # how long the wheels have turned against each other, s
        self._against = 0.0
        # how long the vehicle has been too fast, s
        self._fast = 0.0
        # how long combined odometry and encoders have disagreed, s
        self._apart = 0.0

    def check(self, motor: int, right: int, left: int, v: float, v_combined: float | None, dt: float) -> str | None:
        """Return why this is a runaway, or None.

        `motor` is the motor's output (PWM counts), `right` and `left` are the encoders' ticks in the last `dt` s. `v`
        is the speed by the encoders (m/s), and `v_combined` by combined odometry, while the loops use it.
        """
        fast = abs(v) > self._fastest
        apart = v_combined is not None and abs(v_combined - v) > DISAGREEMENT
        if not (fast or apart):
            # both turn the same way
            if right * left > 0:
                if not self._calm:
                    self.clear()
                return None
            # at rest
            if self._calm and right == left == 0 and abs(motor) <= self._strongest:
                return None
        self._calm = False
        self._fast = self._fast + dt if fast else 0.0
        if self._fast >= PERSISTS:
            return f"{abs(v):.1f} m/s is faster than any command"
        self._apart = self._apart + dt if apart else 0.0
        if self._apart >= self._limits.runaway_time:
            return f"combined odometry says {v_combined:.1f} m/s, the encoders {v:.1f} m/s"
        against = not self._pivots and min(right, left) < -NOISE_COUNTS and max(right, left) > NOISE_COUNTS
        self._against = self._against + dt if against else 0.0
        if self._against >= PERSISTS:
            return "the encoders turn against each other"
        return self._check_silence(abs(motor) > self._strongest, right, left, dt)

    def _check_silence(self, driven: bool, right: int, left: int, dt: float) -> str | None:
        for wheel, ticks, other in ((0, right, left), (1, left, right)):
            if ticks:
                self._silent[wheel], self._passed[wheel] = 0.0, 0
                continue
            self._silent[wheel] = self._silent[wheel] + dt if driven else 0.0
            self._passed[wheel] += abs(other)
        too_long = [
            s >= self._limits.runaway_time or p > self._limits.runaway_counts
            for s, p in zip(self._silent, self._passed, strict=True)
        ]
        # a car that pushes against a wall trembles, and a wheel that stands counts now and then
        stands = any(long and passed <= NOISE_COUNTS for long, passed in zip(too_long, self._passed, strict=True))
        if all(too_long) or (stands and not self._pivots):
            return BLOCKED
        if any(too_long) and not self._pivots:
            return f"the {'right' if too_long[0] else 'left'} encoder is silent"
        return None


Guard = Callable[[float, float, float], tuple[float, float]]
"""Given a set-point (v, omega) and the time, s of the run, returns the set-point that it allows: no faster."""


class Gate:
    """Decides what reaches the actuators; `on_close` is called with the reason whenever the gate disarms.

    `count` is m per count of an encoder; 0 if it is fine, or unknown.
    """

    def __init__(self, limits: Limits, on_close: Callable[[str], None], count: float = 0.0) -> None:
        self.limits = limits
        self.sight = WheelSight(count)
        """Whether the car is seen while it is commanded to drive."""
        self._bounds = SetpointBounds(limits)
        self._timeout = limits.command_timeout + 1e-9
        self._motor_max = float(limits.motor_max)
        self.armed = False
        self.stopped = False
        self.reason = "not armed yet"
        # the fault that closed it, unless an operator or a program has stopped or disarmed it since
        self.closed_by: Fault | None = None
        self.counts: dict[Fault, int] = dict.fromkeys(Fault, 0)
        self._on_close = on_close
        # stamped on every command as it comes in; `renew` raises it
        self.epoch = 0
        self._valid_from = 0.0
        self._fresh = False
        self._motor = 0
        # the free servos' counts as they were given last, and inside the limits
        self._servos = self._clipped = (0, 0)
        self._neutral = Outputs()
        self._runaway = RunawayWatch(limits)
        self.guards: list[Guard] = []
        self.limited = False
        """Whether a guard holds the robot before something that it sees, which is no loss of anything."""
        self.held = False
        """Whether the outputs are neutral until a board that did not obey for a moment has settled."""

    @property
    def told(self) -> str:
        """Why it is closed, as people are told: the remedy first; "" while it is open."""
        remedy = "" if self.closed_by is None else REMEDIES.get(self.closed_by, "")
        if remedy and self.reason.startswith("blocked"):
            remedy = WAY_BACK
        return f"{remedy}: {self.reason}" if remedy else self.reason

    def count(self, fault: Fault) -> None:
        """Count a fault."""
        self.counts[fault] += 1

    def arm(self, now: float) -> None:
        """Open the gate at `now` and release the emergency stop. Only commands given from then on count."""
        self.armed, self.stopped, self.reason, self.closed_by = True, False, "", None
        self.renew(now)
        self._runaway.clear()
        self.sight.clear()
        self.held = False

    def renew(self, now: float) -> None:
        """Make all commands given up to `now` invalid: the robot has been armed, or its mode changed."""
        self.epoch += 1
        self._valid_from = now
        self._fresh = False

    def disarm(self, reason: str, fault: Fault | None = None) -> None:
        """Close the gate; a fault is counted if the gate was open. Without a fault a user or program closes it."""
        if not self.armed:
            if fault is None:
                self.closed_by = None
            return
        self.closed_by = fault
        self._close(reason, fault)

    def stop(self) -> None:
        """Emergency stop: disarm and latch, armed or not."""
        self.closed_by = None
        if not self.stopped:
            self.stopped = True
            self._close("emergency stop", Fault.STOP)

    def _close(self, reason: str, fault: Fault | None) -> None:
        self.armed, self.reason, self._motor = False, reason, 0
        if fault is not None:
            self.count(fault)
        self._on_close(reason)

    def admit_velocity(self, v: float, omega: float) -> tuple[float, float] | None:
        """Return the set-point (v, omega) inside the limits; None if it is not finite and must be ignored."""
        if not (-LARGEST <= v <= LARGEST and -LARGEST <= omega <= LARGEST):
            self.count(Fault.NOT_FINITE)
            return None
        limited = self._bounds.nearest(v, omega)
        if limited[1] != omega:
            self.count(Fault.YAW_RATE)
        if abs(v) > self._bounds.v_max:
            self.count(Fault.SPEED)
        return limited

    def guarded(self, v: float, omega: float, now: float) -> tuple[float, float]:
        """Return the set-point that every guard allows; 0 if a guard makes it faster, reverses it or is not finite."""
        for guard in self.guards:
            slower, turning = guard(v, omega, now)
            if not (isfinite(turning) and 0.0 <= slower * v <= v * v):
                slower = turning = 0.0
            v, omega = self._bounds.nearest(slower, turning)
        return v, omega

    def admit_finite(self, *values: float) -> bool:
        """Return whether all values are finite; if not, count a fault."""
        if all(-LARGEST <= value <= LARGEST for value in values):
            return True
        self.count(Fault.NOT_FINITE)
        return False

    def admit_pwm(self, *counts: float) -> tuple[int, ...] | None:
        """Return PWM counts inside +-24000; None if one is not finite and all must be ignored."""
        if not self.admit_finite(*counts):
            return None
        if any(abs(c) > PWM_MAX for c in counts):
            self.count(Fault.PWM)
        return tuple(int(clip(c, PWM_MAX)) for c in counts)

    def passes(self, given: float | None, epoch: int, now: float) -> bool:
        """Return whether a command of that time (s of the run) and epoch may act; count it when it gets stale."""
        fresh = False
        # CPython compares quickly where it branches
        if (
            given is not None
            and epoch == self.epoch
            and given >= self._valid_from
            and -AHEAD <= now - given <= self._timeout
        ):
            fresh = True
        if not fresh and self._fresh and self.armed:
            self.count(Fault.STALE)
        self._fresh = fresh
        return fresh and self.armed and not (self.sight.doubted or self.held)

    def neutral(self, servos: tuple[int, int]) -> Outputs:
        """Motor off, steering straight, set-point 0; the free servos follow while armed, else stay where they are."""
        self._motor = 0
        if self.armed and servos is not self._servos:
            self._hold(servos)
        return self._neutral

    def _hold(self, servos: tuple[int, int]) -> None:
        self._servos = servos
        self._clipped = int(clip(servos[0], PWM_MAX)), int(clip(servos[1], PWM_MAX))
        self._neutral = Outputs(0, 0, 0, *self._clipped)

    def outputs(
        self, motor: float, front: float, rear: float, servos: tuple[int, int], v: float, omega: float
    ) -> Outputs:
        """Return the outputs for counts and a set-point that are asked for.

        Neutral when the gate is closed or a value is not finite. Call `passes` first: it tells whether the command
        behind the values is fresh.
        """
        if not (self.armed and self._fresh):
            return self.neutral(servos)
        # a value that is not finite makes the sum not finite
        if not -inf < motor + front + rear + v + omega < inf:
            self.count(Fault.NOT_FINITE)
            return self.neutral(servos)
        if abs(motor) > self._motor_max:
            self.count(Fault.MOTOR)
            motor = clip(motor, self._motor_max)
        if abs(front) > STEERING_LIMIT or abs(rear) > STEERING_LIMIT:
            self.count(Fault.STEERING)
            front, rear = clip(front, STEERING_MAX), clip(rear, STEERING_MAX)
        v, omega = self._bounds.nearest(v, omega)
        self._motor = int(motor)
        if servos is not self._servos:
            self._hold(servos)
        pwm4, pwm5 = self._clipped
        return new(Outputs, (self._motor, int(front), int(rear), pwm4, pwm5, v, omega))

    def watch(self, right: int, left: int, v: float, v_combined: float | None, dt: float) -> None:
        """Disarm on a runaway, by the readings of the last dt seconds (see `RunawayWatch.check`)."""
        if self.armed:
            reason = self._runaway.check(self._motor, right, left, v, v_combined, dt)
            if reason is not None:
                self.disarm(reason if reason is BLOCKED else f"runaway: {reason}", Fault.RUNAWAY)

    def unseen(self, asked: float, dt: float, brakes: bool) -> bool:
        """Return whether the outputs have to be neutral now, as a reading shows no wheel turning (see `WheelSight`).

        Disarm if the car is not seen any more.
        """
        lost = self.sight.lost(asked, dt, brakes)
        if lost:
            self.disarm(LOST, Fault.RUNAWAY)
        return lost or self.sight.doubted

    def slept(self, duration: float, period: float) -> None:
        """Disarm if the computer was suspended for `duration` s, as long as too many cycles of `period` s take."""
        if duration >= self.limits.missed_ticks_max * period:
            self.disarm(f"the computer slept {duration:.1f} s", Fault.SLEPT)

    def missed(self, cycles: int) -> None:
        """Disarm if the controller has missed too many cycles in a row."""
        if cycles >= self.limits.missed_ticks_max:
            self.disarm(f"the controller missed {cycles} cycles", Fault.MISSED)
