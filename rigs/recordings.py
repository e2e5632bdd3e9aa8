"""Reads a recording with another library, as strangers' tools do."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def messages(file: Path) -> dict[str, list[Any]]:
    """Return the messages of a file by their topics, as the library mcap reads them."""
    found: dict[str, list[Any]] = {}
    with file.open("rb") as stream:
        for _, channel, _, message in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    return found
