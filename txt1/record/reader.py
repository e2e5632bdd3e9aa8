"""A recording as it is read: message by message from the front, whole or broken off, with every checksum compared."""

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, cast

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC
from mcap_ros2.decoder import DecoderFactory

from txt1.errors import RecordingError, Txt1Error
from txt1.file_limits import CHUNK_MAX, UNPACKED_MAX, UNPACKED_SHARE, open_file
from txt1.kernel.clock import NS_PER_S, nanoseconds

HEAD: Final = struct.Struct("<BQ")
# metadata of a recording, and of its time stamps where they are known only when the run has begun
ABOUT, TIME = "txt1", "txt1.time"
OWN: Final = ("/input", "/reports", "/steps", "/snapshot")
"""Topics of older recordings that are for txt1 alone."""
# of channels whose messages have no definition in the file
NO_SCHEMA: Final = Schema(id=0, data=b"", encoding="", name="")
_KINDS: Final[dict[int, Any]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}


class Item(NamedTuple):
    """A message of a recording."""

    topic: str
    schema: Schema
    channel: Channel
    message: Message

    @property
    def name(self) -> str:
        """Its topic without the name of a robot before it."""
        return self.channel.metadata.get("topic", self.topic)

    @property
    def robot(self) -> str:
        """The name of its robot; empty for a single robot."""
        return self.topic.removesuffix(self.name).strip("/")

    @property
    def own(self) -> bool:
        """Whether its topic is for txt1's own replay and screens alone."""
        # older recordings do not say so
        return self.channel.metadata.get("own", str(self.name in OWN)) == str(True)

    @property
    def derived(self) -> bool:
        """Whether other topics of its robot have its contents, too."""
        return self.channel.metadata.get("derived") == str(True)

    @property
    def kind(self) -> str:
        """The type of its messages, or their encoding if the file does not define them."""
        return self.schema.name or f"({self.channel.message_encoding}, without a schema)"

    @property
    def time(self) -> float:
        """Its time stamp in s since 1970."""
        return self.message.log_time / NS_PER_S


