"""A command on a real terminal: what it draws, read back by pyte, and its picture."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pexpect
import pyte

from rigs.patience import LIMIT, TXT1

ROOT: Final = Path(__file__).parents[1]
FONTS: Final = Path("/usr/share/fonts/truetype/dejavu")
# pixels of a character, and of the text in it
CELL: Final = (9, 18)
TEXT: Final = 15
COLOURS: Final = {
    "default": "#d8dee6",
    "black": "#10141a",
    "red": "#e05561",
    "green": "#5fb878",
    "brown": "#e5c07b",
    "blue": "#61afef",
    "magenta": "#c678dd",
    "cyan": "#56b6c2",
    "white": "#d8dee6",
    "brightblack": "#7f8896",
    "brightred": "#ff7b86",
    "brightgreen": "#8fdd9f",
    "brightbrown": "#ffdf8e",
    "brightyellow": "#ffdf8e",
    "brightblue": "#8cc8ff",
    "brightmagenta": "#e2a0f5",
    "brightcyan": "#7fdbe6",
    "brightwhite": "#ffffff",
}
GROUND: Final = "#10141a"


def start(columns: int, rows: int, *words: str, folder: Path = ROOT, **environment: str) -> pexpect.spawn[bytes]:
    """Start the command `txt1` in a folder, on a terminal of that size."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("TXT1_", "LC_", "LANG"))}
    return pexpect.spawn(
        TXT1[0],
        [*TXT1[1:], *words],
        dimensions=(rows, columns),
        timeout=LIMIT,
        env=clean | {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color"} | environment,
        cwd=str(folder),
    )


class Watched:
    """The screen that a command draws, and all that it was told."""

    def __init__(self, child: pexpect.spawn[bytes], columns: int, rows: int) -> None:
        self.child, self.screen, self.told = child, pyte.Screen(columns, rows), b""
        self._stream = pyte.ByteStream(self.screen)

    def until(self, *words: str) -> None:
        """Wait until all these words are on it; TimeoutError, with what is there, when they do not come."""
        self.until_seen(lambda text: all(word in text for word in words), f"{words}")

    def until_seen(self, seen: Callable[[str], bool], words: str) -> None:
        """Wait until `seen` is true of its text; TimeoutError, with these words for it, when it never is."""
        ends = time.monotonic() + LIMIT
        while not seen(self.text):
            if time.monotonic() > ends:
                raise TimeoutError(f"{words} not among:\n{self.text}")
            self.told += (new := self.child.read_nonblocking(65536, timeout=LIMIT))
            self._stream.feed(new)

    def until_end(self) -> int | None:
        """Wait until the command has ended; return its exit code."""
        self.child.expect(pexpect.EOF)
        self._stream.feed(self.child.before or b"")
        self.child.close()
        return self.child.exitstatus

    @property
    def text(self) -> str:
        """All rows, one below the other."""
        return "\n".join(self.screen.display)

    def picture(self, file: Path) -> None:
        """Write what is on it as a PNG, with its colours."""
        # the tests of texts need no Pillow
        from PIL import Image, ImageDraw, ImageFont

        width, height = CELL
        fonts = {
            bold: ImageFont.truetype(FONTS / f"DejaVuSansMono{'-Bold' if bold else ''}.ttf", TEXT)
            for bold in (False, True)
        }
        image = Image.new("RGB", (width * self.screen.columns, height * self.screen.lines), GROUND)
        draw = ImageDraw.Draw(image)
        for y in range(self.screen.lines):
            for x in range(self.screen.columns):
                cell = self.screen.buffer[y][x]
                ink, ground = _colour(cell.fg, COLOURS["default"]), _colour(cell.bg, GROUND)
                if cell.reverse:
                    ink, ground = ground, ink
                left, top = x * width, y * height
                draw.rectangle((left, top, left + width - 1, top + height - 1), ground)
                if dots := _dots(cell.data):
                    for column, row in dots:
                        a, b = left + 2 + 4 * column, top + 1 + 4.5 * row
                        draw.ellipse((a, b, a + 2, b + 2), ink)
                else:
                    draw.text((left, top), cell.data, ink, fonts[cell.bold])
        image.save(file, optimize=True)


def _dots(character: str) -> list[tuple[int, int]]:
    """Return column and row of each dot of a braille character, which few fonts have."""
    bits = ord(character[:1] or " ") - 0x2800
    if not 0 < bits < 256:
        return []
    places = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))
    return [place for bit, place in enumerate(places) if bits >> bit & 1]


def _colour(name: str, usual: str) -> str:
    if name == "default":
        return usual
    return COLOURS.get(name, f"#{name}")
