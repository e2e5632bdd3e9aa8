"""Maps as others publish them: the kinds of nav2, slam_toolbox, turtlebot3 and race stacks, of our own making."""

from __future__ import annotations

import sys
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.cli import execute
from txt1.errors import ConfigError, MissingExtra
from txt1.kernel.loop import run
from txt1.maps.files import Map, read, write
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from txt1.robot import Robot

HEAD = "resolution: 0.05\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\n"
SAVED = np.array([[254, 254, 0], [205, 254, 254]], np.uint8)
"""A floor as savers of maps write it: a wall, and a cell that nobody has seen."""
AS_MEANT = [[UNKNOWN, FREE, FREE], [FREE, FREE, OCCUPIED]]


def pgm(pixels: Any) -> bytes:
    rows, columns = np.shape(pixels)
    return b"P5\n# CREATOR: map_saver\n%d %d\n255\n" % (columns, rows) + np.asarray(pixels, np.uint8).tobytes()


def given(folder: Path, text: str, picture: bytes = pgm(SAVED), name: str = "floor.pgm") -> Map:
    (folder / name).write_bytes(picture)
    (folder / "floor.yaml").write_text(text)
    return read(str(folder / "floor.yaml"))


TRINARY = {
    "nav2 of Humble, slam_toolbox": f"image: floor.pgm\nmode: trinary\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.25",
    "nav2 of Jazzy": f"image: floor.pgm\nmode: trinary\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.196\n",
    "nav2's warehouse": f"image: floor.pgm\nmode: trinary\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.1\n",
    "ROS 1": f"image: floor.pgm\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.196\n\n",
    "a race": f"image: floor.pgm\n{HEAD}occupied_thresh: 0.45\nfree_thresh: 0.2\ncenterline: floor_centerline.csv\n",
    "in quotes": (
        'map_type: "occupancy"\nimage: "floor.pgm"\nresolution: "0.05"\norigin: ["-1.0", 2, 0]\nnegate: "0"\n'
        'mode: "Trinary"\noccupied_thresh: "0.65"\nfree_thresh: 1.96e-1\n'
    ),
    "YAML's words": (
        "image: floor.pgm\nresolution: 5e-2\norigin: [-1e0, 2., +0]\nnegate: no\nmode: TRINARY\n"
        "occupied_thresh: .65\nfree_thresh: 25e-2\n"
    ),
    "another computer's place": f"image: /home/maker/ws/src/maps/floor.pgm\n{HEAD}",
    "a home": f"image: ~/maps/of/the/maker/floor.pgm\n{HEAD}",
}


@pytest.mark.parametrize("kind", TRINARY)
def test_a_map_is_read_as_its_saver_meant_it(kind: str, tmp_path: Path) -> None:
    found = given(tmp_path, TRINARY[kind])
    assert found.grid.cells.tolist() == AS_MEANT
    assert (found.grid.resolution, found.grid.origin) == (0.05, (-1.0, 2.0, 0.0))


def test_unknown_cells_of_a_map_of_humble_are_told_once(tmp_path: Path) -> None:
    found = given(tmp_path, TRINARY["nav2 of Humble, slam_toolbox"])
    (remark,) = found.remarks
    assert remark.startswith(f"{tmp_path / 'floor.yaml'}: grey 205 is unknown, 17% of the map")
    assert "free_thresh 0.25" in remark and "\n" not in remark
    assert given(tmp_path, TRINARY["nav2 of Jazzy"]).remarks == ()


def test_a_grey_205_that_is_dark_where_black_is_free_is_a_wall(tmp_path: Path) -> None:
    text = f"image: floor.pgm\n{HEAD.replace('negate: 0', 'negate: 1')}free_thresh: 0.25\n"
    found = given(tmp_path, text, pgm([[0, 205, 120]]))
    assert found.grid.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN]] and not found.remarks


def test_a_picture_from_another_computers_place_is_told(tmp_path: Path) -> None:
    (remark,) = given(tmp_path, TRINARY["another computer's place"]).remarks
    assert "image: /home/maker/ws/src/maps/floor.pgm is not there, so floor.pgm beside the .yaml is read" in remark
    (tmp_path / "floor.pgm").unlink()
    with pytest.raises(ConfigError, match=r"/home/maker/ws/src/maps/floor\.pgm: cannot read the map: No such file"):
        read(str(tmp_path / "floor.yaml"))


