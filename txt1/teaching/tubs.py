"""Tubs of donkeycar: lessons from its recordings of driving, and a recording as a tub.

How a tub is laid out
=====================

Version 2 (donkeycar 4 and later): ``manifest.json`` has five lines of JSON; the last has the names of the catalogs and
the indexes of deleted records. A catalog has a record a line. Pictures are in ``images/``. Version 1: ``meta.json``,
and beside it the file ``record_N.json`` of each record, and the pictures; ``exclude.json`` has the indexes of deleted
records.

A record holds the picture (``cam/image_array``), the human's steering (``user/angle``, -1 for full left to 1 for full
right), throttle (``user/throttle``, 1 for full ahead) and mode: in the mode "user" the human drives. In txt1 steering
is 1 for full left. A throttle is no speed, so a throttle of 1 counts as the car's safety.v_max.

Times come from the records. A tub that was converted or merged has the times of the conversion; then records are as far
apart as in donkeycar's default, 1/20 s.
"""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.config import Config, load, recorded
from txt1.errors import ConfigError, RecordingError
from txt1.file_limits import JSON_MAX, YAML_MAX, open_file, read_bytes, read_text
from txt1.kernel.clock import NS_PER_S
from txt1.record.reader import Decoding, FilePass, Item, check_own
from txt1.sensors.readings import Image
from txt1.teaching.features import Seen, Sight, Unfit, picture, seen, sight_of
from txt1.teaching.human_drive import HumanDrive
from txt1.teaching.policy import Taught
from txt1.teaching.training import LessonSet

MANIFEST, META, EXCLUDED = "manifest.json", "meta.json", "exclude.json"
PICTURE, ANGLE, THROTTLE, MODE = "cam/image_array", "user/angle", "user/throttle", "user/mode"
# Hz, donkeycar's default of DRIVE_LOOP_HZ
DRIVE_LOOP_RATE: Final = 20.0
# s between two records below which the times are those of a conversion: no camera is as fast
RECORD_PERIOD_MIN: Final = 0.025
# s; the longest time that a record counts for, if records are missing
RECORD_TIME_MAX: Final = 0.5
# a smaller throttle is not driving
THROTTLE_MIN: Final = 0.02
# bytes of a picture
JPEG_MAX: Final = 10_000_000
# records in a catalog, as donkeycar has it
CATALOG: Final = 1000


class Record(NamedTuple):
    """A record of a tub."""

    number: int
    """Its index in the tub."""
    time: float | None
    """s since 1970, or since the start of the drive."""
    session: str
    picture: Path
    angle: float
    """-1 for full left to 1 for full right."""
    throttle: float
    mode: str


def is_tub(path: Path) -> bool:
    """Return whether a folder is a tub of donkeycar."""
    return path.is_dir() and any((path / name).exists() for name in (MANIFEST, META))


def digest(tub: Path) -> str:
    """Return the SHA-256 of a tub's records and pictures; raises RecordingError."""
    found = hashlib.sha256()
    try:
        for folder in (tub, tub / "images"):
            for file in sorted(folder.iterdir()) if folder.is_dir() else ():
                if file.is_file():
                    with open_file(file) as opened:
                        found.update(file.name.encode() + b"\0" + hashlib.file_digest(opened, "sha256").digest())
    except OSError as error:
        raise RecordingError(f"{tub}: cannot read it: {error.strerror}; check the name") from None
    return found.hexdigest()


