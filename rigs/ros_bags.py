"""Bags of a drive round a room, written by rosbags itself as ROS 1 and ROS 2 write them."""

from __future__ import annotations

from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SIDE = 4.0
"""m, the room's; a box stands in a corner."""
MOUNT = (0.2, 0.05, 0.5)
"""The laser's place on the robot: x, y (m), yaw (rad)."""
BEAMS = np.linspace(-2.0, 2.0, 201)


def ranges_at(pose: np.ndarray) -> np.ndarray:
    """What a laser at a pose measures in the room."""
    angles = pose[2] + BEAMS
    dx, dy = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        to_x = (np.where(dx > 0.0, SIDE, -SIDE) / 2.0 - pose[0]) / dx
        to_y = (np.where(dy > 0.0, SIDE, -SIDE) / 2.0 - pose[1]) / dy
        found = np.minimum(to_x, to_y)
        # the box: x above 1, y above 0.6
        for edge, along, across, at, limit in ((1.0, dx, dy, pose[0], 0.6), (0.6, dy, dx, pose[1], 1.0)):
            far = (edge - at) / along
            other = (pose[1] if at == pose[0] else pose[0]) + far * across
            found = np.where((far > 0.0) & (along > 0.0) & (other > limit), np.minimum(found, far), found)
    return found


def poses(count: int) -> np.ndarray:
    """Poses of the robot, 2 cm apart on a circle."""
    turn = 0.04 * np.arange(count)
    return np.column_stack((0.5 * np.sin(turn), -0.5 * np.cos(turn), turn))


def bag(path: Path, kind: str, odometry: str = "odom", count: int = 170) -> Path:
    """Write a bag; `kind`: ros1, sqlite3 or mcap; `odometry`: odom, tf or none."""
    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    types = store.types
    if ros1:
        writer: Any = Writer1(path)
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[kind.upper()])

    def header(stamp: float, frame: str) -> Any:
        time = types["builtin_interfaces/msg/Time"](sec=int(stamp), nanosec=int(1e9 * (stamp % 1.0)))
        more = {"seq": 0} if ros1 else {}
        return types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **more)

    def transform(stamp: float, parent: str, child: str, x: float, y: float, theta: float) -> Any:
        vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
        turn = quaternion(x=0.0, y=0.0, z=sin(theta / 2.0), w=cos(theta / 2.0))
        step = types["geometry_msgs/msg/Transform"](translation=vector(x=x, y=y, z=0.1), rotation=turn)
        made = types["geometry_msgs/msg/TransformStamped"](header(stamp, parent), child, step)
        return types["tf2_msgs/msg/TFMessage"](transforms=[made])

    with writer:
        names = {"/scan": "sensor_msgs/msg/LaserScan", "/tf_static": "tf2_msgs/msg/TFMessage"}
        if odometry == "odom":
            names["/odom"] = "nav_msgs/msg/Odometry"
        if odometry == "tf":
            names["/tf"] = "tf2_msgs/msg/TFMessage"
        lines = {name: writer.add_connection(name, each, typestore=store) for name, each in names.items()}

        def put(name: str, stamp: float, message: Any) -> None:
            data = store.serialize_ros1(message, names[name]) if ros1 else store.serialize_cdr(message, names[name])
            writer.write(lines[name], int(1e9 * stamp), data)

        put("/tf_static", 1000.0, transform(1000.0, "base_link", "laser", *MOUNT))
        c, s = np.cos, np.sin
        for k, pose in enumerate(poses(count)):
            stamp = 1000.0 + 0.1 * k
            x, y, theta = pose.tolist()
            if odometry == "odom":
                put("/odom", stamp, _odometry(types, header(stamp, "odom"), x, y, theta))
            if odometry == "tf":
                put("/tf", stamp, transform(stamp, "odom", "base_link", x, y, theta))
            laser = np.array(
                (
                    x + c(theta) * MOUNT[0] - s(theta) * MOUNT[1],
                    y + s(theta) * MOUNT[0] + c(theta) * MOUNT[1],
                    theta + MOUNT[2],
                )
            )
            scan = types["sensor_msgs/msg/LaserScan"](
                header=header(stamp, "laser"),
                angle_min=float(BEAMS[0]),
                angle_max=float(BEAMS[-1]),
                angle_increment=float(BEAMS[1] - BEAMS[0]),
                time_increment=0.0,
                scan_time=0.1,
                range_min=0.05,
                range_max=10.0,
                ranges=ranges_at(laser).astype(np.float32),
                intensities=np.zeros(0, np.float32),
            )
            put("/scan", stamp, scan)
    return path


def _odometry(types: Any, header: Any, x: float, y: float, theta: float) -> Any:
    vector, zeros = types["geometry_msgs/msg/Vector3"], np.zeros(36)
    place = types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=sin(theta / 2.0), w=cos(theta / 2.0))
    still = vector(x=0.0, y=0.0, z=0.0)
    pose = types["geometry_msgs/msg/PoseWithCovariance"](types["geometry_msgs/msg/Pose"](place, turn), zeros)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](still, still), zeros)
    return types["nav_msgs/msg/Odometry"](header, "base_link", pose, twist)
