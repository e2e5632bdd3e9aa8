"""What ROS is told: stamps judged, messages that both generations read, and a description that a parser reads."""

from __future__ import annotations

import asyncio
import json
import sys
from base64 import b64decode
from math import pi, tau
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from urdf_parser_py.urdf import URDF

from txt1.errors import ConfigError
from txt1.kernel.loop import run
from txt1.mapping.map_sensors import OnMap
from txt1.mapping.topics import MapNews, sheet_of
from txt1.maps.grid import Grid
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.record.cdr import MessageBuffer
from txt1.robot import Robot
from txt1.ros.calls import Calls
from txt1.ros.definitions import ACTIONS, SERVICES, own, write_package
from txt1.ros.publisher import PLAIN, Publisher, Told, Transforms
from txt1.ros.python import INSTALLED, ros2
from txt1.ros.stamps import Publishers, Stamps
from txt1.ros.topics import JOINTS, recorded, turned
from txt1.ros.urdf import robot_description
from txt1.sensors.base import Reading
from txt1.sensors.mounts import ORIGINAL, TO_OPTICAL
from txt1.sensors.readings import BASE_HEIGHT, OPTICAL, Mount, Scan
from txt1.telemetry.messages import DEFINITIONS, schema_name, schema_text
from txt1.telemetry.topics import Rule, Topic

STALE = 0.25
LASER = "sensor_msgs/msg/LaserScan"


@given(offset=st.floats(-1e5, 1e5), delays=st.lists(st.floats(0.0, 0.2), min_size=2, max_size=50))
def test_a_stamped_command_is_as_old_as_its_delay_beyond_the_shortest(offset: float, delays: list[float]) -> None:
    stamps = Stamps(STALE)
    shortest = 1.0
    for k, delay in enumerate(delays):
        sent = 100.0 + 0.1 * k
        age = stamps.age(sent + offset, sent + delay)
        if delay < shortest - 0.1:
            return  # so much sooner than all before that a clock may have been set
        shortest = min(shortest, delay)
        assert age == pytest.approx(delay - shortest, abs=0.002), "but for the drift that is allowed for"


def test_a_stamp_from_the_past_or_the_future_is_refused_and_counted() -> None:
    stamps = Stamps(STALE)
    assert stamps.age(100.0, 100.0) == 0.0
    assert stamps.age(99.0, 100.1) is None and stamps.refused["past"] == 1
    assert stamps.age(105.0, 100.2) is None and stamps.refused["future"] == 1
    assert stamps.age(100.3, 100.3) == pytest.approx(0.0, abs=1e-9)
    assert stamps.age(0.0, 100.4) == 0.0, "0 is no stamp"


@pytest.mark.parametrize("off", [70.0, -70.0, 86400.0, -86400.0])
def test_a_clock_that_is_far_off_is_no_reason_to_refuse(off: float) -> None:
    stamps = Stamps(STALE)
    ages = [stamps.age(1000.0 + off + 0.1 * k, 1000.0 + 0.1 * k) for k in range(20)]
    assert all(age is not None and age < 0.01 for age in ages)


@pytest.mark.parametrize("step", [0.3, -0.3, 5.0, -5.0, 70.0, -70.0, 86400.0, -86400.0])
def test_a_clock_that_is_set_in_mid_drive_stops_the_robot_for_less_than_a_second(step: float) -> None:
    stamps = Stamps(STALE)
    for k in range(20):
        assert stamps.age(1000.0 + 0.1 * k, 1000.0 + 0.1 * k) is not None
    ages = [stamps.age(1002.0 + step + 0.1 * k, 1002.0 + 0.1 * k) for k in range(10)]
    assert ages[:3] == [None] * 3, "longer than a command is good for"
    assert all(age is not None and age < 0.01 for age in ages[4:])


