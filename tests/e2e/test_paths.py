"""Three people's paths, typed word by word as the pages say.

The people are a student without a robot, the owner of a Donkey Car, and someone who comes from ROS with a bag.
"""

import re
from pathlib import Path

import pexpect
import pytest

from rigs.ros_bags import bag
from rigs.terminals import ROOT, Watched, start
from txt1.cli import execute
from txt1.ui.screens import installed

PRACTICE = ("run", "--practice", "--seed", "1")
KEYS_A_SECOND = 3.0
FIRST_SUCCESS = 300.0  # s
# of a line, in which the remedy begins on a narrow terminal
NARROW = 60


def has_driven(text: str) -> bool:
    """Return whether the screen MAP shows the car more than 0.2 m from its start."""
    found = re.search(r"(?:room|map) x +(-?[\d.]+)", text)
    return found is not None and float(found[1]) > 0.2


def test_no_screen_of_a_practice_is_cut() -> None:
    child = start(60, 20, *PRACTICE)
    names = list(installed())
    at = names.index("MAP")
    for columns, rows in ((60, 20), (80, 24), (120, 40)):
        child.setwinsize(rows, columns)
        watched = Watched(child, columns, rows)
        watched.until("ARMED", "http://", "[MAP]")
        for name in names[at + 1 :] + names[: at + 1]:
            child.send(b"\x1b[C")
            watched.until(f"[{name}]", "ARMED", "http://")
            assert "…" not in watched.text, f"{name} is cut in {columns} columns:\n{watched.text}"
    child.send(b"q")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0


def test_a_student_without_a_robot_drives_looks_and_repeats(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "drive.mcap"
    assert execute([]) == 0
    told = capfd.readouterr().out
    assert "txt1 run --practice" in told and "txt1 report drive.mcap" in told
    child = start(80, 24, *PRACTICE, "--log", str(log))
    watched = Watched(child, 80, 24)
    watched.until("ARMED", "⠢ laser", "http://")
    for key in (b"w", b"w", b"a", b"w"):
        child.send(key)
    watched.until_seen(has_driven, "more than 0.2 m of way")
    child.send(b"q")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
    assert execute(["report", str(log)]) == 0
    page = log.with_suffix(".html").read_text("utf-8")
    assert "<svg" in page and ">walls<" in page and ">car<" in page
    # by the same patient program
    again = start(80, 24, "replay", "--verify", str(log))
    again.expect(pexpect.EOF)
    again.close()
    assert again.exitstatus == 0, again.before
    typed = ["make run", "waaw", "q", "txt1 report drive.mcap", "txt1 replay --verify drive.mcap"]
    assert sum(map(len, typed)) / KEYS_A_SECOND < FIRST_SUCCESS


def test_the_owner_of_a_donkey_car_drives_it_on_the_desk_and_is_told_what_it_lacks(
    capfd: pytest.CaptureFixture[str],
) -> None:
    desk = ["txt1 run --vehicle donkeycar --screen 5", "ww", "q"]
    child = start(80, 24, *desk[0].split()[1:], "--seed", "1")
    watched = Watched(child, 80, 24)
    watched.until("ARMED", "[MAP]")
    for key in desk[1]:
        child.send(key)
    watched.until_seen(has_driven, "more than 0.2 m of way")
    child.send(desk[2])
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
    if Path("/dev/i2c-1").exists():
        pytest.skip("there is a bus, and perhaps a car")
    car = ["txt1 doctor --hal pi --vehicle donkeycar", "txt1 run --hal pi --vehicle donkeycar"]
    assert execute(car[0].split()[1:]) == 1
    wrong = [line for line in capfd.readouterr().out.splitlines() if line.startswith("! ")]
    assert wrong and "sudo raspi-config" in wrong[0][:NARROW]
    assert execute([*car[1].split()[1:], "--headless", "--duration", "1"]) == 1
    assert "sudo raspi-config" in capfd.readouterr().err[:NARROW]
    assert sum(map(len, desk + car)) / KEYS_A_SECOND < FIRST_SUCCESS


@pytest.mark.long
def test_who_comes_from_ros_with_a_bag_makes_a_map_and_drives_in_it(tmp_path: Path) -> None:
    page = (ROOT / "docs/tutorials/bag.md").read_text("utf-8")
    typed = ["txt1 log info drive.bag", "txt1 map drive.bag -o room"]
    typed.append("txt1 run --set sim.room.map=room.yaml --set sensors.laser.driver=sim_laser --in room")
    assert all(f"    {each}\n" in page for each in typed)
    bag(tmp_path / "drive.bag", "ros1")
    for words, told in zip(typed[:2], ("sensor_msgs/LaserScan", "room.yaml"), strict=True):
        watched = Watched(start(80, 24, *words.split()[1:], folder=tmp_path), 80, 24)
        assert watched.until_end() == 0
        assert told in watched.text
    child = start(80, 24, *typed[2].split()[1:], "--seed", "1", folder=tmp_path)
    watched = Watched(child, 80, 24)
    watched.until("ARMED")
    for screen in list(installed())[1 : list(installed()).index("MAP") + 1]:
        child.send(b"\x1b[C")
        watched.until(f"[{screen}]")
    child.send(b"ww")
    watched.until_seen(has_driven, "more than 0.2 m of way")
    assert "[MAP]" in watched.text and "…" not in watched.text
    child.send(b"q")
    assert watched.until_end() == 0
    assert sum(map(len, [*typed, "4 times right", "wwq"])) / KEYS_A_SECOND < FIRST_SUCCESS


def test_ctrl_c_ends_a_map_of_a_bag_and_leaves_no_file(tmp_path: Path) -> None:
    bag(tmp_path / "drive.bag", "ros1", count=3000)
    child = start(80, 24, "map", "drive.bag", "-o", "room", folder=tmp_path)
    watched = Watched(child, 80, 24)
    watched.until("scans: /scan")
    child.sendintr()
    assert watched.until_end() == 130
    assert [each.name for each in tmp_path.iterdir()] == ["drive.bag"]
