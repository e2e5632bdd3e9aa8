"""The section ``mapping`` of the configuration."""

from txt1.config.schema import Section
from txt1.units import NotNegative


class MappingConfig(Section):
    """Where the robot is on a map: the sensor ``map``, a particle filter of a laser's scans."""

    room: str | None = None
    """The map, its .yaml or the name without it; null: none."""
    at: tuple[float, float, float] | None = None
    """Where the robot is at the start: x, y (m), theta (rad); null: it finds that out."""
    laser: str | None = None
    """The laser's name; null: the only one."""
    delay: NotNegative = 0.1
    """In virtual time, time from a scan's end until its pose is told, s: as long as the computer may take for it."""
