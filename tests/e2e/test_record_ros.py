"""A recording and a node of ROS 2 side by side: their messages are the same, and neither disturbs the other."""

from __future__ import annotations

import asyncio
import json
from base64 import b64decode
from contextlib import AsyncExitStack
from itertools import pairwise
from pathlib import Path

from txt1.config.sources import load
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.record.reader import FilePass
from txt1.record.session import recording
from txt1.robot import Robot
from txt1.ros.publisher import Publisher
from txt1.telemetry.topics import Rule, Topic

SENSORS = [f"sensors.{name}.driver=sim_{name}" for name in ("imu", "laser", "camera", "depth", "gps")]
NAMES = {
    "odom": "/odom", "tf": "/tf", "battery_state": "/battery1", "/rosout": "/rosout", "scan": "/sensors/laser",
    "imu/data": "/sensors/imu", "camera/image_raw/compressed": "/sensors/camera",
    "camera/depth/image_raw": "/sensors/depth",
}  # fmt: skip
"""Where ROS 2 has a recorded topic under a name of its own."""
SHARED = ("tf", "/diagnostics")
"""Where several topics meet in ROS 2."""
BEHIND_TELEMETRY = -110
PERIOD = 20_000_000  # of the controller, ns

Messages = dict[str, list[tuple[int, bytes]]]
"""By topic the times (ns) and bytes of its messages."""


class Node:
    """A node of ROS 2, as far as the robot is concerned; one that never `starts` has only its task there."""

    def __init__(self, robot: Robot, starts: bool = True) -> None:
        self.feed = Publisher(robot.runtime, print)
        self._starts = starts
        self.messages: Messages = {}
        self._names: dict[int, str] = {}
        robot.runtime.add_task("node", BEHIND_TELEMETRY, 0.02, self._hear)

    async def _hear(self, ticks: Ticks) -> None:
        if self._starts:
            self.feed.begin()
        async for now in ticks:
            if self._starts and not 1.0 < now < 1.7:  # busy with something else then
                self.hear()

    def hear(self) -> None:
        """Take what there is."""
        told = json.loads(self.feed.line({}) or b"{}")
        self._names.update({number: name for number, name, _, _ in told.get("new", ())})
        for number, time, data in told.get("messages", ()):
            self.messages.setdefault(self._names[number], []).append((time, b64decode(data)))


def recorded(file: Path) -> Messages:
    """The same of a recording."""
    messages: Messages = {}
    for item in FilePass(file):
        messages.setdefault(item.name, []).append((item.message.log_time, item.message.data))
    return messages


def test_a_message_has_the_same_bytes_in_the_recording_and_in_ros(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"

    def place(name: str, rule: Rule) -> Topic[float]:
        return Topic(
            name, float, "m", "geometry_msgs/PoseStamped", rule, "", {}, ("pose.position.x",), lambda value: (value,)
        )

    cycle, event = place("/cycle", Rule.CYCLE), place("/event", Rule.EVENT)

    async def drive() -> Node:
        config = load(overrides=SENSORS).config
        async with (
            recording(file, config, "max", {}, print) as attach,
            Robot.open(config=config, attach=attach) as robot,
        ):
            robot.runtime.bus.offer(cycle, lambda: robot.now)
            node = Node(robot)
            for _ in range(60):
                robot.command(0.4, 0.4)
                robot.runtime.bus.publish(event, robot.now, robot.now)
                await asyncio.sleep(0.05)
            robot.tell("done")
            node.hear()
            return node

    told, kept = run(drive(), speed="max").messages, recorded(file)
    for name, messages in told.items():
        stored = kept.get(NAMES.get(name, name.removeprefix("~")))
        if stored is not None:
            own = [each for each in messages if name not in SHARED or each in stored]
            first = stored.index(own[0])
            assert own == stored[first : first + len(own)], f"{name}: each once, in order, and the same"
    assert set(NAMES) | {"~/setpoint", "~/mode", "~/cycle", "~/event"} <= told.keys(), "all of these were compared"
    assert len(told["odom"]) > 140 and len(told["~/event"]) >= 59


def test_a_recording_begun_on_the_way_costs_ros_no_message_and_repeats_none(tmp_path: Path) -> None:
    async def drive() -> Node:
        config = load().config
        async with Robot.open(config=config) as robot, AsyncExitStack() as stack:
            node = Node(robot)
            await asyncio.sleep(0.5)
            attach = await stack.enter_async_context(recording(tmp_path / "run.mcap", config, "max", {}, print))
            attach(robot.runtime)
            await asyncio.sleep(2.0)
            await stack.aclose()
            await asyncio.sleep(0.5)
            return node

    odometry = [time for time, _ in run(drive(), speed="max").messages["odom"]]
    assert len(odometry) > 145 and {after - before for before, after in pairwise(odometry)} == {PERIOD}


def test_a_recording_is_the_same_with_ros_beside_it(tmp_path: Path) -> None:
    async def drive(file: Path, beside: bool) -> None:
        config = load(overrides=SENSORS).config
        async with (
            recording(file, config, "max", {}, print) as attach,
            Robot.open(config=config, attach=attach) as robot,
        ):
            Node(robot, starts=beside)
            for _ in range(40):
                robot.command(0.4, 0.4)
                await asyncio.sleep(0.05)

    files = [tmp_path / "alone.mcap", tmp_path / "beside.mcap"]
    for file in files:
        run(drive(file, file is files[1]), speed="max")
    alone, beside = map(recorded, files)
    assert alone.keys() == beside.keys()
    for name in alone.keys() - {"/diagnostics", "/snapshot"}:  # which tell how long the tasks took
        assert set(alone[name]) <= set(beside[name]), f"{name}: what is kept is told once more, to whoever comes late"
