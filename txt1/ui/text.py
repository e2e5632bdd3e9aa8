"""Formats values: numbers with units, durations, bars, tables, and a dash for an unknown value.

All strings are markup for rich; `clean` escapes text from elsewhere.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Final, NamedTuple

from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

# for a value that this HAL cannot know
DASH: Final = "–"
LABEL: Final = "cyan"
DIM: Final = "bright_black"
GOOD: Final = "green"
WARNING: Final = "yellow"
BAD: Final = "bold red"


def number(value: float | None, decimals: int, unit: str = "") -> str:
    """Return the value with aligned digits and its unit; a dash for None."""
    if value is None:
        return DASH
    # no "-0.00"
    rounded = round(value, decimals) + 0.0
    return f"{rounded:.{decimals}f} {unit}".rstrip()


def duration(s: float) -> str:
    """Return a short time in at most six characters, in ns, µs, ms or s."""
    if s == 0.0:
        return "0"
    for below, factor, decimals, unit in (
        (0.9995e-6, 1e9, 0, "ns"),
        (0.9995e-3, 1e6, 0, "µs"),
        (0.09995, 1e3, 1, "ms"),
        (0.9995, 1e3, 0, "ms"),
        (99.995, 1.0, 2, "s"),
    ):
        if s < below:
            return f"{s * factor:.{decimals}f}{unit}"
    return f"{s:.0f}s"


def count(n: int, digits: int) -> str:
    """Return a count in at most `digits` characters (four or more): large counts in thousands, millions, ..."""
    text, value = str(n), float(n)
    for suffix in "kMGT":
        if len(text) > digits:
            value /= 1000.0
            text = f"{value:.1f}{suffix}" if len(f"{value:.1f}{suffix}") <= digits else f"{value:.0f}{suffix}"
    return text


def run_time(s: float) -> str:
    """Return a time of the run as h:mm:ss.t."""
    minutes, tenths = divmod(int(s * 10.0), 600)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{tenths // 10:02d}.{tenths % 10}"


def styled(text: str, style: str) -> str:
    """Return the text in a style."""
    return f"[{style}]{text}[/]" if style else text


def clean(text: str) -> str:
    """Return the text without anything that a terminal or rich obeys: a message may quote bytes from a wire."""
    return escape(printable(text))


def printable(text: str) -> str:
    """Return the text with a space for each character that a terminal obeys."""
    return "".join(c if c.isprintable() else " " for c in text)


def centred_bar(share: float, width: int) -> str:
    """Return a bar from the middle to the left (share < 0) or right, full at -1 and 1."""
    half = max(1, (width - 1) // 2)
    length = min(half, round(abs(share) * half))
    full, rest, empty = styled("█" * length, "bright_blue"), "·" * (half - length), "·" * half
    return styled(f"{rest}{full}│{empty}" if share < 0.0 else f"{empty}│{full}{rest}", DIM)


def bar(share: float, width: int) -> str:
    """Return a bar from the left, full at 1."""
    length = min(width, max(0, round(share * width)))
    return styled("█" * length, "bright_blue") + styled("·" * (width - length), DIM)


class Column(NamedTuple):
    """A column of a table: heading, style, alignment, whether long text is folded or cut, least width in cells."""

    heading: str = ""
    style: str = ""
    right: bool = False
    fold: bool = False
    least: int | None = None


NAME_COLUMN: Final = Column(style=LABEL)
# names and values
FIELDS: Final = (NAME_COLUMN, Column())


class Kept:
    """A renderable that is drawn once for each size and kept: a frame then takes 5 ms of the processor, not 20."""

    def __init__(self, content: RenderableType) -> None:
        self._content = content
        self._drawn: dict[tuple[int, int | None], list[Segment]] = {}

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[Segment]:
        size = options.max_width, options.height
        if size not in self._drawn:
            self._drawn[size] = list(console.render(self._content, options))
        return self._drawn[size]


@lru_cache(maxsize=64)
def table(
    title: str,
    columns: tuple[Column, ...],
    rows: tuple[tuple[str, ...], ...],
    *,
    gap: int = 2,
    padding: tuple[int, int] = (0, 1),
    border: str = DIM,
) -> Kept:
    """Return rows of cells in a frame with a title; an unchanged table is not drawn again.

    `gap` is the cells between columns, `padding` the rows and columns between frame and table.
    """
    grid = Table.grid(padding=(0, gap))
    grid.show_header, grid.header_style = any(column.heading for column in columns), LABEL
    for index, (heading, style, right, fold, least) in enumerate(columns):
        # a long value never takes room from the names
        if style == LABEL and least is None:
            least = max((Text.from_markup(row[index]).cell_len for row in rows if index < len(row)), default=0)
        grid.add_column(
            heading,
            style=style,
            justify="right" if right else "left",
            overflow="fold" if fold else "ellipsis",
            no_wrap=not fold,
            min_width=least,
        )
    for row in rows:
        grid.add_row(*row)
    return Kept(Panel(grid, title=title, border_style=border, padding=padding))