@pytest.mark.parametrize("gap", [0.5, 2.0, 60.0])
def test_a_burst_after_a_gap_moves_nothing_but_by_its_fresh_commands(gap: float) -> None:
    stamps = Stamps(STALE)
    for k in range(20):
        assert stamps.age(1000.0 + 0.05 * k, 1000.0 + 0.05 * k) is not None
    late = 1001.0 + gap
    sent = [1001.0 + 0.05 * k for k in range(round(gap / 0.05))]
    ages = [stamps.age(each, late + 1e-6 * k) for k, each in enumerate(sent)]
    for each, age in zip(sent, ages, strict=True):
        if late - each > STALE + 0.05:
            assert age is None
        elif age is not None:
            assert age == pytest.approx(late - each, abs=0.02)


@pytest.mark.parametrize("off", [-3.0, 3.0, 86400.0])
def test_a_stop_is_never_refused_whatever_its_stamp(off: float) -> None:
    stamps = Stamps(STALE)
    for k in range(20):
        stamps.age(1000.0 + 0.1 * k, 1000.0 + 0.1 * k)
    assert stamps.age(1002.0 + off, 1002.0) is None
    assert stamps.age(1002.0 + off, 1002.0, moves=False) == 0.0
    assert stamps.age(1002.1, 1002.1) == pytest.approx(0.0, abs=0.01), "and the driver before it is heard on"


def test_a_line_that_is_late_for_good_drives_nothing() -> None:
    stamps = Stamps(STALE)
    for k in range(20):
        stamps.age(1000.0 + 0.1 * k, 1000.0 + 0.1 * k)
    assert [stamps.age(1002.0 + 0.1 * k, 1004.0 + 0.1 * k) for k in range(100)] == [None] * 100


def test_two_publishers_are_told_apart_from_one_that_stutters() -> None:
    one, two = Publishers(), Publishers()
    for number in (1, 2, 3, 7, 8):
        one.take(number)
    for number in (1, 1, 2, 2, 3, 3):
        two.take(number)
    assert (one.mixed, one.lost) == (0, 3)
    assert two.mixed == 3


def _messages() -> list[str]:
    own()
    return sorted(DEFINITIONS)


@pytest.fixture(scope="module")
def store() -> Typestore:
    """The other library's types of ROS 2."""
    return get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize("message", _messages())
def test_every_message_is_read_by_another_library(message: str, store: Typestore) -> None:
    kind, text = schema_name(message), schema_text(message)
    found = get_types_from_msg(text, kind)
    for name, fields in found.items():
        if name in store.fielddefs:
            assert store.fielddefs[name][1] == fields[1], f"{name} is ROS's own, and has ROS's fields"
    store.register({name: fields for name, fields in found.items() if name not in store.fielddefs})
    data = bytes(MessageBuffer(message))
    read = store.deserialize_cdr(data, kind)
    assert bytes(store.serialize_cdr(read, kind)) == data


@pytest.mark.parametrize("steering", ["both", "front", "skid"])
def test_the_description_has_every_wheel_joint_and_sensor_in_its_place(steering: str) -> None:
    geometry = Geometry(steering=steering)  # type: ignore[arg-type]
    text = robot_description("txt03", geometry, ORIGINAL)
    robot = URDF.from_xml_string(text.partition("\n")[2])
    assert robot.get_root() == "base_footprint"
    assert {joint.name for joint in robot.joints} >= set(JOINTS)
    for link, mount in ORIGINAL:
        joint = robot.joint_map[f"{link}_joint"]
        assert (joint.parent, joint.type) == ("base_link", "fixed")
        assert joint.origin.xyz == pytest.approx([mount.x, mount.y, mount.z - BASE_HEIGHT])
    optical = robot.joint_map[f"{OPTICAL}_joint"]
    assert optical.parent == "base_camera_link" and optical.origin.rpy == pytest.approx([-tau / 4, 0.0, -tau / 4])
    moving = {joint.name for joint in robot.joints if joint.type == "revolute"}
    assert len(moving) == {"both": 4, "front": 2, "skid": 0}[steering]
    height = (
        robot.joint_map["base_link_joint"].origin.xyz[2] + robot.joint_map["rear_left_steering_joint"].origin.xyz[2]
    )
    assert height == pytest.approx(robot.link_map["rear_left_wheel"].visual.geometry.radius, abs=1e-5), "on the floor"


