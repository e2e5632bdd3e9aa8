"""Makes a valid file from a broken one: it keeps every complete message, in order."""

from itertools import chain
from pathlib import Path
from typing import NamedTuple

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer

from txt1.errors import RecordingError
from txt1.record.reader import FilePass


class Recovered(NamedTuple):
    """The count of messages that were saved, and of damaged chunks and bytes at the end that were not."""

    messages: int
    damaged: int
    unread: int
    was_complete: bool


def recover(source: Path, target: Path) -> Recovered:
    """Write the sound part of a recording to a new file, and return how much that was.

    Raises RecordingError: the source cannot be read or is no MCAP file, or the target exists or cannot be written.
    """
    reading = FilePass(source)
    try:
        with target.open("xb") as file:
            # ours from here on; half a file would pass for all that could be saved
            try:
                count = _copy(reading, Writer(file))
                file.flush()
            except BaseException:
                target.unlink(missing_ok=True)
                raise
    except FileExistsError:
        raise RecordingError(f"{target}: there is such a file already; choose another name with -o") from None
    except OSError as error:
        raise RecordingError(f"{target}: cannot write it: {error.strerror}; choose another place") from None
    return Recovered(count, reading.damaged, reading.unread, reading.complete)


def _copy(reading: FilePass, writer: Writer) -> int:
    """The number of messages copied; schemas and channels get new numbers."""
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    count = 0
    records = reading.records()
    # the header, whose profile the new file takes over
    first = next(records, None)
    writer.start(reading.header.profile, reading.header.library)
    for record in chain((first,), records):
        match record:
            case Schema() if record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in channels and record.schema_id in schemas:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
            case Message(channel_id, log_time, data, publish_time, sequence) if channel_id in channels:
                writer.add_message(channels[channel_id], log_time, data, publish_time, sequence)
                count += 1
            case Metadata(name, metadata):
                writer.add_metadata(name, metadata)
            case Attachment():
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
    writer.finish()  # type: ignore[no-untyped-call]
    return count
