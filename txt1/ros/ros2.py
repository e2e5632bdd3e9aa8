"""The node of ROS 2: it publishes serialised messages, and passes requests on to the robot.

It runs under the Python of rclpy.

The main thread takes commands, a second thread publishes the robot's messages, and further threads serve requests that
wait for the robot.
"""

import fcntl
import json
import signal
import socket
import struct
import sys
import threading
import time
from base64 import b64decode
from collections import deque
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import partial
from importlib import import_module
from math import atan2
from typing import Any, Final

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from txt1.ros.calls import Caller
from txt1.ros.stamps import Publishers, Stamps
from txt1.sidecar import Connection

# s between two checks whether a goal is cancelled
CANCEL_CHECK_PERIOD: Final = 0.1
# s between two reports about the node
SECOND: Final = 1.0
# s for which messages are discarded after this process stood still
DEAF: Final = 0.1
# Linux's request for an interface's flags
SIOCGIFFLAGS: Final = 0x8913
# ... and for its address
SIOCGIFADDR: Final = 0x8915
# the flag of an interface that is up
IFF_RUNNING: Final = 0x40
# s of a thread's turn: a command must not wait for a camera's picture
THREAD_TURN: Final = 5e-4
# number of its own transforms that a node recognises
OWN: Final = 256
# bytes before a message, which the middleware may change
MESSAGE_HEAD: Final = 4
# s without a sign of life from the main thread after which this process ends
MAIN_THREAD_SILENCE: Final = 5.0

_BEST_EFFORT: Final = ReliabilityPolicy.BEST_EFFORT
QUALITIES: Final = {
    "default": QoSProfile(depth=10),
    "sensor": QoSProfile(depth=5, reliability=_BEST_EFFORT),
    "latched": QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    "clock": QoSProfile(depth=1, reliability=_BEST_EFFORT),
}


def heading(turn: Any) -> float:
    """Return the heading of a quaternion, rad."""
    return atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def with_info(take: Callable[[Any, dict[str, Any]], None]) -> Callable[..., None]:
    """Return the callback for a subscription; before ROS 2 Iron it gets the message alone, without its times."""
    if hasattr(Subscription, "CallbackType"):
        return take
    return lambda message: take(message, {})


def moves(twist: Any) -> bool:
    """Return whether a command moves the robot. A number that is none is refused by the robot itself."""
    return bool(twist.linear.x or twist.angular.z)