class FilePass:
    """One pass through a file: the messages of `robot`, or of all robots for None."""

    def __init__(self, path: Path, robot: str | None = None) -> None:
        self.path, self.robot = path, robot
        self.complete = False
        """Whether the file goes to its proper end; known after the pass."""
        self.damaged = 0
        """Chunks that were left out because their bytes are not what was written."""
        self.unread = 0
        """Bytes at the end that belong to no complete record."""
        # bytes that the rest of the file may unpack to
        self._left = 0
        self.header = Header("", "")
        self.epoch = 0.0
        """Time stamp of the run's start, s since 1970; 0 in a file of others, and before its metadata were read."""
        self._epoch_ns = 0
        self.metadata: dict[str, dict[str, str]] = {}
        """The metadata records so far, by name."""
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}

    def __iter__(self) -> Iterator[Item]:
        for record in self.records():
            if isinstance(record, Message):
                channel = self.channels.get(record.channel_id)
                if channel is None:
                    continue
                schema = NO_SCHEMA if channel.schema_id == 0 else self.schemas.get(channel.schema_id)
                if schema is not None:
                    item = Item(channel.topic, schema, channel, record)
                    if self.robot is None or item.robot == self.robot:
                        yield item

    def run_time(self, item: Item) -> float:
        """When it was told, s of the run."""
        return (item.message.log_time - self._epoch_ns) / NS_PER_S

    def records(self) -> Iterator[McapRecord]:
        """Every sound record of the data section, in order, those inside the chunks included.

        Raises RecordingError: the file cannot be read, or is no MCAP file.
        """
        try:
            with BufferedReader(open_file(_readable(self.path))) as file:
                size = file.seek(0, 2)
                file.seek(0)
                self._left = UNPACKED_MAX + UNPACKED_SHARE * size
                yield from self._records(file, size)
        except OSError as error:
            remedy = "'txt1 teach' reads a donkeycar's tub" if self.path.is_dir() else "check the name"
            raise RecordingError(f"{self.path}: cannot read it: {error.strerror}; {remedy}") from None

    def _records(self, file: IO[bytes], size: int) -> Iterator[McapRecord]:
        magic = file.read(len(MCAP0_MAGIC))
        if not MCAP0_MAGIC.startswith(magic):
            raise RecordingError(f"{self.path}: no MCAP file, it begins otherwise; 'txt1 run --log FILE' makes one")
        while True:
            start = file.tell()
            head = file.read(HEAD.size)
            opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            if len(head) < HEAD.size or length > size - start - HEAD.size:
                self.unread = size - start
                return
            if opcode == Opcode.DATA_END:
                self.complete = _ends_well(file, size)
                return
            payload = file.read(length)
            try:
                records = self._parse(opcode, payload)
            except RecordingError:
                raise
            except Exception:
                # each compression has errors of its own
                self.damaged += 1
            else:
                yield from records

    def _parse(self, opcode: int, payload: bytes) -> list[McapRecord]:
        stream = ReadDataStream(BytesIO(payload))
        if opcode == Opcode.CHUNK:
            chunk = self._unpacked(Chunk.read(stream))
            return [self._noted(record) for record in breakup_chunk(chunk, validate_crc=True)]
        if opcode == Opcode.MESSAGE:
            return [Message.read(stream, len(payload))]
        kind = _KINDS.get(opcode)
        return [] if kind is None else [self._noted(kind.read(stream))]

    def _unpacked(self, chunk: Chunk) -> Chunk:
        """Return a chunk that is not packed; raises RecordingError: the file unpacks to more than a recording does."""
        size = chunk.uncompressed_size
        self._left -= size
        if size > CHUNK_MAX or self._left < 0:
            raise RecordingError(
                f"{self.path}: a small file that unpacks to {size / 1e6:.0f} MB or more is no recording, so it is not "
                "read any further; check where it came from"
            )
        match chunk.compression:
            case "zstd":
                with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
                    data = reader.read(size)
            case "lz4":
                data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size)
            case "":
                return chunk
            case other:
                raise ValueError(other)
        if len(data) != size:
            raise ValueError("its size is another")
        return replace(chunk, compression="", data=data)

    def _noted(self, record: McapRecord) -> McapRecord:
        match record:
            case Header():
                self.header = record
            case Schema():
                self.schemas[record.id] = record
            case Channel():
                self.channels[record.id] = record
            case Metadata(name, values):
                self.metadata[name] = values
                if name in (ABOUT, TIME) and "epoch" in values:
                    self.epoch = float(values["epoch"])
                    self._epoch_ns = nanoseconds(self.epoch)
        return record


def _is_packed(path: Path) -> bool:
    """Return whether a path is a bag of ROS that is no MCAP file."""
    from txt1.bags.reader import is_bag

    return path.suffix != ".mcap" and path.exists() and is_bag(path)


def _readable(path: Path) -> Path:
    """Return a recording as it is, a bag of ROS that is no MCAP file as one; raises BagError, MissingExtra."""
    from txt1.bags.reader import as_mcap

    return as_mcap(path) if _is_packed(path) else path


def _ends_well(file: IO[bytes], size: int) -> bool:
    """Whether footer and magic stand at the end."""
    tail = HEAD.size + 20 + len(MCAP0_MAGIC)
    if size - file.tell() < tail:
        return False
    file.seek(size - tail)
    data = file.read(tail)
    if data[0] != Opcode.FOOTER or not data.endswith(MCAP0_MAGIC):
        return False
    return bool(Footer.read(ReadDataStream(BytesIO(data[HEAD.size :]))).summary_start <= size)


