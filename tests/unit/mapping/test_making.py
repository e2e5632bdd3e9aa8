"""`txt1 run --map`: a map is made while a simulated robot drives; files, recordings, replays, and what is refused."""

import asyncio
import gc
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from tests.unit.mapping.rooms import drive, room, scan
from txt1.cli import execute
from txt1.errors import HalError
from txt1.mapping import graph_file, grid_files, scan_work
from txt1.mapping.growing_grid import GrowingGrid
from txt1.mapping.map_sensors import NewsSensor
from txt1.mapping.mapper import Mapper
from txt1.mapping.sweeps import Sweep
from txt1.mapping.worker import Far
from txt1.maps import files
from txt1.record.command.view import viewable
from txt1.record.reader import Decoding, FilePass
from txt1.telemetry import exact

RUN = (
    *("run", "--hal", "sim", "--headless", "--speed", "max", "--drive", "0.5,0.45"),
    *("--set", "sensors.laser.driver=sim_laser"),
)
MOUNT = (0.0, 0.0, 0.0)


def tasks(count: int) -> list[scan_work.ScanTask]:
    rng, there = np.random.default_rng(1), room()
    return [
        scan_work.ScanTask(Sweep(0.1 * k, scan(there, pose, rng), np.array(pose), np.array(pose)), MOUNT)
        for k, pose in enumerate(drive(1.0)[:count])
    ]


def machine_code() -> dict[str, int]:
    """How many types of arguments each compiled loop has machine code for."""
    loops = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {each.__name__: len(each.signatures) for each in loops if each.signatures}


def test_scans_from_the_other_process_need_no_more_compiling(tmp_path):
    scan_work.warm()
    before = machine_code()
    scans = [exact.decode(scan_work.ScanTask, exact.encode(task)) for task in tasks(30)]
    making = scan_work.Mapping(tmp_path / "room", 0.05)
    for task in scans:
        making.take(task)
    making.finish()
    searching = scan_work.locating(str(tmp_path / "room"), 0)
    for task in scans:
        searching.take(task)
    loops = {"thin", "stamp", "search", "listed", "align", "carve", "bounds_of", "refined", "_weigh"}
    after = machine_code()
    assert loops <= set(before) and {name: after[name] for name in loops} == {name: before[name] for name in loops}


def test_a_map_is_made_while_driving_and_the_run_verifies(tmp_path, capsys):
    file, name = tmp_path / "drive.mcap", tmp_path / "room"
    assert execute([*RUN, "--duration", "4", "--seed", "1", "--map", str(name), "--log", str(file)]) == 0
    assert "keyframes" in capsys.readouterr().err
    assert {each.suffix for each in tmp_path.glob("room.*")} == set(graph_file.SUFFIXES)
    assert files.read(f"{name}.yaml").grid.is_free(1.0, 0.0)
    topics = {item.name for item in FilePass(file)}
    assert {"/map", "/tf_map", "/tf_room_below", "/sensors/map", "/sensors/mapping"} <= topics
    assert "/tf_room" not in topics, "odom has one parent, the map"
    # for viewers that draw no map and no way on it: the walls of the empty room, 5 m x 5 m, and the way, as points
    viewable(file, tmp_path / "copy.mcap")
    clouds, decoding = {}, Decoding()
    for item in FilePass(tmp_path / "copy.mcap"):
        if item.name in ("/map/points", "/sensors/mapping/points"):
            message = decoding.message(item)
            clouds[item.name] = np.frombuffer(bytes(message.data), np.float32).reshape(-1, 3)
    walls, way = clouds["/map/points"], clouds["/sensors/mapping/points"]
    assert len(walls) > 100 and np.abs(np.abs(walls[:, :2]).max(axis=1) - 2.5).max() < 0.2
    assert 1.0 < np.hypot(*np.diff(way[:, :2], axis=0).T).sum() < 2.0
    before = {each: each.read_bytes() for each in tmp_path.glob("room.*")}
    assert execute(["replay", "--verify", str(file)]) == 0
    assert "no difference" in capsys.readouterr().out
    # a replay computes no map and writes none
    assert {each: each.read_bytes() for each in tmp_path.glob("room.*")} == before


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--map", "room", "--in", "flat"], "give one of them"),
        (["--map", "room", "--at", "0,0,0"], "give the map, with --in"),
        (["--map", "room.yaml"], "without .yaml"),
        (["--map", "nowhere/room"], "there is no folder"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, monkeypatch, capsys, options, word):
    monkeypatch.chdir(tmp_path)
    assert execute([*RUN, "--duration", "1", *options]) == 2
    assert word in capsys.readouterr().err


@pytest.mark.parametrize(("takes", "told"), [(0.5, False), (4.0, True)])
def test_a_map_that_takes_long_to_finish_can_be_left_to_the_background(tmp_path, monkeypatch, capsys, takes, told):
    async def slow(sensor):
        await asyncio.sleep(takes)
        return ["room.yaml: written"]

    monkeypatch.setattr(NewsSensor, "finish", slow)
    assert execute([*RUN, "--duration", "1", "--map", str(tmp_path / "room")]) == 0
    before, written, _ = capsys.readouterr().err.partition("written")
    assert written and ("Ctrl-C leaves that to the background" in before) is told


