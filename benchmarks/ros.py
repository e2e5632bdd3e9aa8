"""ROS 2's node beside an empty relay, and every topic beside its promise: ``python -m benchmarks.ros --page``.

Two programs of ROS run at the same time as the robot: one hands on what another one sends, at once and in the next of
50 cycles a second, as the least that any program of rclpy costs; the latter drives, too. A command is followed by the
robot's recording: when the commander had it, and the controller's cycle in which it was the set-point. Then a third
program listens to every topic of a robot with all sensors; their twins are drawn in the robot's own process, which real
ones are not. All are on one computer, and so on one clock.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from rigs import page_parts
from txt1.record.reader import Decoding, FilePass
from txt1.ros.python import RosPython, ros2

ROOT: Final = Path(__file__).parents[1]
PEERS: Final = Path(__file__).with_name("ros_peers.py")
PAGE: Final = ROOT / "docs" / "ros.md"
COMMANDER: Final = "a command until the commander has it"
SETPOINT: Final = "a command until the cycle in which it is the set-point"
ODOMETRY: Final = "odometry from its cycle until a program has it"
HEARD: Final = "a command until a program hears of the set-point"
RELAY: Final = "an empty relay, there and back"
IN_CYCLE: Final = "a relay that hands on in 50 cycles a second, there and back"
BESIDE: Final = {COMMANDER: RELAY, SETPOINT: IN_CYCLE, ODOMETRY: RELAY}
"""What is compared: each is from one process to another by way of a third."""
RATIO_MAX: Final = 1.5  # of a time beside the relay's
RATE: Final = 0.02  # by which a rate may be off what was promised
FIRST: Final = ("chrt", "--fifo", "1")
START: Final = 4.0  # s that a robot and its node have to start
PROMISED: Final = {
    **dict.fromkeys((
        "/odom", "/odometry/filtered", "/tf", "/joint_states", "/txt1/setpoint", "/txt1/pwm", "/txt1/encoders",
        "/txt1/gains", "/txt1/pose",
    ), 50.0),
    "/imu/data": 100.0, "/scan": 10.0, "/fix": 5.0, "/txt1/sensors/gps": 5.0,
    **dict.fromkeys(("/camera/image_raw/compressed", "/camera/camera_info"), 10.0),
    **dict.fromkeys(("/camera/depth/image_raw", "/camera/depth/camera_info"), 10.0),
    "/battery_state": 1.0, "/txt1/battery2": 1.0,
}  # fmt: skip
"""Hz, by topic; what is told on change promises none."""
ROBOT: Final = (
    "--headless",
    "--seed",
    "1",
    "--ros2",
    "--arm",
    "--set",
    "safety.missed_ticks_max=100000",
    "--set",
    "sim.room.length=20",
    "--set",
    "sim.room.width=20",
)

SENSORS: Final = (
    "--set",
    "sensors.imu.driver=sim_imu",
    "--set",
    "sensors.laser.driver=sim_laser",
    "--set",
    "sensors.gps.driver=sim_gps",
    "--set",
    "sensors.camera.driver=sim_camera",
    "--set",
    "sensors.depth.driver=sim_depth",
    "--set",
    "estimation.preset=gyro",
)


@contextmanager
def robot(domain: Mapping[str, str], first: bool, *words: str) -> Iterator[None]:
    """A robot in real time with a node of ROS 2."""
    process = subprocess.Popen(
        [*FIRST * first, sys.executable, "-m", "txt1", "run", *ROBOT, *words],
        env={**os.environ, **domain, "PYTHONPATH": str(ROOT)},
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
    )
    try:
        time.sleep(START)
        if first:
            for thread in threads(child(process.pid, b"ros2:main")):
                os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(1))
        yield
    finally:
        process.terminate()
        process.wait(30)


def child(parent: int, word: bytes) -> int:
    """The id of a process's child with this in its command line."""
    for place in Path("/proc").iterdir():
        with suppress(OSError, IndexError):  # it is no process, or has ended
            above = int((place / "stat").read_text().rpartition(")")[2].split()[1])
            if above == parent and word in (place / "cmdline").read_bytes():
                return int(place.name)
    raise LookupError(word)


def threads(process: int) -> list[int]:
    """The ids of a process's threads."""
    return [int(place.name) for place in Path(f"/proc/{process}/task").iterdir()]


def start(
    ros: RosPython, domain: Mapping[str, str], first: bool, program: str, seconds: float
) -> subprocess.Popen[str]:
    """One of the programs of ROS, at work."""
    words = [*FIRST * first, *ros.program, str(PEERS), program, str(seconds)]
    return subprocess.Popen(words, env={**ros.environment, **domain}, text=True, stdout=subprocess.PIPE)


def ended(process: subprocess.Popen[str]) -> dict[str, Any]:
    """What a program saw."""
    said, _ = process.communicate()
    return dict(json.loads(said.splitlines()[-1]))


def share(values: Sequence[float], part: float) -> float:
    """A percentile."""
    return sorted(values)[min(len(values) - 1, int(part * len(values)))]


