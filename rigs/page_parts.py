"""Parts of pages that commands print: each stands between two marks, which name it and the command."""

from pathlib import Path


def write(page: Path, part: str, text: str, by: str) -> None:
    """Put a text in the place of a page's part, which the module `by` prints.

    Raises:
        ValueError: the page has no marks for it.

    """
    begins, ends = f"<!-- {part}: printed by {by} -->", f"<!-- the end of {part} -->"
    before, mark, rest = page.read_text(encoding="utf-8").partition(begins)
    _, end, after = rest.partition(ends)
    if not mark or not end:
        raise ValueError(f"{page} has no place for '{part}': it needs the lines {begins} and {ends}")
    page.write_text(f"{before}{begins}\n\n{text.strip()}\n\n{ends}{after}", encoding="utf-8")