def test_a_map_that_grows_is_that_of_all_scans_at_once():
    mapper, growing = Mapper(), GrowingGrid()
    for k, each in enumerate(tasks(25)):
        mapper.add(each.sweep.time, each.sweep.points, each.sweep.odometry)
        if k % 6 == 4 and k < 24:
            growing.update(mapper)
    grown = growing.update(mapper)
    assert grown is not None
    whole = grid_files.grid_of([key.cloud for key in mapper.keys], mapper.graph.poses, mapper.loops)
    x, y = np.meshgrid(np.arange(-3.9, 3.9, 0.1) + 0.02, np.arange(-2.9, 2.9, 0.1) + 0.02)
    assert np.array_equal(grown.is_free(x, y), whole.is_free(x, y))


def test_a_full_disk_keeps_the_map_elsewhere(tmp_path, monkeypatch):
    other = tmp_path / "other"
    other.mkdir()
    monkeypatch.setattr(scan_work, "gettempdir", lambda: str(other))
    making, put = scan_work.Mapping(tmp_path / "room", 0.05), grid_files.put

    def full(files):
        if next(iter(files)).parent == tmp_path:
            raise OSError(28, "No space left on device")
        put(files)

    monkeypatch.setattr(grid_files, "put", full)
    for each in tasks(4):
        making.take(each)
    lines = " ".join(making.finish())
    assert "No space left on device" in lines and str(other / "room") in lines
    assert (other / "room.yaml").exists() and not (tmp_path / "room.yaml").exists()


def test_a_map_is_extended_and_a_drive_without_its_place_leaves_it(tmp_path):
    first = scan_work.Mapping(tmp_path / "room", 0.05)
    for each in tasks(30):
        first.take(each)
    first.finish()
    before = (tmp_path / "room.graph").read_bytes()
    again = scan_work.Mapping(tmp_path / "room", 0.05)
    assert again.take(tasks(1)[0]).lost
    assert "fits nowhere" in again.finish()[0]
    assert (tmp_path / "room.graph").read_bytes() == before


@pytest.mark.long
def test_a_process_makes_the_map_and_keeps_it_when_the_robot_is_gone(tmp_path):
    async def work(finish: bool, name: str) -> list[str]:
        far = Far({"make": str(tmp_path / name), "resolution": 0.05})
        await far.open()
        told = []
        for each in tasks(6):
            far.give(each)
            while not far.done:
                assert not far.failure
                await asyncio.sleep(0.01)
            told.append(far.done.popleft())
        assert [each.time for each in told] == [each.sweep.time for each in tasks(6)]
        assert told[0].sheet is not None
        if finish:
            return await far.finish()
        # as if the robot's process had been killed
        far._line.shutdown(2)  # noqa: SLF001
        await asyncio.to_thread(far._child.wait)  # noqa: SLF001
        return []

    assert "6 scans" in asyncio.run(work(True, "room"))[0]
    asyncio.run(work(False, "kept"))
    assert {each.name for each in tmp_path.glob("*.yaml")} == {"room.yaml", "kept.yaml"}


@pytest.mark.long
def test_a_process_that_cannot_begin_says_why(tmp_path):
    (tmp_path / "room.graph").write_bytes(b"nonsense")
    far = Far({"make": str(tmp_path / "room"), "resolution": 0.05})
    with pytest.raises(HalError, match="damaged"):
        asyncio.run(far.open())


def test_who_ends_the_robot_while_the_process_compiles_does_not_wait_for_it(tmp_path):
    async def ended() -> int | None:
        far = Far({"make": str(tmp_path / "room"), "resolution": 0.05})
        opening = asyncio.create_task(far.open())
        while far._child is None:  # noqa: SLF001
            await asyncio.sleep(0.01)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        return far._child.poll()  # noqa: SLF001

    assert asyncio.run(ended()) == -signal.SIGKILL


def test_who_leaves_the_finishing_of_a_map_to_its_process_does_not_wait_for_it():
    far = Far({"make": "room", "resolution": 0.05})
    far._thread = threading.Thread()  # noqa: SLF001 - its process works on

    async def left() -> None:
        finishing = asyncio.create_task(far.finish())
        await asyncio.sleep(0)
        finishing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await finishing

    asyncio.run(left())


def test_news_go_through_the_line_whole():
    from txt1.mapping.topics import MapNews
    from txt1.telemetry import exact

    making = scan_work.Mapping(Path("nowhere/room"), 0.05)
    for each in tasks(3):
        again = exact.decode(scan_work.ScanTask, exact.encode(each))
        assert np.array_equal(again.sweep.points, each.sweep.points) and again.mount == each.mount
        news = making.take(again)
        assert exact.decode(MapNews, exact.encode(news)) == news
