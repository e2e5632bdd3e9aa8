"""The fleet for the screens: a line for each robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from txt1.control.hand import Hand
from txt1.control.standstill import Stop
from txt1.telemetry.topics import Rule, Topic, declare

if TYPE_CHECKING:
    from txt1.robot import Robot


# s in a fleet; within them a robot leaves to an earlier robot of the same name
NEW: Final = 30.0


class Member(NamedTuple):
    """A robot of a fleet; None stands for an unknown value.

    `armed` says whether it may drive, `reason` why not. `pose` is its place in the room (m, rad), `v` and `omega` its
    velocities (m/s, rad/s), `driver` the source that drives it, `battery` its voltage (V). It was heard `age` s ago,
    and its clock is `offset` s ahead of ours. `silent` names a robot that it needs and does not hear. `stop` says how
    its last stop goes by its own watch, `stuck` what blocks it while it wants to drive. `hand` is its hand rule.
    """

    name: str
    armed: bool
    reason: str = ""
    pose: tuple[float, float, float] | None = None
    v: float = 0.0
    omega: float = 0.0
    driver: str = ""
    battery: float | None = None
    age: float | None = None
    offset: float | None = None
    alive: bool = True
    silent: str = ""
    stop: str = ""
    stuck: str = ""
    hand: Hand | None = None


FLEET: Final[Topic[tuple[Member, ...]]] = declare(
    Topic("/fleet", tuple[Member, ...], "", "std_msgs/String", Rule.SNAPSHOT, "all robots of the fleet")
)
FLEET_STOP: Final = declare(
    Topic(
        "/fleet_stop", str, "", "std_msgs/String", Rule.SNAPSHOT, "how the last stop of all that was said here stands"
    )
)


def member_of(robot: Robot, silent: str = "", stuck: str = "") -> Member:
    """Return a robot's own line now; `silent` names the robot that it waits for, `stuck` what blocks it."""
    odometry = robot.odometry
    pose = robot.pose or (odometry.x, odometry.y, odometry.theta)
    return Member(
        robot.config.name,
        robot.armed,
        robot.told,
        pose,
        odometry.v,
        odometry.omega,
        robot.driver.name,
        robot.battery.battery1,
        silent=silent,
        stop=_stop_of(robot),
        stuck=stuck,
        hand=robot.config.hand(),
    )


def _stop_of(robot: Robot) -> str:
    """Return the progress of the robot's last stop; "standing" only if it was seen to stand and still stands."""
    if robot.runtime.stands(robot.now) and not robot.hal.capabilities.blind:
        return Stop.STANDING
    seen = robot.stop_state
    # the watch has not been asked since
    if seen is Stop.STANDING:
        return Stop.SLOWING
    if robot.hal.capabilities.blind:
        return Stop.UNSEEN
    return Stop.SLOWING if seen in (None, Stop.NONE) else seen
