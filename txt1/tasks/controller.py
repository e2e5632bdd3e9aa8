"""The controller task: both PID loops, PWM outputs. Priority 4, 50 Hz, hard (thesis 3.3.3, 4)."""

from math import inf
from operator import attrgetter
from typing import Final

from txt1.control.limits import Fault, Gate
from txt1.control.loops import Loops
from txt1.control.pid import Gains, at_rest
from txt1.hal.base import Capabilities, Hal
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import wheel_ticks
from txt1.model.vehicle import Geometry
from txt1.tasks.fields import Command, Control, ManualPwm, Source
from txt1.tasks.state import State
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare
from txt1.units import new

CONTROL_PERIOD: Final = 0.02

# s of age from which combined odometry is not used
COMBINED_TIMEOUT: Final = 0.1
# s of age from which odometry counts as lost
ODOMETRY_TIMEOUT: Final = 0.5
# s: the longest gap between two readings of the odometry that a step of the loops may bridge
STEP_MAX: Final = 0.1
# m/s of the faster wheel from which boards also read the slower wheel: originals read 0 below 0.045
READ: Final = 0.1
SETPOINT: Final = declare(
    Topic(
        "/setpoint",
        Control,
        "m/s, rad/s",
        "geometry_msgs/TwistStamped",
        Rule.CYCLE,
        "the set-point in force behind the safety gate",
        {"header": {"frame_id": "base_footprint"}},
        ("twist.linear.x", "twist.angular.z"),
        attrgetter("v", "omega"),
    )
)
PWM: Final = declare(
    Topic(
        "/pwm",
        Control,
        "counts of +-24000",
        define("txt1_msgs/Pwm", "std_msgs/Header header\nint32 motor\nint32 front\nint32 rear\nint32 pwm4\nint32 pwm5"),
        Rule.CYCLE,
        "the five channels",
        {"header": {"frame_id": "base_footprint"}},
        ("motor", "front", "rear", "pwm4", "pwm5"),
        lambda control: control.outputs[:5],
        in_snapshots=False,
    )
)
GAINS: Final = declare(
    Topic[tuple[Gains, Gains]](
        "/gains",
        tuple,
        "counts per mm/s, per mrad/s",
        define(
            "txt1_msgs/Gains",
            "std_msgs/Header header\nfloat64 linear_kp\nfloat64 linear_ki\nfloat64 linear_kd\n"
            "float64 angular_kp\nfloat64 angular_ki\nfloat64 angular_kd",
        ),
        Rule.CHANGE,
        "the gains in force",
        {"header": {"frame_id": "base_footprint"}},
        tuple(f"{loop}_{gain}" for loop in ("linear", "angular") for gain in ("kp", "ki", "kd")),
        lambda gains: gains[0] + gains[1],
        in_snapshots=False,
    )
)

MEASURED_BY: Final = declare(
    Topic(
        "/measured_by",
        Source,
        "",
        "std_msgs/String",
        Rule.CHANGE,
        'where the velocities come from; "reckoned": nothing measures them, and /odom is dead reckoning',
        make=lambda source: {"data": str(source)},
    )
)

_OFF: Final = Gains()
# Python finds an attribute of an Enum slowly
ENCODER: Final = Source.ENCODER
COMBINED: Final = Source.COMBINED
RECKONED: Final = Source.RECKONED


# s of commands without effect after which the robot tells why it cannot move
UNMOVED_TIME: Final = 0.5


def reason_not_to_move(state: State, can: Capabilities) -> str | None:
    """Return why no command moves the armed robot, with the remedy; None if commands move it."""
    if state.power.esc is False:
        return "the ESC is off, so nothing moves: switch it on first (e, or Robot.switch_power)"
    if not state.gains.loaded and (can.gains or (can.pwm and not can.blind)):
        return "no gains are loaded, so nothing moves: call 'await robot.load_gains()' first"
    return None


async def controller(ticks: Ticks, state: State, hal: Hal, gate: Gate, geometry: Geometry, loops: Loops) -> None:
    """Turn the command in force into outputs, once per tick, through the safety gate.

    The loops step with every reading of the odometry: in every tick if the HAL has encoders, else when odometry
    arrives.
    """
    cycle = Cycle(state, hal, gate, geometry, loops)
    async for now in ticks:
        if ticks.missed:
            gate.missed(ticks.missed)
        if state.board is not cycle.board:
            cycle.watch_line()
        cycle.measure(now)
        cycle.watch_wheels(now)
        control = cycle.decide(now)
        if not cycle.drives or cycle.asked_since < inf:
            cycle.explain(now)
        hal.write(control.outputs, now)
        state.control = control


