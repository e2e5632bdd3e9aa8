"""A robot in a map: recorded, verified, shown."""

from pathlib import Path

import numpy as np
import pytest

from tests.unit.maps.test_rays import hall
from txt1.cli import execute
from txt1.commands import OK, USAGE
from txt1.errors import RecordingError
from txt1.kernel.loop import run
from txt1.maps.files import write
from txt1.maps.grid import OCCUPIED, Grid
from txt1.record.session import recording
from txt1.record.verification import verify
from txt1.robot import Robot


async def drive(file: Path, settings: list[str]) -> None:
    from txt1.config import load

    config = load(overrides=settings).config
    async with (
        recording(file, config, "max", {}, print) as attach,
        Robot.open(config=config, attach=attach) as robot,
    ):
        await robot.load_gains()
        await robot.drive(0.5, 0.0, 5.0)


def test_a_recording_in_a_map_verifies_as_long_as_the_map_is_there(tmp_path: Path) -> None:
    map_, made = tmp_path / "hall.yaml", tmp_path / "drive.mcap"
    write(hall(), map_)
    run(drive(made, [f"sim.room.map={map_}", "sim.start=[-0.5, 0, 0.3]", "safety.runaway_time=60"]), speed="max")
    found = verify(made)
    assert found.difference is None and found.compared > 100

    cells = hall().cells.copy()
    cells[10, 10] = OCCUPIED
    write(Grid(cells, hall().resolution, hall().origin), map_)
    with pytest.raises(
        RecordingError, match=r"recorded in the map .*hall\.yaml of SHA-256 \w{12}, now it is \w{12}: put"
    ):
        verify(made)
    map_.unlink()
    with pytest.raises(RecordingError, match=r"recorded in the map .*, which cannot be read here: there is no map"):
        verify(made)


@pytest.mark.parametrize("name", ["flat", "thesis"])
def test_a_map_or_a_world_is_drawn_by_its_name(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["world", "show", name]) == OK
    printed = capsys.readouterr().out
    assert any("⠀" < each <= "⣿" for each in printed)
    assert "start: (0, 0, 0), light: (0, 0)" in printed
    assert ("free 67%, walls 8%, unknown 25%" in printed) is (name == "flat")


def test_a_file_is_drawn_whether_it_is_a_map_or_a_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(hall(), tmp_path / "hall.yaml")
    (tmp_path / "world.yaml").write_text(
        "sim: {room: {map: oval}, obstacles: [{kind: post, x: 2, y: 0.5, radius: 0.1}]}\n"
    )
    assert execute(["world", "show", str(tmp_path / "hall.yaml")]) == OK
    assert "4.1 m x 3.1 m" in capsys.readouterr().out
    assert execute(["world", "show", str(tmp_path / "world.yaml")]) == OK
    assert "obstacles: 1" in capsys.readouterr().out


@pytest.mark.parametrize(("lap", "closes"), [("false", False), ("true", True)])
def test_what_moves_is_drawn_with_its_way(lap: str, closes: bool, capsys: pytest.CaptureFixture[str]) -> None:
    def drawn(movers: str) -> list[str]:
        assert execute(["world", "show", "thesis", "--set", f"sim.movers=[{movers}]"]) == OK
        return capsys.readouterr().out.splitlines()

    room, world = drawn(""), drawn(f"{{path: [[-2, -2], [2, -2], [2, 2]], speed: 0.5, lap: {lap}}}")
    changed = {
        (row, column)
        for row, line in enumerate(world[:-3])
        for column, sign in enumerate(line)
        if sign != room[row][column]
    }
    low, high, first, last = (f({place[axis] for place in changed}) for axis in (0, 1) for f in (min, max))
    between = [(row, column) for row, column in changed if low + 2 < row < high - 2 and first + 6 < column < last - 6]
    assert high - low > 5 and last - first > 10
    assert bool(between) is closes  # the straight way back to the first point crosses the room
    assert world[-1].endswith("movers: 1")


def test_a_start_in_a_wall_is_refused_with_a_place_that_is_free(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["world", "show", "flat", "--set", "sim.start=[3.1, -1, 0]"]) == USAGE
    told = capsys.readouterr().err
    x, y = np.fromstring(told.partition("there is room at [")[2].partition("]")[0], sep=",")[:2]
    assert execute(["world", "show", "flat", "--set", f"sim.start=[{x}, {y}, 0]"]) == OK


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["cellar"], "cellar: there is no such map or world; 'txt1 world list' names ours, or give a .yaml"),
        (["thesis", "--config", "config/txt1.yaml"], "thesis is a configuration itself; give one of them"),
        (["flat", "--set", "sim.room.length=8"], "length, width: the walls are those of the map"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["world", "show", *words]) == USAGE
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1


def test_the_maps_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["world", "list"]) == OK
    told = "world thesis: the thesis's world, as it stands"
    assert {"map clover", "map flat", told} <= set(capsys.readouterr().out.splitlines())
