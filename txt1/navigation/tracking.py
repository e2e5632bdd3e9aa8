"""Following a stretch of path in one gear: where the robot is on it, and the curvature that brings it back."""

from __future__ import annotations

from math import cos, sin
from typing import Final

from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.model.reeds_shepp import Path, Pose

RETURN_LENGTH: Final = 0.25  # m of path in which an error falls to a quarter; shorter would oscillate
LATERAL_GAIN: Final = 1.0 / RETURN_LENGTH**2  # curvature per lateral error, 1/m^2
HEADING_GAIN: Final = 2.0 / RETURN_LENGTH  # curvature per heading error, 1/m: critical damping


class Stretch:
    """A part of a path that is driven in one gear, from `start` on; beyond both ends it goes straight on."""

    def __init__(self, start: Pose, path: Path) -> None:
        self.gear = 1.0 if path[0].distance > 0.0 else -1.0  # forward, backward
        self._pieces: list[tuple[float, Pose, float]] = []  # path driven before, pose there, curvature
        self.length, pose = 0.0, start  # m
        for curvature, distance in path:
            self._pieces.append((self.length, pose, curvature))
            self.length += abs(distance)
            pose = move_along_arc(*pose, distance, curvature, 0.0)
        self.end = pose

    def at(self, driven: float) -> tuple[Pose, float]:
        """Pose and curvature (1/m) after `driven` m."""
        if driven <= 0.0:
            return move_along_arc(*self._pieces[0][1], self.gear * driven, 0.0, 0.0), self._pieces[0][2]
        if driven >= self.length:
            return move_along_arc(*self.end, self.gear * (driven - self.length), 0.0, 0.0), self._pieces[-1][2]
        before, pose, curvature = next(piece for piece in reversed(self._pieces) if piece[0] <= driven)
        return move_along_arc(*pose, self.gear * (driven - before), curvature, 0.0), curvature

    def bends(self, first: float, last: float) -> bool:
        """Whether there is a curve between two places on it, in m driven."""
        ends = [before for before, _, _ in self._pieces[1:]] + [self.length]
        return any(
            curvature != 0.0 and before <= last and ends_at >= first
            for (before, _, curvature), ends_at in zip(self._pieces, ends, strict=True)
        )

    def nearest(self, pose: Pose, around: float) -> float:
        """Metres driven at the point abreast of a pose, sought from `around` on."""
        driven = around
        for _ in range(4):
            (x, y, theta), _ = self.at(driven)
            driven += self.gear * ((pose[0] - x) * cos(theta) + (pose[1] - y) * sin(theta))
        return driven

    def errors(self, pose: Pose, driven: float) -> tuple[float, float]:
        """Lateral error (m, left positive) and heading error (rad) of a pose abreast of `driven`."""
        (x, y, theta), _ = self.at(driven)
        return (pose[1] - y) * cos(theta) - (pose[0] - x) * sin(theta), wrap_angle(pose[2] - theta)

    def steer(self, pose: Pose, driven: float, preview: float) -> float:
        """The curvature, 1/m, that brings the robot back to the path; that of the path `preview` m ahead is its base.

        With e the lateral and a the heading error, and ' the derivative by the path driven in gear g: e' = g a and
        a' = g (curvature - path's), so curvature = path's - e / l^2 - g a 2 / l gives e'' + 2 / l e' + e / l^2 = 0.
        """
        lateral, heading = self.errors(pose, driven)
        _, base = self.at(driven + preview)
        return base - LATERAL_GAIN * lateral - self.gear * HEADING_GAIN * heading
