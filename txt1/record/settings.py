"""The section ``record`` of the configuration."""

from typing import Literal

from txt1.config.schema import Section
from txt1.units import NotNegative


class RecordConfig(Section):
    """Recordings."""

    epoch: NotNegative | None = None
    """Time stamp of the run's start, s since 1970; null: the time of day, in virtual time 0."""
    rotate_size: NotNegative = 0.0
    """Size at which a new file begins, MB; 0: never."""
    rotate_time: NotNegative = 0.0
    """Duration after which a new file begins, s of the run; 0: never."""
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    """Of the chunks in the file."""
