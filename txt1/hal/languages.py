"""Which device speaks on a line: each HAL on a line may say by what its device is known.

A HAL that hears bytes but no answer of its own device names the one whose language they are, and `txt1 doctor` asks
each. A part of the group ``txt1.languages``, by the HAL's name, is a `Language`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from txt1.errors import HalError
from txt1.link.base import Link, Port
from txt1.plugins import Registry
from txt1.protocol.decoder import Decoder, FrameFault
from txt1.protocol.layout import Role

LANGUAGES: Final = Registry("language", "txt1.languages", {"serial": "txt1.hal.languages:BOARD"}, HalError)
# s that a device has to answer
LISTENED: Final = 0.8
# bytes by which a language is known
KEPT: Final = 4096
Opens = Callable[["Language"], Port]
"""Makes a port that is opened at a language's speed."""


class Language(NamedTuple):
    """How a device is known."""

    # in words
    device: str
    baud: int
    question: bytes
    """What makes it answer, and moves nothing; empty where it speaks by itself."""
    speaks: Callable[[bytes], bool]
    """Whether these bytes are its language."""


def _board(data: bytes) -> bool:
    return any(not isinstance(event, FrameFault) for event in Decoder(Role.HOST).feed(data))


BOARD: Final = Language("a board of the TXT-1", 57600, b"", _board)


def known() -> Iterator[tuple[str, Language]]:
    """Yield every language with its HAL's name."""
    for name in LANGUAGES.ours:
        language: Language = LANGUAGES.find("hal", name)[0]  # type: ignore[assignment]
        yield name, language


def named(data: bytes, but: str = "") -> str:
    """Return whose language these bytes are, and the HAL that speaks it, in words; "" where nobody's, or that HAL's."""
    for name, language in known():
        if name != but and language.speaks(data):
            return f"{language.device} speaks there: take --hal {name}"
    return ""


class Asker:
    """An end of a line that asks a device, and keeps what it answers."""

    def __init__(self, language: Language) -> None:
        self._language = language
        self._heard = b""
        self.link: Link | None = None

    @property
    def found(self) -> bool:
        """Whether it answered in its language."""
        return self._language.speaks(self._heard)

    def close(self) -> None:
        """Let go of the line."""
        if self.link is not None:
            self.link.close()

    def connected(self, link: Link) -> None:
        """Ask."""
        self.link = link
        if self._language.question:
            link.write(self._language.question)

    def received(self, data: bytes) -> None:
        """Keep what comes."""
        self._heard = (self._heard + data)[-KEPT:]

    def lost(self, reason: str) -> None:
        """Nothing: there is nobody."""


async def answering(port_for: Opens) -> list[tuple[str, Language]]:
    """Ask at a port in each language, and return those that were answered; raises HalError: it cannot be opened."""
    found = []
    for name, language in known():
        port, listener = port_for(language), Asker(language)
        try:
            await port.open(listener)
            for _ in range(8):
                await asyncio.sleep(LISTENED / 8)
                if listener.found:
                    found.append((name, language))
                    break
        finally:
            listener.close()
            await port.close()
    return found
