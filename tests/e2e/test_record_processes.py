"""Recording on the real clock: what a crash, a full disk and a slow disk cost, and what they do not."""

from __future__ import annotations

import asyncio
import errno
import os
import random
import signal
import subprocess
import time
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.patience import LIMIT, PATIENT, TXT1, lateness, wait_until
from txt1.config import load
from txt1.kernel.loop import run
from txt1.record import mcap_file
from txt1.record import recorder as record_recorder
from txt1.record.reader import FilePass
from txt1.record.recovery import recover
from txt1.record.session import recording
from txt1.robot import Robot

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.usefixtures("patient")

LOST_MAX = 1.0
"""s of a run that a crash may cost."""


def started(path: Path) -> subprocess.Popen[bytes]:
    words = ["run", "--headless", "--drive", "0.3,0.3", "--log", str(path)]
    return subprocess.Popen([*TXT1, *words], cwd=ROOT, stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL)


def wall_start(path: Path) -> float:
    reading = FilePass(path)
    list(reading.records())
    return datetime.fromisoformat(reading.metadata["txt1"]["wall_start"]).timestamp()


def begun(paths: list[Path]) -> bool:
    """Whether these recordings hold something."""
    return all(path.exists() and path.stat().st_size > 20_000 for path in paths)


@pytest.mark.long
def test_ten_killed_runs_lose_at_most_a_second_each_and_are_recovered(tmp_path: Path) -> None:
    rng = random.Random(5)
    lost = []
    for pair in range(5):  # two at a time: the processor has other things to do as well
        paths = [tmp_path / f"{pair}-{number}.mcap" for number in range(2)]
        processes = [started(path) for path in paths]
        wait_until(partial(begun, paths))
        for path, process in zip(paths, processes, strict=True):
            with lateness() as late:
                time.sleep(LOST_MAX + rng.uniform(0.1, 0.6))
                process.send_signal(signal.SIGKILL)
                killed = time.time()
                process.wait()
            saved = path.with_suffix(".saved.mcap")
            result = recover(path, saved)
            assert not result.was_complete and result.damaged == 0
            with saved.open("rb") as file:
                summary = make_reader(file).get_summary()
            assert summary is not None and summary.statistics is not None
            assert summary.statistics.message_count == result.messages > 100
            lost.append(killed - wall_start(path) - summary.statistics.message_end_time / 1e9 - 3.0 * late())
    assert len(lost) == 10
    assert max(lost) <= LOST_MAX, lost


async def at_work(path: Path, enough: Callable[[Robot], bool]) -> tuple[Robot, list[str]]:
    """A robot that was recorded on the real clock until it is enough, and what was said about it."""
    said: list[str] = []
    config = load(overrides=PATIENT).config
    async with (
        recording(path, config, None, {}, said.append) as attach,
        Robot.open(config=config, attach=attach) as robot,
    ):
        await robot.load_gains()
        async with asyncio.timeout(LIMIT):
            while not enough(robot):
                await robot.drive(0.3, 0.0, 0.5)
    return robot, said


def test_on_the_real_clock_a_full_disk_costs_messages_and_no_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = 60_000
    full = False

    class Os:
        def __getattr__(self, name: str) -> object:
            return self.limited if name == "write" else getattr(os, name)

        def limited(self, file: int, data: bytes) -> int:
            nonlocal left, full
            if full := left < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            left -= len(data)
            return os.write(file, data)

    monkeypatch.setattr(mcap_file, "os", Os())
    with pytest.raises(Exception, match=r"No space left on device; 'txt1 log recover' saves what is in it"):
        run(at_work(tmp_path / "run.mcap", lambda _: full))
    monkeypatch.undo()
    assert not (reading := FilePass(tmp_path / "run.mcap")).complete
    assert len(list(reading)) > 100


def test_a_slow_disk_costs_messages_that_are_counted_and_no_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_recorder, "BATCH_PERIOD", 0.02)
    monkeypatch.setattr(record_recorder, "BACKLOG", 3)
    monkeypatch.setattr(mcap_file.McapFile, "add", slow(mcap_file.McapFile.add))

    def punctual(robot: Robot) -> bool:
        """With a loop that waits for the disk there is hardly a cycle, however long it runs."""
        controller = robot.runtime.statistics()["controller"]
        return robot.now > 2.0 and controller.misses < 0.5 * controller.cycles

    _, said = run(at_work(tmp_path / "run.mcap", punctual))
    (sentence,) = said
    dropped = int(sentence.split(": ")[1].split()[0])
    assert sentence.endswith("messages were not recorded: the disk was full or too slow")
    assert dropped > 100
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        ends = {record.name: record.metadata for record in reader.iter_metadata()}["txt1.end"]
        assert ends["dropped"] == str(dropped)
        file.seek(0)
        sequences = [m.sequence for _, _, m in make_reader(file).iter_messages(topics=["/odom"])]
    assert sequences[-1] + 1 > len(sequences) == len(set(sequences))  # the numbers tell where messages are missing


def slow(add: object) -> object:
    def wrapped(*arguments: object) -> object:
        time.sleep(0.2)
        return add(*arguments)  # type: ignore[operator]

    return wrapped
