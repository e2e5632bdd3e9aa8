"""The snapshots of a recording: the robot's state at any time of it."""

from bisect import bisect_right
from collections import deque
from math import atan2
from pathlib import Path
from typing import Any, Final

from txt1.control.pid import Gains
from txt1.errors import RecordingError
from txt1.hal.base import Outputs
from txt1.kernel.clock import NS_PER_S
from txt1.model.odometry import Odometry
from txt1.record.reader import Decoding, FilePass, check_own, robot_in
from txt1.tasks.controller import GAINS, PWM, SETPOINT
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import EVENTS, LOG, VEHICLES, Control, Encoders, Event
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import SNAPSHOT, Snapshot
from txt1.telemetry.topics import Topic

# between two snapshots
STEP_NS: Final = NS_PER_S // 10

# lines of the event log that are shown, as in the robot
EVENTS_MAX: Final = 20

_FAST: Final = frozenset(topic.name for topic in (ODOMETRY, SETPOINT, PWM, ENCODERS, POSE))
_SELDOM: Final = frozenset(topic.name for topic in (MODE, GAINS))

Values = dict[Topic[Any], Any]


class Snapshots:
    """The snapshots in a recording, one a second; fast topics are updated ten times a second.

    With several robots they are those of `robot`, for None of the first, with the others' poses. `start` and `end` are
    the times of the first and the last snapshot, s of the run. RecordingError: the file cannot be read, or it has no
    snapshots.
    """

    def __init__(self, path: Path, robot: str | None = None) -> None:
        robot = robot_in(path, robot)
        self._others: dict[str, list[tuple[float, tuple[float, float, float]]]] = {}
        self._steps: list[tuple[float, Values]] = []
        self._recorded: list[tuple[float, str]] = []
        reading, decoding = FilePass(path), Decoding()
        events: deque[Event] = deque(maxlen=EVENTS_MAX)
        latest: dict[str, Any] = {}
        due_ns, shown_ns, shown, wanted = 0, 0, 0.0, True
        for item in reading:
            time_ns, now = item.message.log_time, reading.run_time(item)
            if item.robot != robot:
                if item.name == POSE.name:
                    passed = self._others.setdefault(item.robot, [])
                    if not passed or time_ns >= round(passed[-1][0] * NS_PER_S) + STEP_NS:
                        passed.append((now, _place(decoding.message(item).pose)))
                continue
            if item.name == LOG.name:
                events.append(Event(now, decoding.message(item).msg))
            elif item.name == SNAPSHOT.name:
                self._recorded.append((now, decoding.message(item).data))
            elif item.name == ODOMETRY.name:
                # the first of a cycle's topics: what is known now is all of the cycle before
                if item.name in latest and shown_ns >= due_ns:
                    self._steps.append((shown, _values(latest, tuple(events))))
                    due_ns = shown_ns + STEP_NS
                wanted = time_ns >= due_ns
                shown_ns, shown = time_ns, now
            if item.name in _SELDOM or (wanted and item.name in _FAST):
                latest[item.name] = decoding.message(item)
        if ODOMETRY.name in latest:
            self._steps.append((shown, _values(latest, tuple(events))))
        if not self._recorded or not self._steps:
            check_own(path)
            raise RecordingError(f"{path}: no snapshots in it for the screens; was it recorded by txt1, for a second?")
        self.start, self.end = self._steps[0][0], self._steps[-1][0]

    def at(self, time: float) -> Snapshot:
        """The robot's state at a time of the run, s; RecordingError where the snapshot there is none."""
        now, values = self._steps[max(0, bisect_right(self._steps, time, key=lambda step: step[0]) - 1)]
        _, line = self._recorded[max(0, bisect_right(self._recorded, now, key=lambda each: each[0]) - 1)]
        try:
            snapshot = Snapshot.decode(line)
        except ValueError as error:
            raise RecordingError(f"at {now:.1f} s: {error}; the version that made the recording shows it") from None
        # the panel, link and power are in the snapshot
        if MODE in values:
            armed, stopped, reason = values[MODE]
            values = values | {MODE: snapshot.get(MODE, Mode())._replace(armed=armed, stopped=stopped, reason=reason)}
        if self._others:
            before = {
                name: bisect_right(passed, now, key=lambda each: each[0]) for name, passed in self._others.items()
            }
            values = values | {VEHICLES: tuple(self._others[name][max(0, at - 1)][1] for name, at in before.items())}
        return snapshot.replaced(values, now)


def _values(latest: dict[str, Any], events: tuple[Event, ...]) -> Values:
    """The topics whose messages are known, as the robot's values."""
    odometry, setpoint, encoders = latest[ODOMETRY.name], latest.get(SETPOINT.name), latest.get(ENCODERS.name)
    pose, mode = latest.get(POSE.name), latest.get(MODE.name)
    twist = odometry.twist.twist
    values: Values = {
        ODOMETRY: Odometry(*_place(odometry.pose.pose), twist.linear.x, twist.angular.z),
        EVENTS: events,
    }
    if setpoint is not None:
        v, omega = setpoint.twist.linear.x, setpoint.twist.angular.z
        pwm, gains = latest.get(PWM.name), latest.get(GAINS.name)
        channels = (0,) * 5 if pwm is None else (pwm.motor, pwm.front, pwm.rear, pwm.pwm4, pwm.pwm5)
        in_force = () if gains is None else (gains.angular_kp, gains.angular_ki, gains.angular_kd)
        values[SETPOINT] = Control(Outputs._make((*channels, v, omega)), v, omega, gains=Gains(*in_force))
    if pose is not None:
        values[POSE] = _place(pose.pose)
    if encoders is not None and encoders.valid:
        values[ENCODERS] = Encoders(encoders.right, encoders.left)
    if mode is not None:
        values[MODE] = mode.armed, mode.stopped, mode.reason
    return values


def _place(pose: Any) -> tuple[float, float, float]:
    """(x, y, theta) of a pose in the plane, m and rad."""
    return pose.position.x, pose.position.y, 2.0 * atan2(pose.orientation.z, pose.orientation.w)
