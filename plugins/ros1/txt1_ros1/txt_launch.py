"""The original's package txt_launch: its launch files by their names, arguments, nodes and frames (thesis B.3).

`txt_node` starts the node and the frames on this computer, `txt_node_net` the node on the robot's computer; `txt_tf`
publishes the frames of the original's sensors, and `txt_teleop` drives by joystick. The nodes `tf` and `teleop` are
programs of this package, because Debian has neither tf's programs nor the original's.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Final

from txt1.sensors.mounts import ORIGINAL, mounted

if TYPE_CHECKING:
    from collections.abc import Iterator

MANIFEST: Final = """\
<?xml version="1.0"?>
<package format="2">
  <name>txt_launch</name>
  <version>1.0.0</version>
  <description>Launch files of the TXT-1</description>
  <maintainer email="robot@example.org">TXT-1</maintainer>
  <license>MIT</license>
  <buildtool_depend>catkin</buildtool_depend>
  <exec_depend>txt_driver</exec_depend>
  <exec_depend>rospy</exec_depend>
  <exec_depend>joy</exec_depend>
</package>
"""
CMAKE: Final = """\
cmake_minimum_required(VERSION 3.5)
project(txt_launch)
find_package(catkin REQUIRED)
catkin_package()
catkin_install_python(PROGRAMS bin/txt_tf bin/txt_teleop DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(DIRECTORY launch DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
"""
_PORT: Final = """\
  <!-- the board's port; sim: a simulated robot -->
  <arg name="port" default="$(optenv TXT_PORT /dev/ttyUSB0)"/>
  <!-- further options of the command txt1 run -->
  <arg name="options" default="$(optenv TXT_OPTIONS)"/>
"""
_NODE: Final = """\
  <node name="txt1_node" pkg="txt_driver" type="txt_node" args="$(arg options)" output="screen"{machine}>
    <param name="port" value="$(arg port)"/>
    <rosparam command="load" file="$(find txt_driver)/cfg/pid.yaml"/>{env}
  </node>
  <include file="$(find txt_launch)/launch/txt_tf.launch"/>
"""
_NET: Final = """\
  <!-- the computer of the ROS master, and the robot's computer -->
  <arg name="host"/>
  <arg name="client"/>
  <machine name="txt" address="$(arg client)" env-loader="$(optenv TXT_ENV_LOADER /opt/ros/noetic/env.sh)"/>
"""
_MASTER: Final = """
    <env name="ROS_MASTER_URI"
         value="$(eval optenv('ROS_MASTER_URI', 'http://localhost:11311').replace('localhost', arg('host')))"/>"""
_TELEOP: Final = """\
  <node name="joystick" pkg="joy" type="joy_node">
    <!-- a dead-man that is held is told again and again -->
    <param name="autorepeat_rate" value="20"/>
  </node>
  <node name="teleop" pkg="txt_launch" type="txt_teleop"/>
"""
LAUNCHES: Final = {
    "txt_node": _PORT + _NODE.format(machine="", env=""),
    "txt_node_net": _NET + _PORT + _NODE.format(machine=' machine="txt"', env=_MASTER),
    "txt_tf": '  <node name="tf" pkg="txt_launch" type="txt_tf"/>\n',
    "txt_teleop": _TELEOP,
}
"""The launch files, without their root element."""

TF: Final = '''\
#!/usr/bin/python3
"""Publishes the frames of the original's sensors, ten times a second.

A frame that the robot's node publishes itself, because it reads that sensor, is left to it.
"""

import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
from tf.transformations import quaternion_from_euler

# parent, name, x, y, z (m), roll, pitch, yaw (rad)
FRAMES = [
{frames}]

rospy.init_node("tf")
others = set()
rospy.Subscriber("/tf_static", TFMessage, lambda told: others.update(t.child_frame_id for t in told.transforms))
publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
rate = rospy.Rate(10.0)
while not rospy.is_shutdown():
    told = TFMessage()
    for parent, name, x, y, z, roll, pitch, yaw in FRAMES:
        if "/" + name in others or name in others:
            continue
        each = TransformStamped(child_frame_id=name)
        each.header.stamp, each.header.frame_id = rospy.Time.now(), parent
        place, turn = each.transform.translation, each.transform.rotation
        place.x, place.y, place.z = x, y, z
        turn.x, turn.y, turn.z, turn.w = quaternion_from_euler(roll, pitch, yaw)
        told.transforms.append(each)
    publisher.publish(told)
    try:
        rate.sleep()
    except rospy.ROSInterruptException:
        break
'''
TELEOP: Final = '''\
#!/usr/bin/python3
"""Drives by joystick, ten times a second, while button 0, the dead-man, is held and the joystick is heard."""

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import Joy

# s without a message after which the joystick is not heard
SILENCE = 0.3

rospy.init_node("teleop")
linear, angular = rospy.get_param("~linAxis", 1), rospy.get_param("~angAxis", 0)
v_max, radius_min = rospy.get_param("~linVelMax", 1.5), rospy.get_param("~radiusMin", 0.555)
last = [None, 0.0]
# by this computer's clock, as the joystick's may differ
rospy.Subscriber("joy", Joy, lambda told: last.__setitem__(slice(None), [told, rospy.get_time()]))
publisher = rospy.Publisher("cmd_vel", Twist, queue_size=1)
rate = rospy.Rate(10.0)
while not rospy.is_shutdown():
    command, (joy, at) = Twist(), last
    if joy is not None and rospy.get_time() - at < SILENCE and joy.buttons[0] == 1:
        command.linear.x = v_max * joy.axes[linear]
        command.angular.z = abs(command.linear.x) / radius_min * joy.axes[angular]
    publisher.publish(command)
    try:
        rate.sleep()
    except rospy.ROSInterruptException:
        break
'''


def frames() -> Iterator[tuple[str, str, float, float, float, float, float, float]]:
    """Yield the original's frames: parent, name, place in m, roll, pitch and yaw in rad.

    The IMU is turned: the original's sends its readings as they are, with z downwards.
    """
    for each in mounted(ORIGINAL)["transforms"]:
        name, (x, y, z) = each["child_frame_id"], (round(each["transform"]["translation"][axis], 6) for axis in "xyz")
        angle = pi if name == "base_imu_link" else 0.0
        # the original had no frame for its camera's pictures
        if "optical" not in name:
            yield each["header"]["frame_id"], name, x, y, z, angle, 0.0, angle


def files() -> dict[str, str]:
    """Return the package's files: their texts by their paths."""
    listed = "".join(f"    {each!r},\n" for each in frames())
    return {
        "package.xml": MANIFEST,
        "CMakeLists.txt": CMAKE,
        **{f"launch/{name}.launch": f"<launch>\n{text}</launch>\n" for name, text in LAUNCHES.items()},
        "bin/txt_tf": TF.format(frames=listed),
        "bin/txt_teleop": TELEOP,
    }