class Cycle:
    """The steps of one cycle of the controller, in the order in which it takes them, and what they pass on."""

    def __init__(self, state: State, hal: Hal, gate: Gate, geometry: Geometry, loops: Loops) -> None:
        self._state, self._gate, self._geometry, self._loops = state, gate, geometry, loops
        self.can = hal.capabilities
        self._closes_loops, self._has_ticks, self._blind = self.can.pwm, self.can.ticks, self.can.blind
        self.board = state.board
        # measured: the source, speed (m/s) and yaw rate (rad/s), and s since the reading before
        self.source, self.v_now, self.omega_now, self.dt, self._read_at = ENCODER, 0.0, 0.0, CONTROL_PERIOD, 0.0
        # the command that asks
        self._given: ManualPwm | Command | None = None
        # whether it may act, whether the loops carry it out, and the mode
        self._passes, self.drives, self._was_manual = False, False, False
        # since when commands have been in vain, s of the run, and whether that was told
        self.asked_since, self._told = inf, False

    def watch_line(self) -> None:
        """Disarm if the line to the board was lost since the cycle before."""
        before, self.board = self.board, self._state.board
        if before is not None and self.board is not None and before.losses != self.board.losses:
            self._gate.disarm(self.board.reason, Fault.LINK)

    def measure(self, now: float) -> None:
        """Take the velocities that the loops and the rules go by: combined odometry while it is selected and fresh."""
        state = self._state
        combined, odometry = state.combined, state.odometry
        if combined is not None and state.link.combined and now - combined.time <= COMBINED_TIMEOUT + 1e-9:
            self.source, self.v_now, self.omega_now = COMBINED, combined.v, combined.omega
        else:
            self.source, self.v_now, self.omega_now = ENCODER, odometry.v, odometry.omega
        if self._blind:
            self.source = RECKONED
        elif not self._has_ticks:
            self.dt, self._read_at = min(state.odometry_time - self._read_at, STEP_MAX), state.odometry_time

    def watch_wheels(self, now: float) -> None:
        """Disarm on a runaway, and when the odometry is lost."""
        state, gate = self._state, self._gate
        right, left = state.encoders
        odometry = state.odometry
        if not (self._has_ticks or self._blind):
            wheel = abs(odometry.v) + 0.5 * self._geometry.track_width * abs(odometry.omega)
            if self.dt > 0.0 and wheel < inf and (self._closes_loops or wheel >= READ):
                right, left = wheel_ticks(odometry.v, odometry.omega, self.dt, self._geometry)
        if right is not None and left is not None and not state.held:
            gate.watch(right, left, odometry.v, self.v_now if self.source is COMBINED else None, self.dt)
        if now - state.odometry_time > ODOMETRY_TIMEOUT:
            gate.disarm("odometry lost", Fault.ODOMETRY)

    def decide(self, now: float) -> Control:
        """Return the outputs and set-point for the command in force: neutral unless it may act."""
        state, gate = self._state, self._gate
        manual = state.panel.manual is True
        given = self._given = state.manual_pwm if manual else state.command
        passes = given is not None and gate.passes(given.time, given.epoch, now)
        if not -inf < self.v_now + self.omega_now < inf:
            gate.count(Fault.MEASURED)
            passes = False
        self._passes, self.drives = passes, False
        was_manual, self._was_manual = self._was_manual, manual
        if passes and manual is was_manual and state.link.alive and state.power.esc is not False:
            if isinstance(given, ManualPwm):
                outputs = gate.outputs(given.motor, given.front, given.rear, state.servos, 0.0, 0.0)
                return Control(outputs, source=self.source)
            assert given is not None
            v, omega, _, _ = given
            if omega != 0.0 or not at_rest(v, self.v_now):
                return self._close_loops(v, omega, now)
        self._loops.clear()
        return new(Control, (gate.neutral(state.servos), 0.0, 0.0, self.source, _OFF))

    def _close_loops(self, v: float, omega: float, now: float) -> Control:
        """Return the outputs by both loops for the set-point that the guards allow, and this set-point."""
        state, gate = self._state, self._gate
        if gate.guards:
            v, omega = gate.guarded(v, omega, now)
        motor = steering = 0.0
        angular = _OFF
        if state.held:
            self._loops.clear()
        if self._closes_loops:
            linear, schedule, self.drives = state.gains
            angular = schedule.at(self.v_now)
            motor, steering = self._loops.step(v, omega, self.v_now, self.omega_now, linear, angular, self.dt)
        outputs = gate.outputs(motor, -steering, steering, state.servos, v, omega)
        return new(Control, (outputs, v, omega, self.source, angular))

    def explain(self, now: float) -> None:
        """Tell once why commands are in vain, when they have been for UNMOVED_TIME."""
        state, given = self._state, self._given
        in_vain = self._passes and (state.power.esc is False or not state.gains.loaded)
        if not in_vain or not isinstance(given, Command) or not (given.v or given.omega):
            # the next attempt tells it again
            self.asked_since, self._told = inf, False
            return
        self.asked_since = min(self.asked_since, now)
        if (
            now - self.asked_since >= UNMOVED_TIME
            and not self._told
            and (reason := reason_not_to_move(state, self.can)) is not None
        ):
            self._told = True
            state.tell(now, reason)
