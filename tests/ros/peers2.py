"""Programs of ROS 2 beside the robot, run by the Python that has ROS: each prints what it saw as one line of JSON."""

import json
import os
import sys
import time
from collections import Counter
from importlib import import_module

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def kind(name):
    package, _, name = name.partition("/")
    return getattr(import_module(f"{package}.msg"), name)


LIMIT = 120.0 * float(os.environ.get("TXT_PATIENCE", "1"))  # as in tests/patience.py, which this Python has not


class Peer(Node):
    def __init__(self, name="peer"):
        super().__init__(name)
        self.seen, self.last = Counter(), {}

    def hear(self, topic, message, quality=10):
        def take(heard):
            self.seen[topic] += 1
            self.last[topic] = heard

        self.create_subscription(kind(message), topic, take, quality)

    def run(self, seconds, every=0.1, do=lambda: None):
        ends, due = time.monotonic() + seconds, time.monotonic()
        while time.monotonic() < ends:
            if time.monotonic() >= due:
                due += every
                do()
            rclpy.spin_once(self, timeout_sec=0.01)

    def until(self, true, limit=LIMIT):
        ends = time.monotonic() + limit
        while not true():
            if time.monotonic() > ends:
                raise TimeoutError(str(true))
            rclpy.spin_once(self, timeout_sec=0.02)

    def linked(self):
        """Wait until the robot may be armed, a second after its start."""
        self.hear("/txt1/mode", "txt1_msgs/Mode", LATCHED)
        self.until(lambda: (mode := self.last.get("/txt1/mode")) is not None and mode.link_alive)

    def call(self, service, name, **fields):
        package, _, kind_name = service.partition("/")
        found = getattr(import_module(f"{package}.srv"), kind_name)
        client = self.create_client(found, name)
        assert client.wait_for_service(LIMIT), name
        future = client.call_async(found.Request(**fields))
        self.until(future.done)
        return future.result()


def twist(v, omega):
    from geometry_msgs.msg import Twist

    made = Twist()
    made.linear.x, made.angular.z = v, omega
    return made


def theta(q):
    from math import atan2

    return atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))


