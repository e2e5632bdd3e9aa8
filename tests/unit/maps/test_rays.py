"""Rays against an occupancy grid: compiled and as arrays, beside what geometry says."""

import re
from math import cos, inf, nan, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from txt1.installing import installs
from txt1.maps import rays
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Floats, Grid
from txt1.maps.rays import cast, prepare

CELL = 0.05
ANGLES = np.linspace(-pi, pi, 97)


def hall(length: int = 80, width: int = 60, yaw: float = 0.0) -> Grid:
    """An empty hall of so many cells around the origin, in walls one cell thick."""
    cells = np.full((width + 2, length + 2), OCCUPIED, np.int8)
    cells[1:-1, 1:-1] = FREE
    x, y = -0.5 * CELL * (length + 2), -0.5 * CELL * (width + 2)
    return Grid(cells, CELL, (x * cos(yaw) - y * sin(yaw), x * sin(yaw) + y * cos(yaw), yaw))


def to_the_walls(x: float, y: float, angles: Floats) -> Floats:
    """The distances to the walls of `hall`, by the equation of a rectangle."""
    with np.errstate(divide="ignore"):
        return np.minimum(
            np.abs((np.where(np.cos(angles) > 0.0, 2.0, -2.0) - x) / np.cos(angles)),
            np.abs((np.where(np.sin(angles) > 0.0, 1.5, -1.5) - y) / np.sin(angles)),
        )


def without_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rays, "_compiled", lambda: None)


@pytest.mark.parametrize("compiled", [True, False])
@settings(deadline=None, max_examples=40)
@given(st.floats(-1.99, 1.99), st.floats(-1.49, 1.49), st.floats(-pi, pi))
def test_rays_in_a_rectangle_are_as_long_as_geometry_says(compiled: bool, x: float, y: float, yaw: float) -> None:
    with pytest.MonkeyPatch.context() as patch:
        if not compiled:
            without_numba(patch)
        px, py = x * cos(yaw) - y * sin(yaw), x * sin(yaw) + y * cos(yaw)
        assert cast(hall(yaw=yaw), px, py, ANGLES + yaw) == pytest.approx(to_the_walls(x, y, ANGLES), abs=1e-9)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.4))
def test_the_compiled_rays_and_those_of_arrays_are_the_same_within_a_cell(seed: int, filled: float) -> None:
    rng = np.random.default_rng(seed)
    grid = Grid(rng.choice([FREE, OCCUPIED, UNKNOWN], (37, 53), p=[1 - filled, 0.5 * filled, 0.5 * filled]), CELL)
    x, y = rng.uniform(-0.2, 2.9, 40), rng.uniform(-0.2, 2.1, 40)
    angles = rng.choice([rng.uniform(-7.0, 7.0), 0.0, pi / 2, pi / 4], 40)
    fast = cast(grid, x, y, angles)
    with pytest.MonkeyPatch.context() as patch:
        without_numba(patch)
        slow, single = cast(grid, x, y, angles), cast(grid, x[:3], y[:3], angles[:3])
    # a ray that passes a corner by a rounding error may go on on either side
    assert np.mean(np.abs(fast - slow) > 1e-6) <= 0.05
    assert single == pytest.approx(fast[:3], abs=1e-9)


def test_a_ray_stops_at_the_unknown_and_at_the_edge_and_is_0_long_in_a_wall() -> None:
    grid = Grid(np.array([[FREE, FREE, UNKNOWN, FREE], [FREE, FREE, FREE, OCCUPIED]], np.int8), 1.0)
    assert cast(grid, 0.5, [0.5, 1.5], 0.0).tolist() == [1.5, 2.5]
    assert cast(grid, [0.5, 3.5, 9.0], [0.5, 1.5, 0.5], pi).tolist() == [0.5, 0.0, 0.0]
    assert cast(grid, 0.5, 0.5, 0.0, range_max=1.0) == inf
    assert np.isinf(cast(grid, [nan, 0.5, inf], 0.5, [0.0, nan, 0.0])).all()


def test_places_and_angles_are_broadcast() -> None:
    ranges = cast(hall(), np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((1, 5)))
    assert ranges.shape == (3, 5) and np.all(ranges == pytest.approx(2.0))
    assert cast(hall(), 0.0, 0.0, 0.0).shape == ()


def test_without_numba_it_is_told_once_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    without_numba(monkeypatch)
    prepare.cache_clear()
    with pytest.warns(
        RuntimeWarning, match=f"rays against a map take long without numba: {re.escape(installs('fast'))}"
    ):
        assert not prepare()
    assert not prepare()
    prepare.cache_clear()
