"""How values are written: numbers with units, durations, bars, and a dash for what nobody can know."""

from __future__ import annotations

from typing import Final

from rich.table import Table
from rich.text import Text

DASH: Final = "–"
"""Stands for a value that this HAL cannot know."""

LABEL: Final = "cyan"
DIM: Final = "bright_black"
GOOD: Final = "green"
WARNING: Final = "yellow"
BAD: Final = "bold red"


def number(value: float | None, decimals: int, unit: str = "") -> str:
    """The value with sign-aligned digits and its unit; a dash for None."""
    if value is None:
        return DASH
    rounded = round(value, decimals) + 0.0  # no "-0.00"
    return f"{rounded:.{decimals}f} {unit}".rstrip()


def duration(s: float) -> str:
    """A short time in at most six characters, in ns, µs, ms or s."""
    if s == 0.0:
        return "0"
    if s < 0.9995e-6:
        return f"{s * 1e9:.0f}ns"
    if s < 0.9995e-3:
        return f"{s * 1e6:.0f}µs"
    if s < 0.09995:
        return f"{s * 1e3:.1f}ms"
    if s < 0.9995:
        return f"{s * 1e3:.0f}ms"
    return f"{s:.2f}s" if s < 99.995 else f"{s:.0f}s"


def count(n: int, digits: int) -> str:
    """A count in at most so many characters (four or more): large ones in thousands, millions, ..."""
    text, value = str(n), float(n)
    for suffix in "kMGT":
        if len(text) <= digits:
            break
        value /= 1000.0
        text = f"{value:.1f}{suffix}" if len(f"{value:.1f}{suffix}") <= digits else f"{value:.0f}{suffix}"
    return text


def run_time(s: float) -> str:
    """Time of the run as h:mm:ss.t."""
    tenths = int(s * 10.0)
    minutes, tenths = divmod(tenths, 600)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{tenths // 10:02d}.{tenths % 10}"


def minutes(s: float | None) -> str:
    """A long time in minutes; a dash for None."""
    return DASH if s is None else f"{s / 60.0:.0f} min"


def on_off(on: bool) -> Text:
    """ "on" or "off"."""
    return Text("on", style=GOOD) if on else Text("off", style=WARNING)


def clean(text: str) -> str:
    """The text without anything a terminal could obey: a message may quote what came over a wire."""
    return "".join(c if c.isprintable() else " " for c in text)


def centred_bar(share: float, width: int) -> Text:
    """A bar from the middle to the left (share < 0) or right, full at -1 and 1."""
    half = max(1, (width - 1) // 2)
    length = min(half, round(abs(share) * half))
    left = ("█" * length if share < 0.0 else "").rjust(half, "·")
    right = ("█" * length if share > 0.0 else "").ljust(half, "·")
    return _bar(left + "│" + right)


def bar(share: float, width: int) -> Text:
    """A bar from the left, full at 1."""
    length = min(width, max(0, round(share * width)))
    return _bar("█" * length + "·" * (width - length))


def _bar(characters: str) -> Text:
    """The bar with its empty part dimmed."""
    text = Text(characters, style="bright_blue", no_wrap=True)
    text.highlight_regex("[·│]+", DIM)
    return text


def field_table(*rows: tuple[str, str | Text]) -> Table:
    """Two columns: names and values."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style=LABEL, no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, value)
    return table
