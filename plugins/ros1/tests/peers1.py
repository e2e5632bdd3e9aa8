"""A program of ROS 1 beside the robot, run by Debian's Python: it prints what it saw as one line of JSON."""

import json
import os
import sys
import time

import genmsg
import genpy.dynamic
import rospy
import tf
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CameraInfo, CompressedImage, Imu, Joy, LaserScan, NavSatFix, PointCloud2
from tf2_msgs.msg import TFMessage
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
    told["frames"] = [moving.header.frame_id, moving.child_frame_id, batteries[-1][1].header.frame_id]
    told["unsure"] = [moving.pose.covariance[place] for place in range(0, 36, 7)]
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


def std_service(name, kind, request):
    """A service of std_srvs, whose package need not be here: `request` are its fields."""
    context = genmsg.MsgContext.create_default()
    answer = "bool success\nstring message\n"
    spec = genmsg.msg_loader.load_srv_from_string(context, f"{request}---\n{answer}", f"std_srvs/{kind}")
    made = {
        part: genpy.dynamic.generate_dynamic(f"std_srvs/{kind}{part}", text)[f"std_srvs/{kind}{part}"]
        for part, text in (("Request", request), ("Response", answer))
    }
    known = {"Trigger": "937c9679a518e3a18d831e57125ea522", "SetBool": "09fb03525b03e7ea1fd3992bafd87e16"}
    assert genmsg.compute_md5(context, spec) == known[kind]
    fields = {"_type": f"std_srvs/{kind}", "_md5sum": known[kind]}
    fields |= {f"_{part.lower()}_class": kind_of for part, kind_of in made.items()}
    rospy.wait_for_service(name, LIMIT)
    return rospy.ServiceProxy(name, type(kind, (), fields))


def gate():
    """Disarm and arm, go to manual mode and back; whether each was done, and what then was not."""
    disarm, arm = (std_service(name, "Trigger", "") for name in ("/disarm", "/arm"))
    manual, pwm = std_service("/manual", "SetBool", "bool data\n"), rospy.ServiceProxy("/pwm_change", PwmTest)
    done = {"disarm": disarm().success, "arm": arm().success, "manual": manual(True).success}
    done["pwm"] = pwm(0, 0, 0, 0, 0).result
    done["controller"] = manual(False).success
    return done, {"pwm": pwm(0, 0, 0, 0, 0).result}


def sensors():
    """A message of each sensor, as far as its numbers tell that it is the right one, and where it sits."""
    heard = {}
    for name, kind in (("scan", LaserScan), ("imu/data", Imu), ("fix", NavSatFix)):
        rospy.Subscriber(f"/{name}", kind, lambda told, name=name: heard.setdefault(name, []).append(told))
    rospy.Subscriber("/camera/image_raw/compressed", CompressedImage, lambda told: heard.setdefault("picture", told))
    rospy.Subscriber("/camera/camera_info", CameraInfo, lambda told: heard.setdefault("info", told))
    rospy.Subscriber("/camera/depth/points", PointCloud2, lambda told: heard.setdefault("points", told))
    rospy.Subscriber("/tf_static", TFMessage, lambda told: heard.setdefault("static", told))
    until(lambda: len(heard) == 7 and all(len(heard[name]) > 5 for name in ("scan", "imu/data", "fix")))
    scan, imu, fix = (heard[name][-1] for name in ("scan", "imu/data", "fix"))
    frames = {each.child_frame_id: each.header.frame_id for each in heard["static"].transforms}
    return {
        "scan": [scan.header.frame_id, len(scan.ranges), round(scan.scan_time, 4)],
        "imu": [imu.header.frame_id, imu.linear_acceleration.z, list(imu.angular_velocity_covariance)],
        "fix": [fix.header.frame_id, fix.latitude, fix.position_covariance_type],
        "picture": [heard["picture"].format, heard["picture"].data[:2].hex(), len(heard["info"].K)],
        "points": [heard["points"].width, len(heard["points"].data), [each.name for each in heard["points"].fields]],
        "frames": frames,
        "late": time.time() - scan.header.stamp.to_sec(),
    }


def ignored():
    """What /rosout says, and how loudly, to a program that drives a robot that nobody armed."""
    heard = []
    rospy.Subscriber("/rosout", Log, heard.append)
    drive = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    command = Twist()
    command.linear.x = 0.4

    def told():
        return [each for each in heard if "are ignored" in each.msg]

    until(lambda: drive.publish(command) or time.sleep(0.1) or told())
    for _ in range(10):
        drive.publish(command)
        time.sleep(0.1)
    return [[each.level == Log.WARN, each.name, each.msg] for each in told()]


def frames():
    """The frames of /tf without rotation of the wheels: parent, x, y, z and the angles of each."""
    heard = {}

    def note(told):
        for each in told.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            angles = tf.transformations.euler_from_quaternion((turn.x, turn.y, turn.z, turn.w))
            heard[each.child_frame_id] = [each.header.frame_id, place.x, place.y, place.z, list(map(abs, angles))]

    rospy.Subscriber("/tf", TFMessage, note)
    rospy.Subscriber("/tf_static", TFMessage, note)
    until(lambda: "base_imu_link" in heard and "base_gps_link" in heard)
    until(lambda: "/base_link" in heard or "base_link" in heard)
    return {name.lstrip("/"): [each[0].lstrip("/"), *each[1:]] for name, each in heard.items()}


def joystick():
    """What teleop commands: dead-man held, let go, and held by a joystick that falls silent."""
    heard, told = [], {}
    pad = rospy.Publisher("/joy", Joy, queue_size=1)
    rospy.Subscriber("/cmd_vel", Twist, lambda twist: heard.append([twist.linear.x, twist.angular.z]))

    def commanded(buttons, expected):
        until(
            lambda: (
                (buttons is not None and pad.publish(Joy(axes=[-0.5, 0.5], buttons=buttons)))
                or time.sleep(0.05)
                or (len(heard) > 3 and all(abs(each[0] - expected) < 1e-6 for each in heard[-3:]))
            )
        )
        return heard[-1]

    told["held"] = commanded([1], 0.75)
    told["let go"] = commanded([0], 0.0)
    commanded([1], 0.75)
    told["silent"] = commanded(None, 0.0)
    return told


def stop():
    """Stop it, and arm it again; whether each was done."""
    return [std_service("/stop", "Trigger", "")().success, std_service("/arm", "Trigger", "")().success]


if __name__ == "__main__":
    rospy.init_node("peer", anonymous=True)
    print(json.dumps(globals()[sys.argv[1]]()), flush=True)
    rospy.signal_shutdown("done")
