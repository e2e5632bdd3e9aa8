"""The configuration: its schema and its sources."""

from txt1.config.schema import Config, Section
from txt1.config.sources import checked, completed, flatten, load, origin_of, recorded, with_sections

__all__ = ["Config", "Section", "checked", "completed", "flatten", "load", "origin_of", "recorded", "with_sections"]
