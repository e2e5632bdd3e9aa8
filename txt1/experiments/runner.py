"""Drives an experiment through the Robot API, and measures meanwhile."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import Any, Final, NamedTuple

from txt1.control.limits import SetpointBounds
from txt1.errors import NotArmed, Overruled
from txt1.experiments.profile import Profile, ProfileStep, Waypoints
from txt1.experiments.recording import Instant, Recording
from txt1.kernel.ticks import Ticks
from txt1.model.battery import CUT_OFF_V
from txt1.model.reeds_shepp import Pose
from txt1.navigation import PoseSource, follow, fused_pose, map_pose, true_pose, wheel_pose
from txt1.navigation.pose_source import located, places_on_earth, step_between
from txt1.navigation.waypoints import Point
from txt1.robot import Robot
from txt1.tasks.battery import BAD_TIME
from txt1.tasks.fields import BatteryState

# s between two commands, as in the original tests
PUBLISH: Final = 0.1

# m/s below which the vehicle counts as standing, ...
STOPPED_V: Final = 0.02
# ... and s after which a vehicle that stands although it is commanded to drive ends the experiment
STOPPED_TIME: Final = 5.0
# s between two checks of the batteries
BATTERY_CHECK_PERIOD: Final = 1.0


class Leg(NamedTuple):
    """A leg between two waypoints, and its start, s of the experiment."""

    time: float
    start: Point
    end: Point


class Outcome(NamedTuple):
    """The result of an experiment."""

    # the samples
    recording: Recording
    # legs of waypoints, in order
    legs: tuple[Leg, ...]
    # reason for its end: "the end of the profile", or an earlier event
    stopped_by: str
    # time of the battery warning, s of the experiment; None: none came
    warned: float | None
    # the robot's pose source; "" without waypoints
    pose_source: str

    def json(self) -> list[Any]:
        """Return the outcome as JSON values; `outcome_of` is the inverse."""
        return [self.recording.columns.T.tolist(), *self[1:]]


def outcome_of(values: Sequence[Any]) -> Outcome:
    """Return the outcome from the values of `json`."""
    samples, legs, *rest = values
    recording = Recording(Instant(*sample) for sample in samples)
    return Outcome(recording, tuple(Leg(time, tuple(start), tuple(end)) for time, start, end in legs), *rest)


END_OF_PROFILE: Final = "the end of the profile"
SAFE_END: Final = "the safe end of the battery"
CUT_OFF: Final = "the battery's cut-off"
INTERRUPTED: Final = "the operator"
ANOTHER: Final = "another source of commands,"


@dataclass
class Experiment:
    """A profile that is driven by a robot."""

    robot: Robot
    profile: Profile
    # whether the robot stops when no time is left on its batteries
    safe_end: bool = True
    # called with the finished share of the profile, 0 to 1
    progressed: Callable[[float], None] = lambda _: None

    def __post_init__(self) -> None:
        self._samples: list[Instant] = []
        self._legs: list[Leg] = []
        self._begin = 0.0
        self._warned: float | None = None
        self._stopped_by = INTERRUPTED
        self._source: PoseSource | None = None
        # the pose source for waypoints
        self._believed: Pose | None = None
        self._still_since = inf

    async def run(self) -> None:
        """Drive the profile, and stop; `outcome` has the measurements, even if this was cancelled.

        Raises Overruled: another source of commands drives already. A source that takes the wheel later ends the
        experiment.
        """
        robot, profile = self.robot, self.profile
        robot.program.begin()
        self._begin = robot.now
        robot.add_task("measurement", profile.sample, self._measure, priority=-1)
        watch = asyncio.ensure_future(self._watch())
        waypoints = profile.waypoints
        drive = self._drive_steps(profile.steps) if waypoints is None else self._drive_waypoints(waypoints)
        work = asyncio.ensure_future(drive)
        try:
            await asyncio.wait((work, watch), return_when=asyncio.FIRST_COMPLETED)
            if watch.done():
                self._stopped_by = watch.result()
            else:
                work.result()
                self._stopped_by = END_OF_PROFILE
        except NotArmed as error:
            # without power the encoders are silent, too, so the gate may report a runaway first
            self._stopped_by = CUT_OFF if self._empty() else f"the safety gate: {error.reason}"
        except Overruled as error:
            self._stopped_by = f"{ANOTHER} '{error.driver}'"
        finally:
            watch.cancel()
            work.cancel()
            robot.program.release()

    def outcome(self) -> Outcome:
        """Return the measurements so far."""
        name = "" if self._source is None else self._source.name
        return Outcome(Recording(self._samples), tuple(self._legs), self._stopped_by, self._warned, name)

    async def _drive_steps(self, steps: tuple[ProfileStep, ...]) -> None:
        robot, total = self.robot, self.profile.duration
        begin = due = robot.now
        ends = begin
        for step in steps:
            ends += step.seconds
            while due < ends - 1e-6:
                robot.program.insist(step.v, step.omega)
                due = min(due + PUBLISH, ends)
                await asyncio.sleep(max(due - robot.now, 0.0))
                self.progressed((due - begin) / total)

    async def _drive_waypoints(self, waypoints: Waypoints) -> None:
        robot = self.robot
        source = {"true": true_pose, "fused": fused_pose, "odometry": wheel_pose, "map": map_pose}[waypoints.pose](
            robot
        )
        points = waypoints.points
        if waypoints.earth:
            points = await places_on_earth(robot, waypoints.earth, points)
        if waypoints.pose in ("fused", "map"):
            await located(robot, source)

        def read() -> Pose | None:
            self._believed = source.read()
            return self._believed

        self._source = PoseSource(source.name, read)
        total = waypoints.laps * len(points)

        def on_leg(number: int, start: Point, end: Point) -> None:
            self._legs.append(Leg(robot.now - self._begin, start, end))
            if total < inf:
                self.progressed(min(number / total, 1.0))

        how = waypoints.model_dump(include={"laps", "speed", "look_ahead"})
        await follow(robot, points, **how, pose_source=self._source, on_leg=on_leg)

    async def _watch(self) -> str:
        """Return why the experiment has to end early: the batteries, or a vehicle that does not move."""
        robot = self.robot
        while True:
            await asyncio.sleep(BATTERY_CHECK_PERIOD)
            battery, now = robot.battery, robot.now
            driven = now - self._begin
            if battery.state is BatteryState.WARNING and self._warned is None:
                self._warned = driven
            if self.profile.figure == "battery" and battery.remaining is not None:
                self.progressed(min(driven / (driven + battery.remaining + 1e-9), 1.0))
            # a board that has just got its power reads low at first
            if self.safe_end and battery.remaining == 0.0 and driven >= BAD_TIME:
                return SAFE_END
            if now - self._still_since >= STOPPED_TIME:
                return CUT_OFF if self._empty() else "a vehicle that does not move"

    def _empty(self) -> bool:
        """Return whether the batteries' voltage is so low that the cut-off circuit opens."""
        voltages = [volts for volts in self.robot.battery[:2] if volts]
        return bool(voltages) and max(voltages) < CUT_OFF_V + 0.1

    async def _measure(self, ticks: Ticks) -> None:
        robot, bounds = self.robot, SetpointBounds(self.robot.config.limits())
        before: tuple[float, Pose] | None = None
        wheels: Pose = robot.odometry[:3]
        way = turn = 0.0
        async for now in ticks:
            command = robot.runtime.state.command
            set_v, set_omega = (0.0, 0.0) if command is None else bounds.nearest(command.v, command.omega)
            *_, v, omega = odometry = robot.odometry
            rolled, turned = step_between(wheels, odometry[:3])
            way, turn, wheels = way + rolled, turn + turned, odometry[:3]
            x, y, theta = self._believed or wheels
            pose, battery = robot.pose, robot.battery
            true_v = true_omega = nan
            if pose is not None:
                # the true speed is a mean since the sample before
                if before is None:
                    before = now, pose
                    continue
                distance, angle = step_between(before[1], pose)
                true_v, true_omega = distance / (now - before[0]), angle / (now - before[0])
                before = now, pose
            volts = [volt for volt in battery[:2] if volt is not None]
            self._samples.append(
                Instant(
                    now - self._begin,
                    set_v,
                    set_omega,
                    v,
                    omega,
                    x,
                    y,
                    theta,
                    robot.runtime.state.odometry_time - self._begin,
                    way,
                    turn,
                    true_v,
                    true_omega,
                    *(pose or (nan, nan, nan)),
                    max(volts) if volts else nan,
                    nan if battery.remaining is None else battery.remaining,
                )
            )
            if abs(set_v) < STOPPED_V or abs(v) > STOPPED_V:
                self._still_since = inf
            elif self._still_since == inf:
                self._still_since = now
