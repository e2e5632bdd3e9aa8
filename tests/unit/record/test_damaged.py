"""Recordings whose checksums are right and whose content is not: refused in one line, whatever reads them."""

from __future__ import annotations

from collections.abc import Callable
from errno import ENOSPC
from importlib.util import find_spec
from os import strerror
from pathlib import Path

import pytest
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import Writer

from txt1.cli import execute
from txt1.errors import RecordingError
from txt1.record.reader import FilePass
from txt1.record.recovery import recover
from txt1.record.verification import verify

GOLDEN = Path(__file__).parents[2] / "golden" / "line.mcap"
LONGEST = 1000  # messages of it, which are enough

Spoil = Callable[[str, bytes], bytes]


def spoilt(path: Path, told: Spoil, defined: Spoil, noted: Callable[[str], str]) -> Path:
    """A copy of a recording with other messages and definitions, by topic and name, and another configuration."""
    channels: dict[int, tuple[int, str]] = {}
    schemas: dict[int, int] = {}
    with path.open("xb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        count = 0
        for record in FilePass(GOLDEN).records():
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, defined(record.name, record.data)
                )
            elif isinstance(record, Channel) and record.id not in channels:
                number = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
                channels[record.id] = number, record.topic
            elif isinstance(record, Metadata):
                writer.add_metadata(
                    record.name,
                    {key: noted(each) if key == "config" else each for key, each in record.metadata.items()},
                )
            elif isinstance(record, Message) and count < LONGEST:
                number, topic = channels[record.channel_id]
                data = told(topic, record.data)
                writer.add_message(number, record.log_time, data, record.publish_time, record.sequence)
                count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def same(name: str, data: bytes) -> bytes:
    """What it was."""
    del name
    return data


def cut_setpoint(topic: str, data: bytes) -> bytes:
    """Half a set-point."""
    return data[:20] if topic == "/setpoint" else data


def other_definition(name: str, data: bytes) -> bytes:
    """A definition of set-points that is none."""
    return b"uint3{" if name == "geometry_msgs/msg/TwistStamped" else data


# a bag of ROS 1 is a plug-in's
WORDS = ["report", "replay --verify", *(["log export --rosbag1"] if find_spec("txt1_ros1") else [])]
CASES = {
    "message": (cut_setpoint, same, str),
    "definition": (same, other_definition, str),
    "configuration cut off": (same, same, lambda text: text[:100]),
    "configuration a list": (same, same, lambda text: "[]"),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("words", WORDS)
@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_a_damaged_recording_is_told_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, words: str, case: str
) -> None:
    file = spoilt(tmp_path / "run.mcap", *CASES[case])
    code = execute([*words.split(), str(file)])
    said = capfd.readouterr().err.splitlines()
    assert not any(line.startswith("Traceback") for line in said), said
    assert not caplog.records
    if "bag" in words and "configuration" in case:
        assert code == 0, "a bag has no configuration"
    elif "replay" in words and "configuration" not in case:
        # a message is a difference, and where the bytes are the same no definition is read
        assert code == int(case == "message")
    else:
        assert code != 0
        assert said[-1].startswith("txt1: ")
        assert not list(tmp_path.glob("*.bag"))


def test_a_damaged_message_is_a_difference(tmp_path: Path) -> None:
    file = spoilt(tmp_path / "run.mcap", lambda topic, data: data[:6] if topic == "/snapshot" else data, same, str)
    difference = verify(file).difference
    assert difference is not None
    assert (difference.topic, difference.recorded) == ("/snapshot", "a damaged message")


def test_a_recovery_onto_a_full_disk_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> None:
        del arguments
        raise OSError(ENOSPC, strerror(ENOSPC))

    monkeypatch.setattr(Writer, "finish", full)
    target = tmp_path / "saved.mcap"
    with pytest.raises(RecordingError, match="No space left"):
        recover(GOLDEN, target)
    assert not target.exists()


def test_a_recovery_leaves_a_file_that_is_there_alone(tmp_path: Path) -> None:
    target = tmp_path / "saved.mcap"
    target.write_text("mine")
    with pytest.raises(RecordingError, match="such a file already"):
        recover(GOLDEN, target)
    assert target.read_text() == "mine"
