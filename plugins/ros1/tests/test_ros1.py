"""Programs of ROS 1, Debian's, and the original's node. `make test-ros` installs the peers."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import xmlrpc.client
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from benchmarks.ros import child
from rigs.ports import free_port
from tests.patience import LIMIT, TXT1, S, wait_until
from tests.ros.network import ADDRESSES, GUEST, HOST, plug_in, pull_out, two_computers, within
from txt1.errors import ConfigError
from txt1.ros.python import clean
from txt1_ros1.robot_node import SYSTEM, python
from txt1_ros1.txt_driver import write, write_package
from txt1_ros1.txt_launch import files

pytestmark = pytest.mark.long
HERE = Path(__file__).parent
ROOT = HERE.parents[2]
GENPY, GENCPP = Path("/usr/lib/genpy"), Path("/usr/lib/gencpp/gen_cpp.py")
CLIENT = Path(os.environ.get("TXT1_CLIENT") or HERE / "client.cpp")
"""A client in C++; another one's source is compiled in its place."""


@pytest.fixture(scope="module", autouse=True)
def debian() -> None:
    try:
        python()
    except ConfigError as error:
        pytest.skip(f"did not run: {error}")
    if shutil.which("rosmaster") is None:
        pytest.skip("did not run: no ROS master here: 'apt install python3-rosmaster'")


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """txt_driver's modules for Python, made by ROS's own generators."""
    folder = tmp_path_factory.mktemp("ros1")
    source = write_package(folder / "src")
    write(folder / "src" / "txt_launch", files())
    if not GENPY.is_dir():
        pytest.skip("did not run: ROS's generators are not here: 'apt install python3-genpy'")
    where = ["-Itxt_driver:" + str(source / "msg"), "-Istd_msgs:/usr/share/std_msgs/msg"]
    for kind in ("msg", "srv"):
        out = folder / "python" / "txt_driver" / kind
        out.mkdir(parents=True)
        program = [SYSTEM, str(GENPY / f"gen{kind}_py.py"), "-p", "txt_driver", *where, "-o", str(out)]
        for file in sorted((source / kind).iterdir()):
            subprocess.run([*program, str(file)], check=True, env=clean(os.environ))
        subprocess.run([*program, "--initpy"], check=True, env=clean(os.environ))
    (folder / "python" / "txt_driver" / "__init__.py").touch()
    return folder


