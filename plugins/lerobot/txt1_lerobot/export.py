"""A recording's episodes as a LeRobot dataset, version 3.0, for people who train elsewhere.

    DIR/meta/info.json, stats.json, tasks.parquet, episodes/chunk-000/file-000.parquet
    DIR/data/chunk-000/file-000.parquet

An episode is one of the learner's; of a recording without a learner, a drive from arming to disarming. Frames are
evenly apart: the state is what had been told until then, the action is the set-point that was in force when the next
frame was due. The pictures of cameras are the JPEGs of the recording, as LeRobot's feature of the kind image, and the
statistics of their colours are over as many of them as LeRobot itself takes.
"""

import json
from collections.abc import Callable, Sequence
from io import BytesIO
from math import atan2, ceil
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pyarrow import parquet

from txt1.commands import say
from txt1.errors import ConfigError, RecordingError
from txt1.record.reader import Decoding, FilePass

Array = NDArray[np.float64]
VERSION: Final = "v3.0"
DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES: Final = "meta/episodes/chunk-000/file-000.parquet"
# files in a folder at most, as LeRobot's own tools have it; here it is one
CHUNK: Final = 1000
ACTION: Final = "/setpoint"
PICTURE: Final = "sensor_msgs/msg/CompressedImage"


class Signal(NamedTuple):
    """Numbers that are taken from a topic's messages."""

    names: tuple[str, ...]
    of: Callable[[Any], Sequence[float]]


def _pose(message: Any) -> tuple[float, ...]:
    pose, twist = message.pose.pose, message.twist.twist
    theta = 2.0 * atan2(pose.orientation.z, pose.orientation.w)
    return pose.position.x, pose.position.y, theta, twist.linear.x, twist.angular.z


STATE: Final = {
    "/odom": Signal(("x.pos", "y.pos", "theta.pos", "x.vel", "theta.vel"), _pose),
    "/light": Signal(tuple(f"light_{place}_lux" for place in ("fl", "fr", "rl", "rr")), lambda message: message.lux),
}
SIGNALS: Final = STATE | {
    ACTION: Signal(("x.vel", "theta.vel"), lambda message: (message.twist.linear.x, message.twist.angular.z))
}


class Series:
    """A topic's values, and when they were told, s."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._values: list[Sequence[float]] = []

    def add(self, time: float, values: Sequence[float]) -> None:
        """Take a message."""
        self._times.append(time)
        self._values.append(values)

    @property
    def first(self) -> float:
        """When its first value was told, s."""
        return self._times[0]

    def at(self, times: Array) -> Array:
        """The last values told before each time, shape (times, values)."""
        return np.array(self._values)[np.searchsorted(self._times, times, side="left") - 1]


class Pictures:
    """A camera's pictures as JPEGs, and when they were told, s."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._data: list[bytes] = []

    def add(self, time: float, data: bytes) -> None:
        """Take a picture."""
        self._times.append(time)
        self._data.append(data)

    @property
    def first(self) -> float:
        """When the first was told, s."""
        return self._times[0]

    def at(self, times: Array) -> list[bytes]:
        """Return the last ones told before each time."""
        return [self._data[index] for index in np.searchsorted(self._times, times, side="left") - 1]


class Taken(NamedTuple):
    """A recording's signals by topic, its episodes as their begin and end, s; whether a learner's; its pictures."""

    series: dict[str, Series]
    episodes: list[tuple[float, float]]
    learned: bool
    pictures: dict[str, Pictures]


