"""The keys of a replay, typed on a real terminal whose screen is read."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tests.patience import LIMIT, TXT1, S
from tests.unit.ui.ui_tty import Tty
from txt1.cli import execute

ROOT = Path(__file__).parents[2]
LENGTH = 20.0


@pytest.fixture(scope="module")
def circle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("keys") / "run.mcap"
    words = ["run", "--headless", "--speed", "max", "--json", "--duration", f"{LENGTH:g}", "--drive", "0.4,0.4"]
    assert execute([*words, "--log", str(path)]) == 0
    return path


class Replay:
    """A replay on a terminal."""

    def __init__(self, *words: str) -> None:
        self.tty = Tty()
        self.process = subprocess.Popen(
            [*TXT1, "replay", *words],
            stdin=self.tty.slave,
            stdout=self.tty.slave,
            start_new_session=True,
            cwd=ROOT,
        )
        self.until("TXT-1  (replay|paused)")

    def until(self, pattern: str, limit: float = LIMIT) -> re.Match[str]:
        """What the screen shows as soon as it matches."""
        found: list[re.Match[str]] = []

        def shows() -> bool:
            match = re.search(pattern, self.tty.text())
            found.extend([] if match is None else [match])
            return match is not None

        self.tty.until(shows, limit)
        return found[0]

    def time(self) -> float:
        """Where the film is, s of the run; to be asked while it rests."""
        minutes, seconds = self.until(r"0:(\d\d):(\d\d\.\d)").groups()
        return 60.0 * float(minutes) + float(seconds)

    def type(self, keys: str) -> None:
        self.tty.type(keys.encode())

    def wind(self, keys: str, time: float) -> None:
        """Type keys until the screen shows this time: after a stall of the machine, no driving key counts."""
        while True:
            self.type(keys)
            with suppress(AssertionError):
                self.until(rf"0:{int(time) // 60:02d}:{time % 60:04.1f}", 5.0 * S)
                return

    def close(self) -> int:
        self.type("q")
        self.tty.until(lambda: self.process.poll() is not None)
        assert self.tty.restored()
        return self.process.returncode


@pytest.fixture
def replay(circle: Path) -> Iterator[Replay]:
    """A replay that is paused 5 s behind its beginning."""
    replay = Replay(str(circle), "--from", "3")
    replay.type(" ")
    replay.until("paused x1")
    replay.wind("w", 0.0)
    replay.wind("d", 5.0)
    yield replay
    if replay.process.poll() is None:
        replay.process.kill()
        replay.process.wait()
    replay.tty.close()


def test_space_pauses_and_goes_on(replay: Replay) -> None:
    rests = replay.time()
    assert rests == 5.0
    replay.tty.read(0.5)
    assert replay.time() == rests
    replay.type(" ")
    replay.until("replay x1")
    replay.tty.until(lambda: replay.time() > rests)
    assert replay.close() == 0


@pytest.mark.long
def test_a_d_and_w_wind(replay: Replay) -> None:
    rests = replay.time()
    replay.wind("d", rests + 5.0)
    replay.wind("a", rests)
    replay.wind("dddd", LENGTH - 0.1)
    replay.wind("w", 0.0)
    replay.until("disarmed")
    assert replay.close() == 0


@pytest.mark.long
def test_plus_minus_and_the_arrows(replay: Replay) -> None:
    replay.type("+")
    replay.until("paused x2")
    replay.type("--")
    replay.until(r"paused x0\.5")
    replay.type("\x1b[C")
    replay.until(r"\[PWM\]")
    assert replay.close() == 0


@pytest.mark.long
def test_m_begins_anew_at_the_end(replay: Replay) -> None:
    replay.type("m")
    replay.until("paused loop x1")
    replay.wind("dddd", LENGTH - 0.1)
    replay.type(" ")
    replay.tty.until(lambda: replay.time() < 3.0)
    replay.until("replay loop x1")
    assert replay.close() == 0


@pytest.mark.long
def test_driving_keys_drive_nothing(replay: Replay) -> None:
    rests = replay.time()
    replay.type("sc")
    replay.tty.read(0.5)
    replay.until("mode +controller")
    assert replay.time() == rests
    assert replay.close() == 0