class Bridge:
    """The node with everything that it `offers`; `stale` is the age in s at which a command is stale.

    Its diagnostics are those of `owner`. If another program publishes the parent of the frame `child`, the robot is
    told.
    """

    def __init__(
        self,
        robot: Connection,
        node: Node,
        offers: Collection[str],
        parameters: dict[str, Any],
        stamped: bool,
        stale: float,
        virtual: bool,
        owner: str = "",
        child: str = "",
        best_effort: bool = False,
        ackermann: bool = False,
    ) -> None:
        self._robot, self._node, self._stale, self._virtual = robot, node, stale, virtual
        self._owner, self._child, self._best_effort = owner, child, best_effort
        # subscribes to transforms while other programs publish some
        self._others: Any = None
        # the newest transforms of this node, without the header
        self._own: deque[bytes] = deque(maxlen=OWN)
        self.over = False
        """Whether the node has to end and start again, because ROS looks at the network only when it starts."""
        self.wake: Callable[[], None] = lambda: None
        """Wakes the main thread."""
        self._network = addresses()
        self._publishers: dict[int, tuple[Any, str]] = {}
        self._by_name: dict[str, Any] = {}
        self._clock: Any = None
        # the robot's present time stamp, ns
        self._now = 0
        self._caller = Caller(robot)
        # state on the way to a goal: time, and feedback
        self._feedback: tuple[int, list[float]] | None = None
        self._counts = {"commands": 0, "publishers": 0}
        self._alive = time.monotonic()
        # time of the robot's last message
        self._heard = self._alive
        # time until which commands are refused
        self._deaf = 0.0
        self._names: tuple[str, ...] = ()
        self._stamps, self._order = Stamps(stale), Publishers()
        self._drive_stamps = Stamps(stale)
        self._commands: Any = None
        self._group = ReentrantCallbackGroup()
        self.driving = MutuallyExclusiveCallbackGroup()
        """Group of subscriptions and self-checks: callbacks that never wait."""
        self._serve(offers)
        self._diagnostics: Any = None
        if "drive" in offers:
            from diagnostic_msgs.msg import DiagnosticArray

            self._declare(parameters, stamped)
            self._subscribe(stamped)
            if ackermann:
                self._subscribe_to_steering()
            self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(SECOND, self._report, callback_group=self.driving)

    # -- the robot's messages -------------------------------------------------------------------------------------

    def publish(self) -> None:
        """Publish the robot's messages until its process ends; in a thread of its own."""
        self._robot.request("begin")
        for telemetry in self._robot:
            # acknowledged: the next may come
            self._robot.request("")
            if self.over:
                return
            if time.monotonic() - self._alive > MAIN_THREAD_SILENCE:
                # the main thread hangs, so this heartbeat stops
                return
            now = time.monotonic()
            if now - self._heard > self._stale:
                self._deaf = now + DEAF
            self._heard, self._now = now, telemetry["now"]
            if self._virtual:
                self._tell_time(self._now)
            for number, name, message, quality in telemetry.get("new", ()):
                self._advertise(number, name, message, quality)
            for number, _, data in telemetry.get("messages", ()):
                publisher = self._publishers.get(number)
                if publisher is not None:
                    told = b64decode(data)
                    if publisher[1] == "tf":
                        self._own.append(told[MESSAGE_HEAD:])
                    publisher[0].publish(told)
            self._caller.answered(telemetry.get("answers", ()))
            if "feedback" in telemetry:
                self._feedback = self._now, telemetry["feedback"]

    def _advertise(self, number: int, name: str, message: str, quality: str) -> None:
        package, _, kind = message.partition("/")
        publisher = self._by_name.get(name)
        if publisher is None:
            try:
                found = getattr(import_module(f"{package}.msg"), kind)
                if quality == "sensor" and not self._best_effort:
                    quality = "default"
                publisher = self._node.create_publisher(found, name, QUALITIES[quality])
            except (ImportError, AttributeError):
                self._publishers.pop(number, None)
                self._robot.request("missing", message=message, name=name)
                return
            self._by_name[name] = publisher
        self._publishers[number] = publisher, name

    def _tell_time(self, now: int) -> None:
        from rosgraph_msgs.msg import Clock

        if self._clock is None:
            self._clock = self._node.create_publisher(Clock, "/clock", QUALITIES["clock"])
        told = Clock()
        told.clock.sec, told.clock.nanosec = divmod(now, 10**9)
        self._clock.publish(told)

    # -- commands ----------------------------------------------------------------------------------------------

    def _subscribe(self, stamped: bool) -> None:
        from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped
        from nav_msgs.msg import Odometry
        from std_msgs.msg import Int32MultiArray

        def subscribe() -> None:
            self._subscribe_to_commands(TwistStamped if self._stamped else Twist)

        self._stamped = stamped
        # only the subscription's own executor may destroy it
        self._changed = self._node.create_guard_condition(subscribe, callback_group=self.driving)
        subscribe()
        self._node.create_subscription(
            Odometry, "odom_comb", self._combined, QUALITIES["sensor"], callback_group=self.driving
        )
        self._node.create_subscription(Int32MultiArray, "~/servos", self._servos, 10, callback_group=self.driving)
        for kind, topic, name in (
            (PoseStamped, "goal_pose", "goal_pose"),
            (PoseWithCovarianceStamped, "initialpose", "initial_pose"),
        ):
            take = partial(self._posed, name)
            self._node.create_subscription(kind, topic, take, 10, callback_group=self.driving)

    def _subscribe_to_commands(self, kind: type) -> None:
        """Subscribe to commands of this type: a topic has a single type."""
        if self._commands is not None:
            self._node.destroy_subscription(self._commands)
        self._stamps, self._order = Stamps(self._stale), Publishers()
        take = with_info(self._take_stamped if kind.__name__ == "TwistStamped" else self._take_plain)
        # compatible with publishers of both kinds
        quality = QoSProfile(depth=10, reliability=_BEST_EFFORT)
        self._commands = self._node.create_subscription(kind, "cmd_vel", take, quality, callback_group=self.driving)

    def _subscribe_to_steering(self) -> None:
        """Subscribe to speeds and steering angles, as programs for F1TENTH publish them."""
        try:
            from ackermann_msgs.msg import AckermannDriveStamped
        except ImportError:
            text = "ROS has no ackermann_msgs here: apt install ros-$ROS_DISTRO-ackermann-msgs; drive is not heard"
            self._robot.request("tell", text=text)
            return
        quality = QoSProfile(depth=10, reliability=_BEST_EFFORT)
        take = with_info(self._take_steering)
        self._node.create_subscription(AckermannDriveStamped, "drive", take, quality, callback_group=self.driving)

    def _take_steering(self, message: Any, info: dict[str, Any]) -> None:
        stamp, drive = message.header.stamp, message.drive
        received = self._now if self._virtual else time.monotonic_ns()
        age = self._drive_stamps.age(stamp.sec + 1e-9 * stamp.nanosec, 1e-9 * received, bool(drive.speed))
        if age is not None and self._is_known(bool(drive.speed), info):
            self._robot.request("steer", speed=drive.speed, angle=drive.steering_angle, age=age)

    def _take_plain(self, twist: Any, info: dict[str, Any]) -> None:
        """Take a command without a stamp: the middleware has noted when it was sent, 0 if it does not do that."""
        sent = 0 if self._virtual else info.get("source_timestamp") or 0
        age = self._stamps.age(1e-9 * sent, time.monotonic(), moves(twist))
        if age is not None:
            self._take(twist, info, age)

    def _take(self, twist: Any, info: dict[str, Any], age: float = 0.0) -> None:
        if self._is_known(moves(twist), info):
            self._robot.request("drive", v=twist.linear.x, omega=twist.angular.z, age=age)

    def _is_known(self, moves: bool, info: dict[str, Any]) -> bool:
        """Count a command; return whether its age is known: it is not if this process stood still."""
        self._counts["commands"] += 1
        self._order.take(info.get("publication_sequence_number"))
        now = time.monotonic()
        return not (moves and (now < self._deaf or now - self._heard > self._stale))

    def _take_stamped(self, message: Any, info: dict[str, Any]) -> None:
        stamp = message.header.stamp
        # not the time of day, which may be set in mid-drive
        received = self._now if self._virtual else time.monotonic_ns()
        age = self._stamps.age(stamp.sec + 1e-9 * stamp.nanosec, 1e-9 * received, moves(message.twist))
        if age is not None:
            self._take(message.twist, info, age)

    def _combined(self, message: Any) -> None:
        twist, place = message.twist.twist, message.pose.pose.position
        self._robot.request("combined", x=place.x, y=place.y, theta=0.0, v=twist.linear.x, omega=twist.angular.z)

    def _servos(self, message: Any) -> None:
        if len(message.data) == 2:
            self._robot.request("servos", pwm4=message.data[0], pwm5=message.data[1])

    def _posed(self, name: str, message: Any) -> None:
        """Pass on a clicked pose, stamped or with a covariance; the covariance is not used."""
        pose = getattr(message.pose, "pose", message.pose)
        frame = message.header.frame_id.lstrip("/")
        self._caller.ask(name, frame=frame, x=pose.position.x, y=pose.position.y, theta=heading(pose.orientation))

    # -- services ----------------------------------------------------------------------------------------------

    def _serve(self, offers: Collection[str]) -> None:
        from std_srvs.srv import SetBool, Trigger

        def trigger(name: str) -> Any:
            return lambda request, response: self._answer(response, name)

        def switch(name: str, **fields: Any) -> Any:
            word = "manual" if name == "manual" else "on"
            return lambda request, response: self._answer(response, name, **fields, **{word: request.data})

        services = {name: (Trigger, trigger(name)) for name in ("arm", "disarm", "stop", "load_gains")}
        services |= {f"power_{which}": (SetBool, switch("power", switch=which)) for which in ("atx", "esc")}
        services["manual"] = SetBool, switch("manual")
        # txt1's own types
        with suppress(ImportError):
            from txt1_msgs.srv import Place

            def place(request: Any, response: Any) -> Any:
                return self._answer(response, "place", x=request.x, y=request.y, theta=request.theta)

            services["place"] = Place, place
            if "drive_to" in offers:
                self._serve_goals()
        for name in services.keys() & set(offers):
            kind, take = services[name]
            self._node.create_service(kind, f"~/{name}", take, callback_group=self._group)

    def _serve_goals(self) -> None:
        """Serve the action that drives to a pose."""
        from geometry_msgs.msg import Pose2D
        from rclpy.action import ActionServer, CancelResponse
        from txt1_msgs.action import DriveTo

        def drive(goal: Any) -> Any:
            asked, told = goal.request.pose, 0
            place = asked.pose.position

            def look() -> bool:
                nonlocal told
                if self._feedback is not None and self._feedback[0] != told:
                    told, (distance, *pose) = self._feedback
                    goal.publish_feedback(DriveTo.Feedback(distance=distance, pose=_pose(pose)))
                return bool(goal.is_cancel_requested)

            done, text = self._caller.watched(
                "drive_to",
                CANCEL_CHECK_PERIOD,
                look,
                frame=asked.header.frame_id.lstrip("/"),
                x=place.x,
                y=place.y,
                theta=heading(asked.pose.orientation),
                speed=goal.request.speed,
            )
            result = DriveTo.Result(message=text)
            if done:
                found = json.loads(text)
                result = DriveTo.Result(
                    arrived=found["arrived"], message=found["told"], reached=_pose(found["reached"])
                )
                goal.succeed() if result.arrived else goal.abort()
            elif goal.is_cancel_requested:
                goal.canceled()
            else:
                goal.abort()
            return result

        def _pose(pose: Any) -> Any:
            return Pose2D(x=pose[0], y=pose[1], theta=pose[2])

        ActionServer(
            self._node,
            DriveTo,
            "~/drive_to",
            drive,
            callback_group=self._group,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    def _answer(self, response: Any, name: str, **fields: Any) -> Any:
        response.success, response.message = self._caller.call(name, **fields)
        return response

    # -- parameters --------------------------------------------------------------------------------------------

    def _declare(self, parameters: dict[str, Any], stamped: bool) -> None:
        from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult

        for name, (value, may_set) in parameters.items():
            self._node.declare_parameter(name, value, ParameterDescriptor(read_only=not may_set))
        self._node.declare_parameter(
            "use_stamped_vel", stamped, ParameterDescriptor(description="cmd_vel is TwistStamped, not Twist")
        )

        def changed(given: list[Parameter]) -> SetParametersResult:
            values = {each.name: each.value for each in given if each.name in parameters}
            if values:
                told = {name: list(value) if name == "control.angular" else value for name, value in values.items()}
                done, text = self._caller.call("set", values=told)
                if not done:
                    return SetParametersResult(successful=False, reason=text)
            for each in given:
                if each.name == "use_stamped_vel":
                    self._stamped = bool(each.value)
                    self._changed.trigger()
            return SetParametersResult(successful=True)

        self._node.add_on_set_parameters_callback(changed)

    # -- about the node itself ---------------------------------------------------------------------------------

    def _report(self) -> None:
        self._alive = time.monotonic()
        if not (network := addresses()) <= self._network:
            self.over = True
            self._robot.request("tell", text="the network has changed, and the node starts again")
        self._network = network
        self._look_for_others()
        if self._diagnostics is not None:
            self._report_commands()

    def _look_for_others(self) -> None:
        """Subscribe to transforms while other programs publish some: messages do not contain the publisher's name."""
        name = self._node.get_name()
        found = self._node.get_publishers_info_by_topic("tf")
        nodes = sorted(each.node_name for each in found if self._child and each.node_name != name)
        if bool(nodes) is (self._others is not None):
            return
        if nodes:
            from tf2_msgs.msg import TFMessage

            def heard(data: bytes) -> None:
                if data[MESSAGE_HEAD:] not in self._own:
                    self._hear(deserialize_message(data, TFMessage), ", ".join(nodes))

            self._others = self._node.create_subscription(
                TFMessage, "tf", heard, 100, callback_group=self.driving, raw=True
            )
        else:
            self._node.destroy_subscription(self._others)
            self._others = None

    def _hear(self, message: Any, nodes: str) -> None:
        """Tell the robot if a node in `nodes` publishes the parent of its frame."""
        for each in message.transforms:
            if self._child and each.child_frame_id.lstrip("/") == self._child:
                self._child = ""
                self._robot.request("parent", frame=each.header.frame_id, nodes=nodes)

    def _report_commands(self) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        found = self._node.get_publishers_info_by_topic("cmd_vel")
        names = tuple(sorted(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found))
        if names != self._names:
            self._names = names
            self._order = Publishers()
            if len(names) > 1:
                self._robot.request("tell", text=f"{len(names)} programs publish cmd_vel: {', '.join(names)}")
        order, refused = self._order, self._stamps.refused
        counts = {
            "publishers": len(names),
            "commands": self._counts["commands"],
            "lost": order.lost,
            "mixed": order.mixed,
            "from_the_past": refused["past"],
            "from_the_future": refused["future"],
        }
        message = DiagnosticArray()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self._now, 10**9)
        message.status = [
            DiagnosticStatus(
                level=DiagnosticStatus.WARN if len(names) > 1 or refused else DiagnosticStatus.OK,
                name=f"{self._owner}: cmd_vel" if self._owner else "cmd_vel",
                hardware_id=self._owner or "txt1",
                message="several programs publish it: " + ", ".join(names) if len(names) > 1 else "",
                values=[KeyValue(key=key, value=str(value)) for key, value in counts.items()],
            )
        ]
        self._diagnostics.publish(message)