class Ros:
    """A ROS master, and what runs beside it; on two computers, where the robot and the master are on the first."""

    def __init__(self, package: Path, *, two: bool = False) -> None:
        self.port = free_port()
        self.place, self.peers_place = (within(HOST), within(GUEST)) if two else ([], [])
        here, there = (ADDRESSES[HOST], ADDRESSES[GUEST]) if two else ("127.0.0.1", "127.0.0.1")
        self.uri = {"ROS_MASTER_URI": f"http://{here}:{self.port}", "ROS_HOSTNAME": here}
        self.environment = {
            **clean(os.environ),
            **self.uri,
            "PYTHONPATH": str(package / "python"),
            "PYTHONUNBUFFERED": "1",
            "ROS_PACKAGE_PATH": f"{package / 'src'}:/usr/share",
            "ROS_HOSTNAME": there,
        }
        self.start()

    def start(self) -> None:
        words = [*self.place, "rosmaster", "--core", "-p", str(self.port)]
        self.master = subprocess.Popen(
            words, env=self.environment | self.uri, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def stop(self) -> None:
        self.master.terminate()
        self.master.wait(LIMIT)

    def ask(self, *words: str, limit: float = 2.0 * LIMIT) -> str:
        words = (*self.peers_place, *words)
        done = subprocess.run(words, env=self.environment, capture_output=True, text=True, timeout=limit)
        assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
        return done.stdout

    def asks_master(self, call: str, *words: Any) -> Any:
        """What the master answers; raises AssertionError where it has no answer."""
        with xmlrpc.client.ServerProxy(self.uri["ROS_MASTER_URI"]) as master:
            code, text, value = getattr(master, call)("/test", *words)  # type: ignore[misc]
        assert code == 1, text
        return value

    def is_up(self) -> bool:
        """Whether the master answers."""
        with suppress(OSError):
            return bool(self.asks_master("getUri"))
        return False

    def names(self, kind: int) -> set[str]:
        """The names of topics published (0) or subscribed to (1), or of services (2); none while there is no master."""
        with suppress(OSError):
            return {name for name, _ in self.asks_master("getSystemState")[kind]}
        return set()

    def peer(self, scenario: str) -> Any:
        return json.loads(self.ask(SYSTEM, str(HERE / "peers1.py"), scenario).splitlines()[-1])


@pytest.fixture
def ros(package: Path) -> Iterator[Ros]:
    made = Ros(package)
    yield made
    made.stop()


@contextmanager
def robot(ros: Ros, *words: str, path: str = "") -> Iterator[subprocess.Popen[str]]:
    """`txt1 run --ros1`."""
    room = ["--set", "sim.room.length=40", "--set", "sim.room.width=40"]
    environment = {
        **os.environ,
        **ros.uri,
        "PYTHONPATH": f"{ROOT}:{ROOT / 'plugins/ros1'}",
        "PATH": f"{path}:{os.environ['PATH']}",
    }
    process = subprocess.Popen(
        [*ros.place, *TXT1, "run", "--headless", "--seed", "1", "--ros1", *room, *words],
        env=environment,
        text=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.said = process.communicate(timeout=LIMIT)[0]  # type: ignore[attr-defined]
        print(process.said)  # type: ignore[attr-defined]


def test_the_original_s_surface_is_there_with_its_types_rates_and_frames(ros: Ros) -> None:
    with robot(ros):
        told = ros.peer("surface")
        listed = ros.ask("rostopic", "list").split()
        loaded = ros.ask("rosservice", "call", "/pid_load")
    assert {"/cmd_vel", "/odom_comb", "/pwm", "/odom", "/battery", "/tf"} <= set(listed)
    assert "result: True" in loaded
    assert told["types"]["/odom"] == "nav_msgs/Odometry" and told["types"]["/battery"] == "txt_driver/Battery"
    assert told["md5"]["txt_driver/Battery"] == "005ac39378ddb1716f86ce80aedc84ad"
    assert told["md5"]["txt_driver/Pwm"] == "e192cc353441052456f4435f8c52dd28"
    assert told["md5"]["txt_driver/PidLoad"] == "eb13ac1f1354ccecb7941ee8fa2192e8"
    assert told["pid_load"] is True and told["atx"] is True
    assert told["manual only"] is False and told["shutdown, armed"] is False
    assert told["rate"] == pytest.approx(20.0, rel=0.15)
    assert told["batteries"] == pytest.approx(1.0, abs=0.4)
    assert told["frames"] == ["/odom", "/base_footprint", "battery"]
    assert told["unsure"] == [1.0, 1.0, 99999.0, 99999.0, 99999.0, 2.0], "robot_pose_ekf divides by it"
    assert told["v"] == pytest.approx(0.5, abs=0.1) and told["omega"] > 0.1
    x, y, theta = told["tf"]
    assert x > 0.5 and y > 0.0 and theta > 0.0
    assert told["after"] == 0.0
    one, two, seconds = told["battery"]
    used = (12.165769 - max(one, two)) / 0.033691
    assert 9.0 < one < 13.0 and seconds == pytest.approx(60.0 * min(50.0 - used, 50.0), abs=0.1), "the original's"
    assert told["parameters"] == ["angular_pid", "batt1", "batt2", "linear_pid", "port", "pwr_auto"]


def call(ros: Ros, name: str, *words: str) -> str:
    """The answer of a service of txt_driver, once it is there."""
    wait_until(lambda: name in ros.names(2))
    return " ".join(ros.ask("rosservice", "call", name, *words).split())


def test_it_is_disarmed_armed_stopped_and_switched_to_manual_mode_over_ros(ros: Ros) -> None:
    with robot(ros):
        assert ros.peer("alive") is True
        told = ros.peer("gate")
        assert ros.peer("alive") is True, "it was armed again"
        stopped = ros.peer("stop")
    done, refused = told
    assert done == {"disarm": True, "arm": True, "manual": True, "pwm": True, "controller": True}
    assert refused == {"pwm": False}
    assert stopped == [True, True], "the way back is to arm it"


def test_a_program_that_drives_a_robot_that_nobody_armed_finds_out_on_rosout(ros: Ros) -> None:
    with robot(ros, "--no-arm") as process:
        told = ros.peer("ignored")
    ((warns, name, text),) = told
    assert warns and name == "/txt1_node"
    assert "the robot is not armed" in text and "rosservice call /arm" in text
    assert text in process.said  # type: ignore[attr-defined]


def test_gains_that_are_no_numbers_are_refused_and_the_node_lives(ros: Ros) -> None:
    with robot(ros):
        assert "result: True" in call(ros, "/pid_load")
        for wrong in (["a", "b", "c"], 7, [1.0, True, 2.0]):
            ros.asks_master("setParam", "/txt1_node/linear_pid", wrong)
            assert "result: False" in call(ros, "/pid_load")
        ros.asks_master("setParam", "/txt1_node/linear_pid", [4, 130, 0.005])
        assert "result: True" in call(ros, "/pid_load")


def test_sensors_are_told_as_programs_of_ros_know_them_and_where_they_sit(ros: Ros) -> None:
    sensors = ("laser", "imu", "gps", "camera", "depth")
    words = [word for name in sensors for word in ("--set", f"sensors.{name}.driver=sim_{name}")]
    with robot(ros, *words):
        told = ros.peer("sensors")
    assert told["scan"][0] == "/base_laser_link"
    assert told["scan"][1] > 100
    assert told["scan"][2] == 0.1
    assert told["imu"][0] == "/base_imu_link"
    assert told["imu"][1] == pytest.approx(9.81, abs=1.0)
    assert told["imu"][2][0] == told["imu"][2][8] > 0.0
    assert told["fix"][0] == "/base_gps_link"
    assert -90.0 < told["fix"][1] < 90.0
    assert told["picture"] == ["jpeg", "ffd8", 9]
    assert told["points"] == [160, 160 * 120 * 12, ["x", "y", "z"]]
    assert told["frames"]["/base_laser_link"] == "/base_link"
    assert told["frames"]["/base_link"] == "/base_footprint"
    assert abs(told["late"]) < LIMIT, "stamped with the time of day"


def test_two_robots_share_a_master_in_namespaces_and_leave_it_as_they_found_it(ros: Ros) -> None:
    with robot(ros, "--ros1-namespace", "car1"), robot(ros, "--ros1-namespace", "car2"):
        for name in ("car1", "car2"):
            assert "result: True" in call(ros, f"/{name}/pid_load")
            assert ros.asks_master("lookupNode", f"/{name}/txt1_node")
        told = ros.ask("rostopic", "echo", "-n", "1", "/car2/odom")
        assert 'frame_id: "/car2/odom"' in told and 'child_frame_id: "/car2/base_footprint"' in told
        assert "/odom" not in ros.names(0) and "/cmd_vel" not in ros.names(1)
    wait_until(lambda: not any("car" in name for kind in (0, 1, 2) for name in ros.names(kind)))


def test_a_second_robot_of_the_same_name_waits_and_says_so(ros: Ros, tmp_path: Path) -> None:
    file, text = tmp_path / "second.mcap", "txt1_node is on this master already"

    def told() -> str:
        words = [sys.executable, "-m", "txt1", "log", "cat", str(file), "--topic", "/rosout"]
        return subprocess.run(words, capture_output=True, text=True, cwd=ROOT).stdout

    with robot(ros):
        assert ros.peer("alive") is True
        where = ros.asks_master("lookupNode", "/txt1_node")
        with robot(ros, "--log", str(file)):
            wait_until(lambda: text in told())  # of a recording that is still being made
            time.sleep(S)
            assert ros.asks_master("lookupNode", "/txt1_node") == where
        assert ros.peer("alive") is True
    assert told().count(text) == 1 and "--ros1-namespace" in told()


LAUNCH = """<launch>
  <node pkg="txt_driver" type="txt_node" name="txt1_node" args="--seed 1" output="screen">
    <rosparam file="$(find txt_driver)/cfg/pid.yaml" command="load"/>
    <param name="port" value="sim"/>
  </node>
</launch>"""


def test_a_launch_file_as_the_original_s_starts_the_robot_with_its_gains(
    ros: Ros, package: Path, tmp_path: Path
) -> None:
    if shutil.which("roslaunch") is None:
        pytest.skip("did not run: no roslaunch here: 'apt install python3-roslaunch'")
    file = tmp_path / "txt.launch"
    file.write_text(LAUNCH)
    path = f"{Path(sys.executable).parent}:{ros.environment['PATH']}"
    environment = ros.environment | {"PATH": path, "ROS_LOG_DIR": str(tmp_path)}
    wait_until(ros.is_up)
    launch = subprocess.Popen(["roslaunch", str(file)], env=environment)
    try:
        assert "result: True" in call(ros, "/pid_load"), "its own gains, from its own file"
        assert ros.peer("alive") is True
        assert len(ros.asks_master("getParam", "/txt1_node/angular_pid")) == 56
    finally:
        launch.send_signal(signal.SIGINT)
        launch.wait(LIMIT)
    wait_until(lambda: "/pid_load" not in ros.names(2))


@contextmanager
def board(*words: str) -> Iterator[Path]:
    """`txt1 board` at a pseudo-terminal, whose path it yields."""
    with TemporaryDirectory() as folder:
        line = Path(folder) / "line"
        process = subprocess.Popen([*TXT1, "board", *words, "--pty", str(line)], cwd=ROOT, stdout=subprocess.DEVNULL)
        try:
            wait_until(line.exists)
            yield line
        finally:
            process.terminate()
            process.wait(LIMIT)


COMMAND = "roslaunch txt_launch txt_node_net.launch host:=localhost client:=localhost"
EXAMPLE_COMMAND = "roslaunch name template"
"""The thesis's commands (B.3), on a single computer."""
EXAMPLE = """<launch>
  <node pkg="name" type="txt_driver_template" name="template" output="screen"/>
</launch>"""


@contextmanager
def launched(ros: Ros, port: str, options: str, tmp_path: Path) -> Iterator[None]:
    """The robot and its frames, started by the thesis's command."""
    if shutil.which("roslaunch") is None:
        pytest.skip("did not run: no roslaunch here: 'apt install python3-roslaunch'")
    path = f"{Path(sys.executable).parent}:{ros.environment['PATH']}"
    given = {"PATH": path, "ROS_LOG_DIR": str(tmp_path), "TXT_PORT": port, "TXT_OPTIONS": options}
    wait_until(ros.is_up)
    launch = subprocess.Popen(COMMAND.split(), env=ros.environment | given)
    try:
        yield
    finally:
        launch.send_signal(signal.SIGINT)
        launch.wait(LIMIT)


ENDLESS = "--set sim.room.length=.inf --set sim.room.width=.inf"


@pytest.fixture(scope="module")
def example(package: Path, client: Path) -> None:
    """The package that B.3 has its reader make, with a launch file, as roslaunch starts nothing else."""
    folder = package / "src" / "name"
    folder.mkdir()
    shutil.copy(client, folder / "txt_driver_template")
    (folder / "template").write_text(EXAMPLE)
    (folder / "package.xml").write_text(PACKAGE)


PACKAGE = """<package format="2">
  <name>name</name><version>1.0.0</version><description>B.4</description>
  <maintainer email="robot@example.org">TXT-1</maintainer><license>MIT</license>
</package>"""


@pytest.mark.parametrize("kind", ["sim", "ours", "original"])
@pytest.mark.usefixtures("example")
def test_the_thesis_s_commands_start_the_robot_and_its_example(ros: Ros, tmp_path: Path, kind: str) -> None:
    with ExitStack() as stack:
        port, options = "sim", f"--seed 1 {ENDLESS}"
        if kind != "sim":
            port, options = str(stack.enter_context(board(*ENDLESS.split(), "--as", kind))), "--ros1-auto-arm"
        stack.enter_context(launched(ros, port, options, tmp_path))
        assert "result: True" in call(ros, "/pid_load")
        frames = ros.peer("frames")
        assert ros.peer("alive") is True
        output = tmp_path / "example"
        environment = ros.environment | {"ROS_LOG_DIR": str(tmp_path), "ROSCONSOLE_STDOUT_LINE_BUFFERED": "1"}
        with output.open("w") as file:
            process = subprocess.Popen(EXAMPLE_COMMAND.split(), env=environment, stdout=file, stderr=subprocess.STDOUT)
        try:
            tells = "PID Load Response: 1", "PWR Response: 1", "odom", "battery"
            wait_until(lambda: all(re.search(each, output.read_text(), re.I) for each in tells))
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(LIMIT)
    assert frames["base_laser_link"][:4] == ["base_link", 0.1905, 0.0, 0.1435]
    assert frames["base_imu_link"][4] == pytest.approx([3.1416, 0.0, 3.1416], abs=1e-3), "its z points down"
    assert frames["base_link"][0] == "base_footprint"


def test_a_joystick_drives_while_its_dead_man_is_held_and_it_is_heard(ros: Ros, package: Path) -> None:
    with robot(ros):
        assert ros.peer("alive") is True
        teleop = subprocess.Popen([str(package / "src/txt_launch/bin/txt_teleop")], env=ros.environment)
        try:
            told = ros.peer("joystick")
        finally:
            teleop.terminate()
            teleop.wait(LIMIT)
    assert told["held"] == pytest.approx([0.75, 0.75 / 0.555 * -0.5])
    assert told["let go"] == [0.0, 0.0]
    assert told["silent"] == [0.0, 0.0]


def test_two_programs_that_drive_are_told_and_what_is_no_number_is_refused(ros: Ros, tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with robot(ros, "--log", str(file)):
        assert ros.peer("alive") is True
        words = ["rostopic", "pub", "-r", "10", "/cmd_vel", "geometry_msgs/Twist", "{linear: {x: .nan}}"]
        other = subprocess.Popen(words, env=ros.environment, stdout=subprocess.DEVNULL)
        try:
            assert ros.peer("alive") is True
        finally:
            other.terminate()
            other.wait(LIMIT)
    words = [sys.executable, "-m", "txt1", "log", "cat", str(file), "--topic", "/rosout"]
    told = subprocess.run(words, capture_output=True, text=True, cwd=ROOT).stdout
    assert "2 programs publish /cmd_vel: /peer_" in told and "/rostopic_" in told
    assert "v must be a finite number, not nan" in told


def test_a_master_that_was_restarted_finds_the_node_again(ros: Ros) -> None:
    with robot(ros):
        assert ros.peer("alive") is True
        ros.stop()
        time.sleep(1.5 * S)
        ros.start()
        assert ros.peer("alive") is True


def test_an_interface_that_was_away_delays_robot_and_programs_no_longer(
    package: Path,
) -> None:
    with two_computers():
        ros = Ros(package, two=True)
        try:
            with robot(ros) as process:
                assert ros.peer("alive") is True
                pull_out()
                time.sleep(2.0 * S)
                plug_in()
                assert ros.peer("alive") is True
                assert process.poll() is None
        finally:
            ros.stop()


@pytest.mark.parametrize("what", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_a_node_that_is_killed_or_stopped_comes_back_by_itself(ros: Ros, what: signal.Signals) -> None:
    with robot(ros) as process:
        assert ros.peer("alive") is True
        os.kill(child(process.pid, b"ros1:main"), what)
        assert ros.peer("alive") is True
        assert process.poll() is None


@pytest.fixture(scope="module")
def client(package: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The thesis's example (B.4), compiled."""
    tmp_path = tmp_path_factory.mktemp("client")
    if not GENCPP.exists() or shutil.which("g++") is None or not Path("/usr/include/ros/ros.h").exists():
        pytest.skip("did not run: no roscpp here: 'apt install libroscpp-dev libtf-dev python3-gencpp g++'")
    out = tmp_path / "include" / "txt_driver"
    out.mkdir(parents=True)
    source = package / "src" / "txt_driver"
    for file in (*sorted((source / "msg").iterdir()), *sorted((source / "srv").iterdir())):
        subprocess.run(
            [
                SYSTEM,
                str(GENCPP),
                str(file),
                f"-Itxt_driver:{source / 'msg'}",
                "-Istd_msgs:/usr/share/std_msgs/msg",
                "-p",
                "txt_driver",
                "-o",
                str(out),
                "-e",
                "/usr/share/gencpp",
            ],
            check=True,
            env=clean(os.environ),
        )
    client = tmp_path / "client"
    libraries = ["-lroscpp", "-lrosconsole", "-lroscpp_serialization", "-lrostime", "-ltf", "-ltf2"]
    subprocess.run(
        [
            "g++",
            "-w",
            "-O0",
            f"-I{tmp_path / 'include'}",
            str(CLIENT),
            "-o",
            str(client),
            *libraries,
            "-lboost_system",
            "-lboost_thread",
        ],
        check=True,
    )
    return client


def test_the_thesis_s_example_in_cpp_runs_unchanged(ros: Ros, client: Path, tmp_path: Path) -> None:
    stub = tmp_path / "bin" / "shutdown"
    stub.parent.mkdir()
    record = tmp_path / "shutdowns"
    stub.write_text(f'#!/bin/sh\necho "$@" >> {record}\n')
    stub.chmod(0o755)
    file = tmp_path / "run.mcap"
    with robot(ros, "--log", str(file), "--set", "host.allow_shutdown=true", path=str(stub.parent)):
        assert ros.peer("alive") is True  # and so it is armed
        process = subprocess.Popen(
            [str(client)], env=ros.environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        time.sleep(14.0 * S)
        process.terminate()
        said = process.communicate(timeout=LIMIT)[0]
    print(said[-3000:])
    assert "PID Load Response: 1" in said and "PWR Response: 1" in said
    assert "PWM Response: 0" in said and "PWM Response: 1" not in said, "in manual mode only"
    assert "Shutdown called: 0" in said and "Shutdown called: 1" not in said, "not while it is armed"
    assert not record.exists()
    assert re.search(r"odom", said, re.I) and re.search(r"battery", said, re.I)
    told = subprocess.run(
        [sys.executable, "-m", "txt1", "log", "cat", str(file), "--topic", "/odom"],
        capture_output=True,
        text=True,
        cwd=ROOT,
    ).stdout.splitlines()
    speeds = [json.loads(line)["message"]["twist"]["twist"]["linear"]["x"] for line in told]
    starts = sum(1 for before, after in pairwise(speeds) if abs(before) < 0.02 <= abs(after))
    assert max(speeds) > 0.1
    assert starts >= 3, "at a period of 2 s it stops between two commands"
    assert speeds[-1] == 0.0


def test_a_disarmed_robot_s_host_is_shut_down_where_it_allows_it(ros: Ros, tmp_path: Path) -> None:
    stub, record = tmp_path / "shutdown", tmp_path / "shutdowns"
    stub.write_text(f'#!/bin/sh\necho "$@" >> {record}\n')
    stub.chmod(0o755)
    for allowed in (False, True):
        with robot(ros, "--no-arm", "--set", f"host.allow_shutdown={str(allowed).lower()}", path=str(tmp_path)):
            ros.ask(
                SYSTEM, "-c", "import rospy; rospy.init_node('wait'); rospy.wait_for_service('/shutdown_computer', 30)"
            )
            assert f"result: {allowed}" in ros.ask("rosservice", "call", "/shutdown_computer", "true")
        time.sleep(0.5 * S)
        assert record.exists() is allowed
    assert record.read_text() == "-h now\n"


def test_rosbag_opens_a_recording_that_is_exported(ros: Ros, tmp_path: Path) -> None:
    file, bag = tmp_path / "run.mcap", tmp_path / "run.bag"
    for words in (
        ["run", "--headless", "--speed", "max", "--duration", "5", "--drive", "0.4,0.3", "--log", str(file)],
        ["log", "export", "--rosbag1", str(file)],
    ):
        subprocess.run([sys.executable, "-m", "txt1", *words], cwd=ROOT, check=True, capture_output=True)
    if shutil.which("rosbag") is None:
        pytest.skip("did not run: no rosbag here: 'apt install python3-rosbag'")
    told = ros.ask("rosbag", "info", str(bag))
    assert re.search(r"/odom +250 msgs +: nav_msgs/Odometry", told), told
    assert ros.ask("rosbag", "check", str(bag)) is not None