def metadata_of(path: Path, name: str) -> dict[str, str]:
    """The first metadata record of this name; empty when there is none, or the file is no recording."""
    if _is_packed(path):
        # it has none, and to unpack it takes a while
        return {}
    with suppress(RecordingError):
        for record in FilePass(path).records():
            if isinstance(record, Metadata) and record.name == name:
                return dict(record.metadata)
    return {}


def check_own(path: Path) -> None:
    """Raise RecordingError if a file cannot be a recording of txt1's, without unpacking it, which takes a while."""
    if _is_packed(path):
        raise RecordingError(f"{path}: no configuration in it: it is a bag of ROS, and txt1 did not make it")


@contextmanager
def trusting(path: Path) -> Iterator[None]:
    """Trust a recording's content; errors that damaged content causes become RecordingError."""
    try:
        yield
    except (Txt1Error, OSError):
        raise
    except Exception as error:
        raise RecordingError(
            f"{path}: its content is not what it has to be, so it is damaged ({type(error).__name__}: "
            f"{' '.join(str(error).split())[:200]}); see 'txt1 log info'"
        ) from error


def robots_in(path: Path) -> list[str]:
    """Return the names of the recorded robots, in the order of their plan; a single robot may have none.

    Raises RecordingError: they cannot be read.
    """
    about = metadata_of(path, "txt1")
    with trusting(path):
        if "robots" not in about:
            return [str(json.loads(about.get("config", "{}")).get("name", ""))]
        if names := list(json.loads(about["robots"]).keys()):
            return names
        raise ValueError("no robots")


def robot_in(path: Path, name: str | None) -> str:
    """Return the robot of this name in a recording, for None the first; RecordingError: it is not there."""
    names = robots_in(path)
    if name is None:
        return names[0]
    if name not in names:
        raise RecordingError(f"{path}: robot '{name}' is not in it; choose one of: {', '.join(names) or 'none'}")
    return name


class Decoding:
    """Turns items into their messages, and those into plain values."""

    def __init__(self) -> None:
        self._factory = DecoderFactory()
        self._decoders: dict[int, Any] = {}

    def message(self, item: Item) -> Any:
        """The message, with its fields as attributes.

        Raises RecordingError: it is in another encoding than ROS 2's, or it or its definition is damaged.
        """
        try:
            decoder = self._decoders.get(item.channel.id)
            if decoder is None:
                decoder = self._decoders[item.channel.id] = self._factory.decoder_for(
                    item.channel.message_encoding, item.schema
                )
            if decoder is not None:
                return decoder(item.message.data)
        except Exception as error:
            # whatever the libraries say to a definition that is none
            raise RecordingError(
                f"{item.topic}: a message is not as its definition {item.schema.name!r} in the file says, so one of "
                f"both is damaged ({type(error).__name__}: {error}); choose other topics with --topic"
            ) from error
        raise RecordingError(
            f"{item.topic}: its messages are encoded as {item.channel.message_encoding!r}, "
            "and only ROS 2's 'cdr' with a schema, and 'json', are read here; choose other topics with --topic"
        )

    def values(self, item: Item, as_bytes: bool = False) -> dict[str, Any]:
        """The message as nested dictionaries and lists; bytes as such, or as hexadecimal digits.

        A message in JSON may have no definition. Raises RecordingError as `message`.
        """
        if item.channel.message_encoding == "json":
            with suppress(ValueError, RecursionError):
                found = json.loads(item.message.data)
                return found if isinstance(found, dict) else {"data": found}
        return cast(dict[str, Any], _plain(self.message(item), as_bytes))


def _plain(value: Any, as_bytes: bool) -> Any:
    if hasattr(value, "__slots__") and not isinstance(value, str | bytes | int | float):
        return {name: _plain(getattr(value, name), as_bytes) for name in value.__slots__}
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value) if as_bytes else bytes(value).hex(" ")
    if isinstance(value, list | tuple) or hasattr(value, "tolist"):
        return [_plain(each, as_bytes) for each in value]
    return value


def flat(values: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value with its dotted path; a list is a single value."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from flat(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value
