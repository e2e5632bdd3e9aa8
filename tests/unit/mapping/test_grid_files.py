"""A map's files: map_server's pair as `txt1.maps` reads it, and what a full disk leaves."""

from pathlib import Path

import numpy as np
import pytest

from txt1.mapping import grid_files
from txt1.maps import files
from txt1.maps.files import CELLS_MAX
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid


def grid() -> Grid:
    cells = np.full((4, 6), UNKNOWN, np.int8)
    cells[1:3, 1:5] = FREE
    cells[0], cells[2, 2] = OCCUPIED, OCCUPIED
    return Grid(cells, 0.05, (-1.25, 0.5, 0.0))


def test_files_are_read_back(tmp_path):
    grid_files.save(grid(), tmp_path / "room", [("#f00", np.zeros((2, 3)))])
    read = files.read(str(tmp_path / "room.yaml")).grid
    assert np.array_equal(read.cells, grid().cells)
    assert read.resolution == 0.05 and read.origin == (-1.25, 0.5, 0.0)
    assert (tmp_path / "room.pgm").read_bytes().startswith(b"P5\n6 4\n255\n")
    assert "<polyline" in (tmp_path / "room.svg").read_text()
    assert sorted(each.suffix for each in tmp_path.iterdir()) == [".pgm", ".svg", ".yaml"]


def test_a_full_disk_keeps_the_old_map(tmp_path, monkeypatch):
    grid_files.save(grid(), tmp_path / "room")
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}

    def full(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space"):
        grid_files.save(grid(), tmp_path / "room")
    monkeypatch.undo()
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before


def test_a_map_too_large_gets_larger_cells_and_says_so():
    from txt1.mapping.matcher import Cloud, compiled_kernels

    far = Cloud(np.array([[500.0, 500.0]]), np.zeros((1, 2)))
    found = grid_files.grid_of([far], np.zeros((1, 3)), compiled_kernels())
    assert found.resolution == 0.1 and found.cells.size <= CELLS_MAX
    assert found.is_free(250.0, 250.0) and not found.is_free(500.0, 500.0)
    told = grid_files.coarser(found.resolution, 0.05)
    assert told == "the map's cells are 0.1 m, not 0.05 m: at 0.05 m it would have more than 32 million"
    assert not grid_files.coarser(0.05, 0.05)
