"""The robot of a fleet that the terminal shows and drives; SPACE stops all robots."""

from math import inf

from txt1.errors import CommandRefused
from txt1.fleet.fleet import Fleet
from txt1.fleet.members import FLEET, member_of
from txt1.hal.base import Button
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.teleop import Teleop
from txt1.ui.viewer import DRIVING

KEYS = {"SPACE": "stop all", "n": "next robot", **{key: word for key, word in DRIVING.items() if key not in ("SPACE",)}}


class Selection:
    """To the terminal it looks like a robot; it is also the source of the driving keys' commands."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._robots = list(fleet.robots.values())
        self._keys = [robot.source("keys") for robot in self._robots]
        self._at = 0
        config = self._robots[0].config
        self.teleop = Teleop(config.teleop.speed, config.hand())
        """The driving keys, with the hand rule of the selected car."""

    def next(self) -> None:
        """Let go of this robot and select the next."""
        self.release()
        self._at = (self._at + 1) % len(self._robots)
        self.teleop.hand = self._robots[self._at].config.hand()

    @property
    def snapshot(self) -> Snapshot:
        """The snapshot of the selected robot, with a line for each robot of the fleet."""
        parts = {name: (each.silent, each.stuck) for name, each in self._fleet.cooperations.items()}
        members = tuple(member_of(robot, *parts.get(robot.config.name, ())) for robot in self._robots)
        return self._robots[self._at].snapshot.replaced({FLEET: members})

    @property
    def now(self) -> float:
        """Seconds since the run of the selected robot started."""
        return self._robots[self._at].now

    def stop(self) -> None:
        """Stop all robots."""
        self._fleet.stop_all()

    def arm(self) -> None:
        """Arm all robots."""
        self._fleet.arm_all()

    def disarm(self, reason: str) -> None:
        """Disarm all robots."""
        self._fleet.disarm(reason)

    def press(self, button: Button) -> None:
        """Press a button of the joystick of every robot, so that all show the same screen."""
        for robot in self._robots:
            robot.press(button)

    def toggle_esc(self) -> None:
        """Switch the ESC of the selected robot off or on; raises CommandRefused, NotCapable."""
        self._robots[self._at].toggle_esc()

    def tell(self, text: str) -> None:
        """Add a line to the event log of the selected robot."""
        self._robots[self._at].tell(text)

    def hold(self, v: float, omega: float, time: float = -inf) -> None:
        """Drive the selected robot, m/s and rad/s; raises CommandRefused."""
        robot, keys = self._robots[self._at], self._keys[self._at]
        if not robot.armed:
            raise CommandRefused(f"{robot.config.name} is not armed ({robot.reason}); m arms")
        keys.hold(v, omega, None if time == -inf else time)

    def release(self) -> None:
        """Let go of the selected robot."""
        self._keys[self._at].release()
