"""Sums up a robot, or a robot's recording, in a line."""

from typing import Final

from txt1.control.standstill import UNOBEYED, Stop
from txt1.model.odometry import Odometry
from txt1.tasks.battery import BATTERIES
from txt1.tasks.encoder import ODOMETRY
from txt1.tasks.fields import BOARD, WARNINGS, Battery
from txt1.tasks.mode import MODE, Mode
from txt1.tasks.on_map import MAP_POSE
from txt1.tasks.standstill import STOP
from txt1.telemetry.snapshot import Snapshot

SHOWN: Final = tuple(topic.name for topic in (ODOMETRY, MODE, STOP, BOARD, BATTERIES[0], MAP_POSE, WARNINGS))
"""The topics in the line."""


def status_line(snapshot: Snapshot) -> str:
    """Return time, pose, velocities, battery, whether the robot is armed, and its place on the map."""
    x, y, theta, v, omega = snapshot.get(ODOMETRY, Odometry())
    mode, board = snapshot.get(MODE, Mode()), snapshot.get(BOARD)
    voltage = snapshot.get(BATTERIES[0], Battery()).battery1
    state = "armed" if mode.armed else f"disarmed: {mode.reason}"
    stop = snapshot.get(STOP)
    if stop in (*UNOBEYED, Stop.UNASKED):
        state += f"; {stop.value}"
    if board is not None and not board.ready:
        state += f"; {board.text}"
    there = snapshot.get(MAP_POSE)
    if there is not None:
        state += "; lost on the map" if there.lost else f"; map {there.x:+.2f} {there.y:+.2f} m {there.theta:+.2f} rad"
        state += "" if there.lost else f" within {there.sigma:.2f} m"
    state = "; ".join((state, *snapshot.get(WARNINGS, ())))
    battery = "-" if voltage is None else f"{voltage:.2f} V"
    return (
        f"t={snapshot.time:8.2f} s  x={x:+.3f} m  y={y:+.3f} m  theta={theta:+.3f} rad  "
        f"v={v:+.3f} m/s  omega={omega:+.3f} rad/s  battery={battery}  {state}"
    )
