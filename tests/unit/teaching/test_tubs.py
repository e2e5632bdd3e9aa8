"""Tubs of donkeycar: lessons from both versions, what is left out, what is refused, and tubs that are written."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.patience import LIMIT
from txt1.cli import execute
from txt1.commands import OK, USAGE
from txt1.errors import RecordingError
from txt1.teaching.human_drive import HumanDrive
from txt1.teaching.lessons import Ask, drive_in, sha256_of
from txt1.teaching.teach import summary

pillow = pytest.importorskip("PIL.Image")

CAMERA = [Ask("camera")]
DONKEYCAR = os.environ.get("TXT1_DONKEYCAR", "")
"""A Python with donkeycar."""


def jpeg(grey: int) -> bytes:
    stream = BytesIO()
    pillow.fromarray(np.full((120, 160, 3), grey, np.uint8)).save(stream, "JPEG")
    return stream.getvalue()


def record(index: int, **more: Any) -> dict[str, Any]:
    told = {
        "cam/image_array": f"{index}_cam_image_array_.jpg",
        "user/angle": 0.5 if index % 20 < 10 else -0.25,
        "user/throttle": 0.6,
        "user/mode": "user",
    }
    return told | more


def version_2(tub: Path, records: list[dict[str, Any]], deleted: list[int] = [], step: int = 50) -> Path:  # noqa: B006
    """A tub as donkeycar 4 and 5 write it, in catalogs of 100; `step` ms between two records."""
    (tub / "images").mkdir(parents=True)
    names = []
    for first in range(0, len(records), 100):
        lines = []
        for index, told in enumerate(records[first : first + 100], first):
            own = {"_index": index, "_session_id": "26-01-01_0", "_timestamp_ms": 1_700_000_000_000 + step * index}
            lines.append(json.dumps(own | told, sort_keys=True) + "\n")
            (tub / "images" / f"{index}_cam_image_array_.jpg").write_bytes(jpeg(index % 250))
        names.append(f"catalog_{first // 100}.catalog")
        (tub / names[-1]).write_text("".join(lines))
    last = {"paths": names, "current_index": len(records), "max_len": 100, "deleted_indexes": deleted}
    (tub / "manifest.json").write_text("".join(json.dumps(each) + "\n" for each in ([], [], {}, {}, last)))
    return tub


def version_1(tub: Path, records: list[dict[str, Any]], deleted: list[int] = [], step: int = 50) -> Path:  # noqa: B006
    """A tub as donkeycar 2 and 3 write it: a file for each record, those that were deleted listed."""
    tub.mkdir(parents=True)
    (tub / "meta.json").write_text(json.dumps({"inputs": [], "types": [], "start": 1.6e9}))
    for index, told in enumerate(records):
        name = f"{index}_cam-image_array_.jpg"
        (tub / name).write_bytes(jpeg(index % 250))
        own = {"cam/image_array": name, "milliseconds": step * index}
        (tub / f"record_{index}.json").write_text(json.dumps(told | own))
    (tub / "exclude.json").write_text(json.dumps(deleted))
    return tub


Make = Callable[..., Path]
VERSIONS = pytest.mark.parametrize("make", [version_1, version_2])


def lessons(tub: Path, lag: float = 0.0) -> HumanDrive:
    return drive_in(tub, CAMERA, lag=lag)


@VERSIONS
def test_each_record_is_a_lesson_with_left_positive_and_the_throttle_as_speed(make: Make, tmp_path: Path) -> None:
    found = lessons(make(tmp_path / "tub", [record(index) for index in range(300)]))
    assert len(found.lessons) == 300
    expected = [(-0.5 if index % 20 < 10 else 0.25, 0.6) for index in range(300)]
    assert found.lessons.commands == pytest.approx(np.array(expected))
    assert np.diff(found.lessons.times) == pytest.approx(0.05, abs=1e-5)
    assert found.taught.seconds == pytest.approx(14.95) and found.taught.by == {"user": 14.95}
    assert (found.vehicle, found.ends) == ("donkeycar", "complete")
    # the pictures are those of the records, in their order
    brightness = found.lessons.seen.parts[0].mean(axis=(1, 2, 3))
    assert np.all(np.diff(brightness[:200]) > 0.0)


@VERSIONS
def test_a_hand_follows_the_eye_by_the_lag(make: Make, tmp_path: Path) -> None:
    found = lessons(make(tmp_path / "tub", [record(index) for index in range(40)]), lag=0.2)
    assert found.lessons.commands[5:8, 0] == pytest.approx([-0.5, 0.25, 0.25])


@VERSIONS
def test_deleted_records_and_those_of_others_are_left_out(make: Make, tmp_path: Path) -> None:
    records = [record(index) for index in range(100)]
    for index, more in ((10, {"user/mode": "local"}), (20, {"user/throttle": 0.0}), (30, {"user/throttle": -0.4})):
        records[index] = record(index, **more)
    tub = make(tmp_path / "tub", records, deleted=[40, 41, 42])
    missing = next(iter(tub.rglob("50_cam*image_array_.jpg")))
    missing.write_bytes(b"no picture")
    found = lessons(tub)
    assert len(found.lessons) == 100 - 3 - 3 - 1
    assert found.taught.left_out.keys() == {"'local' drove", "stood", "reversed", "deleted", "no picture"}


@pytest.mark.parametrize(
    ("without", "told"),
    [({"_timestamp_ms": None}, "no times of its own"), ({}, "times 4 ms apart, which cannot be right")],
)
def test_a_converted_tub_without_usable_times_counts_twenty_records_a_second(
    tmp_path: Path, without: dict[str, Any], told: str
) -> None:
    found = lessons(version_2(tmp_path / "tub", [record(index) | without for index in range(200)], step=4))
    assert found.taught.seconds == pytest.approx(9.95)
    assert any(f"{told}, so 20 records a second are assumed" in line for line in summary(found))


def test_a_pause_and_a_new_session_are_no_driving(tmp_path: Path) -> None:
    records = [record(index) for index in range(100)]
    for index in range(50, 100):
        records[index] |= {"_session_id": "26-01-02_0", "_timestamp_ms": 1_800_000_000_000 + 50 * index}
    found = lessons(version_2(tmp_path / "tub", records), lag=0.2)
    assert found.taught.seconds == pytest.approx(4.9)
    assert np.all(np.diff(found.lessons.times) > 0.0)


@VERSIONS
def test_a_tub_is_known_again_by_its_content(make: Make, tmp_path: Path) -> None:
    tub = make(tmp_path / "tub", [record(index) for index in range(20)])
    before = sha256_of(tub)
    assert sha256_of(tub) == before
    next(iter(tub.rglob("7_cam*image_array_.jpg"))).write_bytes(jpeg(200))
    assert sha256_of(tub) != before


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"user/angle": "left"}, "record 3: user/angle: 'left'; a number of -1 to 1 is needed"),
        ({"user/throttle": None}, "record 3: user/throttle: not there; a number"),
        ({"cam/image_array": "../../secret.jpg"}, "record 3: cam/image_array: '../../secret.jpg' is no name of a file"),
        (
            {"cam/image_array": "/etc/passwd"},
            "record 3: cam/image_array: '/etc/passwd' is no name of a file in the tub",
        ),
    ],
)
def test_a_damaged_record_is_named(more: dict[str, Any], told: str, tmp_path: Path) -> None:
    records = [record(index) for index in range(5)]
    records[3] |= more
    with pytest.raises(RecordingError) as refused:
        lessons(version_2(tmp_path / "tub", records))
    assert told in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda tub: (tub / "manifest.json").write_text("{"), "a record is no JSON object"),
        (lambda tub: (tub / "catalog_0.catalog").unlink(), r"catalog_0\.catalog: cannot read it: No such file"),
        (lambda tub: (tub / "catalog_0.catalog").write_text("[1]\n"), "a record is no JSON object: '\\[1\\]'"),
        (lambda tub: (tub / "manifest.json").unlink(), "is no tub of donkeycar; give a tub, or a .mcap"),
        (
            lambda tub: (tub / "manifest.json").write_text("\n\n\n\n" + json.dumps({"paths": ["../x.catalog"]})),
            r"paths: '\.\./x\.catalog' is no name of a file in the tub",
        ),
    ],
)
def test_a_damaged_tub_takes_a_line(damage: Callable[[Path], object], told: str, tmp_path: Path) -> None:
    tub = version_2(tmp_path / "tub", [record(index) for index in range(3)])
    damage(tub)
    with pytest.raises(RecordingError, match=told):
        lessons(tub)


def test_a_tub_has_pictures_alone(tmp_path: Path) -> None:
    tub = version_2(tmp_path / "tub", [record(index) for index in range(3)])
    with pytest.raises(RecordingError, match="a tub has a camera's pictures and no other readings: --see camera"):
        drive_in(tub, [Ask("laser")])
    nobody = version_2(tmp_path / "nobody", [record(index, **{"user/throttle": 0.0}) for index in range(30)])
    with pytest.raises(RecordingError, match=r"no human drove in it \(stood 1 s\)"):
        lessons(nobody)


@pytest.mark.long
@pytest.mark.parametrize(("count", "seconds", "warned"), [(1300, "65.0", False), (700, "35.0", True)])
def test_teach_makes_a_policy_of_a_tub_and_warns_of_little_driving(
    count: int, seconds: str, warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub, policy = version_2(tmp_path / "tub", [record(index) for index in range(count)]), tmp_path / "track.onnx"
    words = ["teach", str(tub), "-o", str(policy), "--see", "camera", "--networks", "1", "--epochs", "1", "--no-report"]
    assert execute(words) == OK
    told = capsys.readouterr().out
    assert f"{tub.resolve()}: {count} lessons, driven by user {seconds} s" in told
    assert ("drive longer: 35 s teach the places in them and little else; ten minutes" in told) is warned
    assert policy.exists()


# -- written ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tub of a drive."""
    folder = tmp_path_factory.mktemp("written")
    file = folder / "run.mcap"
    run = ["run", "--headless", "--speed", "max", "--json", "--vehicle", "donkeycar", "--duration", "8"]
    assert execute([*run, "--drive=0.5,0.4", "--set", "sensors.camera.driver=sim_camera", "--log", str(file)]) == OK
    assert execute(["log", "export", str(file), "--tub", str(folder / "tub")]) == OK
    return folder / "tub"


