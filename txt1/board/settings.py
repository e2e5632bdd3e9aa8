"""The section ``board`` of the configuration."""

from typing import Literal

from txt1.config.schema import Section
from txt1.sim.parameters import LineFaults
from txt1.units import Positive


class BoardConfig(Section):
    """The virtual board."""

    habits: Literal["ours", "original"] = "ours"
    """Which board to imitate where the protocol is silent: `ours`, or the firmware of 2011 (`original`)."""
    link_timeout: Positive | None = 0.25
    """Age at which a command from the host is stale, s; null: only the link rule, as on original boards."""
    fault: LineFaults = LineFaults()
