"""The original's node of ROS 1, ``txt1_node`` of ``txt_driver``: its topics, services, parameters, frames and rates.

It runs under the Python of rospy. Types are made at run time from the definitions below, with the original's md5 sums.
The node registers again at a master that was restarted.
"""

import signal
import threading
import time
import xmlrpc.client
from base64 import b64decode
from importlib import import_module
from math import cos, sin
from typing import Any, Final

import genmsg
import genpy.dynamic
import rosgraph
import rospy
from geometry_msgs.msg import Transform, TransformStamped, Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock, Log
from tf2_msgs.msg import TFMessage

from txt1.model.battery import remaining_time
from txt1.ros.calls import Caller
from txt1.sidecar import Connection
from txt1_ros1.txt_driver import MESSAGES, SERVICES

NODE_NAME: Final = "txt1_node"
# s between two combined odometries that are passed on
COMBINED: Final = 0.02
# s within which commands of two programs count as simultaneous
TOGETHER: Final = 1.0
# the level of an event of ROS 2 that is no warning
ROS2_INFO: Final = 20
# s between two checks of the master
LOOK: Final = 0.5
_HEADER: Final = "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"


STD_SRVS: Final = {
    "Trigger": ("", "bool success\nstring message\n"),
    "SetBool": ("bool data\n", "bool success\nstring message\n"),
}
"""Request and response of services of std_srvs, which not every machine has."""
UNSURE: Final = {0: 1.0, 7: 1.0, 14: 99999.0, 21: 99999.0, 28: 99999.0, 35: 2.0}
"""The covariance of its poses, as in the original's messages."""
END_MIN: Final = 50.0
"""Minutes under full load after which a pack is empty for the original node; the robot itself counts fewer."""


def message(name: str, text: str, package: str = "txt_driver") -> type:
    """Return the type of a message."""
    whole = text + (_HEADER if "Header" in text else "")
    return genpy.dynamic.generate_dynamic(f"{package}/{name}", whole)[f"{package}/{name}"]  # type: ignore[no-any-return]


def service(name: str, package: str = "txt_driver") -> type:
    """Return the type of a service of txt_driver or std_srvs."""
    request, response = (SERVICES if package == "txt_driver" else STD_SRVS)[name]
    context = genmsg.MsgContext.create_default()
    spec = genmsg.msg_loader.load_srv_from_string(context, f"{request}---\n{response}", f"{package}/{name}")
    return type(
        name,
        (),
        {
            "_type": f"{package}/{name}",
            "_md5sum": genmsg.compute_md5(context, spec),
            "_request_class": message(f"{name}Request", request, package),
            "_response_class": message(f"{name}Response", response, package),
        },
    )


BATTERY: Final = message("Battery", MESSAGES["Battery"])
PWM: Final = message("Pwm", MESSAGES["Pwm"])


def fill(told: Any, tree: dict[str, Any], place: str) -> Any:
    """Put a tree of values into a message, and return it; the names of frames begin with `place`."""
    for name, value in tree.items():
        # some fields in small letters in ROS 2 are in capitals here, as CameraInfo's
        name = name if hasattr(told, name) else name.upper()
        there = getattr(told, name)
        if name in ("frame_id", "child_frame_id"):
            setattr(told, name, f"{place}{value}")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            kind = told._slot_types[told.__slots__.index(name)].removesuffix("[]")  # noqa: SLF001  # as genpy does
            element = genpy.message.get_message_class(kind)
            setattr(told, name, [fill(element(), each, place) for each in value])
        elif not isinstance(value, dict):
            setattr(told, name, value)
        elif "base64" in value:
            setattr(told, name, b64decode(value["base64"]))
        elif isinstance(there, list | tuple):
            numbers = list(there)
            for index, number in value.items():
                numbers[int(index)] = number
            setattr(told, name, numbers)
        else:
            fill(there, value, place)
    return told


