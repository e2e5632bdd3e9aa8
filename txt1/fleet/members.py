"""A fleet as it is shown: one line for each robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from txt1.control.hand import Hand
from txt1.control.standstill import Stop
from txt1.telemetry.topics import Rule, Topic, declare

if TYPE_CHECKING:
    from txt1.robot import Robot


NEW: Final = 30.0  # s in a fleet in which a robot gives way to one of its name that was there before


class Member(NamedTuple):
    """A robot of a fleet.

    Its name, whether it may drive and else why not, its pose in the room (m, rad) and velocities (m/s, rad/s), who
    drives it, its battery (V); how long ago it was heard (s), how its clock stands to ours (s), whether those it
    cooperates with are heard: the name of one that is not; how its last stop goes, as it has seen itself; what holds it
    where it is to drive and does not get on; and its hand rule. None is what nobody knows.
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
    """A robot's own line, as it is now; `silent` names the robot that it waits for, `stuck` what holds it."""
    odometry = robot.odometry
    pose = robot.pose or (odometry.x, odometry.y, odometry.theta)
    return Member(
        robot.config.name,
        robot.armed,
        robot.reason,
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
    """How the robot's last stop goes: "standing" only where it was seen to stand, and still is."""
    if robot.runtime.stands(robot.now) and not robot.hal.capabilities.blind:
        return Stop.STANDING
    seen = robot.stop_state
    if seen is Stop.STANDING:  # the watch was not asked since
        return Stop.SLOWING
    if robot.hal.capabilities.blind:
        return Stop.UNSEEN
    return Stop.SLOWING if seen in (None, Stop.NONE) else seen