def circle():
    """Drive a left circle, and look at every frame."""
    peer = Peer()
    transforms, static = {}, {}

    def take(into):
        def taken(message):
            for each in message.transforms:
                into[each.child_frame_id] = each

        return taken

    from tf2_msgs.msg import TFMessage

    peer.create_subscription(TFMessage, "tf", take(transforms), 100)
    peer.create_subscription(TFMessage, "tf_static", take(static), LATCHED)
    peer.hear("odom", "nav_msgs/Odometry")
    peer.hear("joint_states", "sensor_msgs/JointState")
    peer.hear("imu/data", "sensor_msgs/Imu", SENSOR)
    peer.hear("scan", "sensor_msgs/LaserScan", SENSOR)
    peer.hear("camera/camera_info", "sensor_msgs/CameraInfo", SENSOR)
    peer.hear("camera/depth/camera_info", "sensor_msgs/CameraInfo", SENSOR)
    peer.hear("camera/depth/points", "sensor_msgs/PointCloud2", SENSOR)
    peer.hear("fix", "sensor_msgs/NavSatFix", SENSOR)
    speeds = {"odom": {}, "odometry/filtered": {}}  # by their stamps: messages of one time do not come together

    def compare(name):
        def compared(message):
            speeds[name][message.header.stamp.sec, message.header.stamp.nanosec] = message.twist.twist.linear.x

        peer.create_subscription(kind("nav_msgs/Odometry"), name, compared, 100)

    for name in speeds:
        compare(name)
    seen = Counter()
    for name, message in (("camera_info", "sensor_msgs/CameraInfo"), ("image_raw", "sensor_msgs/Image")):
        peer.create_subscription(
            kind(message),
            f"camera/depth/{name}",
            lambda told: seen.update([(told.header.stamp.sec, told.header.stamp.nanosec)]),
            SENSOR,
        )
    peer.hear("battery_state", "sensor_msgs/BatteryState", LATCHED)
    peer.hear("robot_description", "std_msgs/String", LATCHED)
    peer.hear("/diagnostics", "diagnostic_msgs/DiagnosticArray")
    peer.hear("/txt1/setpoint", "geometry_msgs/TwistStamped")
    peer.hear("/txt1/pwm", "txt1_msgs/Pwm")
    publisher = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    peer.linked()
    peer.until(lambda: peer.last["/txt1/mode"].armed and peer.seen["odom"] > 10)

    def turns():
        peer.run(0.5, 0.1, lambda: publisher.publish(twist(0.5, 0.5)))
        told, asked = peer.last["odom"].twist.twist, peer.last["/txt1/setpoint"].twist
        together = speeds["odom"].keys() & speeds["odometry/filtered"].keys()
        return told.linear.x > 0.35 and told.angular.z > 0.3 and asked.linear.x and together

    peer.run(2.0, 0.1, lambda: publisher.publish(twist(0.5, 0.5)))
    peer.until(turns)
    moving = peer.last["/txt1/setpoint"].twist
    joints = peer.last["joint_states"].name, peer.last["joint_states"].position
    base, depth = transforms["base_footprint"].transform, peer.last["camera/depth/camera_info"]
    picture, fix = peer.last["camera/camera_info"], peer.last["fix"]
    cloud = peer.last["camera/depth/points"]
    told = {
        "setpoint": (moving.linear.x, moving.angular.z),
        "odom": [
            (o := peer.last["odom"]).pose.pose.position.x,
            o.pose.pose.position.y,
            theta(o.pose.pose.orientation),
            o.twist.twist.linear.x,
            o.twist.twist.angular.z,
        ],
        "odom_frames": (o.header.frame_id, o.child_frame_id),
        "odom_covariance": (o.twist.covariance[0], o.twist.covariance[35], o.pose.covariance[0]),
        "stamp_age": time.time() - o.header.stamp.sec - 1e-9 * o.header.stamp.nanosec,
        "joints": dict(zip(*joints, strict=True)),
        "gyro": peer.last["imu/data"].angular_velocity.z,
        "imu_frame": peer.last["imu/data"].header.frame_id,
        "scan": len(peer.last["scan"].ranges),
        "scan_frame": peer.last["scan"].header.frame_id,
        "depth": (depth.width, depth.height, depth.k[0], depth.k[2], depth.k[5], depth.header.frame_id),
        "points": (cloud.width, cloud.height, len(cloud.data), cloud.header.frame_id),
        "pairs": sum(count == 2 for count in seen.values()),
        "picture": (picture.width, picture.height, picture.k[0]),
        "fix": (fix.latitude, fix.longitude),
        "filtered": [each[max(speeds["odom"].keys() & speeds["odometry/filtered"].keys())] for each in speeds.values()],
        "battery": peer.last["battery_state"].voltage,
        "pwm": (peer.last["/txt1/pwm"].motor, peer.last["/txt1/pwm"].front, peer.last["/txt1/pwm"].rear),
        "description": peer.last["robot_description"].data,
        "frames": {c: t.header.frame_id for c, t in {**transforms, **static}.items()},
        "tf": (base.translation.y, theta(base.rotation)),
        "static": {c: (t.transform.translation.x, t.transform.translation.z) for c, t in static.items()},
        "diagnostics": peer.seen["/diagnostics"],
    }
    peer.until(lambda: peer.last["/txt1/setpoint"].twist.linear.x == 0.0)  # silent
    return told


