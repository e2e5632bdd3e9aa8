"""The page of what torture brought to light: every command writes its own part of it."""

from pathlib import Path
from typing import Final

from rigs import page_parts

PAGE: Final = Path("docs/results/reliability.md")


def write(part: str, text: str) -> None:
    """Put a text in the place of a command's part."""
    page_parts.write(PAGE, part, text, f"torture.{part}")