def test_a_laser_that_looks_back_is_described_so() -> None:
    text = robot_description("", Geometry(), (("base_behind_laser_link", Mount(-0.3, 0.02, BASE_HEIGHT, pi)),))
    origin = URDF.from_xml_string(text.partition("\n")[2]).joint_map["base_behind_laser_link_joint"].origin
    assert (origin.xyz, origin.rpy) == ([-0.3, 0.02, 0.0], [0.0, 0.0, pytest.approx(pi, abs=1e-5)])


def test_ros_is_told_where_each_laser_sits_before_its_first_scan() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    told: list[tuple[str, Any]] = []
    names: list[str] = []
    kinds = {"tf_static": "tf2_msgs/msg/TFMessage", "scan": LASER, "behind/scan": LASER}
    settings = [*(f"sensors.{name}.driver=sim_laser" for name in ("laser", "behind")), "obstacle_stop.sensor=laser"]

    async def listen() -> None:
        async with Robot.open("sim", seed=1, settings=settings) as robot:
            feed = Publisher(robot.runtime, print)
            channels: dict[int, str] = {}
            feed.begin()

            def hear() -> None:
                line = json.loads(feed.line({}) or b"")
                names.extend(name for _, name, _, _ in line.get("new", ()))
                channels.update({number: name for number, name, _, _ in line.get("new", ())})
                for number, _, data in line["messages"]:
                    if (name := channels[number]) in kinds:
                        told.append((name, store.deserialize_cdr(b64decode(data), kinds[name])))

            await asyncio.sleep(0.5)
            hear()
            rear = robot.runtime.sensors["behind"].sensor.topic
            scan = Scan(0.0, 0.1, 0.0, np.ones(3, np.float32), 0.1, 4.0, mount=Mount(-0.3, 0.0, BASE_HEIGHT, pi))
            robot.runtime.bus.publish(rear, scan, robot.now)
            hear()

    run(listen(), speed="max")
    known: set[str] = set()
    for name, message in told:
        if name == "tf_static":
            known |= {each.child_frame_id for each in message.transforms}
        else:
            assert message.header.frame_id in known, "a scan without a frame is lost in RViz and slam_toolbox"
    assert known == {"base_link", "base_laser_link", "base_behind_laser_link"}
    assert names.count("tf_static") == names.count("robot_description") == 1, "one publisher each"
    last = [message for name, message in told if name == "tf_static"][-1].transforms
    assert [each.child_frame_id for each in last] == ["base_link", "base_laser_link", "base_behind_laser_link"]
    assert last[-1].transform.translation.x == -0.3 and last[-1].transform.rotation.z == pytest.approx(1.0)
    assert {message.header.frame_id for name, message in told if name == "behind/scan"} == {"base_behind_laser_link"}


def test_a_camera_s_optical_frame_has_z_ahead_and_x_to_the_right() -> None:
    x, y, z, w = (TO_OPTICAL[axis] for axis in "xyzw")
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert turn @ (0.0, 0.0, 1.0) == pytest.approx([1.0, 0.0, 0.0]), "z ahead"
    assert turn @ (1.0, 0.0, 0.0) == pytest.approx([0.0, -1.0, 0.0]), "x to the right"


def test_a_left_turn_turns_the_front_wheels_left() -> None:
    front, rear = turned(-STEERING_MAX, STEERING_MAX, Geometry())
    assert front == pytest.approx(Geometry().steering_max) and rear == -front
    assert turned(-STEERING_MAX, STEERING_MAX, Geometry(steering="front"))[1] == 0.0


