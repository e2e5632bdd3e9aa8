"""Rays against the shapes in a room: straight edges and round posts, as numpy arrays. No clock."""

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.maps.grid import Grid
from txt1.maps.rays import cast as cast_in_grid
from txt1.maps.rays import prepare
from txt1.sim.obstacles import Obstacle, Outline, outline
from txt1.sim.parameters import Post
from txt1.sim.room import Room

Floats = NDArray[np.float64]


class Shapes(NamedTuple):
    """The outlines of everything that stands on a floor."""

    # (n, 4): from x, y to x, y; m
    edges: Floats
    # (m, 3): x, y and radius; m
    posts: Floats
    # a grid whose solid cells stand there, too
    grid: Grid | None = None

    def __add__(self, other: object) -> "Shapes":
        """Return the shapes of both."""
        assert isinstance(other, Shapes)
        edges, posts = np.concatenate((self.edges, other.edges)), np.concatenate((self.posts, other.posts))
        return Shapes(edges, posts, self.grid or other.grid)

    def __bool__(self) -> bool:
        """Return whether there is a shape."""
        return bool(len(self.edges) or len(self.posts) or self.grid)


def edges_of(outlines: Iterable[Outline]) -> Shapes:
    """Return the edges of closed outlines."""
    edges = [(*a, *b) for each in outlines for a, b in zip(each, (*each[1:], each[0]), strict=True)]
    return Shapes(np.array(edges, float).reshape(-1, 4), np.empty((0, 3)))


def walls_of(room: Room) -> Shapes:
    """Return the four walls without walls at infinity; or the walls of a map, with its ray caster ready."""
    x, y = 0.5 * room.length, 0.5 * room.width
    # largest coordinate, m, for a wall whose ends are at infinity
    far = 1e6
    wide, high = (min(each, far) for each in (x, y))
    walls = [(side * x, -high, side * x, high) for side in (-1.0, 1.0) if isfinite(x)]
    walls += [(-wide, side * y, wide, side * y) for side in (-1.0, 1.0) if isfinite(y)]
    grid = None
    if room.walls is not None:
        grid = room.walls.grid
        prepare()
    return Shapes(np.array(walls, float).reshape(-1, 4), np.empty((0, 3)), grid)


def shapes_of(obstacles: Sequence[Obstacle]) -> Shapes:
    """Return the outlines of boxes and posts."""
    posts = [(each.x, each.y, each.radius) for each in obstacles if isinstance(each, Post)]
    boxes = edges_of(outline(each) for each in obstacles if not isinstance(each, Post))
    return Shapes(boxes.edges, np.array(posts, float).reshape(-1, 3))


def cast(x: Floats | float, y: Floats | float, angles: Floats, shapes: Shapes) -> Floats:
    """Return the distance (m) from (x, y) along each of the angles (rad) to the first shape; inf if there is none.

    x and y are numbers for all rays, or arrays with a number for each ray. Let p + t u be a ray.

    - It meets the edge from a to b at t = (a - p) x (b - a) / (u x (b - a)), if t >= 0 and 0 <= s <= 1, with
      s = (a - p) x u / (u x (b - a)).
    - It meets the circle around c with the radius r at t = u . (c - p) - sqrt(r^2 - (u x (c - p))^2).
    """
    # a row for each shape: numpy is quickest along a row, and there are more rays than shapes
    ux, uy = np.cos(angles), np.sin(angles)
    px, py = np.asarray(x, float), np.asarray(y, float)
    nearest = np.full(len(angles), np.inf)
    if len(shapes.edges):
        ax, ay, bx, by = shapes.edges.T[..., None]
        dx, dy, ox, oy = bx - ax, by - ay, ax - px, ay - py
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            # inf for a ray that runs along the edge
            share = 1.0 / (ux * dy - uy * dx)
            t = (ox * dy - oy * dx) * share
            s = (ox * uy - oy * ux) * share
            t[~((t >= 0.0) & (s >= 0.0) & (s <= 1.0))] = np.inf
        nearest = t.min(axis=0)
    if len(shapes.posts):
        cx, cy, radius = shapes.posts.T[..., None]
        ox, oy = cx - px, cy - py
        along, beside = ux * ox + uy * oy, ux * oy - uy * ox
        half = radius * radius - beside * beside
        reach = np.sqrt(np.maximum(half, 0.0))
        # from inside, the point where the ray leaves
        t = np.where(along - reach >= 0.0, along - reach, along + reach)
        t[(half < 0.0) | (t < 0.0)] = np.inf
        nearest = np.minimum(nearest, t.min(axis=0))
    if shapes.grid is not None:
        nearest = np.minimum(nearest, cast_in_grid(shapes.grid, px, py, angles))
    return nearest