def drive_of_tub(tub: Path, asks: Sequence[tuple[str, str]], vehicle: str, lag: float) -> HumanDrive:
    """Return the lessons of a tub, whose car is `vehicle`; the human reacts after `lag` s.

    `asks` are the kinds and names of the sensors to learn from.

    Raises RecordingError: it is no tub, a record is damaged, or no human drove in it; ConfigError: there is no such
    vehicle.
    """
    if [kind for kind, _ in asks] != ["camera"]:
        raise RecordingError(f"{tub}: a tub has a camera's pictures and no other readings: --see camera")
    if not is_tub(tub):
        raise RecordingError(
            f"{tub}: a folder without {MANIFEST} or {META} is no tub of donkeycar; give a tub, or a .mcap"
        )
    config = load(None, [], {}, {"vehicle": vehicle}).config
    records, deleted = records_of(tub)
    times, remark = _times(records)
    sensor = asks[0][1] or "camera"
    left: defaultdict[str, float] = defaultdict(float)
    if deleted:
        left["deleted"] = deleted / DRIVE_LOOP_RATE
    sight: Sight | None = None
    rows: list[tuple[float, Any, int, float]] = []
    for number, record in enumerate(records):
        before = number > 0 and records[number - 1].session == record.session
        seconds = min(times[number] - times[number - 1], RECORD_TIME_MAX) if before else 0.0
        if reason := _reason(record):
            left[reason] += seconds
            continue
        try:
            data = read_bytes(record.picture, JPEG_MAX)
            if sight is None:
                sight = sight_of("camera", sensor, Image(*size_of(record.picture, data), data))
            rows.append((times[number], seen(sight, Image(0, 0, data)), number, seconds))
        except (OSError, Unfit):
            left["no picture"] += seconds
    if sight is None:
        why = ", ".join(f"{reason} {seconds:.0f} s" for reason, seconds in left.items())
        raise RecordingError(f"{tub}: no human drove in it ({why or 'it is empty'}); give one with driving")
    total = sum(seconds for *_, seconds in rows)
    taught = Taught(str(tub.resolve()), digest(tub), round(total, 3), {"user": round(total, 3)}, left_out=dict(left))
    lessons = LessonSet(
        Seen((np.stack([look for _, look, *_ in rows]),)),
        np.array([_command(records, times, number, lag) for *_, number, _ in rows], np.float32),
        np.ones(len(rows), np.float32),
        np.array([time for time, *_ in rows]),
    )
    return HumanDrive(
        taught, (sight,), lessons, config.vehicle, config.geometry.radius_min, config.safety.v_max, remark or "complete"
    )


def _reason(record: Record) -> str:
    """Return why a record is no lesson; "" if it is."""
    if record.mode != "user":
        return f"'{record.mode}' drove"
    if record.throttle < 0.0:
        return "reversed"
    return "stood" if record.throttle < THROTTLE_MIN else ""


def _command(records: Sequence[Record], times: Sequence[float], number: int, lag: float) -> tuple[float, float]:
    """Return what the human gave `lag` s later: the shares of full lock, left positive, and of the largest speed."""
    record = records[number]
    for later in range(number + 1, bisect_right(times, times[number] + lag + 1e-6)):
        if records[later].session != record.session or _reason(records[later]):
            break
        record = records[later]
    return -min(max(record.angle, -1.0), 1.0), min(record.throttle, 1.0)


def _times(records: Sequence[Record]) -> tuple[list[float], str]:
    """Return the times of records, s, which rise, and a remark if they are not the records' own."""
    given = [record.time for record in records]
    steps = [b - a for a, b in pairwise(given) if a is not None and b is not None]
    incomplete, usual = len(steps) < len(records) - 1, float(np.median(steps)) if steps else RECORD_PERIOD_MIN
    if incomplete or usual < RECORD_PERIOD_MIN:
        times = [record.number / DRIVE_LOOP_RATE for record in records]
        apart = f"has times {1e3 * usual:.3g} ms apart, which cannot be right"
        why = "has no times of its own" if incomplete else apart
        return times, f"{why}, so {DRIVE_LOOP_RATE:g} records a second are assumed"
    times, last = [], 0.0
    for number, time in enumerate(given):
        step = 0.0 if number == 0 else time - given[number - 1]  # type: ignore[operator]
        last += step if 0.0 < step < 10.0 * RECORD_TIME_MAX else RECORD_TIME_MAX if number else 0.0
        times.append(last)
    return times, ""


def size_of(file: Path, data: bytes) -> tuple[int, int]:
    """Return the columns and rows of a picture; raises Unfit: it is damaged, MissingExtra."""
    from io import BytesIO

    # a picture that cannot be unpacked is told by its reader
    picture(data, 1, 1, 0.0)
    from PIL import Image as Pillow

    with Pillow.open(BytesIO(data), formats=("JPEG", "PNG")) as opened:
        return opened.size


