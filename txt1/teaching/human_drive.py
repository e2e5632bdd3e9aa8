"""The lessons of a recording in which a human drove, whatever program made it."""

from __future__ import annotations

from dataclasses import dataclass

from txt1.teaching.features import Sight
from txt1.teaching.policy import Taught
from txt1.teaching.training import LessonSet


@dataclass(frozen=True)
class HumanDrive:
    """The lessons of a recording."""

    taught: Taught
    sights: tuple[Sight, ...]
    lessons: LessonSet
    vehicle: str
    radius_min: float
    v_max: float
    ends: str = "complete"
    """Whether the file is complete, or breaks off."""
