"""A recording as a film: the robot's state at any time of it, for the screens."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import atan2
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.control.pid import Gains
from txt1.errors import RecordingError
from txt1.hal.base import Outputs
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.model.odometry import Odometry
from txt1.record.reading import Decoding, Reading
from txt1.tasks import frames
from txt1.tasks.controller import GAINS, PWM, SETPOINT
from txt1.tasks.display import SNAPSHOT
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import Control, Encoders, Event, Snapshot
from txt1.tasks.mode import MODE
from txt1.tasks.state import LOG

STEP_NS: Final = NS_PER_S // 10
"""Between two pictures: the display task's period."""

EVENTS: Final = 20
"""Lines of the event log that are shown, as in the robot."""

_SHOWN: Final = frozenset((ODOMETRY.name, SETPOINT.name, PWM.name, GAINS.name, ENCODERS.name, POSE.name))


class Picture(NamedTuple):
    """What changes from one picture to the next; `time` in s of the run."""

    time: float
    odometry: Odometry
    pose: tuple[float, float, float] | None
    control: Control
    encoders: Encoders
    mode: Any
    events: tuple[Event, ...]


class Film:
    """The pictures of a recording, ten a second, and the whole state once a second.

    Raises:
        RecordingError: the file cannot be read, or there are no pictures in it.

    """

    def __init__(self, path: Path) -> None:
        self._pictures: list[Picture] = []
        self._states: list[tuple[float, str]] = []
        reading, decoding = Reading(path), Decoding()
        events: deque[Event] = deque(maxlen=EVENTS)
        latest: dict[str, Any] = {}
        mode: Any = None
        epoch_ns, due_ns, shown_ns, wanted = 0, 0, 0, True
        for item in reading:
            time_ns = item.message.log_time
            if not latest:
                epoch_ns = nanoseconds(float(reading.metadata.get("txt1", {}).get("epoch", "0")))
            now = (time_ns - epoch_ns) / NS_PER_S
            if item.name == LOG.name:
                events.append(Event(now, decoding.message(item).msg))
            elif item.name == MODE.name:
                mode = decoding.message(item)
            elif item.name == SNAPSHOT.name:
                self._states.append((now, decoding.message(item).data))
            elif item.name == ODOMETRY.name:
                # the first of a cycle's topics: what is known now is all of the cycle before
                if ODOMETRY.name in latest and shown_ns >= due_ns:
                    self._pictures.append(_picture((shown_ns - epoch_ns) / NS_PER_S, latest, mode, tuple(events)))
                    due_ns = shown_ns + STEP_NS
                wanted = time_ns >= due_ns
                shown_ns = time_ns
            if wanted and item.name in _SHOWN:
                latest[item.name] = decoding.message(item)
        if ODOMETRY.name in latest:
            self._pictures.append(_picture((shown_ns - epoch_ns) / NS_PER_S, latest, mode, tuple(events)))
        if not self._states or not self._pictures:
            raise RecordingError(f"{path}: no pictures in it for the screens; was it recorded by txt1, for a second?")
        self._picture_times = [picture.time for picture in self._pictures]
        self._state_times = [time for time, _ in self._states]
        try:
            self.at(self.start)
        except ValueError as error:
            raise RecordingError(
                f"{path}: its state has other fields than this version's ({error}); the version that made it shows it"
            ) from None

    @property
    def start(self) -> float:
        """The time of the first picture, s of the run."""
        return self._picture_times[0]

    @property
    def end(self) -> float:
        """The time of the last."""
        return self._picture_times[-1]

    def at(self, time: float) -> Snapshot:
        """The robot's state at a time of the run, s."""
        picture = self._pictures[max(0, bisect_right(self._picture_times, time) - 1)]
        _, line = self._states[max(0, bisect_right(self._state_times, picture.time) - 1)]
        snapshot = frames.decode(line.encode())
        changes: dict[str, Any] = {
            "time": picture.time,
            "odometry": picture.odometry,
            "pose": picture.pose,
            "control": picture.control,
            "encoders": picture.encoders,
            "events": picture.events,
        }
        if picture.mode is not None:
            mode = picture.mode
            changes |= {"armed": mode.armed, "stopped": mode.stopped, "reason": mode.reason}
        return snapshot._replace(**changes)


def _picture(now: float, latest: dict[str, Any], mode: Any, events: tuple[Event, ...]) -> Picture:
    odometry, setpoint = latest[ODOMETRY.name], latest[SETPOINT.name]
    pwm, gains = latest.get(PWM.name), latest.get(GAINS.name)
    encoders, pose = latest.get(ENCODERS.name), latest.get(POSE.name)
    position, twist = odometry.pose.pose.position, odometry.twist.twist
    v, omega = setpoint.twist.linear.x, setpoint.twist.angular.z
    return Picture(
        now,
        Odometry(position.x, position.y, _heading(odometry.pose.pose), twist.linear.x, twist.angular.z),
        None if pose is None else (pose.pose.position.x, pose.pose.position.y, _heading(pose.pose)),
        Control(
            Outputs(v=v, omega=omega)
            if pwm is None
            else Outputs(pwm.motor, pwm.front, pwm.rear, pwm.pwm4, pwm.pwm5, v, omega),
            v, omega,
            gains=Gains() if gains is None else Gains(gains.angular_kp, gains.angular_ki, gains.angular_kd),
        ),
        Encoders() if encoders is None or not encoders.valid else Encoders(encoders.right, encoders.left),
        mode,
        events,
    )  # fmt: skip


def _heading(pose: Any) -> float:
    """The heading of a pose that lies in the plane, rad."""
    return 2.0 * atan2(pose.orientation.z, pose.orientation.w)
