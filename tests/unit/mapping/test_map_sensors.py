"""`txt1 run --in`: the sensor ``map`` of a simulated robot, in recordings and replays, and what is refused."""

from bisect import bisect
from math import atan2, degrees, hypot
from pathlib import Path

import numpy as np
import pytest

from txt1.cli import execute
from txt1.mapping import grid_files, map_sensors, scan_work
from txt1.mapping.particle_filter import Locator
from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.record.reader import Decoding, FilePass

RUN = (
    *("run", "--hal", "sim", "--headless", "--speed", "max", "--drive", "0.5,0.45"),
    *("--set", "sensors.laser.driver=sim_laser", "--set", "sim.vehicle.slip=0.05"),
    *("--set", "sim.obstacles=[{kind: box, x: 2.2, y: -1.6, length: 0.4, width: 0.4, theta: 0.0}]"),
)
FUSED = ("--set", "estimation.sensors=[encoders, map]")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Few particles, and no functions compiled for nothing."""

    class Few(Locator):
        def __init__(self, grid, seed=0, count=150):
            super().__init__(grid, seed, min(count, 150))

    monkeypatch.setattr(scan_work, "Locator", Few)
    monkeypatch.setattr(scan_work, "warm", lambda: None)


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    """The map of the simulated room, 5 m x 5 m, with its box."""
    cells = np.full((104, 104), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    # from x = 2.0 and y = -1.8 on
    cells[16:24, 92:100] = OCCUPIED
    name = tmp_path_factory.mktemp("map") / "room"
    grid_files.save(Grid(cells, 0.05, (-2.6, -2.6, 0.0)), name)
    return name


def told(file: Path, topic: str) -> list[tuple[float, float, float, float]]:
    """Time, x, y, theta of a topic's messages."""
    decoding, reading, found = Decoding(), FilePass(file), []
    for item in reading:
        if item.name == topic:
            pose = decoding.message(item).pose
            pose = getattr(pose, "pose", pose)
            theta = 2.0 * atan2(pose.orientation.z, pose.orientation.w)
            found.append((reading.run_time(item), pose.position.x, pose.position.y, theta))
    return found


def test_a_robot_finds_itself_in_a_room_and_the_run_verifies(room, tmp_path, capsys):
    file = tmp_path / "in.mcap"
    asked = ("--in", str(room), "--at", "0,0,0", "--log", str(file))
    assert execute([*RUN, *FUSED, "--seed", "3", "--duration", "6", *asked]) == 0
    found, true = told(file, "/sensors/map"), told(file, "/pose")
    assert len(found) > 30
    times = [each[0] for each in true]
    errors = []
    for time, x, y, theta in found:
        _, tx, ty, ttheta = true[min(bisect(times, time), len(true) - 1)]
        turn = (theta - ttheta + np.pi) % (2 * np.pi) - np.pi
        errors.append((hypot(x - tx, y - ty), abs(degrees(turn))))
    position, angle = np.sqrt(np.mean(np.square(errors), axis=0))
    assert position < 0.08 and angle < 2.5
    assert told(file, "/odometry/filtered")
    capsys.readouterr()
    assert execute(["replay", "--verify", str(file)]) == 0
    assert "no difference" in capsys.readouterr().out


def test_from_a_given_pose_it_knows_at_once(room, tmp_path):
    file = tmp_path / "at.mcap"
    assert execute([*RUN, "--duration", "1.5", "--in", f"{room}.yaml", "--at", "0,0,0", "--log", str(file)]) == 0
    assert told(file, "/sensors/map")[0][0] < 0.5


def test_a_first_goal_does_not_import_what_takes_cycles(room, monkeypatch):
    imported = []
    monkeypatch.setattr(map_sensors, "import_module", imported.append)
    assert execute([*RUN, "--duration", "0.1", "--in", str(room)]) == 0
    assert imported == ["scipy.ndimage"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--in", "nowhere"], "there is no map 'nowhere'"),
        (["--in", "ROOM", "--at", "1,2"], "X,Y,THETA"),
        (["--in", "ROOM", "--at", "2.1,-1.6,0"], "no free floor"),
        (["--in", "ROOM", "--set", "mapping.laser=other"], "there are: laser"),
    ],
)
def test_what_is_wrong_is_told(room, options, word, capsys):
    given = [str(room) if each == "ROOM" else each for each in options]
    code = 0
    try:
        code = execute([*RUN, "--duration", "1", *given])
    except SystemExit as exit:
        code = exit.code
    assert code == 2
    assert word in capsys.readouterr().err


def test_without_a_laser_it_is_refused(room, capsys):
    run = ["run", "--hal", "sim", "--headless", "--speed", "max", "--duration", "1", "--in", str(room)]
    assert execute(run) == 2
    assert "no laser is configured" in capsys.readouterr().err