def test_what_moves_in_the_description_has_a_mass_of_a_cars_size() -> None:
    f1tenth = Geometry(steering="front", wheelbase=0.33, circumference=0.33, length=0.58, width=0.31, centre=0.165)
    for geometry, published in ((Geometry(), None), (f1tenth, 3.74)):
        robot = URDF.from_xml_string(robot_description("", geometry, ORIGINAL).partition("\n")[2])
        assert robot.link_map["base_footprint"].inertial is None, "KDL refuses a root with a mass"
        inertial = [robot.link_map[joint.child].inertial for joint in robot.joints if joint.type != "fixed"]
        inertial.append(robot.link_map["base_link"].inertial)
        for each in inertial:
            i = each.inertia
            assert each.mass > 0.0 and i.ixx > 0.0
            assert max(i.ixx, i.iyy, i.izz) < i.ixx + i.iyy + i.izz - max(i.ixx, i.iyy, i.izz) + 1e-9, "a body's"
        mass = sum(link.inertial.mass for link in robot.links if link.inertial is not None)
        assert 2.0 < mass < 8.0
        if published is not None:
            assert mass == pytest.approx(published, rel=0.15)


def test_the_package_of_our_messages_names_every_file(tmp_path: Path) -> None:
    package = write_package(tmp_path, "txt1_msgs", own(), "messages")
    listed = (package / "CMakeLists.txt").read_text()
    files = [path for path in package.rglob("*") if path.suffix in (".msg", ".srv", ".action")]
    assert all(f'"{path.relative_to(package)}"' in listed for path in files)
    assert {"Pwm", "Mode", "Driver", *SERVICES, *ACTIONS} <= {path.stem for path in files}


BROKEN = Topic(
    "/broken", str, "", "geometry_msgs/PoseStamped", Rule.EVENT, "", {}, ("pose.position.x",), lambda x: (x,)
)


def test_a_value_that_is_no_message_is_told_once_and_costs_no_other_topic() -> None:
    said: list[str] = []
    names: set[str] = set()

    async def listen() -> None:
        async with Robot.open("sim", seed=1) as robot:
            feed = Publisher(robot.runtime, said.append)
            feed.begin()
            for _ in range(3):
                await asyncio.sleep(0.1)
                robot.runtime.bus.publish(BROKEN, "no number", robot.now)
                line = json.loads(feed.line({}) or b"")
                names.update(name for _, name, _, _ in line.get("new", ()))
                assert len(line["messages"]) > 10

    run(listen(), speed="max")
    assert {"odom", "tf", "tf_static", "joint_states", "robot_description", "~/setpoint"} <= names
    assert len(said) == 1 and "/broken" in said[0]


def test_a_time_of_day_that_is_set_announces_the_channels_again(monkeypatch: pytest.MonkeyPatch) -> None:
    set_by = 0.0

    async def body() -> None:
        nonlocal set_by
        async with Robot.open("sim") as robot:
            feed = Publisher(robot.runtime, print)
            monkeypatch.setattr(feed, "virtual", False)
            monkeypatch.setattr("txt1.ros.publisher.wall_ns", lambda: round((robot.now + set_by) * 1e9))
            feed.begin()
            channels, stamps = [], []
            for day in (100.0, 100.0, 30.0, 86_400.0):
                set_by = day
                await asyncio.sleep(0.1)
                told = json.loads(feed.line({}) or b"{}")
                channels.append({name for _, name, _, _ in told["new"]} & {"odom", "tf"})
                stamps.append(min(time for _, time, _ in told["messages"]) / 1e9)
            assert channels == [{"odom", "tf"}, set(), {"odom", "tf"}, {"odom", "tf"}]
            assert stamps == pytest.approx([101.0, 101.1, 31.2, 86_401.3], abs=0.2), "the robot runs for a second"
            feed.end()

    run(body(), speed="max")


