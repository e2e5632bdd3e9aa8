"""The encoder task, 50 Hz, and the odometry task, 20 Hz, which sends the pose on (thesis 2.3, 3.3.3, 3.7.1)."""

from collections.abc import Callable, Sequence
from math import cos, sin
from typing import Final

from txt1.control.limits import Gate
from txt1.control.sight import outer_wheel
from txt1.errors import HalError
from txt1.hal.base import BoardLink, Hal, Inputs
from txt1.kernel.ticks import Ticks
from txt1.model.odometry import Odometry, WheelOdometry, advance
from txt1.model.vehicle import Geometry
from txt1.protocol.messages import BoardMessage, EncoderOdometry
from txt1.tasks.fields import Control, Encoders
from txt1.tasks.state import State
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare
from txt1.units import new

# m/s^2: brakes cannot slow the robot faster; a speed that falls faster is no longer measured, or the robot has hit a
# wall
BRAKES: Final = 10.0
# s between two odometry messages: a line may delay some of them, which then arrive in a bunch
ODOMETRY_PERIOD: Final = 0.05
# the numbers of a plane pose in a ROS message
PLACE: Final = ("position.x", "position.y", "orientation.z", "orientation.w")
_ROBOT: Final = {"header": {"frame_id": "odom"}, "child_frame_id": "base_footprint"}


def _diagonal(x: float, y: float, theta: float) -> dict[str, list[float]]:
    """Return a 6 x 6 covariance for ROS, of a robot in the plane. The motions it cannot make have variance 0."""
    values = [0.0] * 36
    values[0], values[7], values[14], values[21], values[28], values[35] = x, y, 1e-6, 1e-6, 1e-6, theta
    return {"covariance": values}


_UNSURE: Final = {
    # 0.1 m and 0.1 rad; the true variance grows with the distance, which a constant cannot show
    "pose": _diagonal(0.01, 0.01, 0.01),
    # m/s and rad/s, from one encoder count, the floor and the tyres
    "twist": _diagonal(0.006**2, 1e-6, 0.04**2),
}


def in_the_plane(pose: Sequence[float]) -> tuple[float, float, float, float]:
    """Return a pose (m, rad) as the numbers of `PLACE`: the heading is a quaternion's z and w."""
    half = 0.5 * pose[2]
    return pose[0], pose[1], sin(half), cos(half)


def _moving(odometry: Odometry) -> tuple[float, ...]:
    x, y, theta, v, omega = odometry
    half = 0.5 * theta
    return x, y, sin(half), cos(half), v, omega


ODOMETRY: Final = declare(
    Topic(
        "/odom",
        Odometry,
        "m, m/s, rad/s",
        "nav_msgs/Odometry",
        Rule.CYCLE,
        "the odometry that the loops use, from where it began",
        _ROBOT | _UNSURE,
        (*(f"pose.pose.{name}" for name in PLACE), "twist.twist.linear.x", "twist.twist.angular.z"),
        _moving,
    )
)
_TRANSFORM: Final = tuple(
    f"transforms.0.transform.{name}" for name in ("translation.x", "translation.y", "rotation.z", "rotation.w")
)
TRANSFORM: Final = declare(
    Topic(
        "/tf",
        Odometry,
        "m",
        "tf2_msgs/TFMessage",
        Rule.CYCLE,
        "the odometry once more, for tools that want transforms",
        {"transforms": [_ROBOT]},
        _TRANSFORM,
        _moving,
        in_snapshots=False,
    )
)
ENCODERS: Final = declare(
    Topic[Encoders](
        "/encoders",
        Encoders,
        "ticks of a cycle",
        define("txt1_msgs/Encoders", "std_msgs/Header header\nint32 right\nint32 left\nbool valid"),
        Rule.CYCLE,
        "both encoders",
        {"header": {"frame_id": "base_footprint"}},
        ("right", "left", "valid"),
        lambda ticks: (ticks.right or 0, ticks.left or 0, ticks.right is not None),
    )
)
Pose = tuple[float, float, float]
POSE: Final = declare(
    Topic[Pose](
        "/pose",
        tuple,
        "m",
        "geometry_msgs/PoseStamped",
        Rule.CYCLE,
        "the true pose in the room, in simulation",
        {"header": {"frame_id": "room"}},
        tuple(f"pose.{name}" for name in PLACE),
        in_the_plane,
    )
)
ROOM: Final = declare(
    Topic[Pose](
        "/tf_room",
        tuple,
        "m",
        "tf2_msgs/TFMessage",
        Rule.SECOND,
        "where the odometry began in the room, as it seems now",
        {"transforms": [{"header": {"frame_id": "room"}, "child_frame_id": "odom"}]},
        _TRANSFORM,
        in_the_plane,
        in_snapshots=False,
    )
)


