"""What the learner senses and decides is recorded, and a recorded trial repeats and is verified."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
from collections.abc import Iterator
from itertools import groupby, pairwise
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blockbuster import BlockBuster
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from tests.e2e.conftest import may_block
from txt1.cli import execute
from txt1.config import load
from txt1.errors import RecordingError
from txt1.installing import installs
from txt1.kernel import loop
from txt1.learning import experiment, qtable
from txt1.learning.command.trials import conduct
from txt1.learning.experiment import Plan
from txt1.learning.light_direction import reward
from txt1.learning.qtable import StoredTable
from txt1.learning.thesis import TABLE_5_3
from txt1.learning.trial import Episode
from txt1.record.session import discard, recording
from txt1.record.verification import verify
from txt1.robot import Robot

Capture = pytest.CaptureFixture[str]
CONFIG = load().config
OVER = -1
OUTSIDE = ("/light", "/learning/step", "/sensors", "/driver", "/reports", "/tf_static")
"""Topics of those who command the robot, which a verification has not, and the readings that it is given."""


@pytest.fixture
def clean_processes() -> Iterator[None]:
    """What several processes shared is let go at once, not by a later test's event loop."""
    yield
    gc.collect()


@pytest.fixture(autouse=True)
def a_verification_may_block(blocking_calls_fail: BlockBuster) -> None:
    """It reads its recording in the loop: nobody waits for a tick."""
    may_block(blocking_calls_fail, "txt1/record/verification.py", "_replay", "write", "close")


def recorded(path: Path, *words: str) -> Path:
    """A recording of a minute in which the robot looks for the light."""
    run = ["run", "--headless", "--speed", "max", "--json", "--seed", "4", "--duration", "60"]
    assert execute([*run, *words, "--log", str(path)]) == 0
    return path


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics=[topic])]