def test_a_recording_becomes_a_tub_that_is_read_again(written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = lessons(written)
    assert len(found.lessons) > 50
    # 0.4 rad/s at 0.5 m/s is a circle of 1.25 m; full lock is 0.45 m, v_max 1 m/s
    assert found.lessons.commands[-1] == pytest.approx([0.36, 0.5], abs=1e-3)
    assert execute(["log", "export", str(written.with_name("run.mcap")), "--tub", str(written)]) == USAGE
    assert "there is such a folder already; choose another name" in capsys.readouterr().err


def test_a_recording_without_pictures_makes_no_tub(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "run.mcap"
    assert execute(["run", "--headless", "--speed", "max", "--json", "--duration", "1", "--log", str(file)]) == OK
    assert execute(["log", "export", str(file), "--tub", str(tmp_path / "tub")]) == 1
    assert "no pictures of a camera while it was armed" in capsys.readouterr().err
    assert not (tmp_path / "tub").exists()


READS = """
import sys
from donkeycar.parts.tub_v2 import Tub
tub = Tub(sys.argv[1], read_only=True)
print(len(tub), sum(record["user/angle"] for record in tub))
"""
WRITES = """
import sys
import numpy as np
from donkeycar.parts.tub_v2 import Tub
names = ["cam/image_array", "user/angle", "user/throttle", "user/mode"]
tub = Tub(sys.argv[1], inputs=names, types=["image_array", "float", "float", "str"], max_catalog_len=30)
for number in range(100):
    picture = np.full((120, 160, 3), number, np.uint8)
    tub.write_record(dict(zip(names, (picture, number / 100, 0.5, "user"))))
tub.delete_records([1, 2])
tub.close()
"""


def donkeycar(program: str, tub: Path) -> str:
    if not DONKEYCAR:
        pytest.skip("did not run: TXT1_DONKEYCAR names no Python with donkeycar ('pip install donkeycar' in one)")
    done = subprocess.run([DONKEYCAR, "-c", program, str(tub)], capture_output=True, text=True, timeout=2 * LIMIT)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1] if done.stdout else ""


def test_donkeycar_reads_what_is_written(written: Path) -> None:
    count, angles = donkeycar(READS, written).split()
    found = lessons(written)
    assert int(count) >= len(found.lessons)
    assert float(angles) == pytest.approx(-found.lessons.commands[:, 0].sum(), abs=0.5)


def test_what_donkeycar_writes_is_read(tmp_path: Path) -> None:
    donkeycar(WRITES, tmp_path / "tub")
    found = lessons(tmp_path / "tub")
    assert len(found.lessons) == 98
    assert found.lessons.commands[1] == pytest.approx([-0.03, 0.5])
