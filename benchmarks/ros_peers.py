"""Programs of ROS 2 for `benchmarks.ros` and `benchmarks.punctuality`, run by the Python that has ROS.

Each prints what it saw as a line of JSON.
"""

import json
import random
import struct
import sys
import time
from importlib import import_module

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

CYCLE = 0.02  # s


def kind(name):
    """The type of a message."""
    package, *_, name = name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def spin(node, ends):
    """Serve a node until it ends."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not ends():
            executor.spin_once(timeout_sec=0.2)
    except (ExternalShutdownException, KeyboardInterrupt):
        pass


def relay(seconds):
    """Hand on every message at once, and those of another topic in the next of 50 cycles a second."""
    node = Node("relay")
    told = kind("nav_msgs/Odometry")
    at_once, in_cycle = (node.create_publisher(told, name, 10) for name in ("relayed", "relayed_in_cycle"))
    waiting = []
    node.create_subscription(told, "relay", at_once.publish, 10)
    node.create_subscription(told, "relay", waiting.append, 10)

    def cycle():
        while waiting:
            in_cycle.publish(waiting.pop(0))

    node.create_timer(CYCLE, cycle)
    spin(node, lambda: False)


def drive(seconds):
    """Send commands and messages to the relay in turn, ten of each a second; when each was sent and what came back."""
    node = Node("drive")
    sent, back, odometry, heard = {}, {"relayed": [], "relayed_in_cycle": []}, [], {}

    def come_back(name):
        return lambda told: back[name].append(time.time() - told.pose.pose.position.x)

    for name in back:
        node.create_subscription(kind("nav_msgs/Odometry"), name, come_back(name), 10)

    def take(told):
        stamp = told.header.stamp
        odometry.append(time.time() - stamp.sec - 1e-9 * stamp.nanosec)

    def setpoint(told):
        stamp = told.header.stamp
        heard.setdefault(round(told.twist.linear.x, 6), (stamp.sec + 1e-9 * stamp.nanosec, time.time()))

    node.create_subscription(kind("nav_msgs/Odometry"), "odom", take, 10)
    node.create_subscription(kind("geometry_msgs/TwistStamped"), "/txt1/setpoint", setpoint, 10)
    relaying = node.create_publisher(kind("nav_msgs/Odometry"), "relay", 10)
    commands = node.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ends = time.monotonic() + 60.0
    while not (odometry and commands.get_subscription_count() and relaying.get_subscription_count()):
        executor.spin_once(timeout_sec=0.1)
        if time.monotonic() > ends:
            raise TimeoutError
    command, message = kind("geometry_msgs/Twist")(), kind("nav_msgs/Odometry")()
    command.angular.z = 0.5
    ends, due, turn = time.monotonic() + seconds + 2.0, time.monotonic(), 0
    begins = time.monotonic() + 2.0  # until then they get to know each other
    while (now := time.monotonic()) < ends:
        if now >= due:
            due += 0.0473 + 0.005 * random.random()  # out of step with 50 Hz
            turn += 1
            if turn % 2:
                command.linear.x = round(random.uniform(0.3, 0.6), 6)
                if now > begins:
                    sent[command.linear.x] = time.time()
                commands.publish(command)
            else:
                message.pose.pose.position.x = time.time()
                relaying.publish(message)
        if now < begins:
            odometry.clear(), back["relayed"].clear(), back["relayed_in_cycle"].clear()
        executor.spin_once(timeout_sec=max(0.0, due - time.monotonic()))
    return {"sent": list(sent.items()), "heard": [(v, *heard[v]) for v in heard], "odometry": odometry, **back}


def listen(seconds):
    """Listen to every topic there is: when each message came, and its stamp."""
    node = Node("listen")
    came, types = {}, {}

    def look():
        for name, (message, *_) in node.get_topic_names_and_types():
            publishers = [each for each in node.get_publishers_info_by_topic(name) if each.node_name.startswith("txt1")]
            if name in types or not publishers or name in ("/parameter_events", "/rosout"):
                continue
            quality = publishers[0].qos_profile
            mine = QoSProfile(depth=100, reliability=quality.reliability, durability=quality.durability)
            try:
                found = kind(message)
            except (ImportError, AttributeError):
                continue
            types[name] = message
            fields = list(found.get_fields_and_field_types().values())
            offset = 4 if fields[0].endswith("Header") else 8 if message.endswith("TFMessage") else None
            came[name] = []

            def take(data, into=came[name], offset=offset):
                stamp = 0.0
                if offset is not None and len(data) >= offset + 8:
                    sec, nanosec = struct.unpack_from("<iI", data, offset)
                    stamp = sec + 1e-9 * nanosec
                into.append((time.time(), stamp))

            node.create_subscription(found, name, take, mine, raw=True)

    node.create_timer(0.5, look)
    ends = time.monotonic() + 4.0
    spin(node, lambda: time.monotonic() > ends)
    for each in came.values():
        each.clear()
    ends = time.monotonic() + seconds
    spin(node, lambda: time.monotonic() > ends)
    return {"types": types, "came": came}


def timer(seconds):
    """Have a timer 50 times a second: how late each call was, s, and how many calls were missed."""
    node = Node("timer")
    period, called = round(CYCLE * 1e9), []
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    timed = node.create_timer(CYCLE, lambda: called.append(time.monotonic_ns()), clock=clock)
    first = time.monotonic_ns() + timed.time_until_next_call()  # rcl keeps to this grid
    ends = time.monotonic() + seconds
    spin(node, lambda: time.monotonic() > ends)
    slots = [divmod(at - first, period) for at in called]
    last = slots[-1][0] if slots else 0
    return {"late": [late * 1e-9 for _, late in slots], "missed": last + 1 - len({slot for slot, _ in slots})}


if __name__ == "__main__":
    rclpy.init()
    print(json.dumps(globals()[sys.argv[1]](float(sys.argv[2]))))
