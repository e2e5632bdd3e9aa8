"""The far end of a simulated line: a virtual board or another virtual device."""

from txt1.board.settings import BoardConfig
from txt1.config import Config
from txt1.link.base import End
from txt1.link.impairments import faulty


def far_end(end: End, config: Config) -> End:
    """Return a device's end of the line behind the faults in `board.fault`."""
    return faulty(end, config.section(BoardConfig).fault, config.own_seed, "the board's line")