class Driving(SingleThreadedExecutor):  # type: ignore[misc]  # rclpy is known to another Python only
    """Serves a callback group of a node. It takes a message much sooner than an executor with many threads."""

    def __init__(self, bridge: Bridge, node: Node) -> None:
        super().__init__()
        self._group, self._node = bridge.driving, node

    def get_nodes(self) -> list[Node]:
        """Return the node, which belongs to the other executor."""
        return [self._node]

    def can_execute(self, entity: Any) -> bool:
        """Return whether the entity belongs to the group, and is ready."""
        return entity.callback_group is self._group and bool(super().can_execute(entity))


class Serving(MultiThreadedExecutor):  # type: ignore[misc]  # as above
    """Serves all other groups, which may wait for the robot."""

    def __init__(self, bridge: Bridge) -> None:
        super().__init__(num_threads=4)
        self._group = bridge.driving

    def can_execute(self, entity: Any) -> bool:
        """Return whether the entity belongs to another group, and is ready."""
        return entity.callback_group is not self._group and bool(super().can_execute(entity))


def main(
    robot: Connection,
    *,
    name: str = "txt1",
    namespace: str = "",
    offers: Collection[str] = (),
    stamped: bool = False,
    stale: float = 0.25,
    virtual: bool = False,
    parameters: dict[str, Any] | None = None,
    **more: Any,
) -> None:
    """Serve until the robot's process ends."""
    sys.setswitchinterval(THREAD_TURN)
    ends = threading.Event()
    while not ends.is_set():
        rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
        node = Node(name, namespace=namespace)
        bridge = Bridge(robot, node, offers, parameters or {}, stamped, stale, virtual, **more)
        serving, driving = Serving(bridge), Driving(bridge, node)
        serving.add_node(node)
        bridge.wake = driving.wake
        threads = [
            threading.Thread(target=_publish, args=(bridge, ends), daemon=True, name="publishing"),
            threading.Thread(target=_serve, args=(serving,), daemon=True, name="serving"),
        ]
        for thread in threads:
            thread.start()
        try:
            while not bridge.over:
                driving.spin_once()
        except ExternalShutdownException:
            ends.set()
        finally:
            for executor in (driving, serving):
                executor.shutdown(timeout_sec=1.0)
            node.destroy_node()
            rclpy.try_shutdown()
        for thread in threads:
            thread.join()


def _serve(executor: Serving) -> None:
    """Serve until the executor is shut down."""
    with suppress(ExternalShutdownException):
        executor.spin()


def _publish(bridge: Bridge, ends: threading.Event) -> None:
    """Publish, and end the process when the robot's has ended or the main thread hangs."""
    # the robot's process has gone
    with suppress(OSError):
        bridge.publish()
    if not bridge.over:
        ends.set()
        signal.raise_signal(signal.SIGTERM)
        # the main thread sleeps in ROS, and obeys signals when it wakes
        bridge.wake()


def addresses() -> frozenset[tuple[int, str]]:
    """Return the network interfaces that are up, by number, and their IPv4 addresses."""
    found = set()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        for number, name in socket.if_nameindex():
            given = struct.pack("256s", name.encode()[:15])
            # the interface has no address
            with suppress(OSError):
                if fcntl.ioctl(asking, SIOCGIFFLAGS, given)[16] & IFF_RUNNING:
                    found.add((number, socket.inet_ntoa(fcntl.ioctl(asking, SIOCGIFADDR, given)[20:24])))
    return frozenset(found)