def taken(path: Path) -> Taken:
    """Read a recording; RecordingError: there is no odometry or no set-point in it, or nothing was driven."""
    series: dict[str, Series] = {}
    pictures: dict[str, Pictures] = {}
    learned: list[tuple[float, float]] = []
    driven: list[tuple[float, float]] = []
    # of the learner's episode
    begun: float | None = None
    armed: float | None = None
    reading, decoding, time = FilePass(path), Decoding(), 0.0
    for item in reading:
        name, time = item.name, reading.run_time(item)
        if name in SIGNALS:
            series.setdefault(name, Series()).add(time, SIGNALS[name].of(decoding.message(item)))
        elif item.schema.name == PICTURE:
            pictures.setdefault(name, Pictures()).add(time, bytes(decoding.message(item).data))
        elif name == "/learning/step":
            over = decoding.message(item).action < 0
            if over and begun is not None:
                learned.append((begun, time))
            begun = None if over else time if begun is None else begun
        elif name == "/mode":
            if decoding.message(item).armed:
                armed = time if armed is None else armed
            else:
                if armed is not None:
                    driven.append((armed, time))
                # a disarm voids the learner's episode
                armed = begun = None
    if armed is not None:
        driven.append((armed, time))
    for topic in ("/odom", ACTION):
        if topic not in series:
            raise RecordingError(
                f"{path}: no {topic} in it, which --lerobot needs; 'txt1 log info' tells what there is"
            )
    if not (learned or driven):
        raise RecordingError(f"{path}: no episode in it, as the robot was never armed; record a drive")
    return Taken(series, learned or driven, bool(learned), pictures)


def export(path: Path, directory: Path, fps: int, task: str | None) -> tuple[int, int]:
    """Write a dataset to a directory that is not there yet; how many episodes and frames.

    Args:
        path: of the recording.
        directory: where to.
        fps: frames a second.
        task: its description, for policies that take one; None: derived from the recording.

    Raises ConfigError: the directory is there; RecordingError: the recording has nothing for it, or the directory
    cannot be written.

    """
    if directory.exists():
        raise ConfigError(f"--lerobot {directory}: is there already; choose another name")
    series, spans, learned, pictures = taken(path)
    topics = [topic for topic in STATE if topic in series]
    ready = max(series[topic].first for topic in (*topics, ACTION))
    ready = max([ready, *(each.first for each in pictures.values())])
    parts = [_frames(series, topics, pictures, max(begin, ready), end, fps) for begin, end in spans]
    parts = [part for part in parts if len(part["timestamp"])]
    if not parts:
        raise RecordingError(f"{path}: no episode lasts as long as a frame at --fps {fps}; give a higher one")
    lengths = [len(part["timestamp"]) for part in parts]
    seen = {
        f"observation.images.{topic.rpartition('/')[2]}": [data for part in parts for data in part.pop(topic)]
        for topic in pictures
    }
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    total = sum(lengths)
    columns |= {
        "episode_index": np.repeat(np.arange(len(parts)), lengths),
        "index": np.arange(total),
        "task_index": np.zeros(total, np.int64),
    }
    if not columns["action"].any():
        say(f"{path}: all {total} actions are 0, so the dataset shows a robot that stands; record a drive")
    names = {
        "observation.state": [name for topic in topics for name in STATE[topic].names],
        "action": list(SIGNALS[ACTION].names),
    }
    try:
        _write(directory, columns, seen, names, lengths, fps, task or ("drive to the light" if learned else "drive"))
    except OSError as error:
        raise RecordingError(f"{error.filename or directory}: cannot write it: {error.strerror}") from None
    return len(parts), total


def _frames(
    series: dict[str, Series], topics: list[str], pictures: dict[str, Pictures], begin: float, end: float, fps: int
) -> dict[str, Any]:
    """An episode's columns, a row a frame."""
    count = max(0, ceil((end - begin) * fps - 1e-6))
    number = np.arange(count)
    times = begin + number / fps
    # what is told in the very instant of a frame belongs to it
    just_after = times + 1e-6
    return {
        "observation.state": np.column_stack([series[topic].at(just_after) for topic in topics]),
        "action": series[ACTION].at(np.minimum(times + 1.0 / fps, end)),
        "timestamp": number / fps,
        "frame_index": number,
        "next.done": number == count - 1,
        **{topic: each.at(just_after) for topic, each in pictures.items()},
    }


