"""Arrays that a learner keeps with its table, in the table's file."""

import numpy as np
from numpy.typing import NDArray

from txt1.learning.qtable import StoredTable


def kept(table: StoredTable, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return an array that a learner keeps with its table; ValueError: it has another shape."""
    array = np.array(table.about[name], float)
    if array.shape != shape:
        raise ValueError(f"keeps '{name}' of the shape {array.shape} where {shape} is needed")
    return array
