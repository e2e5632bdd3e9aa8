"""Pictures with AprilTags: OpenCV's own patterns, drawn as a pinhole camera sees them, ray by ray."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from math import cos, sin
from typing import Any

import numpy as np

from txt1.sim.view import Camera, Picture

# rays in a pixel, to either side
RAYS = 3
# white cells round the black square
MARGIN = 1


def pattern(number: int) -> Any:
    """The cells of a tag of the family 36h11, 8 x 8 with its black border, and the white margin round it."""
    cv2: Any = import_module("cv2")
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return np.pad(cv2.aruco.generateImageMarker(family, number, 8), MARGIN, constant_values=255)


def hang(
    picture: Picture,
    camera: Camera,
    eye: tuple[float, float, float, float],
    tags: Mapping[int, tuple[float, float, float]],
    size: float,
    height: float = 0.25,
) -> Picture:
    """Draw tags of this size, m, into the picture of a camera at x, y, z that looks along theta; m and rad."""
    x, y, z, theta = eye
    shown = picture.astype(float)
    fine = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    columns = (np.arange(camera.width)[:, None] + fine).ravel()
    rows = (np.arange(camera.height)[:, None] + fine).ravel()
    left = (0.5 * (camera.width - 1) - columns) / camera.focal
    up = (0.5 * (camera.height - 1) - rows)[:, None] / camera.focal
    # the direction of each ray on the floor, for 1 m ahead
    dx, dy = cos(theta) - left * sin(theta), sin(theta) + left * cos(theta)
    for number, (tag_x, tag_y, faces) in tags.items():
        nx, ny = cos(faces), sin(faces)
        towards = dx * nx + dy * ny
        with np.errstate(divide="ignore", invalid="ignore"):
            far = ((tag_x - x) * nx + (tag_y - y) * ny) / towards
            # to the right, as seen from the front of the tag
            across = (x + far * dx - tag_x) * -ny + (y + far * dy - tag_y) * nx
            above = z + far * up - height
        cells = pattern(number)
        count = len(cells)
        cell = size / (count - 2 * MARGIN)
        column = np.floor(np.where(np.isfinite(across), across, 1e6) / cell + 0.5 * count)
        row = np.floor(0.5 * count - np.where(np.isfinite(above), above, 1e6) / cell)
        on = (towards < 0.0) & (far > 0.05) & (column >= 0) & (column < count) & (row >= 0) & (row < count)
        if not on.any():
            continue
        value = cells[np.clip(row, 0, count - 1).astype(int), np.clip(column, 0, count - 1).astype(int)]
        shape = camera.height, RAYS, camera.width, RAYS
        share = on.reshape(shape).mean((1, 3))[..., None]
        light = np.where(on, value, 0).reshape(shape).mean((1, 3))[..., None]
        shown = shown * (1.0 - share) + light
    made: Picture = np.clip(shown, 0.0, 255.0).astype(np.uint8)
    return made
