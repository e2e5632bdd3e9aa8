"""`txt1 map`: from a recording to files, the same bytes again, a second drive, and what is wrong."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from txt1.cli import execute
from txt1.errors import ConfigError
from txt1.mapping import command, graph_file, sweeps
from txt1.mapping.poses import accumulated, composed, difference
from txt1.mapping.sweeps import Sweep, Sweeper, awry
from txt1.maps import files
from txt1.record.reader import robot_in
from txt1.sensors.readings import Mount, Scan

RUN = (
    *("run", "--hal", "sim", "--headless", "--speed", "max", "--drive", "0.6,0.5"),
    *("--set", "sensors.laser.driver=sim_laser", "--set", "sim.vehicle.slip=0.05"),
    *("--set", "sim.obstacles=[{kind: box, x: 2.2, y: -1.6, length: 0.4, width: 0.4, theta: 0.3}]"),
)


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A recorded lap."""
    file = tmp_path_factory.mktemp("drive") / "drive.mcap"
    assert execute([*RUN, "--seed", "1", "--duration", "9", "--log", str(file)]) == 0
    return file


@pytest.fixture(scope="module")
def room(drive) -> Path:
    """The map's name."""
    name = drive.with_name("room")
    assert execute(["map", str(drive), "-o", str(name)]) == 0
    return name


def test_a_drive_becomes_a_map(room, capsys):
    grid = files.read(f"{room}.yaml").grid
    assert grid.is_free(0.6, 0.0) and grid.is_free(1.2, 1.2)
    walls = np.argwhere(grid.cells == 100)
    # where the room's walls are, 5 m x 5 m, or the box
    x, y = grid.to_room(walls[:, 1] + 1.5, walls[:, 0] + 1.5)
    side = np.maximum(np.abs(x), np.abs(y))
    print(np.histogram(side))
    assert np.mean(np.abs(side - 2.5) < 0.15) > 0.7
    assert Path(f"{room}.svg").read_text().startswith("<svg")


@pytest.mark.long
def test_it_is_made_again_to_the_same_bytes(drive, room, capsys):
    before = {file: file.read_bytes() for file in room.parent.glob("room.*")}
    assert execute(["map", str(drive), "-o", str(room), "--again"]) == 0
    assert capsys.readouterr().out.count("the same bytes") == 4
    assert {file: file.read_bytes() for file in room.parent.glob("room.*")} == before
    assert command.compared({**before, Path(f"{room}.pgm"): b"P5\n"}) == 1
    assert "room.pgm: DIFFERENT" in capsys.readouterr().out


@pytest.mark.long
def test_a_later_drive_extends_it_and_the_same_drive_does_not(room, tmp_path, capsys):
    drive = tmp_path / "drive.mcap"  # of the same name
    assert execute([*RUN, "--seed", "2", "--duration", "9", "--log", str(drive)]) == 0
    for suffix in (".graph", ".pgm", ".svg", ".yaml"):
        (tmp_path / f"room{suffix}").write_bytes(Path(f"{room}{suffix}").read_bytes())
    before = (tmp_path / "room.graph").stat().st_size
    assert execute(["map", str(drive), "-o", str(tmp_path / "room")]) == 0
    assert (tmp_path / "room.graph").stat().st_size > 1.5 * before
    old, new = (files.read(str(each)).grid for each in (f"{room}.yaml", tmp_path / "room.yaml"))
    assert abs(old.cells.shape[0] - new.cells.shape[0]) <= 3 and abs(old.cells.shape[1] - new.cells.shape[1]) <= 3
    assert execute(["map", str(drive), "-o", str(tmp_path / "room"), "--again"]) != 0
    assert "several drives" in capsys.readouterr().err
    both = (tmp_path / "room.graph").read_bytes()
    assert execute(["map", str(drive), "-o", str(tmp_path / "room")]) == 2
    assert (tmp_path / "room.graph").read_bytes() == both


def test_the_same_drive_is_not_mapped_twice(drive, room, capsys):
    before = Path(f"{room}.graph").read_bytes()
    assert execute(["map", str(drive), "-o", str(room)]) == 2
    told = capsys.readouterr().err
    assert f"this drive is on the map {room}.yaml already; --again" in told
    assert Path(f"{room}.graph").read_bytes() == before


def test_a_drive_with_the_same_start_is_another_drive(drive, room, tmp_path):
    start = tmp_path / "start.mcap"
    words = [each if each != "0.6,0.5" else "0.6,-0.5" for each in RUN]
    assert execute([*words, "--seed", "1", "--duration", "4", "--log", str(start)]) == 0
    mapper, _ = graph_file.load(Path(f"{room}.graph"))
    scans, first = (sweeps.read(file, robot_in(file, None)).sweeps for file in (start, drive))
    assert len(scans) > 20 and np.array_equal(scans[0].points, first[0].points)
    assert not command._repeats(mapper, scans)  # noqa: SLF001


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--sensor", "other"], "no scans of a laser 'other' in it; there are scans of: laser"),
        (["--resolution", "0"], "0.01 to 1 m"),
        (["--again", "-o", "none"], "nothing to compare with"),
    ],
)
def test_what_cannot_be_is_refused(drive, options, told, capsys):
    assert execute(["map", str(drive), *options]) == 2
    assert told in capsys.readouterr().err