class OriginalNode:
    """All services and topics of the node. Names begin with `place`: / or the robot's namespace."""

    def __init__(self, robot: Connection, virtual: bool, parameters: dict[str, Any], place: str = "/") -> None:
        self._place = place
        self._robot, self._virtual, self._parameters = robot, virtual, parameters
        self._caller = Caller(robot)
        self._combined_at = 0.0
        # time of each program's last command, by name
        self._drivers: dict[str, float] = {}
        # programs that commanded simultaneously
        self._together: list[str] = []
        self._services: list[Any] = []
        self._odom = rospy.Publisher(f"{place}odom", Odometry, queue_size=5)
        self._tf = rospy.Publisher("/tf", TFMessage, queue_size=20)
        self._battery = rospy.Publisher(f"{place}battery", BATTERY, queue_size=2)
        self._static = rospy.Publisher("/tf_static", TFMessage, queue_size=2, latch=True)
        self._log = rospy.Publisher("/rosout", Log, queue_size=100)
        # publishers by name; () for a topic without a type
        self._sensors: dict[str, Any] = {}
        self._clock = rospy.Publisher("/clock", Clock, queue_size=1) if virtual else None
        self._set_parameters()
        rospy.Subscriber(f"{place}cmd_vel", Twist, self._drive, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber(f"{place}odom_comb", Odometry, self._combined, queue_size=1)
        rospy.Subscriber(f"{place}pwm", PWM, self._pwm, queue_size=1)
        for name, kind, call in (
            ("pid_load", "PidLoad", self._pid_load),
            ("pwm_change", "PwmTest", self._pwm_change),
            ("switched_pwr", "SwitchedPwr", self._switched_pwr),
            ("shutdown_computer", "Shutdown", self._shutdown),
        ):
            self._services.append(rospy.Service(f"{place}{name}", service(kind), call))
        for name in ("arm", "disarm", "stop"):
            self._services.append(rospy.Service(f"{place}{name}", service("Trigger", "std_srvs"), self._trigger(name)))
        self._services.append(rospy.Service(f"{place}manual", service("SetBool", "std_srvs"), self._manual))

    def publish(self) -> None:
        """Publish the robot's messages until its process ends."""
        self._robot.request("begin")
        for telemetry in self._robot:
            # acknowledged: the next may come
            self._robot.request("")
            stamp = rospy.Time(*divmod(telemetry["now"], 10**9))
            if self._clock is not None:
                self._clock.publish(Clock(stamp))
            if "odom" in telemetry:
                self._tell_odometry(stamp, *telemetry["odom"])
            if "frames" in telemetry:
                self._tell_frames(stamp, telemetry["frames"])
            for told in telemetry.get("readings", ()):
                self._tell_reading(*told)
            if "battery" in telemetry:
                self._tell_battery(stamp, *telemetry["battery"])
            for event in telemetry.get("log", ()):
                self._tell_event(stamp, **event)
            self._caller.answered(telemetry.get("answers", ()))

    def _tell_odometry(self, stamp: Any, x: float, y: float, theta: float, v: float, omega: float) -> None:
        told, moved = Odometry(), TransformStamped(transform=Transform())
        for each in (told, moved):
            each.header.stamp = stamp
            each.header.frame_id, each.child_frame_id = f"{self._place}odom", f"{self._place}base_footprint"
        told.pose.pose.position.x, told.pose.pose.position.y = x, y
        told.pose.pose.orientation.z, told.pose.pose.orientation.w = sin(0.5 * theta), cos(0.5 * theta)
        told.pose.covariance = [UNSURE.get(place, 0.0) for place in range(36)]
        told.twist.twist.linear.x, told.twist.twist.angular.z = v, omega
        moved.transform.translation.x, moved.transform.translation.y = x, y
        moved.transform.rotation = told.pose.pose.orientation
        self._odom.publish(told)
        self._tf.publish(TFMessage([moved]))

    def _tell_battery(self, stamp: Any, first: float, second: float) -> None:
        told: Any = BATTERY()
        told.header.stamp, told.header.frame_id, told.batt1, told.batt2 = stamp, "battery", first, second
        told.expected_time = rospy.Duration.from_sec(remaining_time(max(first, second), END_MIN))
        self._battery.publish(told)

    def _tell_event(self, stamp: Any, level: int, name: str, msg: str) -> None:
        """Publish a line of the event log; its level is ROS 2's."""
        told = Log(level=Log.WARN if level > ROS2_INFO else Log.INFO, name=rospy.get_name(), msg=msg)
        told.header.stamp = stamp
        self._log.publish(told)

    def _tell_frames(self, stamp: Any, transforms: list[dict[str, Any]]) -> None:
        """Publish the places of everything on the robot."""
        told = TFMessage([fill(TransformStamped(), each, self._place) for each in transforms])
        for each in told.transforms:
            each.header.stamp = stamp
        self._static.publish(told)

    def _tell_reading(self, name: str, kind: str, time: int, tree: dict[str, Any]) -> None:
        publisher = self._sensors.get(name)
        if publisher is None:
            package, _, message_name = kind.partition("/")
            try:
                found = getattr(import_module(f"{package}.msg"), message_name)
            except (ImportError, AttributeError):
                self._robot.request("tell", text=f"ROS has no type {kind} here, so {name} is not told")
                found = None
            # without a stamp it is requested only once
            publisher = None if found is None else rospy.Publisher(f"{self._place}{name}", found, queue_size=5)
            self._sensors[name] = publisher or ()
        if not publisher:
            return
        told = fill(publisher.data_class(), tree, self._place)
        told.header.stamp = rospy.Time(*divmod(time, 10**9))
        publisher.publish(told)

    # -- requests -------------------------------------------------------------------------------------------------

    def _drive(self, twist: Any) -> None:
        self._robot.request("drive", v=twist.linear.x, omega=twist.angular.z)
        now = time.monotonic()
        self._drivers[twist._connection_header["callerid"]] = now  # noqa: SLF001  # rospy has no other way to say it
        names = sorted(name for name, at in self._drivers.items() if now - at < TOGETHER)
        if len(names) > 1 and names != self._together:
            self._robot.request("tell", text=f"{len(names)} programs publish /cmd_vel: {', '.join(names)}")
        self._together = names

    def _combined(self, told: Any) -> None:
        if (now := time.monotonic()) - self._combined_at >= COMBINED:
            self._combined_at = now
            place, twist = told.pose.pose.position, told.twist.twist
            self._robot.request("combined", x=place.x, y=place.y, theta=0.0, v=twist.linear.x, omega=twist.angular.z)

    def _pwm(self, told: Any) -> None:
        self._robot.request("servos", pwm4=told.pwm4, pwm5=told.pwm5)

    def _call(self, name: str, **fields: Any) -> tuple[bool]:
        done, why = self._caller.call(name, **fields)
        if not done:
            rospy.logwarn("%s: %s", name, why)
        return (done,)

    def _pid_load(self, _: Any) -> tuple[bool]:
        given = {
            name: rospy.get_param(f"~{name}_pid", self._parameters[f"{name}_pid"]) for name in ("linear", "angular")
        }
        for name, values in given.items():
            if not isinstance(values, list) or not all(type(each) in (int, float) for each in values):
                rospy.logwarn("pid_load: ~%s_pid is %r: give a list of numbers", name, values)
                return (False,)
        return self._call("pid_load", **given)

    def _pwm_change(self, asked: Any) -> tuple[bool]:
        names = ("esc", "front", "rear", "pwm4", "pwm5")
        return self._call("pwm_change", **{name: getattr(asked, name) for name in names})

    def _switched_pwr(self, asked: Any) -> tuple[bool]:
        return self._call("switched_pwr", source=asked.source, on=asked.on)

    def _trigger(self, name: str) -> Any:
        """Return the handler of a Trigger, for the robot's function of this name."""
        return lambda _: self._caller.call(name)

    def _manual(self, asked: Any) -> tuple[bool, str]:
        return self._caller.call("manual", manual=asked.data)

    def _shutdown(self, asked: Any) -> tuple[bool]:
        return self._call("shutdown_computer") if asked.request else (False,)

    # -- the master --------------------------------------------------------------------------------------------

    def _set_parameters(self) -> None:
        for name, value in self._parameters.items():
            if not rospy.has_param(f"~{name}"):
                rospy.set_param(f"~{name}", value)
        if self._virtual:
            rospy.set_param("/use_sim_time", True)

    def watch(self) -> None:
        """Watch the master: a restarted master does not know this node."""
        while not rospy.is_shutdown():
            time.sleep(LOOK)
            if rospy.is_shutdown():
                # the master has just removed this node, which must not register again
                return
            master = rosgraph.Master(rospy.get_name())
            try:
                if master.lookupNode(rospy.get_name()) == rospy.get_node_uri():
                    continue
            except rosgraph.MasterError:
                # the master runs and does not know this node
                pass
            except OSError:
                # it is away
                continue
            try:
                self._register(master)
            except (OSError, rosgraph.MasterError, rospy.ROSException):
                # away again
                continue

    def _register(self, master: Any) -> None:
        uri = rospy.get_node_uri()
        topics = rospy.topics.get_topic_manager()
        for name, kind in topics.get_publications():
            master.registerPublisher(name, kind, uri)
        for name, kind in topics.get_subscriptions():
            publishers = master.registerSubscriber(name, kind, uri)
            xmlrpc.client.ServerProxy(uri).publisherUpdate("/master", name, publishers)
        for each in self._services:
            master.registerService(each.resolved_name, each.uri, uri)
        self._set_parameters()
        self._robot.request("tell", text="the ROS master was restarted and knows the node again")


def taken(robot: Connection, name: str) -> str:
    """Return the address of another node of this full name; "" if there is none."""
    try:
        uri = rosgraph.Master(name).lookupNode(name)
        xmlrpc.client.ServerProxy(uri).getPid(name)
    except (OSError, rosgraph.MasterError, xmlrpc.client.Error):
        return ""
    return str(uri)


def main(
    robot: Connection, *, virtual: bool, parameters: dict[str, Any], namespace: str = "", name: str = NODE_NAME
) -> None:
    """Serve until the robot's process ends. If another node has the same name, wait until it has gone."""
    told = ""
    while not rosgraph.is_master_online() or (where := taken(robot, f"/{namespace}/{name}".replace("//", "/"))):
        if rosgraph.is_master_online() and where != told:
            told = where
            robot.request(
                "tell", text=f"{name} is on this master already, at {where}; end it, or give --ros1-namespace NS"
            )
        # a heartbeat
        robot.receive(LOOK)
    rospy.init_node(name, disable_signals=True, disable_rosout=False)
    node = OriginalNode(robot, virtual, parameters, f"/{namespace}/" if namespace else "/")

    def watch() -> None:
        try:
            node.watch()
        finally:
            signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=watch, daemon=True, name="master").start()
    try:
        node.publish()
    finally:
        rospy.signal_shutdown("the robot's process has ended")
