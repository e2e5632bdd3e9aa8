"""The golden recordings verify: of the same inputs the robot makes what it made of them when they were recorded."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.golden.recipes import RECIPES
from txt1.record.comparison import NUMBERS_CLOSE
from txt1.record.reader import metadata_of
from txt1.record.session import machine
from txt1.record.verification import Verdict, verify
from txt1.telemetry.topics import TOPICS, Rule

FOLDER = Path(__file__).parent
NOBODYS = {"/driver", "/reports", "/snapshot /driver", "/tf_static", "/sensors/gps/fix"}
"""Who drives is a program's affair; the readings are inputs, also as fixes for viewers; mounts are settings."""
CLOCKS = {"/diagnostics", "/link", "/steps", *(f"/snapshot {name}" for name in ("/events", "/tasks", "/traffic"))}
"""On the real clock these are as late as the processor is, and the bytes on the line are the board's."""
PROGRAMS = {"learner": {"/learning/step"}, "wire": CLOCKS}
"""What else is not compared, by recording."""


@cache
def verdict(name: str) -> Verdict:
    return verify(FOLDER / f"{name}.mcap")


@pytest.mark.parametrize("name", RECIPES)
def test_a_golden_recording_verifies(name: str, record_property: Callable[[str, object], None]) -> None:
    found = verdict(name)
    made = metadata_of(FOLDER / f"{name}.mcap", "txt1")
    assert {"processor", "libm", "numpy"} <= made.keys()
    same = all(made[part] == told for part, told in machine().items())
    record_property(
        "compared", "bit for bit" if same else f"within {NUMBERS_CLOSE:g}: made with another processor or library"
    )
    assert found.difference is None, str(found.difference)
    assert found.exact is same
    assert found.lacks == ""
    assert found.compared > 1000


@pytest.mark.parametrize("name", RECIPES)
def test_all_that_follows_from_the_inputs_is_compared(name: str) -> None:
    assert set(verdict(name).left_out) <= NOBODYS | PROGRAMS.get(name, set())


def test_together_they_cover_every_topic_of_the_robots_own_tasks() -> None:
    compared = {topic for name in RECIPES for topic in verdict(name).topics}
    own = {
        "/odom", "/odometry/filtered", "/estimation", "/setpoint", "/pwm", "/tf", "/tf_room", "/pose", "/encoders",
        "/mode", "/gains", "/measured_by", "/stop", "/battery1", "/battery2", "/range_left", "/faults", "/diagnostics",
        "/markers", "/snapshot", "/rosout", "/cmd_vel", "/input", "/link", "/light", "/sensors", "/sensors/laser",
        "/sensors/imu", "/sensors/gps", "/sensors/vicon",
    }  # fmt: skip
    assert own <= compared
    assert all(TOPICS[name].rule is not Rule.SNAPSHOT for name in compared)


def test_they_are_small_and_each_has_its_program() -> None:
    files = sorted(FOLDER.glob("*.mcap"))
    assert [path.stem for path in files] == sorted(RECIPES)
    assert sum(path.stat().st_size for path in files) < 3_000_000
