"""A recording on the screens: played, paused, wound, looped; and drawn as a report."""

from __future__ import annotations

import base64
import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import may_block
from txt1.cli import execute
from txt1.errors import RecordingError
from txt1.hal.base import Button
from txt1.record.player import Player
from txt1.record.snapshots import Snapshots
from txt1.tasks.controller import SETPOINT
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import EVENTS
from txt1.tasks.mode import MODE
from txt1.ui.screens import SCREENS, render
from txt1.ui.terminal import Terminal
from txt1.ui.viewer import Viewer


@pytest.fixture(autouse=True)
def a_replay_may_block(blocking_calls_fail: BlockBuster) -> None:
    """Nobody waits for a tick while a recording is played as lines."""
    may_block(blocking_calls_fail, "txt1/record/player.py", "play")


@pytest.fixture(scope="module")
def circle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "run.mcap"
    words = ["run", "--headless", "--speed", "max", "--json", "--duration", "20", "--drive", "0.4,0.4"]
    assert execute([*words, "--log", str(path), "--set", "record.epoch=1000000000"]) == 0
    return path


class Clock:
    """Real time that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def player(path: Path, **options: Any) -> tuple[Player, Clock]:
    clock = Clock()
    return Player(Snapshots(path), **{"speed": 1.0, "loop": False, "clock": clock} | options), clock


def test_it_shows_what_the_robot_did(circle: Path) -> None:
    recorded = Snapshots(circle)
    assert (recorded.start, round(recorded.end, 2)) == (0.0, 19.98)
    before, during = recorded.at(0.5), recorded.at(10.04)
    assert (before[MODE].armed, before[ODOMETRY].v) == (False, 0.0)
    assert (during[MODE].armed, during.time) == (True, 10.0)
    assert during[ODOMETRY].v == pytest.approx(0.4, abs=0.05)
    control = during[SETPOINT]
    assert (control.v, control.omega) == (0.4, 0.4)
    assert control.outputs.motor > 500 and control.gains.kp > 0.0
    assert during[POSE] != during[ODOMETRY][:3]
    ticks = during[ENCODERS]
    assert ticks.right is not None and ticks.left is not None and ticks.right > ticks.left > 0
    assert [event.text for event in during[EVENTS]] == ["armed"]
    for screen in range(len(SCREENS)):
        panel = during[MODE].panel._replace(screen=screen)
        render(during.replaced({MODE: during[MODE]._replace(panel=panel)}), Viewer(), 100, 30)


def test_it_plays_at_its_speed_and_stays_at_the_end(circle: Path) -> None:
    play, clock = player(circle, speed=4.0)
    clock.now += 2.0
    assert play.position == pytest.approx(8.0)
    assert play.snapshot.time == pytest.approx(8.0)
    clock.now += 60.0
    assert play.position == play.recording.end and play.ended


def test_space_pauses_and_goes_on(circle: Path) -> None:
    play, clock = player(circle)
    clock.now += 3.0
    play.stop()
    clock.now += 50.0
    assert play.position == pytest.approx(3.0)
    assert play.snapshot.name == "paused x1"
    play.stop()
    clock.now += 1.0
    assert play.position == pytest.approx(4.0)


def test_a_and_d_wind_but_not_beyond_the_ends(circle: Path) -> None:
    play, clock = player(circle)
    play.key("d")
    assert play.position == pytest.approx(5.0)
    play.key("a")
    play.key("a")
    assert play.position == 0.0
    for _ in range(9):
        play.key("d")
    assert play.position == play.recording.end
    play.key("w")
    clock.now += 0.5
    assert play.position == pytest.approx(0.5)


def test_m_loops(circle: Path) -> None:
    play, clock = player(circle)
    play.arm()
    clock.now += play.recording.end + 2.0
    assert play.position == pytest.approx(2.0) and not play.ended


def test_plus_and_minus_change_the_speed_from_here_on(circle: Path) -> None:
    play, clock = player(circle)
    clock.now += 2.0
    play.key("+")
    clock.now += 2.0
    assert play.position == pytest.approx(6.0)
    for _ in range(20):
        play.key("-")
    assert play.speed == 1.0 / 64.0


def test_the_joystick_changes_the_screen_of_a_recording(circle: Path) -> None:
    play, _ = player(circle)
    assert play.snapshot[MODE].panel.screen == 0
    play.press(Button.RIGHT)
    assert play.snapshot[MODE].panel.screen == 1


def test_without_a_terminal_it_is_played_as_lines(circle: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert execute(["replay", str(circle), "--speed", "60", "--from", "17"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines[0].startswith("t=   17.00 s") and lines[-1].startswith("t=   19.")
    assert "armed" in lines[0]


def test_what_has_no_snapshots_says_so(circle: Path, tmp_path: Path) -> None:
    (tmp_path / "short.mcap").write_bytes(circle.read_bytes()[:9000])
    with pytest.raises(RecordingError, match="no snapshots in it"):
        Snapshots(tmp_path / "short.mcap")


@pytest.fixture(scope="module")
def report(circle: Path) -> tuple[Path, str]:
    """The page's file, and what the command said."""
    told = StringIO()
    with redirect_stdout(told):
        assert execute(["report", str(circle), "-o", str(circle.parent / "report")]) == 0
    return circle.parent / "report.html", told.getvalue()


def test_the_report_is_a_picture_and_one_page_that_needs_nothing_else(report: tuple[Path, str]) -> None:
    tmp_path, out = report[0].parent, report[1]
    assert str(tmp_path / "report.png") in out and str(tmp_path / "report.html") in out
    assert (tmp_path / "report.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    page = (tmp_path / "report.html").read_text()
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(pictures) == 1 and base64.b64decode(pictures[0]) == (tmp_path / "report.png").read_bytes()
    assert "http" not in page.replace("http-equiv", "").replace('xmlns="http://www.w3.org/2000/svg"', "")
    for told in ("/odom", "1000", "seed", "armed", "control.linear.kp", "controller"):
        assert told in page


def test_the_report_begins_with_a_summary_and_fits_a_phone(report: tuple[Path, str]) -> None:
    page = report[0].read_text()
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    before, _, after = page.partition("<img ")
    assert re.search(r"<li>\d+\.\d\d m in \d+\.\d s by odometry, at most \d\.\d\d m/s\.</li>", before)
    assert re.search(r"<li>Disarmed once, at [\d.]+ s \([^<]+\)\.</li>|<li>It was never disarmed\.</li>", before)
    assert "<li>Faults: none.</li>" in before, "values within their limits are no faults"
    # every table is folded up until it is asked for
    assert after.count("<details><summary>") == after.count("</details>") == 7 and "<details open" not in after
    faults = after.partition("<summary>Faults (")[2].partition("</details>")[0]
    assert "motor_limited" not in faults


def test_the_terminals_keys_are_the_players(circle: Path) -> None:
    play, clock = player(circle)
    terminal = Terminal(play, teleop=play)
    for key in ("d", "d", "a", "s", "+", "space", "m", "right"):
        terminal.obey(key)
    clock.now += 1.0
    assert (play.position, play.speed, play.paused, play.loop) == (pytest.approx(5.0), 2.0, True, True)
    assert play.snapshot[MODE].panel.screen == 1
