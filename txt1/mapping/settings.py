"""The section ``mapping`` of the configuration."""

from typing import Annotated

from pydantic import Field

from txt1.config.schema import Section
from txt1.units import NotNegative


class MappingConfig(Section):
    """A map in use or in the making, by a laser's scans: the sensors ``map`` and ``mapping``."""

    room: str | None = None
    """The map in which the robot drives: its .yaml, or the name without it; null: none."""
    at: tuple[float, float, float] | None = None
    """The robot's pose on it at the start: x, y (m), theta (rad); null: the robot searches for it."""
    make: str | None = None
    """Name of the map that is made or extended while the robot drives; null: none."""
    resolution: Annotated[float, Field(ge=0.01, le=1.0)] = 0.05
    """Side of a cell of the map that is made, m."""
    laser: str | None = None
    """The laser's name; null: the only laser."""
    delay: NotNegative = 0.1
    """In virtual time, time from a scan's end to its pose, s: the time that the computer may take."""