def services():
    """What the node can be asked for, and parameters."""
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

    peer = Peer()
    peer.linked()
    told = {}
    for name in ("arm", "load_gains", "disarm", "stop"):
        told[name] = peer.call("std_srvs/Trigger", f"/txt1/{name}").success
        peer.run(0.2)
        told[f"{name}: armed"] = peer.last["/txt1/mode"].armed
    told["manual"] = peer.call("std_srvs/SetBool", "/txt1/manual", data=True).success
    peer.run(0.2)
    told["mode"] = peer.last["/txt1/mode"].mode
    told["esc"] = peer.call("std_srvs/SetBool", "/txt1/power_esc", data=False).success
    placed = peer.call("txt1_msgs/Place", "/txt1/place", x=1.0, y=-0.5, theta=0.3)
    told["place"] = (placed.success, placed.message)
    far = peer.call("txt1_msgs/Place", "/txt1/place", x=100.0, y=0.0, theta=0.0)
    told["far"] = (far.success, far.message)

    def put(name, value):
        if isinstance(value, list):
            made = ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=value)
        else:
            made = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        asked = [Parameter(name=name, value=made)]
        result = peer.call("rcl_interfaces/SetParameters", "/txt1/set_parameters", parameters=asked).results[0]
        return result.successful, result.reason

    told["kp"] = put("control.linear.kp", 9.0)
    told["angular"] = put("control.angular", [0.5, 3.0, 20.0, 0.0, 1.5, 2.0, 10.0, 0.0])
    told["falling"] = put("control.angular", [0.5, 3.0, 20.0, 0.0, 0.2, 2.0, 10.0, 0.0])
    told["v_max"] = put("v_max", 0.4)
    told["too fast"] = put("v_max", 9.0)
    told["safety"] = put("safety.v_max", 1.0)
    return told


def inputs():
    """Combined odometry and the two free servos."""
    peer = Peer()
    peer.hear("/txt1/pwm", "txt1_msgs/Pwm")
    combined = peer.create_publisher(kind("nav_msgs/Odometry"), "odom_comb", SENSOR)
    servos = peer.create_publisher(kind("std_msgs/Int32MultiArray"), "/txt1/servos", 10)
    peer.linked()
    peer.until(lambda: peer.last["/txt1/mode"].armed and servos.get_subscription_count())
    told = {"before": peer.last["/txt1/mode"].combined}
    made, counts = kind("nav_msgs/Odometry")(), kind("std_msgs/Int32MultiArray")(data=[1200, -2400])
    servos.publish(counts)
    peer.run(3.0, 0.05, lambda: combined.publish(made))
    told["during"] = peer.last["/txt1/mode"].combined
    told["servos"] = peer.last["/txt1/pwm"].pwm4, peer.last["/txt1/pwm"].pwm5
    peer.run(2.5)
    return told | {"after": peer.last["/txt1/mode"].combined}


def goal():
    """Drive to a pose, then towards one that is cancelled, then to one in a frame that does not exist."""
    from math import cos, sin

    from rclpy.action import ActionClient
    from txt1_msgs.action import DriveTo

    peer = Peer()
    peer.hear("odom", "nav_msgs/Odometry")
    client = ActionClient(peer, DriveTo, "/txt1/drive_to")
    assert client.wait_for_server(30.0)
    peer.linked()
    peer.call("std_srvs/Trigger", "/txt1/arm")
    peer.call("std_srvs/Trigger", "/txt1/load_gains")
    feedback = []

    def drive(frame, x, y, theta, cancel_after=None):
        asked = DriveTo.Goal(speed=0.5)
        asked.pose.header.frame_id, asked.pose.pose.position.x, asked.pose.pose.position.y = frame, x, y
        asked.pose.pose.orientation.z, asked.pose.pose.orientation.w = sin(theta / 2), cos(theta / 2)
        sent = client.send_goal_async(asked, feedback_callback=lambda m: feedback.append(m.feedback.distance))
        peer.until(sent.done)
        handle = sent.result()
        if cancel_after is not None:
            peer.run(cancel_after)
            peer.until(handle.cancel_goal_async().done)
        result = handle.get_result_async()
        peer.until(result.done)
        found = result.result()
        return found.status, found.result.arrived, found.result.message, found.result.reached.x, found.result.reached.y

    told = {"there": drive("room", 1.2, 0.4, 0.5), "feedback": list(feedback)}
    told["cancelled"] = drive("odom", 6.0, 0.0, 0.0, 2.0)
    peer.run(1.0)
    told["rests"] = peer.last["odom"].twist.twist.linear.x
    told["nowhere"] = drive("moon", 0.0, 0.0, 0.0)
    return told


def drive_and_die(hertz="10"):
    """Drive, and be killed in the middle of it."""
    import os
    import signal

    peer = Peer()
    peer.hear("odom", "nav_msgs/Odometry")
    publisher = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    peer.until(lambda: peer.seen["odom"] > 10 and publisher.get_subscription_count())
    peer.run(2.0, 1.0 / float(hertz), lambda: publisher.publish(twist(0.5, 0.3)))
    publisher.publish(twist(0.5, 0.3))
    print(json.dumps(peer.last["odom"].twist.twist.linear.x), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)


