"""The configuration: its schema and its sources."""

from txt1.config.schema import Config
from txt1.config.sources import checked, completed, flatten, load, origin_of, recorded, with_sections

__all__ = ["Config", "checked", "completed", "flatten", "load", "origin_of", "recorded", "with_sections"]
