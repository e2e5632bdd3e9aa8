"""Distances in an occupancy grid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from txt1.maps.grid import FREE, OCCUPIED, REACH, WITHIN, Grid, distances


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.2), st.integers(1, 60), st.integers(1, 60))
def test_distances_are_those_of_another_implementation(seed: int, marked: float, rows: int, columns: int) -> None:
    cells = np.random.default_rng(seed).random((rows, columns)) < marked
    cells[0, 0] = True
    exact = distance_transform_edt(~cells)
    assert distances(cells, REACH) == pytest.approx(np.minimum(exact, REACH), abs=1e-5)


def test_depth_is_0_on_the_line_between_free_and_solid_and_negative_inside() -> None:
    cells = np.full((1, 60), FREE, np.int8)
    cells[0, 40:] = OCCUPIED
    depth = Grid(np.repeat(cells, 80, axis=0), 0.1).depth[40]
    assert depth[39:43].tolist() == pytest.approx([0.15, 0.05, -0.05, -0.15])
    assert depth.min() == pytest.approx(0.1 * (0.5 - WITHIN))


def test_places_and_cells_are_turned_into_one_another() -> None:
    grid = Grid(np.zeros((4, 5), np.int8), 0.5, (1.0, -2.0, 0.7))
    x, y = grid.to_room(*grid.to_cells(3.0, 4.0))
    assert (float(x), float(y)) == pytest.approx((3.0, 4.0))
    assert grid.to_cells(1.0, -2.0) == pytest.approx((1.0, 1.0))