def alive():
    """Wait for odometry, and for the robot to drive as it is told."""
    peer = Peer()
    peer.hear("odom", "nav_msgs/Odometry")
    publisher = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)

    def drives():
        publisher.publish(twist(0.4, 0.0))
        peer.run(0.1)
        return peer.seen["odom"] and peer.last["odom"].twist.twist.linear.x > 0.25

    peer.until(drives)
    return True


def drive_on():
    """Drive until it is killed; the speed when there is one."""
    peer = Peer()
    peer.hear("odom", "nav_msgs/Odometry")
    publisher = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)

    def drives():
        publisher.publish(twist(-0.4, 0.0))
        peer.run(0.1)
        return peer.seen["odom"] and peer.last["odom"].twist.twist.linear.x < -0.25

    peer.until(drives)
    print(-peer.last["odom"].twist.twist.linear.x, flush=True)
    while True:
        drives()


def _counts(peer):
    """What the node says of cmd_vel."""
    found = {}

    def take(message):
        for status in message.status:
            if status.name == "cmd_vel":
                found.update({each.key: int(each.value) for each in status.values})
                found["level"] = status.level[0] if isinstance(status.level, bytes) else status.level

    peer.create_subscription(kind("diagnostic_msgs/DiagnosticArray"), "/diagnostics", take, 10)
    return found


def stamped():
    """Stamped commands from now, the past and the future, and without a stamp; and some that are no numbers."""
    peer = Peer()
    peer.hear("/txt1/setpoint", "geometry_msgs/TwistStamped")
    counts = _counts(peer)
    made = kind("geometry_msgs/TwistStamped")()
    publisher = peer.create_publisher(kind("geometry_msgs/TwistStamped"), "cmd_vel", 10)
    peer.until(lambda: peer.seen["/txt1/setpoint"] and publisher.get_subscription_count())
    told = {}

    def give(shift, v=0.4):
        made.twist.linear.x = v
        now = 0.0 if shift is None else time.time() + shift
        made.header.stamp.sec, made.header.stamp.nanosec = int(now), int(now % 1.0 * 1e9)
        publisher.publish(made)

    def setpoint():
        return peer.last["/txt1/setpoint"].twist.linear.x

    def during(name, *what):
        ends = time.monotonic() + LIMIT
        while not setpoint() and time.monotonic() < ends:
            peer.run(0.1, 0.1, lambda: give(*what))
        told[name] = setpoint()
        peer.until(lambda: not setpoint())

    during("now", 0.0)
    for shift in (-1.0, 20.0, -3.0, 40.0):
        give(shift)
        peer.run(0.2)
        told[str(shift)] = setpoint()
    during("again", 0.0)
    during("unstamped", None)
    peer.run(1.0, 0.1, lambda: give(0.0, float("nan")))
    told["not a number"] = setpoint()
    peer.run(1.5)
    counted = dict(counts)  # another subscription counts anew
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

    peer.destroy_publisher(publisher)
    plain = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=False)
    asked = [Parameter(name="use_stamped_vel", value=plain)]
    told["set"] = (
        peer.call("rcl_interfaces/SetParameters", "/txt1/set_parameters", parameters=asked).results[0].successful
    )
    publisher = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    peer.until(publisher.get_subscription_count)
    peer.until(lambda: publisher.publish(twist(0.4, 0.0)) or peer.run(0.1) or setpoint())
    told["plain"] = setpoint()
    return told | {"counts": counted}