def test_thresholds_in_the_other_order_are_read_as_map_server_does_and_told(tmp_path: Path) -> None:
    found = given(tmp_path, f"image: floor.pgm\n{HEAD}occupied_thresh: 0.3\nfree_thresh: 0.8\n", pgm([[0, 150, 254]]))
    assert found.grid.cells.tolist() == [[OCCUPIED, OCCUPIED, FREE]]
    (remark,) = found.remarks
    assert "free_thresh 0.8 is above occupied_thresh 0.3" in remark


def test_scale_is_a_share_between_the_thresholds(tmp_path: Path) -> None:
    text = f"image: floor.pgm\nmode: scale\n{HEAD}occupied_thresh: 1.0\nfree_thresh: 0.0\n"
    found = given(tmp_path, text, pgm([[255, 204, 102, 0]]))
    assert found.grid.cells.tolist() == [[0, 20, 60, 100]]
    assert found.grid.is_free([-0.97, -0.92, -0.87, -0.82], [2.02] * 4).tolist() == [True, True, False, False]
    keepout = f"image: floor.pgm\nmode: Scale\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    assert given(tmp_path, keepout, pgm([[255, 205, 140, 0]])).grid.cells.tolist() == [[0, 0, 50, 100]]


def test_a_raw_map_holds_the_cells_themselves(tmp_path: Path) -> None:
    text = f"image: floor.pgm\nmode: raw\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    found = given(tmp_path, text, pgm([[0, 49, 100, 101, 255]]))
    assert found.grid.cells.tolist() == [[0, 49, 100, UNKNOWN, UNKNOWN]]


# -- pictures as other programs write them -----------------------------------------------------------------------

pillow = pytest.importorskip("PIL.Image")


def saved(pixels: Any, kind: str, mode: str = "") -> bytes:
    """A picture as Pillow writes it, of 8 or 16 bits, in this mode of Pillow's."""
    drawn = pillow.fromarray(np.asarray(pixels))
    stream = BytesIO()
    (drawn.convert(mode) if mode else drawn).save(stream, kind)
    return stream.getvalue()


def transparent(grey: int, alpha: int) -> list[int]:
    return [grey, grey, grey, alpha]


PICTURES: dict[str, Callable[[], bytes]] = {
    "grey": lambda: saved(SAVED, "PNG"),
    "grey of 16 bits": lambda: saved(SAVED.astype(np.uint16) * 257, "PNG"),
    "colours": lambda: saved(SAVED, "PNG", "RGB"),
    "a palette": lambda: saved(SAVED, "PNG", "P"),
    "BMP": lambda: saved(SAVED, "BMP"),
    "BMP in colours": lambda: saved(SAVED, "BMP", "RGB"),
}


@pytest.mark.parametrize("kind", PICTURES)
@pytest.mark.parametrize("free", ["0.196", "0.25"])
def test_a_picture_of_another_program_is_the_same_map(kind: str, free: str, tmp_path: Path) -> None:
    suffix = "bmp" if kind.startswith("BMP") else "png"
    text = f"image: floor.{suffix}\n{HEAD}free_thresh: {free}\n"
    assert given(tmp_path, text, PICTURES[kind](), f"floor.{suffix}").grid.cells.tolist() == AS_MEANT


def test_a_picture_of_one_bit_has_walls_and_floor(tmp_path: Path) -> None:
    found = given(tmp_path, f"image: floor.png\n{HEAD}", saved(SAVED, "PNG", "1"), "floor.png")
    assert found.grid.cells[1, 2] == OCCUPIED and found.grid.cells[0, 1] == FREE


