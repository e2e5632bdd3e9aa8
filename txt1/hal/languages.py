"""Recognises the device on a line by its protocol.

If a HAL hears bytes but no answer of its own device, it names the device that speaks this protocol. `txt1 doctor` asks
each kind of device. A part of the group ``txt1.languages``, by the HAL's name, is a `Language`.
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
# s within which a device has to answer
LISTENED: Final = 0.8
# bytes that are enough to recognise a language
RECOGNITION_BYTES: Final = 4096
Opens = Callable[["Language"], Port]
"""Makes a port with a language's baud rate."""


class Language(NamedTuple):
    """How a device is recognised."""

    # in words
    device: str
    baud: int
    question: bytes
    """Bytes that make the device answer and move nothing; empty if it speaks unasked."""
    speaks: Callable[[bytes], bool]
    """Returns whether these bytes are in its language."""


def _board(data: bytes) -> bool:
    return any(not isinstance(event, FrameFault) for event in Decoder(Role.HOST).feed(data))


BOARD: Final = Language("a board of the TXT-1", 57600, b"", _board)


def known() -> Iterator[tuple[str, Language]]:
    """Yield every language with its HAL's name."""
    for name in LANGUAGES.ours:
        language: Language = LANGUAGES.find("hal", name)[0]  # type: ignore[assignment]
        yield name, language


def named(data: bytes, but: str = "") -> str:
    """Return the device that speaks in these bytes, and its HAL, in words; "" if unknown, or the HAL `but`."""
    for name, language in known():
        if name != but and language.speaks(data):
            return f"{language.device} speaks there: take --hal {name}"
    return ""


class Asker:
    """An end of a line that asks a device, and keeps its answer."""

    def __init__(self, language: Language) -> None:
        self._language = language
        self._heard = b""
        self.link: Link | None = None

    @property
    def found(self) -> bool:
        """Return whether the device answered in its language."""
        return self._language.speaks(self._heard)

    def close(self) -> None:
        """Close the line."""
        if self.link is not None:
            self.link.close()

    def connected(self, link: Link) -> None:
        """Send the question."""
        self.link = link
        if self._language.question:
            link.write(self._language.question)

    def received(self, data: bytes) -> None:
        """Keep the bytes."""
        self._heard = (self._heard + data)[-RECOGNITION_BYTES:]

    def lost(self, reason: str) -> None:
        """Do nothing: the device does not answer."""


async def answering(port_for: Opens) -> list[tuple[str, Language]]:
    """Ask at a port in each language; return the languages with an answer. Raises HalError: it cannot be opened."""
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