def clocks():
    """Stamped commands of a computer whose clock is 70 s ahead, then a day behind, and a burst of old ones."""
    peer = Peer()
    peer.hear("/txt1/setpoint", "geometry_msgs/TwistStamped")
    made = kind("geometry_msgs/TwistStamped")()
    publisher = peer.create_publisher(kind("geometry_msgs/TwistStamped"), "cmd_vel", 50)
    peer.until(lambda: peer.seen["/txt1/setpoint"] and publisher.get_subscription_count())
    made.twist.linear.x = 0.4

    def give(shift):
        now = time.time() + shift
        made.header.stamp.sec, made.header.stamp.nanosec = int(now), int(now % 1.0 * 1e9)
        publisher.publish(made)

    def moves():
        return peer.last["/txt1/setpoint"].twist.linear.x > 0.3

    def drive(shift, reached):
        """Give commands until the robot moves or not; return the s that it took."""
        began = time.monotonic()
        peer.until(lambda: give(shift) or peer.run(0.05) or reached())
        return time.monotonic() - began

    drive(70.0, moves)
    stopped = drive(-86400.0, lambda: not moves())
    again = drive(-86400.0, moves)
    peer.run(2.0)
    stands = not moves()
    for late in range(40):
        give(-86400.0 - 2.0 + 0.04 * late)
    burst = []
    peer.run(1.0, 0.02, lambda: burst.append(moves()))
    return {"stopped": stopped, "again": again, "stands": stands, "burst": any(burst), "after": drive(-86400.0, moves)}


def two():
    """One publisher that stutters, and then two at a time."""
    peer, other = Peer("one"), Peer("other")
    counts = _counts(peer)
    publisher = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    peer.until(lambda: publisher.get_subscription_count())
    for pause in (0.1, 0.5, 0.1, 0.7, 0.1, 0.4):
        publisher.publish(twist(0.3, 0.0))
        peer.run(pause)
    peer.run(2.0)
    alone = dict(counts)
    second = other.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    peer.run(2.5)

    def both():
        publisher.publish(twist(0.3, 0.0))
        second.publish(twist(-0.3, 0.0))

    peer.run(2.0, 0.1, both)
    peer.run(1.5)
    return {"alone": alone, "both": dict(counts)}


def clock(peer=None):
    """Virtual time, as a node with use_sim_time sees it."""
    from rclpy.parameter import Parameter

    peer = peer or Peer()
    peer.set_parameters([Parameter("use_sim_time", value=True)])
    peer.hear("odom", "nav_msgs/Odometry")
    peer.hear("/clock", "rosgraph_msgs/Clock", SENSOR)
    peer.until(lambda: peer.seen["odom"] > 10 and peer.seen["/clock"] > 10)
    began, now = time.monotonic(), peer.get_clock().now().nanoseconds
    peer.run(3.0)
    passed = 1e-9 * (peer.get_clock().now().nanoseconds - now)
    stamp = peer.last["odom"].header.stamp
    return {
        "times real": passed / (time.monotonic() - began),
        "behind": 1e-9 * peer.get_clock().now().nanoseconds - stamp.sec - 1e-9 * stamp.nanosec,
        "now": 1e-9 * peer.get_clock().now().nanoseconds,
    }


def raw():
    """The bytes of messages, as they come."""
    peer, heard = Peer(), {}
    for topic, message, quality in (
        ("odom", "nav_msgs/Odometry", 10),
        ("/txt1/setpoint", "geometry_msgs/TwistStamped", 10),
        ("scan", "sensor_msgs/LaserScan", SENSOR),
        ("camera/depth/image_raw", "sensor_msgs/Image", SENSOR),
        ("battery_state", "sensor_msgs/BatteryState", LATCHED),
        ("/txt1/mode", "txt1_msgs/Mode", LATCHED),
    ):
        taken = heard[topic] = []
        peer.create_subscription(kind(message), topic, lambda data, taken=taken: taken.append(data), quality, raw=True)
    peer.until(lambda: all(heard.values()) and len(heard["odom"]) > 100)
    return {topic: [data.hex() for data in taken] for topic, taken in heard.items()}


def replayed():
    """A recording that is published again, at twice its speed."""
    peer = Peer()
    frames = {}

    def take(message):
        frames.update({each.child_frame_id: each.header.frame_id for each in message.transforms})

    peer.create_subscription(kind("tf2_msgs/TFMessage"), "tf", take, 100)
    peer.create_subscription(kind("tf2_msgs/TFMessage"), "tf_static", take, LATCHED)
    peer.hear("joint_states", "sensor_msgs/JointState")
    peer.hear("scan", "sensor_msgs/LaserScan", SENSOR)
    peer.hear("robot_description", "std_msgs/String", LATCHED)
    peer.hear("/txt1/mode", "txt1_msgs/Mode", LATCHED)
    told = clock(peer)
    twist = peer.last["odom"].twist.twist
    return told | {
        "odom": [twist.linear.x, twist.angular.z],
        "mode": peer.last["/txt1/mode"].mode,
        "frames": frames,
        "wheel": peer.last["joint_states"].position[0],
        "scan": len(peer.last["scan"].ranges),
        "description": peer.last["robot_description"].data,
    }


