"""The bridge to a fleet on a network: a process of its own, which speaks Zenoh beside the robot.

What the robot tells goes out twenty times a second; what was heard comes in as often. What it has learned is told once
a second; what others have learned is checked here and passed on as seldom. A stop of all that others say stops the
robot, and a console may take its wheel, as the source "fleet".
"""

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from math import inf
from pathlib import Path
from typing import Any, Final

from txt1.beside import Connection
from txt1.errors import ConfigError
from txt1.fleet.learned import learned_of
from txt1.fleet.network import Hooks, Peer

RATE: Final = 20.0  # Hz
TOPICS: Final = ["/said", "/member", "/fleet_order"]
SELDOM: Final = ["/learned"]  # once a second
PASSED: Final = 0.8  # s from one table of another robot to the next that is passed on
AT_ONCE: Final = 5  # of them
WAIT: Final = 0.01  # s that an order of the others may wait for the next look


def main(robot: Connection, name: str, interface: str = "", key: str | None = None, loss: float = 0.0) -> None:
    """Be the robot's voice in the fleet until its run ends."""
    orders: deque[tuple[str, dict[str, Any]]] = deque(maxlen=1000)  # of Zenoh's threads, which must not wait
    hooks = Hooks(
        stop=lambda who: orders.append(("stop", {"who": who})),
        drive=lambda who, v, omega: orders.append(("drive", {"v": v, "omega": omega})),
    )
    robot.request("subscribe", topics=TOPICS, rate=RATE, seldom=SELDOM)
    try:
        with ThreadPoolExecutor(1) as beside:  # to look whether a name is taken lasts longer than a heartbeat
            joining = beside.submit(Peer, name, interface, None if key is None else Path(key), hooks, loss)
            while not joining.done():
                robot.receive(WAIT)
        peer = joining.result()
    except ConfigError as error:
        robot.request("refused", reason=str(error))
        return
    passed: dict[str, float] = {}  # when the last table of each was heard that was passed on
    try:
        while True:
            telemetry = robot.receive(WAIT)
            while orders:
                _obey(robot, *orders.popleft())
            if telemetry is None:
                continue
            peer.tell(_state(telemetry["topics"]))
            if learned := telemetry["topics"].get("/learned"):
                peer.teach(learned)
            if any(event["topic"] == "/fleet_order" for event in telemetry.get("events", ())):
                peer.stop_all()
            now = peer.now
            heard = {who: [*said[:5], now - said.time, said.data] for who, said in peer.heard().items()}
            robot.request("fleet", members=[list(member) for member in peer.members()], heard=heard)
            _pass_on(robot, peer, passed)
    finally:
        peer.close()


def _pass_on(robot: Connection, peer: Peer, passed: dict[str, float]) -> None:
    """Tell the robot what others have learned, or why that is refused."""
    new = [(who, *told) for who, told in peer.taught().items() if told[1] >= passed.get(who, -inf) + PASSED]
    for who, told, heard in new[:AT_ONCE]:
        passed[who] = heard
        try:
            robot.request("learned", who=who, learned=learned_of(told)._asdict(), age=peer.now - heard)
        except ValueError as error:
            robot.request("learned", who=who, learned=None, why=str(error))


def _obey(robot: Connection, order: str, fields: dict[str, Any]) -> None:
    if order == "stop":
        robot.request("stop")
        robot.request("tell", text=f"stopped by {fields['who']}")
    else:
        robot.request(order, **fields)


def _state(topics: dict[str, Any]) -> dict[str, Any]:
    """The part of the robot's telemetry that the others are told."""
    said, member = topics.get("/said") or {}, topics.get("/member") or {}
    told = ("armed", "reason", "driver", "battery", "silent")
    return {**{key: value for key, value in said.items() if key != "time"}, **{key: member.get(key) for key in told}}