def _write(
    directory: Path,
    columns: dict[str, Array],
    pictures: dict[str, list[bytes]],
    names: dict[str, list[str]],
    lengths: list[int],
    fps: int,
    task: str,
) -> None:
    kinds = dict.fromkeys((*names, "timestamp"), "float32") | {"next.done": "bool"}
    for name in (DATA.format(chunk_index=0, file_index=0), EPISODES):
        (directory / name).parent.mkdir(parents=True)
    features: dict[str, Any] = {}
    data: dict[str, Any] = {}
    stats: dict[str, Any] = {}
    for name, values in columns.items():
        kind = kinds.get(name, "int64")
        features[name] = {"dtype": kind, "shape": list(values.shape[1:]) or [1], "names": names.get(name)}
        rows = values.astype(kind)
        data[name] = (
            pa.array(rows) if rows.ndim == 1 else pa.array(rows.tolist(), pa.list_(pa.float32(), rows.shape[1]))
        )
        stats[name] = _stats(values)
    for name, files in pictures.items():
        features[name], stats[name] = _picture_feature(files)
        files_of = [{"bytes": each, "path": None} for each in files]
        data[name] = pa.array(files_of, pa.struct({"bytes": pa.binary(), "path": pa.string()}))
    parquet.write_table(pa.table(data), directory / DATA.format(chunk_index=0, file_index=0))
    _write_tasks(directory / "meta" / "tasks.parquet", task)

    ends = np.cumsum(lengths).tolist()
    zeros = [0] * len(lengths)
    episodes = {
        "episode_index": list(range(len(lengths))),
        "tasks": [[task]] * len(lengths),
        "length": lengths,
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "dataset_from_index": [end - length for end, length in zip(ends, lengths, strict=True)],
        "dataset_to_index": ends,
        "meta/episodes/chunk_index": zeros,
        "meta/episodes/file_index": zeros,
    }
    parquet.write_table(pa.table(episodes), directory / EPISODES)
    info = {
        "codebase_version": VERSION, "robot_type": "txt1", "total_episodes": len(lengths), "total_frames": ends[-1],
        "total_tasks": 1, "chunks_size": CHUNK, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": fps,
        "splits": {"train": f"0:{len(lengths)}"}, "data_path": DATA, "video_path": None, "features": features,
    }  # fmt: skip
    for name, about in (("info", info), ("stats", stats)):
        text = json.dumps(about, indent=4, allow_nan=False) + "\n"
        (directory / "meta" / f"{name}.json").write_text(text, encoding="utf-8")


def _stats(values: Array) -> dict[str, list[float]]:
    """Statistics that policies are normalised by: min, max, mean and deviation of each number, and the count."""
    rows = values.reshape(len(values), -1).astype(float)
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    return {name: each.tolist() for name, each in found.items()} | {"count": [len(rows)]}


def _picture_feature(files: list[bytes]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the feature of a camera's pictures, and the statistics of their colours, 0 to 1.

    Raises RecordingError: they are of several sizes, or damaged.
    """
    number = max(min(100, len(files)), min(int(len(files) ** 0.75), 10_000))
    colours, sizes = [], set()
    for index in np.linspace(0, len(files) - 1, number).astype(int):
        try:
            with Image.open(BytesIO(files[index]), formats=("JPEG",)) as picture:
                sizes.add(picture.size)
                colours.append(np.asarray(picture.convert("RGB"), float).reshape(-1, 3) / 255.0)
        except (OSError, UnidentifiedImageError) as error:
            raise RecordingError(f"a picture is damaged ({error}); see 'txt1 log info'") from None
    if len(sizes) > 1:
        raise RecordingError(f"the pictures have several sizes: {', '.join(map(str, sorted(sizes)))}")
    rows = np.concatenate(colours)
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    ((width, height),) = sizes
    feature = {"dtype": "image", "shape": [height, width, 3], "names": ["height", "width", "channels"]}
    return feature, {name: each[:, None, None].tolist() for name, each in found.items()} | {"count": [number]}


def _write_tasks(path: Path, task: str) -> None:
    """Write the table of tasks, which LeRobot reads with pandas, by their words: pandas' own note says so."""
    table = pa.table({"task_index": [0], "task": [task]})
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    note = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for name, (kind, numpy) in kinds.items()
        ],
    }
    parquet.write_table(table.replace_schema_metadata({"pandas": json.dumps(note)}), path)