def board():
    """A virtual board, driven by the host at its line."""
    peer = Peer()
    peer.hear("odom", "nav_msgs/Odometry")
    peer.hear("/txt1_board/mode", "txt1_msgs/Mode", LATCHED)
    commands = peer.create_publisher(kind("geometry_msgs/Twist"), "cmd_vel", 10)
    peer.until(lambda: peer.seen["odom"] and peer.last["odom"].twist.twist.linear.x > 0.25)
    told = {"v": peer.last["odom"].twist.twist.linear.x, "cmd_vel": commands.get_subscription_count()}
    told["manual"] = peer.call("std_srvs/SetBool", "/txt1_board/manual", data=True).success
    peer.run(2.0)
    told["mode"] = peer.last["/txt1_board/mode"].mode
    peer.call("std_srvs/SetBool", "/txt1_board/manual", data=False)
    told["esc"] = peer.call("std_srvs/SetBool", "/txt1_board/power_esc", data=False).success
    for name in ("disarm", "stop"):
        told[name] = peer.call("std_srvs/Trigger", f"/txt1_board/{name}").success
    peer.run(0.5)
    return told | {"armed": peer.last["/txt1_board/mode"].armed}


def viewer():
    """Look at everything as RViz does by default: reliably."""
    peer = Peer()
    frames = {}

    def take(message):
        frames.update((each.child_frame_id, each.header.frame_id) for each in message.transforms)

    peer.create_subscription(kind("tf2_msgs/TFMessage"), "/car1/tf", take, 100)
    peer.create_subscription(kind("tf2_msgs/TFMessage"), "/car1/tf_static", take, LATCHED)
    for name, message in (
        ("scan", "sensor_msgs/LaserScan"),
        ("imu/data", "sensor_msgs/Imu"),
        ("fix", "sensor_msgs/NavSatFix"),
    ):
        peer.hear(f"/car1/{name}", message)
    names = set()
    peer.create_subscription(
        kind("diagnostic_msgs/DiagnosticArray"),
        "/diagnostics",
        lambda told: names.update(s.name for s in told.status),
        100,
    )
    awaited = {"car1: cmd_vel", "car1: task controller"}
    peer.until(lambda: len(peer.last) == 3 and "car1/odom" in frames and awaited <= names)
    scan, imu = peer.last["/car1/scan"], peer.last["/car1/imu/data"]
    return {
        "frames": frames,
        "scan": [scan.header.frame_id, scan.scan_time],
        "imu": [imu.header.frame_id, imu.angular_velocity_covariance[8], imu.orientation_covariance[0]],
        "names": sorted(names),
    }


def mapper():
    """Tell map -> odom ten times a second, as a mapper does, and look who else says where odom is."""
    peer = Peer("slam_toolbox")
    message, transform = kind("tf2_msgs/TFMessage"), kind("geometry_msgs/TransformStamped")
    heard = Counter()
    publisher = peer.create_publisher(message, "tf", 100)
    made = transform()
    made.header.frame_id, made.child_frame_id, made.transform.translation.x = "map", "odom", 0.123

    def take(told):
        heard.update((each.header.frame_id, each.child_frame_id) for each in told.transforms)

    peer.create_subscription(message, "tf", take, 100)
    peer.until(lambda: heard["room", "odom"])

    def tell():
        made.header.stamp = peer.get_clock().now().to_msg()
        publisher.publish(message(transforms=[made]))

    peer.run(4.0, do=tell)
    heard.clear()
    peer.run(2.0, do=tell)
    return {" ".join(each): count for each, count in heard.items()}


if __name__ == "__main__":
    rclpy.init()
    print(json.dumps(globals()[sys.argv[1]](*sys.argv[2:])))
