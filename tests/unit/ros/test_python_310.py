"""The node runs under Python 3.10, as ROS 2 Humble has it: the real interpreter, with a stand-in for rclpy."""

from __future__ import annotations

import asyncio
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from txt1.ros.node import START
from txt1.ros.python import ros2
from txt1.sidecar import Request, Sidecar

ROOT = Path(__file__).parents[3]
FOUND = [
    *map(str, sorted((Path.home() / ".pyenv/versions").glob("3.10.*/bin/python3.10"))),
    *filter(None, [shutil.which("python3.10")]),
]

# Stands in for rclpy 3.3 of Humble: its subscriptions have no CallbackType, so callbacks get the message alone. A spin
# hands a message to the subscription of `drive`, then of `cmd_vel`.
RCLPY = '''
import sys, time, types


class Anything:
    """A message, a request, a profile: it has whatever is asked for."""

    def __init__(self, *given, **named):
        self.__dict__.update(named)

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        value = 0 if name in NUMBERS else Anything()
        self.__dict__[name] = value
        return value

    def __call__(self, *given, **named):
        return Anything()


NUMBERS = ("sec", "nanosec", "x", "y", "z", "w", "speed", "steering_angle")


class Types(types.ModuleType):
    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        made = type(name, (Anything,), {"BEST_EFFORT": 1, "TRANSIENT_LOCAL": 1, "NO": 0, "OK": b"0", "WARN": b"1"})
        setattr(self, name, made)
        return made


for package in ("geometry_msgs", "nav_msgs", "std_msgs", "std_srvs", "diagnostic_msgs", "ackermann_msgs",
                "rcl_interfaces", "tf2_msgs", "rosgraph_msgs"):
    for module in (package, package + ".msg", package + ".srv"):
        sys.modules[module] = Types(module)
for module in ("parameter", "qos", "serialization", "callback_groups", "subscription"):
    sys.modules["rclpy." + module] = Types("rclpy." + module)


class Subscription:
    pass


sys.modules["rclpy.subscription"].Subscription = Subscription
callbacks = {}


class Node:
    def __init__(self, *given, **named):
        pass

    def create_subscription(self, kind, topic, callback, quality, **more):
        callbacks[topic] = callback

    def get_publishers_info_by_topic(self, topic):
        return []

    def get_name(self):
        return "txt1"

    def __getattr__(self, name):
        return Anything()


class Executor:
    def __init__(self, **more):
        self.turn = 0

    def add_node(self, node):
        pass

    def spin(self):
        time.sleep(60.0)

    def spin_once(self):
        time.sleep(0.05)
        self.turn += 1
        if self.turn % 2:
            message = Anything()
            message.drive.speed, message.drive.steering_angle = 1.0, 0.25
            callbacks["drive"](message)
        else:
            message = Anything()
            message.linear.x = 0.5
            callbacks["cmd_vel"](message)

    def can_execute(self, entity):
        return True

    def wake(self):
        pass

    def shutdown(self, **more):
        pass


nodes, executors = types.ModuleType("rclpy.node"), types.ModuleType("rclpy.executors")
nodes.Node = Node
executors.SingleThreadedExecutor = executors.MultiThreadedExecutor = Executor
executors.ExternalShutdownException = type("ExternalShutdownException", (Exception,), {})
sys.modules["rclpy.node"], sys.modules["rclpy.executors"] = nodes, executors
SignalHandlerOptions = Types("options").SignalHandlerOptions


def init(**more):
    pass


def try_shutdown():
    pass
'''


@pytest.mark.skipif(not FOUND, reason="there is no Python 3.10 here")
def test_the_node_passes_commands_on_under_python_3_10(tmp_path: Path) -> None:
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "__init__.py").write_text(RCLPY)
    told: list[Request] = []

    async def main() -> None:
        both = asyncio.Event()

        def take(request: Request) -> None:
            told.append(request)
            if {"steer", "drive"} <= {each.name for each in told}:
                both.set()

        beside = Sidecar(
            "txt1.ros.ros2:main",
            lambda: b'{"now": 1}\n',
            take,
            options={"offers": ["drive"], "ackermann": True, "parameters": {}},
            program=(FOUND[0], str(START), str(ROOT)),
            environment={"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"], "PYTHONDONTWRITEBYTECODE": "1"},
        )
        async with beside:
            waits = [asyncio.ensure_future(both.wait()), asyncio.ensure_future(beside.ended())]
            done, left = await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
            for each in left:
                each.cancel()
            assert waits[0] in done, "it has ended"

    asyncio.run(main())
    fields: dict[str, Any] = {each.name: each.fields for each in told}
    assert fields["steer"]["speed"] == 1.0 and fields["steer"]["angle"] == 0.25
    assert (fields["drive"]["v"], fields["drive"]["omega"]) == (0.5, 0.0)


def test_humble_is_taken_and_its_python_has_no_option_p(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/humble")
    for name, program in (("humble", ("python3",)), ("jazzy", ("python3", "-P"))):
        monkeypatch.setenv("ROS_DISTRO", name)
        assert ros2().program == program
