"""What a newcomer meets first: `make run`, whatever files and environment say, on a terminal of 80 x 24."""

import os
import re
import subprocess
from pathlib import Path
from urllib.request import urlopen

import pexpect
import pytest

from rigs.terminals import Watched, start
from tests.patience import LIMIT, TXT1
from txt1.cli import execute
from txt1.commands import USAGE

ROOT = Path(__file__).parents[2]
PRACTICE = ("run", "--practice", "--seed", "1")


def test_make_run_begins_a_practice() -> None:
    told = subprocess.run(
        ["make", "-n", "run", "RUN=--hal serial"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "txt1 run --practice --hal serial" in told.stdout


@pytest.mark.parametrize(
    ("words", "environment", "told"),
    [
        (("--hal", "serial"), {}, "--hal"),
        (("--port", "/dev/ttyUSB0"), {}, "--port"),
        (("--set", "hal=vesc"), {}, "--set"),
        ((), {"TXT1_HAL": "pi"}, "TXT1_HAL"),
        (("--config", "FILE"), {}, "car.yaml"),
    ],
)
def test_a_practice_drives_nothing_but_the_simulation(
    words: tuple[str, ...],
    environment: dict[str, str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "car.yaml").write_text("hal: waveshare\n", "utf-8")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    words = tuple(str(tmp_path / "car.yaml") if word == "FILE" else word for word in words)
    assert execute([*PRACTICE, "--headless", "--duration", "1", *words]) == USAGE
    said = capsys.readouterr().err
    assert told in said and "a practice drives the simulation only" in said and "txt1 run --hal" in said


def test_the_first_press_moves_something_and_the_page_answers_where_the_header_says() -> None:
    child = start(80, 24, *PRACTICE)
    watched = Watched(child, 80, 24)
    watched.until("ARMED", "[MAP]", "⠢ laser", "x 0.00 y 0.00", "http://")
    page = re.search(r"http://127\.0\.0\.1:\d+/", watched.screen.display[0])
    assert page is not None, "the header has the address"
    with urlopen(page[0], timeout=LIMIT) as answer:
        assert answer.status == 200
    light = re.search(r"light (\d+\.\d+) m", "\n".join(watched.screen.display))
    assert light is not None and float(light[1]) > 1.0, "it does not start on the light"
    before = watched.screen.display[3:20]
    child.send(b"w")
    watched.until("x 0.3")
    assert watched.screen.display[3:20] != before, "the car on the map has moved"
    child.send(b"q")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
    assert b"the page is at" not in watched.told.split(b"\x1b[?1049h")[0], "nothing is said before it answers"


@pytest.mark.parametrize("command", [["run"], ["run", "--practice"]])
def test_a_screen_that_is_not_there_is_refused_without_a_terminal_too(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute([*command, "--screen", "9", "--duration", "1"]) == USAGE
    assert "--screen 9: there is none of this number; there are 1 STATUS, 2 PWM" in capsys.readouterr().err


def test_without_its_libraries_a_practice_says_how_to_get_page_and_speed(tmp_path: Path) -> None:
    without = "import sys\nfor name in ('aiohttp', 'numba'):\n    sys.modules[name] = None\n"
    (tmp_path / "sitecustomize.py").write_text(without, "utf-8")
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{ROOT}"}
    told = subprocess.run(
        [*TXT1, *PRACTICE, "--headless", "--duration", "0.5"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env=environment,
        timeout=LIMIT,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    assert "there is no page beside it" in told.stderr and "[web]" in told.stderr
    (numba,) = (line for line in told.stderr.splitlines() if "numba" in line)
    assert numba.startswith("txt1: the laser's rays against the map take long without numba: ") and "[fast]" in numba
    assert "Warning" not in told.stderr


@pytest.mark.parametrize("words", ["replay FILE --from nan", "log cat FILE --from inf", "log cat FILE --to x"])
def test_a_time_that_is_none_is_refused_with_and_without_a_terminal(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "drive.mcap"
    file.touch()
    assert execute([str(file) if word == "FILE" else word for word in words.split()]) == USAGE
    told = capsys.readouterr().err
    assert f"'{words.rpartition(' ')[2]}' is not" in told


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("run --seed x", "argument --seed: 'x' is not a whole number from 0"),
        ("run --seed -1", "argument --seed: '-1' is not a whole number from 0"),
        ("run --baud fast", "argument --baud: 'fast' is not a whole number from 1"),
        ("map FILE --resolution fine", "argument --resolution: 'fine' is not a finite number"),
    ],
)
def test_a_number_that_is_none_is_refused_with_what_it_has_to_be(
    words: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "drive.bag"
    file.touch()
    assert execute([str(file) if word == "FILE" else word for word in words.split()]) == USAGE
    assert told in capsys.readouterr().err