def test_a_recording_is_published_under_the_names_of_a_run() -> None:
    assert recorded("/odom", "nav_msgs/Odometry", ()) == ("odom", "default")
    assert recorded("/mode", "txt1_msgs/Mode", ()) == ("~/mode", "latched")
    assert recorded("/tf_room", "tf2_msgs/TFMessage", ()) == ("tf", "default")
    assert recorded("/input", "txt1_msgs/Input", ()) is None
    assert recorded("/sensors/front", "sensor_msgs/LaserScan", ()) == ("scan", "sensor")
    assert recorded("/sensors/rear", "sensor_msgs/LaserScan", {"scan"}) == ("~/sensors/rear", "sensor")


def test_the_ros_2_of_the_shell_comes_first_and_one_too_old_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("TXT1_ROS2_HOME", str(tmp_path))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    if not INSTALLED.exists():
        with pytest.raises(ConfigError, match=r"no ROS 2 on this machine: install ROS 2 .* or 'txt1 ros2 install'"):
            ros2()
        (tmp_path / "bin").mkdir()
        (tmp_path / "bin" / "python").touch()
        assert ros2().ours and ros2().program[0] == str(tmp_path / "bin" / "python")
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
    monkeypatch.setenv("PYTHONPATH", "/opt/ros/jazzy/lib/python3.12/site-packages")
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setattr(sys, "prefix", "/home/anna/venv")
    monkeypatch.setenv("PATH", "/home/anna/venv/bin:/opt/ros/jazzy/bin:/usr/bin")
    found = ros2()
    assert found.environment["PATH"] == "/opt/ros/jazzy/bin:/usr/bin", "its python3, not that of our environment"
    assert found.program[0] == "python3" and found.environment["PYTHONPATH"].startswith("/opt/ros/jazzy")
    monkeypatch.setenv("ROS_DISTRO", "foxy")
    with pytest.raises(ConfigError, match=r"this shell's is foxy: source Humble or later"):
        ros2()


@pytest.mark.parametrize("fields", [{}, {"x": 10**400}, {"y": 1}])
def test_whatever_a_node_calls_for_is_answered_and_does_not_end_the_run(fields: dict[str, object]) -> None:
    async def main() -> list[tuple[int, bool, str]]:
        unexpected: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: unexpected.append(context))
        calls = Calls({"turn": lambda x: float(x)})
        calls.call(1, "turn", fields)
        calls.call(2, "turn", {"x": 2})
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        assert not unexpected
        return calls.take()

    first, second = asyncio.run(main())
    assert first[:2] == (1, False) and "Error" in first[2]
    assert second == (2, True, "2.0")


SURE = (1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4)
ESTIMATE = ("sensors.imu.driver=sim_imu", "estimation.preset=gyro")


def frames(
    told: Told, *settings: str, other: bool = False, lost: bool | None = None
) -> tuple[dict[str, str], list[str], list[str]]:
    """What a node tells in a second: frames by their child, names of diagnostics, and what the operator hears.

    `lost` says whether the robot is lost on its map; None: it has none.
    """
    said: list[str] = []
    store = get_typestore(Stores.ROS2_JAZZY)
    found: dict[str, str] = {}
    names: list[str] = []

    def take(name: str, data: bytes) -> None:
        if name in ("tf", "tf_static"):
            message: Any = store.deserialize_cdr(data, "tf2_msgs/msg/TFMessage")
            found.update((each.child_frame_id, each.header.frame_id) for each in message.transforms)
        elif name in ("odom", "imu/data", "joint_states"):
            kind = {"odom": "nav_msgs/msg/Odometry", "imu/data": "sensor_msgs/msg/Imu"}.get(name)
            message = store.deserialize_cdr(data, kind or "sensor_msgs/msg/JointState")
            found[f"in {name}"] = message.header.frame_id
        elif name == "/diagnostics":
            message = store.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray")
            names.extend(each.name for each in message.status)

    async def listen() -> None:
        async with Robot.open("sim", seed=1, settings=settings) as robot:
            if lost is not None:
                there = OnMap(robot.runtime, False, None)
                robot.runtime.parts.append(there)
                there.heard(Reading(0.0, MapNews(0.0, (3.0, 0.0, 0.0), SURE, (3.0, 0.0, 0.0), 0.9, lost)))
            feed = Publisher(robot.runtime, said.append, told)
            feed.begin()
            if other:
                for _ in range(2):
                    feed.parent("map", "slam_toolbox")
            channels: dict[int, str] = {}
            for _ in range(20):
                await asyncio.sleep(0.1)
                line = json.loads(feed.line({}) or b"")
                channels |= {number: name for number, name, _, _ in line.get("new", ())}
                for number, _, data in line["messages"]:
                    take(channels[number], b64decode(data))

    run(listen(), speed="max")
    return found, names, said


