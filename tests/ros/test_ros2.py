"""Programs of ROS 2 and the robot, each in a process of its own. `make test-ros` installs the peers."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import radians, tan
from pathlib import Path
from typing import Any

import pytest

from benchmarks.ros import child
from rigs.ports import free_port
from tests.patience import LIMIT, TXT1, S, wait_until
from tests.ros.network import GUEST, HOST, plug_in, pull_out, two_computers, within
from txt1.driver import REFRESH
from txt1.errors import ConfigError
from txt1.record.reader import Decoding, FilePass
from txt1.ros.install import outdated
from txt1.ros.python import RosPython, clean, home, ros2

pytestmark = pytest.mark.long
HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@pytest.fixture(scope="module")
def ros() -> RosPython:
    """The Python that has ROS 2."""
    try:
        found = ros2()
    except ConfigError as error:
        pytest.skip(f"did not run: no ROS 2: {error}")
    if found.ours and outdated(home()):
        pytest.skip("did not run: the types of ROS 2 here are of other definitions: run 'txt1 ros2 install' again")
    return found


@pytest.fixture(scope="module")
def domain(worker_id: str) -> dict[str, str]:
    """A domain of ROS 2 that no other test uses, on this computer alone."""
    number = 100 + (int(worker_id.removeprefix("gw")) if worker_id.startswith("gw") else 10)
    return {"ROS_DOMAIN_ID": str(number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": "/tmp/txt1-ros"}


@contextmanager
def robot(domain: dict[str, str], *words: str, place: Sequence[str] = ()) -> Iterator[subprocess.Popen[str]]:
    """`txt1 run --ros2`; its output is read when it has ended."""
    command = [*place, *TXT1, "run", "--headless", "--seed", "1", "--ros2", *words]
    room = ["--set", "sim.room.length=20", "--set", "sim.room.width=20"]
    process = subprocess.Popen(
        [*command, *room],
        env={**os.environ, **domain, "PYTHONPATH": str(ROOT)},
        text=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        yield process
    finally:
        process.terminate()
        said, _ = process.communicate(timeout=LIMIT)
        print(said)


def ask(
    ros: RosPython,
    domain: dict[str, str],
    scenario: str,
    *words: str,
    limit: float = 2.0 * LIMIT,
    place: Sequence[str] = (),
) -> Any:
    """What a peer saw."""
    command = [*place, *ros.program, str(HERE / "peers2.py"), scenario, *words]
    done = subprocess.run(command, env={**ros.environment, **domain}, capture_output=True, text=True, timeout=limit)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>'
    '<Discovery><Peers><Peer address="127.0.0.1"/></Peers><ParticipantIndex>auto</ParticipantIndex></Discovery>'
    "</Domain></CycloneDDS>"
)
"""cyclonedds on this computer alone, as ROS_AUTOMATIC_DISCOVERY_RANGE has it of ROS."""
SENSORS = (
    "--set",
    "sensors.imu.driver=sim_imu",
    "--set",
    "sensors.laser.driver=sim_laser",
    "--set",
    "sensors.camera.driver=sim_camera",
    "--set",
    "sensors.depth.driver=sim_depth",
    "--set",
    "sensors.gps.driver=sim_gps",
    "--set",
    "estimation.preset=gyro",
)


def test_a_left_circle_has_the_signs_of_rep_103_in_every_frame(ros: RosPython, domain: dict[str, str]) -> None:
    with robot(domain, *SENSORS):
        told = ask(ros, domain, "circle")
    x, y, theta, v, omega = told["odom"]
    assert told["setpoint"] == pytest.approx([0.5, 0.5])
    assert x > 0.0 and y > 0.0 and theta > 0.0 and v > 0.3 and omega > 0.2
    assert told["odom_frames"] == ["odom", "base_footprint"]
    assert 0.0 <= told["stamp_age"] < 1.0
    assert told["tf"][0] > 0.0 and told["tf"][1] > 0.0
    assert told["gyro"] > 0.2 and told["imu_frame"] == "base_imu_link"
    assert told["scan"] > 100 and told["scan_frame"] == "base_laser_link"
    joints = told["joints"]
    assert joints["front_left_wheel_joint"] > 0.0
    assert joints["front_left_steering_joint"] > 0.0 > joints["rear_left_steering_joint"]
    assert told["pwm"][0] > 0 > told["pwm"][1], "front steering: right is positive"
    assert 9.0 < told["battery"] < 13.0
    frames = told["frames"]
    assert frames["odom"] == "map" and frames["base_footprint"] == "odom", "REP 105: one parent each, from the map down"
    assert frames["base_link"] == "base_footprint"
    assert frames["base_laser_link"] == frames["base_imu_link"] == frames["base_camera_link"] == "base_link"
    assert told["static"]["base_imu_link"] == pytest.approx([-0.1016, 0.3187])
    width, height, f, x, y, frame = told["depth"]
    assert (x, y) == ((width - 1) / 2, (height - 1) / 2) and f == pytest.approx(0.5 * width / tan(radians(30.0)))
    assert frame == "base_camera_optical_link" and told["pairs"] > 5, (
        "a picture and how it was seen have the same stamp"
    )
    assert told["points"] == [width, height, 12 * width * height, frame]
    assert told["picture"] == [160, 120, 0.0], "nobody has calibrated it"
    assert -90.0 < told["fix"][0] < 90.0 and told["fix"][0] != 0.0
    measured, filtered = told["filtered"]
    assert filtered == pytest.approx(measured, abs=0.15)
    assert told["diagnostics"] > 0 and "<robot" in told["description"]
    assert all(0.0 < each < 1.0 for each in told["odom_covariance"])


def test_a_viewer_of_reliable_topics_sees_sensors_with_the_namespace_s_frames(
    ros: RosPython, domain: dict[str, str]
) -> None:
    with robot(domain, *SENSORS, "--ros2-namespace", "car1", "--ros2-prefix"):
        told = ask(ros, domain, "viewer")
    assert told["frames"]["car1/odom"] == "car1/map" and told["frames"]["car1/base_footprint"] == "car1/odom"
    assert all(name.startswith("car1/") for name in told["frames"])
    assert told["scan"] == ["car1/base_laser_link", pytest.approx(0.1)]
    frame, rate, roll = told["imu"]
    assert frame == "car1/base_imu_link" and 0.0 < rate < 1e-3 and 0.0 < roll < 1e-3
    assert {"car1: cmd_vel", "car1: task controller"} <= set(told["names"])


def test_a_mapper_gets_the_frame_above_odom_for_itself(ros: RosPython, domain: dict[str, str]) -> None:
    with robot(domain):
        told = ask(ros, domain, "mapper")
    assert told["map odom"] >= 15 and told["odom base_footprint"] >= 60
    assert "room odom" not in told, "a frame has one parent"


def test_services_and_parameters_are_checked_as_on_the_command_line(ros: RosPython, domain: dict[str, str]) -> None:
    with robot(domain, "--no-arm"):
        told = ask(ros, domain, "services")
    assert told["arm"] and told["arm: armed"]
    assert told["load_gains"] and told["disarm"] and not told["disarm: armed"]
    assert told["stop"] and told["manual"] and told["mode"] == "manual" and told["esc"]
    assert told["place"] == [True, ""]
    assert not told["far"][0] and told["far"][1]
    assert told["kp"] == [True, ""] and told["angular"] == [True, ""] and told["v_max"] == [True, ""]
    assert not told["falling"][0] and "rise" in told["falling"][1]
    assert not told["too fast"][0] and "safety.v_max" in told["too fast"][1]
    assert not told["safety"][0]


def test_combined_odometry_is_taken_while_it_comes_and_servos_stay(ros: RosPython, domain: dict[str, str]) -> None:
    with robot(domain):
        told = ask(ros, domain, "inputs")
    assert (told["before"], told["during"], told["after"]) == (False, True, False)
    assert told["servos"] == [1200, -2400]


def test_it_drives_to_a_pose_tells_how_far_it_is_and_can_be_called_back(ros: RosPython, domain: dict[str, str]) -> None:
    succeeded, cancelled, aborted = 4, 5, 6  # ROS's numbers of a goal's end
    with robot(domain):
        told = ask(ros, domain, "goal")
    status, arrived, _, x, y = told["there"]
    assert status == succeeded and arrived
    assert (x, y) == pytest.approx((1.2, 0.4), abs=0.05)
    assert len(told["feedback"]) > 5 and told["feedback"][0] > 1.0 > told["feedback"][-1]
    assert told["cancelled"][0] == cancelled and told["rests"] == pytest.approx(0.0, abs=0.02)
    assert told["nowhere"][0] == aborted and "moon" in told["nowhere"][2]


def test_stamps_of_the_past_the_future_and_no_numbers_are_refused_and_counted(
    ros: RosPython, domain: dict[str, str]
) -> None:
    with robot(domain, "--ros2-stamped"):
        told = ask(ros, domain, "stamped")
    assert told["now"] == told["again"] == told["unstamped"] == pytest.approx(0.4)
    assert told["-1.0"] == told["20.0"] == told["-3.0"] == told["40.0"] == 0.0
    assert told["not a number"] == 0.0
    assert told["set"] and told["plain"] == pytest.approx(0.4), "a Twist after all, by the parameter"
    assert told["counts"]["from_the_past"] == 2 and told["counts"]["from_the_future"] == 2


def test_commands_of_another_clock_are_driven_and_a_step_of_it_is_a_stop(
    ros: RosPython, domain: dict[str, str]
) -> None:
    with robot(domain, "--ros2-stamped"):
        told = ask(ros, domain, "clocks")
    assert told["stopped"] < 2.0, "a clock that is set in a drive is a stop"
    assert told["again"] < 2.0, "and fresh commands drive on, after half a second on an idle computer"
    assert told["stands"] and not told["burst"], "old commands that come at once move nothing"
    assert told["after"] < 2.0


def test_two_publishers_are_told_apart_from_one_that_stutters(ros: RosPython, domain: dict[str, str]) -> None:
    with robot(domain) as process:
        told = ask(ros, domain, "two")
    assert told["alone"]["publishers"] == 1 and told["alone"]["mixed"] == 0 and told["alone"]["level"] == 0
    assert told["both"]["publishers"] == 2 and told["both"]["mixed"] > 5 and told["both"]["level"] == 1
    assert process.returncode is not None


@pytest.mark.parametrize(
    ("settings", "hertz", "most"),
    [((), "10", 0.25), (("--set", "commander.timeouts.ros=0.12"), "20", 0.12 + REFRESH)],
    ids=["as_it_is", "sooner"],
)
def test_the_death_of_who_drives_is_neutral_in_a_quarter_second_and_a_tick(
    ros: RosPython, domain: dict[str, str], tmp_path: Path, settings: Sequence[str], hertz: str, most: float
) -> None:
    file = tmp_path / "run.mcap"
    with robot(domain, "--log", str(file), *settings):
        command = [*ros.program, str(HERE / "peers2.py"), "drive_and_die", hertz]
        died = subprocess.run(command, env={**ros.environment, **domain}, capture_output=True, text=True, timeout=LIMIT)
        time.sleep(1.5 * S)
    assert died.returncode == -signal.SIGKILL and float(died.stdout) > 0.3
    assert obeyed_for(file) <= most + 1e-3


def obeyed_for(file: Path, way: int = 1) -> float:
    """How long the last command forwards (1) or backwards (-1) was obeyed, s: until the tick before it is neutral."""
    reading, decoding = FilePass(file), Decoding()
    given = moving = 0.0
    for item in reading:
        if item.topic == "/input":
            message = decoding.values(item)
            if message["kind"] == "Velocity" and way * message["values"][0] > 0.0:
                given = max(given, message["given"])
        elif item.topic == "/setpoint" and way * decoding.values(item)["twist"]["linear"]["x"] > 0.0:
            moving = reading.run_time(item)
    assert given and moving, "no command, or it was not obeyed"
    return moving - given


@pytest.mark.parametrize("what", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_a_node_that_is_killed_or_stopped_comes_back_by_itself(
    ros: RosPython, domain: dict[str, str], what: signal.Signals
) -> None:
    with robot(domain) as process:
        assert ask(ros, domain, "alive")
        os.kill(child(process.pid, b"ros2:main"), what)
        began = time.monotonic()
        assert ask(ros, domain, "alive")
        print(f"back within {time.monotonic() - began:.1f} s")
        assert process.poll() is None


def test_without_its_network_it_stops_and_with_a_new_one_the_node_is_back(ros: RosPython, tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    wire = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}  # two computers have no memory in common
    domain = {"ROS_DOMAIN_ID": "3", "ROS_LOG_DIR": "/tmp/txt1-ros"} | wire
    with two_computers(), robot(domain, "--log", str(file), place=within(HOST)) as process:
        assert ask(ros, domain, "alive", place=within(GUEST))
        words = [*within(GUEST), *ros.program, str(HERE / "peers2.py"), "drive_on"]
        driving = subprocess.Popen(words, env={**ros.environment, **domain}, stdout=subprocess.PIPE, text=True)
        assert driving.stdout is not None
        assert float(driving.stdout.readline()) > 0.25
        pull_out()
        time.sleep(2.0 * S)
        driving.kill()
        driving.communicate()
        plug_in()
        began = time.monotonic()
        assert ask(ros, domain, "alive", place=within(GUEST))
        print(f"back within {time.monotonic() - began:.1f} s")
        assert process.poll() is None
    assert obeyed_for(file, -1) <= 0.25 + 1e-3


def test_virtual_time_is_ros_s_time_for_who_asks_for_it(ros: RosPython, domain: dict[str, str]) -> None:
    with robot(domain, "--speed", "3"):
        told = ask(ros, domain, "clock")
    assert told["times real"] == pytest.approx(3.0, rel=0.3)
    assert -0.05 <= told["behind"] < 1.0 and told["now"] < 1000.0


def test_a_program_gets_the_bytes_that_are_recorded(ros: RosPython, domain: dict[str, str], tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with robot(domain, "--speed", "1", "--log", str(file), *SENSORS):
        told = ask(ros, domain, "raw")
    recorded: dict[str, list[str]] = {}
    for item in FilePass(file):
        data = item.message.data
        padding = bytes(-len(data) % 4)  # which DDS adds
        recorded.setdefault(item.name, []).append((data + padding).hex())
    names = {"/txt1/setpoint": "/setpoint", "/txt1/mode": "/mode", "odom": "/odom", "battery_state": "/battery1"}
    names |= {"scan": "/sensors/laser", "camera/depth/image_raw": "/sensors/depth"}
    for name, messages in told.items():
        assert messages and set(messages) <= set(recorded[names[name]]), name


def test_nodes_of_the_other_distribution_understand_it_and_are_understood(
    ros: RosPython, domain: dict[str, str]
) -> None:
    """Kilted, of wheels in TXT1_ROS2_OTHER: its programs beside our node, and our node there beside our programs."""
    other = os.environ.get("TXT1_ROS2_OTHER", "")
    if not Path(other, "bin", "python").exists() or outdated(Path(other)):
        pytest.skip("did not run: no Kilted here: 'make test-ros' installs it where it can be had")
    with robot(domain):
        assert ask(RosPython((f"{other}/bin/python", "-P"), clean(os.environ), other), domain, "alive")
    with robot(domain | {"TXT1_ROS2_HOME": other}):
        assert ask(ros, domain, "alive")


def test_another_dds_understands_it_and_drives_it(ros: RosPython, domain: dict[str, str]) -> None:
    """cyclonedds, in the folder TXT1_CYCLONEDDS."""
    cyclone = os.environ.get("TXT1_CYCLONEDDS", "")
    if not Path(cyclone, "cyclonedds").exists():
        pytest.skip("did not run: no cyclonedds here: 'make test-ros' installs it where it can be had")
    with robot(domain):
        words = [sys.executable, str(HERE / "cyclone.py"), domain["ROS_DOMAIN_ID"]]
        done = subprocess.run(
            words,
            env={**os.environ, "PYTHONPATH": cyclone, "CYCLONEDDS_URI": LOOPBACK},
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
    assert done.returncode == 0, done.stderr[-2000:]
    assert float(done.stdout.splitlines()[-1]) > 0.2


def test_a_recording_is_published_again_with_its_time_and_a_description_of_the_robot(
    ros: RosPython, domain: dict[str, str], tmp_path: Path
) -> None:
    file = tmp_path / "run.mcap"
    words = ["run", "--headless", "--speed", "max", "--duration", "30", "--seed", "1", "--drive", "0.3,0.4"]
    sensors = ["--set", "sensors.laser.driver=sim_laser"]
    subprocess.run(
        [sys.executable, "-m", "txt1", *words, *sensors, "--log", str(file)], cwd=ROOT, check=True, capture_output=True
    )
    play = [sys.executable, "-m", "txt1", "replay", "--ros2", "--loop", "--from", "5", "--speed", "2", str(file)]
    process = subprocess.Popen(play, cwd=ROOT, env={**os.environ, **domain})
    try:
        told = ask(ros, domain, "replayed")
    finally:
        process.terminate()
        process.wait(LIMIT)
    assert told["times real"] == pytest.approx(2.0, rel=0.3)
    assert abs(told["behind"]) < 0.5 and told["now"] > 5.0
    assert told["odom"] == pytest.approx([0.3, 0.4], abs=0.15)
    assert told["mode"], "told long before second 5, and kept"
    assert told["wheel"] > 1.0 and told["scan"] > 100
    assert told["frames"]["base_laser_link"] == "base_link" and told["frames"]["odom"] == "room"
    assert "<robot" in told["description"]


def test_a_virtual_board_s_panel_is_obeyed_and_takes_no_velocities(ros: RosPython, domain: dict[str, str]) -> None:
    port = free_port()
    words = ["board", "--tcp", str(port), "--ros2"]
    board = subprocess.Popen([*TXT1, *words], cwd=ROOT, env={**os.environ, **domain})

    def listens() -> bool:
        with socket.socket() as line:
            return line.connect_ex(("127.0.0.1", port)) == 0

    wait_until(listens)
    host = subprocess.Popen(
        [
            *TXT1,
            "run",
            "--headless",
            "--drive",
            "0.4,0",
            "--arm",
            "--hal",
            "serial",
            "--set",
            f"serial.port=socket://127.0.0.1:{port}",
        ],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        told = ask(ros, domain, "board")
    finally:
        for each in (host, board):
            each.terminate()
            each.wait(LIMIT)
    assert told["v"] > 0.25, "its host drives"
    assert not told["cmd_vel"], "nobody listens"
    assert told["manual"] and told["mode"] == "manual"
    assert told["esc"] and told["disarm"] and told["stop"] and not told["armed"]
