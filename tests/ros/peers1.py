"""A program of ROS 1 beside the robot, run by Debian's Python: it prints what it saw as one line of JSON."""

import json
import os
import sys
import time

import rospy
import tf
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from txt_driver.msg import Battery, Pwm
from txt_driver.srv import PidLoad, PwmTest, Shutdown, SwitchedPwr, SwitchedPwrRequest

LIMIT = 120.0 * float(os.environ.get("TXT_PATIENCE", "1"))  # as in tests/patience.py, which this Python has not


def until(true, limit=LIMIT):
    ends = time.monotonic() + limit
    while not true():
        if time.monotonic() > ends:
            raise TimeoutError
        time.sleep(0.02)


def surface():
    odoms, batteries = [], []
    rospy.Subscriber("/odom", Odometry, lambda told: odoms.append((time.monotonic(), told)))
    rospy.Subscriber("/battery", Battery, lambda told: batteries.append((time.monotonic(), told)))
    frames = tf.TransformListener()
    drive = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    servos = rospy.Publisher("/pwm", Pwm, queue_size=1)
    until(lambda: len(odoms) > 10 and batteries)
    told = {"types": dict(rospy.get_published_topics())}
    services = {}
    for name, kind in (
        ("pid_load", PidLoad),
        ("pwm_change", PwmTest),
        ("switched_pwr", SwitchedPwr),
        ("shutdown_computer", Shutdown),
    ):
        rospy.wait_for_service(f"/{name}", 20.0)
        services[name] = rospy.ServiceProxy(f"/{name}", kind)
    told["pid_load"] = services["pid_load"]().result
    told["manual only"] = services["pwm_change"](24000, 12000, 0, -12000, -24000).result
    told["atx"] = services["switched_pwr"](SwitchedPwrRequest.SOURCE_ATX, True).result
    told["shutdown, armed"] = services["shutdown_computer"](True).result
    command = Twist()
    command.linear.x, command.angular.z = 0.5, 0.3
    del odoms[:]
    servos.publish(Pwm(12000, -24000))
    began = time.monotonic()
    while time.monotonic() < began + 3.0:
        drive.publish(command)
        time.sleep(0.1)
    moving = odoms[-1][1]
    told["rate"] = (len(odoms) - 1) / (odoms[-1][0] - odoms[0][0])
    told["frames"] = [moving.header.frame_id, moving.child_frame_id]
    told["v"], told["omega"] = moving.twist.twist.linear.x, moving.twist.twist.angular.z
    place, turn = frames.lookupTransform("/odom", "/base_footprint", rospy.Time(0))
    told["tf"] = [place[0], place[1], tf.transformations.euler_from_quaternion(turn)[2]]
    time.sleep(2.0)
    told["after"] = odoms[-1][1].twist.twist.linear.x
    told["battery"] = [batteries[-1][1].batt1, batteries[-1][1].batt2, batteries[-1][1].expected_time.to_sec()]
    told["batteries"] = (len(batteries) - 1) / (batteries[-1][0] - batteries[0][0])
    told["parameters"] = sorted(rospy.get_param("/txt1_node"))
    told["md5"] = {kind._type: kind._md5sum for kind in (Battery, Pwm, PidLoad, PwmTest, SwitchedPwr, Shutdown)}
    return told


def alive():
    """Whether odometry comes and commands move it."""
    odoms = []
    rospy.Subscriber("/odom", Odometry, odoms.append)
    drive = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    until(lambda: odoms)
    command = Twist()
    command.linear.x = -0.4
    until(lambda: drive.publish(command) or time.sleep(0.05) or odoms[-1].twist.twist.linear.x < -0.2)
    rospy.wait_for_service("/pid_load", 20.0)
    return rospy.ServiceProxy("/pid_load", PidLoad)().result


if __name__ == "__main__":
    rospy.init_node("peer", anonymous=True)
    print(json.dumps(globals()[sys.argv[1]]()), flush=True)
    rospy.signal_shutdown("done")