def test_odom_stands_in_the_map_while_the_robot_knows_its_place_on_it() -> None:
    assert frames(Told("auto"), *ESTIMATE, lost=False)[0]["odom"] == "map"
    assert "odom" not in frames(Told("auto"), *ESTIMATE, lost=True)[0]
    assert "odom" not in frames(Told("odom"), lost=False)[0]


async def told_late() -> list[tuple[str, str]]:
    async with Robot.open("sim", seed=1) as robot:
        there = OnMap(robot.runtime, False, None)
        sheet = sheet_of(Grid(np.zeros((4, 4), np.int8), 0.05))
        there.heard(Reading(0.0, MapNews(0.0, (0.0, 0.0, 0.0), SURE, (0.0, 0.0, 0.0), 0.9, False, sheet=sheet)))
        await asyncio.sleep(1.0)
        feed = Publisher(robot.runtime, print)
        feed.begin()
        await asyncio.sleep(0.1)
        return [(name, quality) for _, name, _, quality in json.loads(feed.line({}) or b"")["new"]]


def test_a_node_that_comes_late_is_told_the_map_under_the_name_that_others_look_for() -> None:
    told = run(told_late(), speed="max")
    assert ("map", "latched") in told and not any("tf_map" in name for name, _ in told)


@pytest.mark.parametrize(
    ("transforms", "settings", "above"),
    [
        ("auto", (), "room"),
        ("auto", ESTIMATE, "map"),
        ("map", ESTIMATE, "map"),
        ("room", ESTIMATE, "room"),
        ("odom", ESTIMATE, None),
        ("none", (), None),
    ],
)
def test_what_odom_stands_in_is_told_as_asked(
    transforms: Transforms, settings: tuple[str, ...], above: str | None
) -> None:
    found, _, _ = frames(Told(transforms), *settings)
    assert found.get("odom") == above
    assert found.get("base_footprint") == (None if transforms == "none" else "odom")


def test_the_robot_gives_way_to_a_program_that_tells_where_odom_is() -> None:
    found, _, said = frames(PLAIN, other=True)
    assert "odom" not in found and found["base_footprint"] == "odom"
    assert said == [": slam_toolbox tells map -> odom, so the robot tells no frame above odom now"]
    found, _, said = frames(Told("room"), other=True)
    assert found["odom"] == "room" and said == [], "it was asked for"


def test_frames_and_diagnostics_can_have_the_namespaces_name() -> None:
    found, names, _ = frames(Told(prefix="car1/", owner="car1"), "sensors.imu.driver=sim_imu")
    assert found["car1/base_footprint"] == "car1/odom" and found["car1/odom"] == "car1/room"
    assert found["car1/base_imu_link"] == "car1/base_link"
    assert found["in odom"] == "car1/odom" and found["in imu/data"] == "car1/base_imu_link"
    assert all(name.startswith("car1/") for name in found if not name.startswith("in "))
    assert names and all(name.startswith("car1: ") for name in names)
    plain, names, _ = frames(PLAIN)
    assert not any("/" in name for name in plain) and "task controller" in names