def stream(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as file:
        return [(c.topic, m.sequence, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]


def time_of(message: Any) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec / 1e9)


def episodes(steps: list[Any]) -> list[list[Any]]:
    return [list(group) for _, group in groupby(steps, lambda step: step.episode)]


# -- txt1 run ----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_every_sample_of_the_light_and_every_decision_are_recorded(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "--learn", "thesis")
    times = [time_of(message) for message in messages(path, "/light")]
    steps = [later - earlier for earlier, later in pairwise(times)]
    assert sum(abs(step - 0.016) < 1e-9 for step in steps) > 0.99 * len(steps), "between episodes there are none"
    assert all(1.0 <= lux <= 1000.0 for message in messages(path, "/light") for lux in message.lux)
    done = episodes(messages(path, "/learning/step"))
    assert [group[0].episode for group in done] == list(range(1, len(done) + 1))
    for group in done[:-1]:
        assert [step.action == OVER for step in group] == [*([False] * (len(group) - 1)), True]
        assert all(time_of(later) - time_of(step) == pytest.approx(0.5) for step, later in pairwise(group))


@pytest.mark.long
def test_the_thesiss_table_can_be_followed_in_its_steps(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "--learn", "thesis", "--set", "learning.thesis.remedy=none")
    done = episodes(messages(path, "/learning/step"))
    table: dict[int, list[float]] = {}
    checked = 0
    for group in done:
        for before, step in pairwise([None, *group]):
            if before is not None and not isnan(step.reward):
                assert step.reward == reward(before.state, step.state)
                row = list(before.values)
                best = max(row if step.state == before.state else step.values)
                row[before.action] += 0.3 * (step.reward + 0.5 * best - row[before.action])  # (5.1)
                table[before.state] = row
            elif before is not None:
                assert step.action == OVER, "only a failure teaches nothing"
            if step.state in table:
                assert list(step.values) == pytest.approx(table[step.state])
                checked += 1
            table[step.state] = list(step.values)
    assert checked > 20


@pytest.mark.long
def test_who_drives_by_a_table_learns_nothing_and_takes_the_best(tmp_path: Path) -> None:
    table = tmp_path / "qtable.json"
    qtable.save(table, StoredTable(np.array(TABLE_5_3), {"agent": "thesis"}))
    path = recorded(tmp_path / "run.mcap", "--policy", str(table))
    steps = messages(path, "/learning/step")
    assert len(steps) > 50 and len(messages(path, "/light")) > 1000
    assert all(isnan(step.reward) for step in steps)
    assert all(list(step.values) == list(TABLE_5_3[step.state]) for step in steps if step.state >= 0)
    assert all(step.action == int(np.argmax(step.values)) for step in steps if step.action != OVER and step.state >= 0)


@pytest.mark.long
def test_learning_is_an_outside_source_to_a_verification(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", "--learn", "thesis")
    verdict = verify(path)
    assert verdict.difference is None
    outside = sum(len(messages(path, topic)) for topic in OUTSIDE)
    assert verdict.compared == len(stream(path)) - outside


@pytest.mark.long
def test_a_recorded_learner_learns_what_it_would_without(tmp_path: Path) -> None:
    plan = Plan("thesis", 1, 6, 5, CONFIG)
    alone, _ = conduct(plan, tmp_path / "alone", False, lambda *_: None)
    beside, _ = conduct(plan._replace(log=tmp_path / "log.mcap"), tmp_path / "beside", False, lambda *_: None)
    assert alone[0].episodes == beside[0].episodes
    assert alone[0].table.values == beside[0].table.values


# -- txt1 learn --------------------------------------------------------------------------------------------------


def learn(out: Path, log: Path, *more: str) -> int:
    words = ["learn", "--trials", "2", "--episodes", "3", "--seed", "3", "--jobs", "1", "--no-pictures"]
    return execute([*words, "--out", str(out), "--log", str(log), *more])


def trials(directory: Path) -> list[Path]:
    return [directory / "run-trial-0001.mcap", directory / "run-trial-0002.mcap"]


@pytest.mark.long
@pytest.mark.usefixtures("clean_processes")
def test_each_trial_is_recorded_to_a_file_of_its_own_and_repeats(tmp_path: Path) -> None:
    for jobs in ("1", "2"):
        (tmp_path / jobs).mkdir()
        assert learn(tmp_path / jobs / "out", tmp_path / jobs / "run.mcap", "--jobs", jobs) == 0
        assert sorted((tmp_path / jobs).glob("*.mcap")) == trials(tmp_path / jobs)
    for one, other in zip(trials(tmp_path / "1"), trials(tmp_path / "2"), strict=True):
        assert stream(one) == stream(other)
        assert verify(one).difference is None
        assert [group[-1].action for group in episodes(messages(one, "/learning/step"))] == [OVER] * 3


def test_a_single_trial_is_recorded_to_the_file_that_was_named(tmp_path: Path) -> None:
    assert learn(tmp_path / "out", tmp_path / "run.mcap", "--trials", "1") == 0
    assert [path.name for path in tmp_path.glob("*.mcap")] == ["run.mcap"]


@pytest.mark.long
def test_what_is_resumed_leaves_the_recordings_of_an_uninterrupted_run(tmp_path: Path) -> None:
    plan = Plan("thesis", 2, 3, 3, load(overrides=["record.rotate_time=8"]).config)

    def interrupt(trial: int, one: Episode) -> None:
        if (trial, one.number) == (2, 2):
            os.kill(os.getpid(), signal.SIGINT)

    for name, watch in (("whole", lambda *_: None), ("broken", interrupt)):
        (tmp_path / name).mkdir()
        conduct(plan._replace(log=tmp_path / name / "run.mcap"), tmp_path / name / "out", False, watch)
    first, second = trials(tmp_path / "broken")
    assert 0 < length(second) < length(trials(tmp_path / "whole")[1])
    untouched = first.stat()
    resumed = plan._replace(log=tmp_path / "broken" / "run.mcap")
    _, ended = conduct(resumed, tmp_path / "broken" / "out", True, lambda *_: None)
    assert ended is None
    assert first.stat() == untouched
    names = [path.name for path in sorted((tmp_path / "whole").glob("*.mcap"))]
    assert [path.name for path in sorted((tmp_path / "broken").glob("*.mcap"))] == names
    for name in names:
        assert stream(tmp_path / "broken" / name) == stream(tmp_path / "whole" / name)


def length(path: Path) -> int:
    return sum(len(stream(part)) for part in path.parent.glob(f"{path.stem}*.mcap"))


def test_a_trial_that_carries_on_is_recorded_to_a_file_of_its_own(tmp_path: Path) -> None:
    plan = Plan("thesis", 2, 3, 3, load(overrides=["hal=serial"]).config, log=tmp_path / "run.mcap")
    first, second = trials(tmp_path)
    first.write_bytes(b"of the episodes before")
    again = tmp_path / "run-trial-0001-again-1.mcap"
    assert experiment.recordings(plan, [1, 2], {1}, True) == {1: again, 2: second}
    again.write_bytes(b"of some more")
    assert experiment.recordings(plan, [1], {1}, True) == {1: tmp_path / "run-trial-0001-again-2.mcap"}
    assert first.exists() and again.exists()
    second.write_bytes(b"of a run that failed before its first episode had ended")
    assert experiment.recordings(plan, [2], set(), True) == {2: tmp_path / "run-trial-0002-again-1.mcap"}
    assert second.exists()


def test_what_is_no_recording_of_that_trial_is_not_written_over(tmp_path: Path, capsys: Capture) -> None:
    first, second = trials(tmp_path)
    first.write_text("somebody's diary")
    assert learn(tmp_path / "out", tmp_path / "run.mcap") == 2
    assert f"--log: there is a file {first} already; choose another name" in capsys.readouterr().err
    assert not (tmp_path / "out" / "trials" / "0001.json").exists(), "said before anything is done"
    assert learn(tmp_path / "out", tmp_path / "run.mcap", "--resume") == 2
    assert first.read_text() == "somebody's diary"
    first.unlink()
    recorded(second, "--learn", "thesis")
    before = second.read_bytes()
    assert learn(tmp_path / "out", tmp_path / "run.mcap", "--resume") == 2
    assert second.read_bytes() == before


def test_a_recording_with_a_strange_part_is_left_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    config = load(overrides=["record.rotate_time=5"]).config
    plan: dict[str, object] = {"learn": "thesis"}

    async def run() -> None:
        async with (
            recording(path, config, "max", plan, print) as attach,
            Robot.open(config=config, attach=attach) as robot,
        ):
            await asyncio.sleep(22.0 - robot.now)

    loop.run(run(), speed="max")
    made = sorted(tmp_path.glob("*.mcap"))
    assert len(made) >= 3
    part = tmp_path / "run.2.mcap"
    kept = part.read_bytes()
    part.write_text("somebody's diary")
    with contextlib.suppress(RecordingError):
        assert not discard(path, config, plan)
    assert sorted(tmp_path.glob("*.mcap")) == made
    assert part.read_text() == "somebody's diary"
    part.write_bytes(kept)
    assert discard(path, config, plan)
    assert not list(tmp_path.glob("*.mcap"))


def test_without_the_extra_it_is_said_before_the_robot_moves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Capture
) -> None:
    monkeypatch.setattr("txt1.commands.find_spec", lambda name: None)
    assert learn(tmp_path / "out", tmp_path / "run.mcap") == 2
    assert installs("record") in capsys.readouterr().err