# -- reading ------------------------------------------------------------------------------------------------------


def records_of(tub: Path) -> tuple[list[Record], int]:
    """Return the records of a tub in the order of their indexes, and how many were deleted; raises RecordingError."""
    version_2 = (tub / MANIFEST).exists()
    try:
        found, deleted = _version_2(tub) if version_2 else _version_1(tub)
        items = [(index, _record(tub, index, told, place)) for index, told, place in found]
    except OSError as error:
        raise RecordingError(f"{error.filename or tub}: cannot read it: {error.strerror}; copy the whole tub") from None
    except UnicodeDecodeError as error:
        raise RecordingError(f"{tub}: a file is no text in UTF-8 ({error.reason}); copy the whole tub") from None
    kept = [record for index, record in sorted(items, key=lambda item: item[0]) if index not in deleted]
    return kept, len(items) - len(kept)


def _version_2(tub: Path) -> tuple[Iterator[tuple[int, dict[str, Any], str]], frozenset[int]]:
    lines = read_text(tub / MANIFEST, JSON_MAX).splitlines()
    told = _json(tub / MANIFEST, lines[4] if len(lines) > 4 else "")
    paths, deleted = told.get("paths", []), told.get("deleted_indexes", [])
    if not isinstance(paths, list) or not isinstance(deleted, list):
        raise RecordingError(f"{tub / MANIFEST}: its last line names no catalogs; copy the whole tub")

    def records() -> Iterator[tuple[int, dict[str, Any], str]]:
        number = 0
        for path in paths:
            file = tub / _plain(tub / MANIFEST, "paths", path)
            for line in read_text(file, JSON_MAX).splitlines():
                if line.strip():
                    record = _json(file, line)
                    index = record.get("_index", number)
                    yield index if isinstance(index, int) else number, record, "images"
                    number += 1

    return records(), frozenset(each for each in deleted if isinstance(each, int))


def _version_1(tub: Path) -> tuple[Iterator[tuple[int, dict[str, Any], str]], frozenset[int]]:
    excluded: Any = []
    if (tub / EXCLUDED).exists():
        excluded = json.loads(read_text(tub / EXCLUDED, YAML_MAX) or "[]")

    def records() -> Iterator[tuple[int, dict[str, Any], str]]:
        for file in tub.glob("record_*.json"):
            number = file.stem.removeprefix("record_")
            if number.isdecimal():
                yield int(number), _json(file, read_text(file)), "."

    return records(), frozenset(each for each in excluded if isinstance(each, int))


