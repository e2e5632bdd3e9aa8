"""A recording's episodes as a LeRobot dataset."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet

from txt1.cli import execute
from txt1.record.reader import Decoding, FilePass


def test_a_dataset_has_the_learners_episodes_as_they_were_recorded(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "run.mcap", tmp_path / "dataset"
    words = "run --learn thesis --headless --speed max --duration 20 --seed 1 --log"
    assert execute([*words.split(), str(file)]) == 0
    told = capfd.readouterr().out
    begun, ended = told.count("looks for the light"), told.count("best possible")
    assert begun > ended > 1, "the last is not over, and left out"
    assert execute(["log", "export", str(file), "--lerobot", str(out), "--fps", "20"]) == 0

    info = json.loads((out / "meta/info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["fps"]) == ("v3.0", ended, 20)
    data = parquet.read_table(out / info["data_path"].format(chunk_index=0, file_index=0)).to_pydict()
    assert set(data) == set(info["features"]), "every column is described"
    for name, feature in info["features"].items():
        assert np.array(data[name]).reshape(info["total_frames"], -1).shape[1:] == tuple(feature["shape"])
    assert data["index"] == list(range(info["total_frames"]))
    assert np.allclose(data["timestamp"], np.array(data["frame_index"]) / 20.0)
    assert parquet.read_table(out / "meta/tasks.parquet")["task"].to_pylist() == ["drive to the light"]

    recorded = [(item.name, item.time, decoding.message(item)) for decoding in [Decoding()] for item in FilePass(file)]

    def last(topic: str, until: float) -> Any:
        return next(message for name, time, message in reversed(recorded) if name == topic and time <= until)

    steps = [(time, message) for name, time, message in recorded if name == "/learning/step"]
    episodes = parquet.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for episode in episodes:
        times = [time for time, message in steps if message.episode == episode["episode_index"] + 1]
        assert episode["length"] == pytest.approx(20.0 * (times[-1] - times[0]), abs=1.0)
        rows = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        assert data["next.done"][rows] == [False] * (episode["length"] - 1) + [True]
        states, actions = np.array(data["observation.state"][rows]), np.array(data["action"][rows])
        for k in range(0, episode["length"] - 1, 7):
            now = times[0] + k / 20.0
            assert states[k, 0] == pytest.approx(last("/odom", now + 1e-6).pose.pose.position.x, abs=1e-6)
            assert states[k, 5:] == pytest.approx(np.array(last("/light", now + 1e-6).lux), rel=1e-6)
            command = last("/setpoint", now + 0.05 - 1e-6).twist
            assert actions[k] == pytest.approx([command.linear.x, command.angular.z], abs=1e-6)


def test_a_drive_is_an_episode_and_what_is_there_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "run.mcap", tmp_path / "dataset"
    assert (
        execute([*["run", "--headless", "--speed", "max", "--duration", "2", "--drive", "0.5,0.3", "--log"], str(file)])
        == 0
    )
    export = ["log", "export", str(file), "--lerobot", str(out)]
    assert execute(export) == 0
    assert "1 episode, " in capsys.readouterr().out
    assert parquet.read_table(out / "meta/tasks.parquet")["task"].to_pylist() == ["drive"]
    assert execute(export) == 2, "what is there is not overwritten"
    assert "choose another name" in capsys.readouterr().err


def test_a_dataset_of_a_robot_that_stands_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, drive, zeros in (("stands", "0,0", 1), ("drives", "0.4,0.2", 0)):
        file = tmp_path / f"{name}.mcap"
        run = [
            "run",
            "--headless",
            "--speed",
            "max",
            "--json",
            "--duration",
            "3",
            f"--drive={drive}",
            "--log",
            str(file),
        ]
        assert execute(run) == 0
        assert execute(["log", "export", str(file), "--lerobot", str(tmp_path / name)]) == 0
        assert capsys.readouterr().err.count("actions are 0, so the dataset shows a robot that stands") == zeros


def test_a_cameras_pictures_are_in_it_as_they_were_recorded(tmp_path: Path) -> None:
    file, out = tmp_path / "run.mcap", tmp_path / "dataset"
    run = ["run", "--headless", "--speed", "max", "--duration", "3", "--drive", "0.5,0.3"]
    assert execute([*run, "--set", "sensors.camera.driver=sim_camera", "--log", str(file)]) == 0
    assert execute(["log", "export", str(file), "--lerobot", str(out)]) == 0
    info, stats = (json.loads((out / f"meta/{name}.json").read_text()) for name in ("info", "stats"))
    name = "observation.images.camera"
    assert (info["features"][name]["dtype"], info["features"][name]["shape"]) == ("image", [120, 160, 3])
    assert np.array(stats[name]["mean"]).shape == (3, 1, 1)
    assert 0.0 < stats[name]["min"][0][0][0] < stats[name]["max"][0][0][0] <= 1.0
    data = parquet.read_table(out / info["data_path"].format(chunk_index=0, file_index=0)).to_pydict()
    decoding = Decoding()
    there = [bytes(decoding.message(each).data) for each in FilePass(file) if each.name == "/sensors/camera"]
    shown = [each["bytes"] for each in data[name]]
    assert len(shown) == info["total_frames"]
    assert set(shown) <= set(there)
    assert [there.index(each) for each in shown] == sorted(there.index(each) for each in shown)
