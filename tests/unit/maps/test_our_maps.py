"""The maps in config/maps: drawn by the script, fit to start in, their centre lines on the track."""

from pathlib import Path

import numpy as np
import pytest

from rigs import maps
from txt1.maps.files import MAPS, names, read
from txt1.model.vehicle import Geometry
from txt1.resources import resource
from txt1.sim.walls import PLENTY, walls_of

FOLDER = resource(MAPS)


def test_there_are_three_rooms_a_corridor_and_seven_tracks() -> None:
    assert names() == sorted([*maps.ROOMS, *maps.TRACKS])
    assert (len(maps.ROOMS), len(maps.TRACKS)) == (4, 7)


@pytest.mark.parametrize("name", names())
def test_every_map_is_small_and_has_room_at_its_start(name: str) -> None:
    assert sum(file.stat().st_size for file in FOLDER.glob(f"{name}[._]*")) < 30_000
    assert walls_of(name).clearance(0.0, 0.0, 0.0, Geometry()) > PLENTY


@pytest.mark.parametrize("name", maps.TRACKS)
def test_a_centre_line_lies_between_walls_at_its_widths(name: str) -> None:
    line = np.loadtxt(FOLDER / f"{name}_centerline.csv", delimiter=",")
    grid = read(name).grid
    ahead = np.roll(line[:, :2], -1, axis=0) - line[:, :2]
    length = np.hypot(*ahead.T)
    assert length == pytest.approx(maps.SPACING, abs=0.01)
    assert line[0, :2] == pytest.approx([0.0, 0.0], abs=1e-3)
    assert ahead[0, 1] == pytest.approx(0.0, abs=0.01) and ahead[0, 0] > 0.0
    least, most = maps.TRACKS[name].width
    assert 1.9 <= least < most <= 3.0
    across = line[:, 2] + line[:, 3]
    assert np.all((across >= least - 2e-3) & (across <= most + 2e-3))
    left = np.column_stack((-ahead[:, 1], ahead[:, 0])) / length[:, None]
    for side, width in ((left, line[:, 3]), (-left, line[:, 2])):
        for beyond, free in ((-0.15, True), (0.1, False)):
            x, y = (line[:, :2] + (width + beyond)[:, None] * side).T
            assert np.mean(grid.is_free(x, y) == free) > 0.98


def test_the_script_draws_these_very_maps(tmp_path: Path) -> None:
    for name in ("flat", "oval"):
        maps.draw(name, tmp_path)
        ours, drawn = read(name).grid, read(str(tmp_path / f"{name}.yaml")).grid
        assert (ours.origin, ours.cells.shape) == (drawn.origin, drawn.cells.shape)
        # another processor may round the border of a cell to its other side
        assert np.mean(ours.cells != drawn.cells) < 1e-4
    lines = [np.loadtxt(folder / "oval_centerline.csv", delimiter=",") for folder in (FOLDER, tmp_path)]
    assert lines[0] == pytest.approx(lines[1], abs=2e-3)
