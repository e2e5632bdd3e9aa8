"""The far end of a simulated line: a virtual board or another virtual device."""

from typing import Final

from numpy.random import SeedSequence

from txt1.board.settings import BoardConfig
from txt1.config import Config
from txt1.link.base import End
from txt1.link.impairments import faulty

# distinguishes the random values of the line at the board's end
BOARD_LINE: Final = 2


def far_end(end: End, config: Config) -> End:
    """Return a device's end of the line behind the faults in `board.fault`."""
    return faulty(end, config.section(BoardConfig).fault, SeedSequence([config.own_seed, BOARD_LINE]))