def _json(file: Path, text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise RecordingError(f"{file}: a record is no JSON object: {text[:60]!r}; copy the whole tub")
    return found


def _plain(file: Path, field: str, name: Any) -> str:
    """Return the name of a file in the tub; raises RecordingError: it leads elsewhere."""
    if not isinstance(name, str) or not name or Path(name).name != name or "\0" in name:
        raise RecordingError(f"{file}: {field}: {name!r} is no name of a file in the tub; copy the whole tub")
    return name


def _record(tub: Path, index: int, told: dict[str, Any], folder: str) -> Record:
    def number(field: str) -> float:
        value = told.get(field)
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise RecordingError(
                f"{tub}: record {index}: {field}: {'not there' if value is None else repr(value)}; "
                "a number of -1 to 1 is needed: delete the record with donkeycar"
            )
        return float(value)

    stamp = told.get("_timestamp_ms", told.get("milliseconds"))
    time = stamp / 1000.0 if isinstance(stamp, int | float) and not isinstance(stamp, bool) else None
    name = _plain(tub, f"record {index}: {PICTURE}", told.get(PICTURE))
    mode, session = str(told.get(MODE, "user")), str(told.get("_session_id", ""))
    return Record(index, time, session, tub / folder / name, number(ANGLE), number(THROTTLE), mode)


# -- writing ------------------------------------------------------------------------------------------------------


def export(items: Sequence[Item] | Iterator[Item], file: Path, tub: Path) -> int:
    """Write the pictures of a recording's first camera, and how it drove, as a tub of version 2; return their number.

    The steering is the set-point's share of full lock, the throttle its share of safety.v_max; times in which the robot
    was not armed are left out. Raises ConfigError: the folder is there; RecordingError: no pictures are in it, or the
    tub cannot be written.
    """
    if tub.exists():
        raise ConfigError(f"--tub {tub}: there is such a folder already; choose another name")
    check_own(file)
    reading, decoding = FilePass(file), Decoding()
    # the configuration is at the beginning
    next(iter(reading), None)
    config = _configuration(file, reading)
    radius, v_max = config.geometry.radius_min, config.safety.v_max
    records: list[dict[str, Any]] = []
    camera, armed, v, omega = "", False, 0.0, 0.0
    try:
        for item in items:
            if item.name == "/mode":
                armed = bool(decoding.message(item).armed)
            elif item.name == "/setpoint":
                twist = decoding.message(item).twist
                v, omega = twist.linear.x, twist.angular.z
            elif item.schema.name == "sensor_msgs/msg/CompressedImage" and armed and camera in ("", item.topic):
                camera, index = item.topic, len(records)
                name = f"{index}_cam_image_array_.jpg"
                (tub / "images").mkdir(parents=True, exist_ok=True)
                (tub / "images" / name).write_bytes(bytes(decoding.message(item).data))
                share = omega * radius / v if abs(v) > 1e-3 else 0.0
                records.append(
                    {
                        "_index": index,
                        "_session_id": "txt1",
                        "_timestamp_ms": item.message.log_time * 1000 // NS_PER_S,
                        PICTURE: name,
                        ANGLE: -min(max(share, -1.0), 1.0) + 0.0,
                        MODE: "user",
                        THROTTLE: min(max(v / v_max, -1.0), 1.0),
                    }
                )
        if records:
            _write(tub, records)
    except OSError as error:
        raise RecordingError(f"{error.filename or tub}: cannot write it: {error.strerror}") from None
    if not records:
        raise RecordingError(f"{file}: no pictures of a camera while it was armed; record with one (sensors.camera)")
    return len(records)


def _configuration(file: Path, reading: FilePass) -> Config:
    about = reading.metadata.get("txt1", {})
    try:
        own = next(iter(json.loads(about["robots"]).values())) if "robots" in about else None
        return recorded(json.loads(about["config"]), own)
    except (KeyError, ValueError, ConfigError, StopIteration) as error:
        raise RecordingError(
            f"{file}: no configuration in it that can be read ({error}); was it made by txt1?"
        ) from None


def _write(tub: Path, records: Sequence[dict[str, Any]]) -> None:
    """Write the catalogs and the manifest as donkeycar does."""
    began = records[0]["_timestamp_ms"] / 1000.0 if records else 0.0
    names = []
    for first in range(0, len(records), CATALOG):
        stem = f"catalog_{first // CATALOG}"
        lines = [json.dumps(record, sort_keys=True) + "\n" for record in records[first : first + CATALOG]]
        (tub / f"{stem}.catalog").write_text("".join(lines), encoding="utf-8")
        catalog = {
            "created_at": began,
            "line_lengths": list(map(len, lines)),
            "path": f"{stem}.catalog_manifest",
            "start_index": first,
        }
        (tub / f"{stem}.catalog_manifest").write_text(json.dumps(catalog, sort_keys=True) + "\n", encoding="utf-8")
        names.append(f"{stem}.catalog")
    inputs = {PICTURE: "image_array", ANGLE: "float", THROTTLE: "float", MODE: "str"}
    sessions = {"all_full_ids": ["txt1"], "last_id": 0, "last_full_id": "txt1"}
    last = {"paths": names, "current_index": len(records), "max_len": CATALOG, "deleted_indexes": []}
    about = {"created_at": began, "sessions": sessions}
    written: list[object] = [list(inputs), list(inputs.values()), {}, about, last]
    (tub / MANIFEST).write_text("".join(json.dumps(line) + "\n" for line in written), encoding="utf-8")