def latencies(ros: RosPython, domain: Mapping[str, str], first: bool, seconds: float) -> dict[str, list[float]]:
    """Times in s, by what they are of."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.mcap"
        with robot(domain, first, "--log", str(file)):
            relay = start(ros, domain, first, "relay", 0.0)
            try:
                told = ended(start(ros, domain, first, "drive", seconds))
            finally:
                relay.terminate()
                relay.wait()
        taken: dict[float, float] = {}
        cycles: dict[float, float] = {}
        reading, decoding = FilePass(file), Decoding()
        for item in reading:
            if item.name == "/input":
                message = decoding.message(item)
                if message.kind == "Velocity":
                    taken.setdefault(round(message.values[0], 6), reading.run_time(item))
            elif item.name == "/setpoint":
                cycles.setdefault(round(decoding.message(item).twist.linear.x, 6), reading.run_time(item))
    heard = {v: (stamp, at) for v, stamp, at in told["heard"]}
    began = share([stamp - cycles[v] for v, (stamp, _) in heard.items() if v in cycles], 0.5)
    sent = [(v, at) for v, at in told["sent"] if v in taken and v in cycles and v in heard]
    if lost := len(told["sent"]) - len(sent):
        print(f"{lost} of {len(told['sent'])} commands were overtaken by the next before they were in force")
    return {
        COMMANDER: [taken[v] + began - at for v, at in sent],
        SETPOINT: [cycles[v] + began - at for v, at in sent],
        ODOMETRY: told["odometry"],
        HEARD: [heard[v][1] - at for v, at in sent],
        RELAY: told["relayed"],
        IN_CYCLE: told["relayed_in_cycle"],
    }


def latency_rows(got: Mapping[str, Sequence[float]]) -> Iterator[tuple[str, ...]]:
    """A row of the table for each, with the verdict where there is a limit."""
    for name, values in got.items():
        p50, p99 = (1e3 * share(values, part) for part in (0.5, 0.99))
        ratios, verdict = ("", ""), ""
        if name in BESIDE:
            beside = [share(values, part) / share(got[BESIDE[name]], part) for part in (0.5, 0.99)]
            ratios = f"{beside[0]:.2f}", f"{beside[1]:.2f}"
            verdict = "holds" if max(beside) <= RATIO_MAX else "**missed**"
        yield name, f"{p50:.1f}", f"{p99:.1f}", *ratios, str(len(values)), verdict


def rate_rows(told: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """The same of the topics that are to come at a rate."""
    for name, promised in sorted(PROMISED.items()):
        came = told["came"].get(name, [])
        times = [at for at, stamp in came]
        if any(stamp for _, stamp in came):  # tf has several messages with one stamp
            times = [at for k, (at, stamp) in enumerate(came) if k == 0 or stamp != came[k - 1][1]]
        if len(times) < 2:
            yield f"`{name}`", f"{promised:g}", "none", "", "", "**missed**"
            continue
        gaps = [1e3 * (after - before) for before, after in pairwise(times)]
        late = [abs(gap - 1e3 / promised) for gap in gaps]
        rate = len(gaps) / (times[-1] - times[0])
        verdict = "holds" if abs(rate / promised - 1.0) <= RATE else "**missed**"
        late50, late99 = (f"{share(late, part):.1f}" for part in (0.5, 0.99))
        yield f"`{name}`", f"{promised:g}", f"{rate:.2f}", late50, late99, verdict


def summary(told: Mapping[str, Any]) -> str:
    """Return in two sentences how many topics come at their rate, and which is the most irregular."""
    rows = list(rate_rows(told))
    held = sum(row[-1] == "holds" for row in rows)
    worst = max(rows, key=lambda row: float(row[4]))
    return (
        f"{held} of {len(rows)} topics come within {RATE:.0%} of their promised rate. The most irregular is "
        f"{worst[0]}: off its time by {worst[3]} ms (p50), {worst[4]} ms (p99)."
    )


def table(header: Sequence[str], rows: Iterator[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in (header, ["---"] * len(header), *rows))


def main() -> None:
    """Measure, print, and write to the page where that is asked for."""
    parser = argparse.ArgumentParser(prog="benchmarks.ros", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each of the two measurements; 60 by default")
    parser.add_argument(
        "--first", action="store_true", help="real-time priority for all of them, so that others at work matter less"
    )
    parser.add_argument("--page", action="store_true", help="write the tables to docs/ros.md")
    arguments = parser.parse_args()
    ros = ros2()
    domain = {"ROS_DOMAIN_ID": "77", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": "/tmp/txt1-ros"}
    before = os.getloadavg()[0]
    latency = table(
        ("ms", "p50", "p99", "p50 beside the relay's", "p99", "n", f"at most {RATIO_MAX:g} times"),
        latency_rows(latencies(ros, domain, arguments.first, arguments.seconds)),
    )
    with robot(domain, arguments.first, *SENSORS):
        told = ended(start(ros, domain, arguments.first, "listen", arguments.seconds))
    rates = table(
        ("topic", "promised, Hz", "came", "off its time, ms: p50", "p99", f"within {RATE:.0%}"), rate_rows(told)
    )
    where = (
        f"{os.cpu_count()} processors, {arguments.seconds:g} s each, {date.today()}; load (how many programs want to "
        f"run, over a minute) {before:.1f} before and {os.getloadavg()[0]:.1f} after"
        f"{'; robot, node and programs before all others (SCHED_FIFO)' if arguments.first else ''}."
    )
    print(f"{where}\n\n{latency}\n\n{rates}")
    if arguments.page:
        page_parts.write(PAGE, "latency", f"{where}\n\n{latency}", "benchmarks.ros")
        page_parts.write(PAGE, "rates", summary(told), "benchmarks.ros")


if __name__ == "__main__":
    main()
