"""Faults of the texts in a figure of matplotlib: cut off at an edge, or one over another."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any
from unittest.mock import patch


def faults(figure: Any) -> list[str]:
    """Return what is wrong with a figure's texts; the numbers along an axis may touch one another, and nothing else."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    canvas, drawn = FigureCanvasAgg(figure), list[Any]()
    # numbers beyond the end of an axis are there and are not drawn
    with patch.object(Text, "draw", lambda self, renderer: drawn.append(self)):
        canvas.draw()
    texts = [each for each in drawn if each.get_text().strip() and each.get_visible()]
    boxes = [(each.get_text(), each.get_window_extent(canvas.get_renderer())) for each in texts]
    width, height = figure.bbox.width, figure.bbox.height
    found = [f"{name!r} is cut" for name, box in boxes if min(box.x0, box.y0) < 0 or box.x1 > width or box.y1 > height]
    return found + [
        f"{a!r} stands over {b!r}"
        for (a, one), (b, other) in combinations(boxes, 2)
        if one.overlaps(other) and re.search("[A-Za-z]{2}", a + b)
    ]
