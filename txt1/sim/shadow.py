"""The shadows that the walls of a map throw: in them a light sensor sees nothing of the lamp."""

import numpy as np

from txt1.maps.grid import Grid
from txt1.maps.rays import cast, prepare
from txt1.model.light_sensors import MOUNT, Mount
from txt1.sim.lamp import Lit


def lit_by(light: tuple[float, float], grid: Grid, mount: Mount = MOUNT) -> Lit:
    """Return the function that tells whether sensors at `mount` see a light at (x, y), m, from a pose.

    The cell in which the light is counts as free, so that a lamp may hang on a wall.
    """
    prepare()
    ahead, left = np.array(mount, float).T
    slack = 1.5 * grid.resolution

    def lit(x: float, y: float, theta: float) -> list[bool]:
        c, s = np.cos(theta), np.sin(theta)
        px, py = x + c * ahead - s * left, y + s * ahead + c * left
        dx, dy = light[0] - px, light[1] - py
        seen: list[bool] = (cast(grid, px, py, np.arctan2(dy, dx)) >= np.hypot(dx, dy) - slack).tolist()
        return seen

    return lit
