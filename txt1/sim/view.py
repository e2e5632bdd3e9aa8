"""Pictures of the simulated room as a camera on a vehicle sees them: floor, walls, obstacles, vehicles and the lamp.

Each column of pixels is a ray on the floor. The surface that the ray meets is vertical, so distances along the camera's
axis are equal within a column. Brightness falls with the square of the distance to the lamp, over an ambient light.
"""

from math import cos, hypot, inf, pi, sin, tan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.sim.rays import Floats, Shapes, cast

WALL_HEIGHT: Final = 2.5  # m
OBSTACLE_HEIGHT: Final = 0.6
VEHICLE_HEIGHT: Final = 0.297
# red, green and blue of
PAINTS: Final = (
    # the sky above the walls
    (60.0, 65.0, 75.0),
    # the floor
    (150.0, 140.0, 125.0),
    # walls
    (205.0, 200.0, 190.0),
    # obstacles
    (70.0, 120.0, 190.0),
    # vehicles
    (190.0, 70.0, 60.0),
)
LAMP: Final = (255.0, 250.0, 215.0)
LAMP_RADIUS: Final = 0.05  # m
# share of full brightness without the lamp
AMBIENT: Final = 0.35
# m: at this distance from the lamp and nearer, brightness is full
BRIGHT: Final = 1.0

Picture = NDArray[np.uint8]


class Camera(NamedTuple):
    """A pinhole camera that looks along its x axis, level."""

    width: int = 160  # pixels
    height: int = 120  # pixels
    # horizontal angle of view, rad
    field: float = 60.0 * pi / 180.0

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return 0.5 * self.width / tan(0.5 * self.field)


class Scene(NamedTuple):
    """Everything that the camera may see."""

    walls: Shapes
    obstacles: Shapes
    vehicles: Shapes
    # m, at the camera's height
    light: tuple[float, float]


def distances(camera: Camera, scene: Scene, x: float, y: float, z: float, theta: float) -> Floats:
    """Return the distances along the camera's axis (height, width), m; inf if nothing is there.

    The camera is at (x, y), z above the floor, and looks along theta; m and rad.
    """
    return _surfaces(camera, scene, x, y, z, theta)[0]


def draw(camera: Camera, scene: Scene, x: float, y: float, z: float, theta: float) -> Picture:
    """Return the picture (height, width, 3) of a camera placed as for `distances`."""
    sideways, below = _axes(camera)
    depth, paint = _surfaces(camera, scene, x, y, z, theta)
    here = np.where(np.isfinite(depth), depth, 1e3)
    left = here * sideways
    px, py = x + here * cos(theta) - left * sin(theta), y + here * sin(theta) + left * cos(theta)
    dx, dy, dz = px - scene.light[0], py - scene.light[1], here * below
    shine = AMBIENT + (1.0 - AMBIENT) / np.maximum((dx * dx + dy * dy + dz * dz) / BRIGHT**2, 1.0)
    shine = np.where(np.isfinite(depth), shine, 1.0)
    colour = np.array(PAINTS)[paint] * shine[..., None]
    _draw_lamp(camera, scene.light, x, y, theta, depth, colour)
    return np.clip(colour, 0.0, 255.0).astype(np.uint8)


def _axes(camera: Camera) -> tuple[Floats, Floats]:
    """Return how far each column looks to the left of the axis, and each row below it, for 1 m along it."""
    sideways = (0.5 * (camera.width - 1) - np.arange(camera.width, dtype=float)) / camera.focal
    below = (np.arange(camera.height, dtype=float) - 0.5 * (camera.height - 1))[:, None] / camera.focal
    return sideways, below


def _surfaces(
    camera: Camera, scene: Scene, x: float, y: float, z: float, theta: float
) -> tuple[Floats, NDArray[np.uint8]]:
    """Return the surface in each pixel (height, width): its distance along the axis, m, and its index in `PAINTS`."""
    sideways, below = _axes(camera)
    angles = theta + np.arctan(sideways)
    with np.errstate(divide="ignore"):
        floor = np.where(below > 0.0, z / below, inf)
    depth = np.repeat(floor, camera.width, 1)
    paint = np.repeat((below > 0.0).astype(np.uint8), camera.width, 1)
    for index, (shapes, tall) in enumerate(
        ((scene.walls, WALL_HEIGHT), (scene.obstacles, OBSTACLE_HEIGHT), (scene.vehicles, VEHICLE_HEIGHT)), 2
    ):
        if not shapes:
            continue
        along = cast(x, y, angles, shapes) * np.cos(angles - theta)
        # height over the floor of the visible point
        up = z - below * np.minimum(along, 1e6)
        stands = (up >= 0.0) & (up <= tall) & (along < depth)
        depth = np.where(stands, along, depth)
        paint[stands] = index
    return depth, paint


def _draw_lamp(
    camera: Camera, light: tuple[float, float], x: float, y: float, theta: float, depth: Floats, colour: Floats
) -> None:
    """Draw the lamp with a halo at its place in the picture, unless something stands before it."""
    dx, dy = light[0] - x, light[1] - y
    ahead, left = cos(theta) * dx + sin(theta) * dy, cos(theta) * dy - sin(theta) * dx
    if ahead < 0.1:
        return
    column, row = 0.5 * (camera.width - 1) - camera.focal * left / ahead, 0.5 * (camera.height - 1)
    radius = max(camera.focal * LAMP_RADIUS / ahead, 1.0)
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    away = np.hypot(columns - column, rows - row) / radius
    glow = np.where(depth > hypot(dx, dy) - 0.1, np.clip(np.where(away <= 1.0, 1.0, 1.0 / away**2), 0.0, 1.0), 0.0)
    colour += glow[..., None] * (np.array(LAMP) - colour)
