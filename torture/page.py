"""The page of what torture brought to light: every command writes its own section of it."""

from pathlib import Path
from typing import Final

PAGE: Final = Path("docs/reliability.md")


def write(section: str, text: str, page: Path = PAGE) -> None:
    """Put a text in the place of a section's, between the marks that the page has for it."""
    begins, ends = f"<!-- {section}: written by python -m torture {section} -->", f"<!-- end of {section} -->"
    before, mark, rest = page.read_text().partition(begins)
    if not mark:
        raise ValueError(f"{page} has no place for '{section}': it needs the line {begins}")
    page.write_text(f"{before}{begins}\n\n{text}\n\n{ends}{rest.partition(ends)[2]}")
