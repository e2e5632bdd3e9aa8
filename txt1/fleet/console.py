"""A console of a fleet on a network: it shows all robots, stops all, and drives one. It is no robot itself."""

from collections.abc import Mapping
from math import inf
from typing import Final

from txt1.fleet.members import FLEET, FLEET_STOP, Member
from txt1.fleet.network import Peer
from txt1.hal.base import Button
from txt1.model.odometry import Odometry
from txt1.tasks.encoder import ODOMETRY, POSE
from txt1.tasks.fields import VEHICLES, Panel
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.screens import installed
from txt1.ui.teleop import Teleop

KEYS: Final[Mapping[str, str]] = {
    "SPACE": "stop all", "q": "quit", "?": "help", "n": "next robot", "wasd": "drive it", "+-": "speed", "←→": "screen",
}  # fmt: skip


class Console:
    """To the terminal it looks like a robot; it is also the source of the driving keys' commands."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._began = peer.now
        self._at = ""
        self._screen = list(installed()).index("FLEET")
        self._driving = False
        self.teleop = Teleop()
        """The driving keys, with the hand rule of the selected car."""

    @property
    def robot(self) -> Member | None:
        """The selected robot; None while there is none."""
        members = self._peer.members()
        return next((one for one in members if one.name == self._at), members[0] if members else None)

    def next(self) -> None:
        """Let go of this robot and select the next."""
        self.release()
        names = [one.name for one in self._peer.members()]
        self._at = names[(names.index(self._at) + 1) % len(names)] if self._at in names else "".join(names[:1])
        self._take_hand(self.robot)

    def _take_hand(self, robot: Member | None) -> None:
        """Take the hand rule that the selected robot tells."""
        if robot is not None and robot.hand is not None:
            self.teleop.hand = robot.hand

    @property
    def snapshot(self) -> Snapshot:
        """The fleet, and the selected robot on the map."""
        robot, members = self.robot, self._peer.members()
        self._take_hand(robot)
        name = "fleet" if robot is None else f"fleet, at {robot.name}"
        standing, _ = self._peer.standing() or ("", 0.0)
        values: dict[str, object] = {
            FLEET.name: members,
            FLEET_STOP.name: str(standing) or None,
            MODE.name: Mode(panel=Panel(screen=self._screen)),
        }
        if robot is not None and robot.pose is not None:
            values[POSE.name] = robot.pose
            values[ODOMETRY.name] = Odometry(*robot.pose, robot.v, robot.omega)
            values[VEHICLES.name] = tuple(one.pose for one in members if one.pose and one is not robot)
        return Snapshot(self.now, name, values)

    @property
    def now(self) -> float:
        """Seconds since the console was started."""
        return self._peer.now - self._began

    def stop(self) -> None:
        """Stop all robots of the fleet."""
        self._peer.stop_all()

    def arm(self) -> None:
        """Do nothing: a robot cannot be armed from afar."""

    def disarm(self, reason: str) -> None:
        """Let go of the wheel; the driven robot stops by itself."""
        self.release()

    def press(self, button: Button) -> None:
        """The joystick changes the screen."""
        step = {Button.LEFT: -1, Button.RIGHT: 1}.get(button, 0)
        self._screen = (self._screen + step) % len(installed())

    def tell(self, text: str) -> None:
        """Do nothing: a console has no log."""

    def hold(self, v: float, omega: float, time: float = -inf) -> None:
        """Drive the selected robot, m/s and rad/s; the key was pressed at `time`, s since this console was started."""
        if (robot := self.robot) is not None:
            self._peer.drive(robot.name, v, omega, 0.0 if time == -inf else max(0.0, self.now - time))
            self._driving = True

    def release(self) -> None:
        """Let go of the selected robot."""
        if self._driving and (robot := self.robot) is not None:
            self._peer.drive(robot.name, 0.0, 0.0)
        self._driving = False