def test_a_recording_without_scans_is_refused(tmp_path, capsys):
    file = tmp_path / "blind.mcap"
    assert execute(["run", "--hal", "sim", "--headless", "--speed", "max", "--duration", "1", "--log", str(file)]) == 0
    assert execute(["map", str(file)]) != 0
    assert "no scans of a laser" in capsys.readouterr().err
    assert not (tmp_path / "blind.yaml").exists()


def test_a_damaged_graph_is_refused(drive, tmp_path, capsys):
    (tmp_path / "room.graph").write_bytes(b"PK\x03\x04nonsense")
    assert execute(["map", str(drive), "-o", str(tmp_path / "room")]) == 2
    assert "--new" in capsys.readouterr().err


def test_a_full_disk_keeps_the_map(room, monkeypatch):
    before = {file: file.read_bytes() for file in room.parent.glob("room.*")}

    def full(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ConfigError, match="No space left on device"):
        command.write(dict.fromkeys(before, b"new"))
    assert {file: file.read_bytes() for file in room.parent.glob("room.*")} == before


def test_a_laser_that_looks_askew_is_told():
    rng = np.random.default_rng(1)
    steps = np.column_stack((np.full(200, 0.05), np.zeros(200), 0.01 * rng.standard_normal(200)))
    robot = accumulated((0.0, 0.0, 0.0), steps)
    said, true = (composed(robot, (0.2, 0.0, yaw)) for yaw in (0.0, np.radians(10.0)))
    assert abs(awry(said, said)) < 1e-6
    found = awry(true + 0.003 * rng.standard_normal(true.shape) * (1, 1, 0), said)
    assert 8.0 < found < 12.0
    assert awry(said[:20], said[:20]) is None


def test_beams_leave_from_where_the_robot_was_then():
    sweeper, beams = Sweeper(), 11
    scan = Scan(0.0, 0.0, 0.01, np.full(beams, 2.0, np.float32), 0.1, 4.0, None, Mount())
    sweeper.seen(0.1, scan)
    taken = [each for k in range(5) for each in sweeper.moved(0.1 * k, 1.0 * k * 0.1, 0.0, 0.0)]
    assert len(taken) == 1
    points = taken[0].points
    assert np.allclose(np.diff(points[:, 0]), 0.01) and np.allclose(points[:, 1], 0.0)
    # the middle of the sweep is where its pose is
    assert np.allclose(taken[0].odometry, (0.155, 0.0, 0.0))
    assert np.allclose(difference(taken[0].odometry, taken[0].odometry), 0.0)


@pytest.mark.parametrize(("said", "reach"), [(4.0, 4.0), (np.inf, 30.0)])
def test_a_beam_that_met_nothing_tells_of_no_wall_within_the_lasers_reach(said, reach):
    sweeper = Sweeper()
    sweeper.seen(0.1, Scan(0.0, 0.1, 0.0, np.array([np.inf, np.nan, 2.0], np.float32), 0.1, said, None, Mount()))
    [taken] = [each for k in range(3) for each in sweeper.moved(0.1 * k, 0.0, 0.0, 0.0)]
    assert len(taken.points) == len(taken.free) == 1 and taken.reach == reach


def predicted(rate_at: Callable[[float], float | None]) -> Sweep:
    """The scan at 4 s of a robot that stands for 2 s, and then turns at 0.5 rad/s while its wheels say 0.6."""
    sweeper, taken = Sweeper(), []
    sweeper.seen(3.99, Scan(0.0, 0.0, 0.0, np.full(3, 2.0, np.float32), 0.1, 4.0, None, Mount()))
    for k in range(230):
        now = 0.02 * k
        if (rate := rate_at(now)) is not None:
            sweeper.turned(now, rate)
        turning = max(0.0, now - 2.0)
        taken += sweeper.moved(now, 0.1 * turning, 0.0, 0.6 * turning)
    [sweep] = taken
    return sweep


def gyro(now: float) -> float:
    return 0.02 + (0.5 if now > 2.0 else 0.0)  # its bias, and the turn


def test_the_gyro_predicts_turns_and_its_bias_is_learned_at_rest():
    sweep = predicted(gyro)
    assert sweep.odometry[2] == pytest.approx(1.2, abs=0.02), "the wheels' own odometry stays"
    assert sweep.predicted[2] == pytest.approx(1.0, abs=0.02)


def test_without_a_gyro_wheels_predict_and_where_it_falls_silent_they_go_on():
    for rate_at in (lambda _: None, lambda _: float("nan"), lambda _: 1e308):
        without = predicted(rate_at)
        assert np.array_equal(without.predicted, without.odometry) and without.odometry[2] == pytest.approx(1.194)
    half = predicted(lambda now: gyro(now) if now < 3.0 else None)
    assert half.predicted[2] == pytest.approx(0.5 + 0.6, abs=0.02)


def test_the_number_of_beams_may_change_and_ranges_may_be_nonsense():
    sweeper = Sweeper()
    ranges = np.array([np.nan, np.inf, 0.0, 1.0, 5.0], np.float32)
    for k, values in enumerate((ranges, ranges[1:])):
        sweeper.seen(0.1 * k, Scan(0.0, 0.1, 0.0, values.copy(), 0.1, 4.0, None, Mount()))
    taken = [each for k in range(5) for each in sweeper.moved(0.1 * k, 0.0, 0.0, 0.0)]
    assert [len(each.points) for each in taken] == [1, 1]