def test_colours_are_averaged_as_map_server_does(tmp_path: Path) -> None:
    # a third of white: neither free nor a wall, though people see yellow as light and blue as dark
    colours = np.array([[[255, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    text = f"image: floor.png\n{HEAD}occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    found = given(tmp_path, text, saved(colours, "PNG"), "floor.png")
    assert found.grid.cells.tolist() == [[UNKNOWN, OCCUPIED, FREE]]


def test_transparency_is_one_more_colour_but_unknown_in_scale(tmp_path: Path) -> None:
    colours = np.array([[transparent(255, 255), transparent(0, 255), transparent(0, 0), transparent(255, 0)]], np.uint8)
    picture = saved(colours, "PNG")
    found = given(tmp_path, f"image: floor.png\n{HEAD}", picture, "floor.png")
    assert found.grid.cells.tolist() == [[FREE, OCCUPIED, OCCUPIED, UNKNOWN]]
    found = given(tmp_path, f"image: floor.png\nmode: scale\n{HEAD}", picture, "floor.png")
    assert found.grid.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN, UNKNOWN]]
    grey = saved(np.array([[254, 0]], np.uint8), "PNG", "LA")
    assert given(tmp_path, f"image: floor.png\n{HEAD}", grey, "floor.png").grid.cells.tolist() == [[FREE, OCCUPIED]]


def test_a_bmp_too_large_is_refused_by_its_head_and_a_broken_one_in_a_line(tmp_path: Path) -> None:
    whole = saved(SAVED, "BMP")
    large = whole[:18] + (20_000).to_bytes(4, "little") * 2 + whole[26:]
    for picture, told in (
        (large, "20000 x 20000 pixels; a map has at most 32 million"),
        (whole[:30], "cannot read the"),
    ):
        with pytest.raises(ConfigError) as refused:
            given(tmp_path, f"image: floor.bmp\n{HEAD}", picture, "floor.bmp")
        assert f"floor.bmp: {told}" in str(refused.value) and "\n" not in str(refused.value)


def test_a_bmp_without_pillow_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = saved(SAVED, "BMP")
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingExtra, match=r"a map from a BMP, .* needs the extra 'camera'"):
        given(tmp_path, f"image: floor.bmp\n{HEAD}", picture, "floor.bmp")


# -- as a user meets it -------------------------------------------------------------------------------------------


def humble(folder: Path) -> Path:
    """A floor of 3 m x 3 m in unknown ground, as nav2 of Humble saves it."""
    cells = np.full((80, 80), UNKNOWN, np.int8)
    cells[9:71, 9:71], cells[10:70, 10:70] = OCCUPIED, FREE
    file = folder / "room.yaml"
    write(Grid(cells, 0.05, (-2.0, -2.0, 0.0)), file)
    file.write_text(file.read_text().replace("0.196", "0.25"))
    return file


def test_world_show_tells_what_is_unknown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["world", "show", str(humble(tmp_path))]) == 0
    told = capsys.readouterr().out
    assert "free 56%, walls 4%, unknown 40%" in told
    assert told.count("grey 205 is unknown, 40% of the map") == 1


@pytest.mark.parametrize(
    "words", [["--set", "sim.room.map={}"], ["--in", "{}", "--set", "sensors.laser.driver=sim_laser"]]
)
def test_a_run_tells_it_in_one_line(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(humble(tmp_path))
    drive = ["run", "--headless", "--speed", "max", "--duration", "0.5", *(word.format(file) for word in words)]
    assert execute(drive) == 0
    assert capsys.readouterr().err.count("txt1: ") == 1


def test_a_car_does_not_drive_onto_ground_that_a_map_of_humble_never_saw(tmp_path: Path) -> None:
    cells = np.full((40, 80), UNKNOWN, np.int8)
    cells[10:30, 10:50] = FREE
    file = tmp_path / "open.yaml"
    write(Grid(cells, 0.05, (-1.0, -1.0, 0.0)), file)
    file.write_text(file.read_text().replace("0.196", "0.25"))

    async def drive() -> float:
        from txt1.config import load

        config = load(overrides=[f"sim.room.map={file}", "safety.runaway_time=60"]).config
        async with Robot.open(config=config) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 6.0)
            pose = robot.pose
            assert pose is not None
            return pose[0]

    # the unknown ground begins at 1.5 m, and the car's nose is 0.255 m ahead
    assert run(drive(), speed="max") < 1.3
