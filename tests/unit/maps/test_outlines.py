"""The walls of a grid as closed lines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.unit.maps.test_rays import CELL, hall
from txt1.maps import outlines as module
from txt1.maps.files import names, read
from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.maps.outlines import POINTS_MAX, Outline, outlines


def area(line: Outline) -> float:
    """Of a closed line, m^2: positive when it is anticlockwise."""
    x, y = np.array(line).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def test_a_hall_has_four_corners() -> None:
    (line,) = outlines(hall())
    assert sorted(line) == [(-2.0, -1.5), (-2.0, 1.5), (2.0, -1.5), (2.0, 1.5)]
    assert area(line) == pytest.approx(12.0)


@given(st.integers(0, 2**32 - 1))
def test_the_lines_enclose_just_what_is_free(seed: int) -> None:
    cells = np.random.default_rng(seed).choice([FREE, OCCUPIED], (9, 7)).astype(np.int8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "TOLERANCE", 0.0)
        found = outlines(Grid(cells, CELL, (1.0, -2.0, 0.0)), 10_000)
    assert sum(map(area, found)) == pytest.approx(CELL**2 * np.sum(cells == FREE))


@pytest.mark.parametrize("name", names())
def test_the_lines_of_a_map_are_few_and_enclose_its_floor(name: str) -> None:
    grid = read(name).grid
    found = outlines(grid)
    assert sum(map(len, found)) <= POINTS_MAX
    assert sum(map(area, found)) == pytest.approx(grid.resolution**2 * np.sum(grid.cells == FREE), rel=0.01)


def test_a_map_of_noise_is_drawn_with_few_lines_too() -> None:
    cells = np.random.default_rng(1).choice([FREE, OCCUPIED], (300, 300), p=[0.9, 0.1]).astype(np.int8)
    assert sum(map(len, outlines(Grid(cells, CELL)))) <= POINTS_MAX
