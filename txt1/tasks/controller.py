"""The controller task: both PID loops, PWM outputs. Priority 4, 50 Hz, hard (thesis 3.3.3, 4)."""

from math import inf
from operator import attrgetter
from typing import Final

from txt1.control.car import InformedLoops
from txt1.control.limits import Fault, Gate
from txt1.control.open_loop import OpenLoop
from txt1.control.pid import Gains, VelocityLoops, at_rest
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


UNMOVED: Final = 0.5
"""s of commands without effect after which the robot tells why it cannot move."""

Loops = VelocityLoops | InformedLoops | OpenLoop


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
    closes_loops = hal.capabilities.pwm
    has_ticks = hal.capabilities.ticks
    blind = hal.capabilities.blind
    was_manual = False
    asked_since, told = inf, False
    board = state.board
    read_at = 0.0
    dt = CONTROL_PERIOD
    async for now in ticks:
        if ticks.missed:
            gate.missed(ticks.missed)
        if state.board is not board:
            if board is not None and state.board is not None and board.losses != state.board.losses:
                gate.disarm(state.board.reason, Fault.LINK)
            board = state.board
        source, v_now, omega_now = measured(state, now)
        right, left = state.encoders
        if blind:
            source = RECKONED
        elif not has_ticks:
            dt, read_at = min(state.odometry_time - read_at, STEP_MAX), state.odometry_time
            wheel = abs(state.odometry.v) + 0.5 * geometry.track_width * abs(state.odometry.omega)
            if dt > 0.0 and wheel < inf and (closes_loops or wheel >= READ):
                right, left = wheel_ticks(state.odometry.v, state.odometry.omega, dt, geometry)
        if right is not None and left is not None:
            gate.watch(right, left, state.odometry.v, v_now if source is COMBINED else None, dt)
        if now - state.odometry_time > ODOMETRY_TIMEOUT:
            gate.disarm("odometry lost", Fault.ODOMETRY)

        manual = state.panel.manual is True
        given: ManualPwm | Command | None = state.manual_pwm if manual else state.command
        v = omega = 0.0
        gains = _OFF
        passes = given is not None and gate.passes(given.time, given.epoch, now)
        if not -inf < v_now + omega_now < inf:
            gate.count(Fault.MEASURED)
            passes = False
        still = v_now == 0.0 and isinstance(given, Command) and given.omega == 0.0 and at_rest(given.v, v_now)
        if not (passes and state.link.alive and state.power.esc is not False) or manual is not was_manual or still:
            loops.clear()
            outputs = gate.neutral(state.servos)
        elif isinstance(given, ManualPwm):
            outputs = gate.outputs(given.motor, given.front, given.rear, state.servos, v, omega)
        else:
            assert given is not None
            v, omega = gate.guarded(given.v, given.omega, now) if gate.guards else (given.v, given.omega)
            motor = steering = 0.0
            if closes_loops:
                gains = state.gains.angular.at(v_now)
                motor, steering = loops.step(v, omega, v_now, omega_now, state.gains.linear, gains, dt)
            outputs = gate.outputs(motor, -steering, steering, state.servos, v, omega)
        was_manual = manual
        in_vain = passes and (state.power.esc is False or not state.gains.loaded)
        if in_vain and isinstance(given, Command) and (given.v or given.omega):
            asked_since = min(asked_since, now)
            if (
                not told
                and now - asked_since >= UNMOVED
                and (reason := reason_not_to_move(state, hal.capabilities)) is not None
            ):
                told = True
                state.tell(now, reason)
        else:
            # the next attempt tells it again
            asked_since, told = inf, False
        hal.write(outputs, now)
        control = state.control
        if outputs is not control.outputs or source is not control.source or v != control.v or omega != control.omega:
            state.control = new(Control, (outputs, v, omega, source, gains))


def measured(state: State, now: float) -> tuple[Source, float, float]:
    """Return the source of the measured velocities, the speed (m/s) and the yaw rate (rad/s).

    The source is combined odometry while it is selected and fresh.
    """
    combined = state.combined
    if combined is not None and state.link.combined and now - combined.time <= COMBINED_TIMEOUT + 1e-9:
        return COMBINED, combined.v, combined.omega
    odometry = state.odometry
    return ENCODER, odometry.v, odometry.omega