def origin(pose: Pose, odometry: Odometry) -> Pose:
    """Return the pose in the room (m, rad) of the odometry's frame."""
    turn = pose[2] - odometry.theta
    x, y = odometry.x * cos(turn) - odometry.y * sin(turn), odometry.x * sin(turn) + odometry.y * cos(turn)
    return pose[0] - x, pose[1] - y, turn


STILL: Final = Encoders(0, 0)


async def encoder(ticks: Ticks, state: State, hal: Hal, gate: Gate, geometry: Geometry) -> None:
    """Keep the odometry up to date, from encoder ticks or from a HAL that computes odometry.

    A car that is commanded to drive and not seen any more gets neutral outputs at once, past loops that do not see it.
    """
    turning = 0.5 * geometry.track_width
    # the time of the last reading, s of the run, and the controller's decision at that time
    looked, before = 0.0, state.control
    wheels = WheelOdometry(geometry)
    if hal.capabilities.blind:
        state.tell(0.0, "no encoders: odometry is dead reckoning, and the rules on runaways are off")
    async for now in ticks:
        inputs = hal.read(now)
        state.pose = inputs.pose
        state.held = inputs.held
        if inputs.link is not state.board:
            _note(state, inputs.link, now)
        counted = inputs.ticks
        if counted is None:
            if hal.capabilities.ticks:
                raise HalError(f"the HAL '{hal.name}' reports no encoder ticks any more")
            if hal.capabilities.blind:
                # motors that do not follow the outputs are taken to stand
                given = Control() if inputs.held else state.control
                _put(state, advance(state.odometry, given.v, given.omega, now - state.odometry_time), now, still=False)
                continue
            take_odometry(state, inputs, now)
        else:
            counts = wheels.step(counted, now)
            if counts is not None:
                state.encoders = STILL if wheels.still else new(Encoders, counts)
                _put(state, wheels.odometry, now, wheels.still)
        time = state.odometry_time
        if gate.armed and time > looked:
            _, _, _, v, omega = state.odometry
            if v or omega:
                gate.sight.turns(outer_wheel(v, turning * omega), time - looked)
            elif _unseen(state.control, before, turning, time - looked, gate):
                neutral = gate.neutral(state.servos)
                if hal.capabilities.halt:
                    hal.halt(neutral, now)
                hal.write(neutral, now)
        looked, before = time, state.control


def _unseen(given: Control, before: Control, turning: float, dt: float, gate: Gate) -> bool:
    """Return whether the outputs have to be neutral now, as wheels that were seen to stand do not obey.

    `before` is the decision at the reading before, `dt` s ago; `turning` is half the track's width, m.
    """
    if not (given.v or given.omega or gate.sight.doubted):
        gate.sight.clear()
        return False
    wanted = outer_wheel(given.v, turning * given.omega)
    brakes = given.outputs.motor * wanted < 0.0 or before.outputs.motor * wanted < 0.0
    return gate.unseen(wanted, dt, brakes)


def _put(state: State, odometry: Odometry, time: float, still: bool) -> None:
    """Store the odometry of a time, s of the run.

    `still`: the robot was measured to stand, which needs the ATX supply's 5 V.
    """
    state.odometry, state.odometry_time = odometry, time
    if not still or state.power.atx is False:
        state.moved_time = time


def _note(state: State, link: BoardLink | None, now: float) -> None:
    """Take the state of the line, and tell a change of it."""
    if link is not None and (state.board is None or link.text != state.board.text):
        state.tell(now, link.text)
    state.board = link


def take_odometry(state: State, inputs: Inputs, now: float) -> None:
    """Take the odometry that the hardware reports, and the state of the line."""
    if inputs.link is not state.board:
        _note(state, inputs.link, now)
    if inputs.odometry is not None:
        still = inputs.odometry.v == inputs.odometry.omega == 0.0
        since = inputs.odometry_time - state.odometry_time
        if since > 0.0:
            if fallen(state.odometry.v, inputs.odometry.v, since):
                state.fell_time = inputs.odometry_time
            elif not still:
                state.fell_time = 0.0
        _put(state, inputs.odometry, inputs.odometry_time, still)


def fallen(before: float, after: float, since: float) -> bool:
    """Return whether a speed, m/s, fell within `since` s faster than brakes allow, as when encoders lose power."""
    return abs(before) - abs(after) > BRAKES * max(since, ODOMETRY_PERIOD) + 1e-9


async def odometry(ticks: Ticks, state: State, send: Callable[[BoardMessage], None], heard: Callable[[], bool]) -> None:
    """Send pose and velocities, once per tick, while the link to the host is alive and somebody listens (`heard`)."""
    async for _ in ticks:
        if state.link.alive:
            # for the transmit LED; all other messages are too few to show
            state.transmitted += 1
            if heard():
                send(EncoderOdometry(*state.odometry))
