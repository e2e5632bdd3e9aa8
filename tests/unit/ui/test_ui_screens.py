"""What the user reads on each screen."""

from __future__ import annotations

import re
from io import StringIO

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console
from ui_snapshots import RATES, TEAM, blind, full, mode

from txt1.control.schedule import Schedule
from txt1.fleet.members import FLEET
from txt1.sensors.base import SENSORS
from txt1.sensors.readings import Scan, scan_topic
from txt1.tasks.battery import BATTERIES
from txt1.tasks.controller import SETPOINT
from txt1.tasks.diagnostics import FAULTS
from txt1.tasks.encoder import ODOMETRY
from txt1.tasks.fields import (
    EVENTS,
    GAIN_TABLE,
    TRAFFIC,
    Battery,
    BatteryState,
    Event,
    GainTable,
    LinkState,
    Panel,
    Traffic,
)
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.screens import installed, render
from txt1.ui.tables import in_force, values_of, visible
from txt1.ui.text import count, duration, number, run_time
from txt1.ui.viewer import DRIVING, Viewer

NAMES = list(installed())

SIZES = [(80, 24), (110, 30), (133, 40), (200, 50)]

FIELDS = {
    "STATUS": """
        ARMED alive encoder keys refused program 7
        warning 11.84 0.00 40 0.50 0.250 11.000 18.000 130.000 ATX ESC off bad_frames clipped
        number 19
    """,
    "PWM": "motor 1815 front -7351 rear 7351 pwm4 1200 pwm5 -1200 backlight 62 controller █",
    "ENCODERS": "right 31 left 29 0.512 omega odometry room theta",
    "PID GAINS": "linear 11.000 v_max -1.35 1.35 200.000 ► Kp Ki Kd loaded",
    "MAP": "room light path ✶ ├ m x y θ",
    "SENSORS": "light front 812.5 rear 20 lx thermometer 21.5 °C 16.0ms 2.00s 5000 40 3 healthy sonar –",
    "TASKS": "controller 50Hz 123456 serial event 12µs 346µs 34.5ms prio rate cycles miss p50 p99 max",
    "FLEET": "alone",
}


def printed(snapshot: Snapshot | None, viewer: Viewer, width: int, height: int) -> list[str]:
    console = Console(file=StringIO(), width=width, height=height, color_system=None, highlight=False)
    with console.capture() as capture:
        console.print(render(snapshot, viewer, width, height), end="")
    return capture.get().rstrip("\n").split("\n")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("screen", range(len(installed())))
def test_every_screen_shows_its_fields_and_fits_the_window(screen: int, size: tuple[int, int]) -> None:
    lines = printed(full(screen=screen), Viewer(), *size)
    text = "\n".join(lines)
    assert len(lines) == size[1]
    assert all(cell_len(line) <= size[0] for line in lines)
    assert f"[{NAMES[screen]}]" in lines[0]
    assert [field for field in FIELDS[NAMES[screen]].split() if field not in text] == []
    assert "…" not in text
    assert "quit" in lines[-1]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("screen", range(len(installed())))
def test_a_hal_that_knows_little_still_gets_every_screen(screen: int, size: tuple[int, int]) -> None:
    lines = printed(blind(screen=screen), Viewer(), *size)
    assert len(lines) == size[1]
    assert all(cell_len(line) <= size[0] for line in lines)


@pytest.mark.parametrize(
    ("screen", "names"),
    [
        (0, ["odometry", "mode", "battery 1", "battery 2", "remaining", "power", "angular"]),
        (1, ["motor", "front", "rear", "pwm4", "pwm5", "backlight", "mode"]),
        (2, ["ticks right", "ticks left"]),
    ],
)
def test_what_the_hal_cannot_know_is_a_dash(screen: int, names: list[str]) -> None:
    lines = printed(blind(screen=screen), Viewer(), 80, 24)
    for name in names:
        assert any(f"{name} " in line and "–" in line.split(name, 1)[1] for line in lines), name


def test_no_set_is_marked_when_a_board_does_the_scheduling() -> None:
    assert in_force(blind()) is None
    assert "in force: –" in "\n".join(printed(blind(screen=3), Viewer(), 80, 24))


def test_equal_gains_are_told_apart_by_the_speed() -> None:
    sets = full()[GAIN_TABLE].angular.sets
    snapshot = full()
    for v, expected in ((-1.4, 0), (-1.2, 1), (-1.0, 2), (5.0, 13)):
        control = snapshot[SETPOINT]._replace(gains=sets[expected].gains)
        slow = snapshot.replaced({SETPOINT: control, ODOMETRY: snapshot[ODOMETRY]._replace(v=v)})
        assert in_force(slow) == expected


def test_an_input_without_a_second_pack_is_told_in_words() -> None:
    topic = BATTERIES[0]
    for volts, told in ((0.0, "no pack"), (11.9, "11.90 V")):
        snapshot = full().replaced({topic: full()[topic]._replace(battery2=volts)})
        lines = printed(snapshot, Viewer(), 80, 24)
        assert [line for line in lines if "battery 2" in line and told in line]


def test_help_shows_every_key_of_driving_in_a_small_window() -> None:
    lines = printed(full(), Viewer(help=True), 60, 20)
    keys = {line.removeprefix("│").split()[0] for line in lines if line.startswith("│ ")}
    assert {"SPACE", "m", "w", "a", "+", "c", "e", "?"} <= keys


def test_the_state_line_cannot_be_misread() -> None:
    assert "ARMED" in printed(full(), Viewer(), 80, 24)[1]
    stopped = mode(full(), armed=False, stopped=True, reason="emergency stop")
    assert "EMERGENCY STOP" in printed(stopped, Viewer(), 80, 24)[1]
    assert "ARMED" not in printed(stopped, Viewer(), 80, 24)[1]
    disarmed = mode(full(), armed=False, reason="link lost")
    assert "disarmed  m arms" in printed(disarmed, Viewer(), 80, 24)[1]
    assert "link lost" in printed(disarmed, Viewer(), 80, 24)[2]
    late = mode(full().replaced({BATTERIES[0]: None}), armed=False, reason="the controller missed 14 cycles")
    assert "m arms" in printed(late, Viewer(), 80, 24)[1] and "missed 14 cycles" in printed(late, Viewer(), 80, 24)[2]
    assert "m arms" not in printed(late, Viewer({"q": "quit"}), 80, 24)[1]  # a recording is not to be armed
    long = mode(full(), armed=False, reason="a very long reason " * 5)
    assert "link alive  RX" in printed(long, Viewer(), 80, 24)[1]
    assert "\n".join(printed(long, Viewer(), 60, 20)).count("reason") == 5, "nothing of it is cut"


def test_buzzer_and_leds_follow_the_robot() -> None:
    snapshot = full().replaced({TRAFFIC: Traffic(1, 2), BATTERIES[0]: Battery(12.0)})
    assert "RX ●  TX ○" in printed(snapshot, Viewer(), 80, 24)[1]
    assert "BUZZER" not in printed(snapshot, Viewer(), 80, 24)[1]
    assert "RX ○  TX ●" in printed(snapshot.replaced({TRAFFIC: Traffic(2, 3)}), Viewer(), 80, 24)[1]
    assert "BUZZER" in printed(mode(snapshot, link=LinkState()), Viewer(), 80, 24)[1]
    low = snapshot.replaced({BATTERIES[0]: Battery(9.3, state=BatteryState.WARNING)})
    assert ["BUZZER" in printed(low.replaced({}, time), Viewer(), 80, 24)[1] for time in (1.0, 3.0, 5.0)] == [
        True,
        False,
        True,
    ]


@pytest.mark.parametrize("screen", range(len(installed())))
def test_help_covers_the_screen_but_not_the_state(screen: int) -> None:
    lines = printed(full(screen=screen), Viewer(help=True), 80, 24)
    text = "\n".join(lines)
    assert "HELP" in text
    assert "ARMED" in lines[1]
    for key in ("SPACE", "w s", "a d", "+ -", "← →", "↑ ↓"):
        assert key in text


def test_before_the_first_snapshot_it_waits_for_the_robot() -> None:
    assert "waiting for the robot" in "\n".join(printed(None, Viewer(), 80, 24))


def test_the_gains_scroll_and_the_last_row_stays_visible() -> None:
    small = mode(full(), panel=Panel(3, 2))
    text = "\n".join(printed(small, Viewer(), 80, 16))
    assert "-1.15" not in text
    assert "-0.95" in text
    far = mode(full(), panel=Panel(3, 100))
    text = "\n".join(printed(far, Viewer(), 80, 16))
    assert "1.35  " in text
    assert "-1.35" not in text
    assert visible(14, 20, 5) == range(14)


def test_without_gains_the_table_says_so() -> None:
    empty = full(screen=3).replaced({GAIN_TABLE: GainTable(angular=Schedule())})
    text = "\n".join(printed(empty, Viewer(), 80, 24))
    assert "no sets" in text
    assert "not loaded" in text


def test_an_event_cannot_command_the_terminal() -> None:
    nasty = full().replaced({EVENTS: (Event(1.0, "a\x1b[2Jb\x07\nc\x9bd"),)})
    nasty = mode(nasty, reason="\x1b]0;x\x07", armed=False)
    console = Console(file=StringIO(), width=80, height=24, color_system=None)
    with console.capture() as capture:
        console.print(render(nasty, Viewer(), 80, 24), end="")
    assert "\x1b" not in capture.get()
    assert "\x07" not in capture.get()
    assert "\x9b" not in capture.get()


def test_many_faults_leave_room_for_the_events() -> None:
    many = full().replaced({FAULTS: {f"fault_{i}": i for i in range(1, 40)}})
    text = "\n".join(printed(many, Viewer(), 80, 24))
    assert "more" in text
    assert "number 19" in text


@pytest.mark.parametrize("screen", range(len(installed())))
def test_a_snapshot_that_tells_nothing_still_gets_every_screen(screen: int) -> None:
    text = "\n".join(printed(mode(Snapshot(1.0, "", {MODE.name: Mode()}), panel=Panel(screen)), Viewer(), 80, 24))
    assert "failed" not in text and "disarmed" in text


def test_the_joystick_goes_round_the_screens() -> None:
    assert f"[{NAMES[-1]}]" in printed(full(screen=-1), Viewer(), 80, 24)[0]
    assert f"[{NAMES[1]}]" in printed(full(screen=3 * len(NAMES) + 1), Viewer(), 80, 24)[0]


def numbers(lines: list[str]) -> set[str]:
    """The numbers on a screen; what is cut visibly, by an ellipsis, is none, and neither is how many there are."""
    inside = re.sub(r"╭[^╮]*╮", "", "\n".join(lines[1:]))
    return set(re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\d.]*…)", inside))


@pytest.mark.parametrize("size", [(58, 20), (60, 20), (80, 24)])
@pytest.mark.parametrize("name", [name for name in NAMES if name != "MAP"])  # whose scale is the window's
def test_no_number_on_a_narrow_screen_is_cut_so_that_it_reads_as_another(name: str, size: tuple[int, int]) -> None:
    screen = NAMES.index(name)
    snapshot = full(screen=screen).replaced({FLEET: TEAM})
    wide = numbers(printed(snapshot, Viewer(), 200, 50))
    assert wide and numbers(printed(snapshot, Viewer(), *size)) <= wide


def test_a_header_without_room_names_the_current_screen_and_how_many_there_are() -> None:
    assert f"4/{len(NAMES)} [PID GAINS]" in printed(full(screen=3), Viewer(), 60, 20)[0]


def test_a_narrow_window_loses_no_column_of_the_gains_and_no_name_of_a_task() -> None:
    gains = "\n".join(printed(full(screen=3), Viewer(), 58, 20))
    assert "Kd" in gains and "0.005" in gains and "…" not in gains
    tasks = "\n".join(printed(full(screen=NAMES.index("TASKS")), Viewer(), 58, 20))
    assert all(name in tasks for name in RATES) and "…" not in tasks


def test_a_narrow_footer_keeps_the_keys_that_matter_whole() -> None:
    assert printed(full(), Viewer(), 40, 20)[-1].rstrip() == "SPACE stop q quit ? help m arm ←→ screen"


def test_other_keys_take_the_place_of_driving_in_footer_and_help() -> None:
    viewer = Viewer({"SPACE": "pause"})
    assert printed(full(), viewer, 80, 24)[-1].rstrip() == "SPACE pause"
    viewer.help = True
    text = "\n".join(printed(full(), viewer, 80, 24))
    assert "pause" in text and "drive" not in text


def test_a_further_key_of_a_robot_in_a_fleet_is_listed_with_the_standard_keys() -> None:
    viewer = Viewer({"SPACE": DRIVING["SPACE"], "x": "stop all"} | DRIVING)
    assert printed(full(), viewer, 80, 24)[-1].startswith("SPACE stop x stop all q quit")
    viewer.help = True
    text = "\n".join(printed(full(), viewer, 80, 24))
    assert "EMERGENCY STOP" in text and "stop all" in text


def test_many_sensors_are_listed_as_far_as_there_is_room_and_counted() -> None:
    sensor = full()[SENSORS][0]
    many = full(screen=NAMES.index("SENSORS")).replaced(
        {SENSORS: tuple(sensor._replace(name=f"light{i}") for i in range(40))}
    )
    text = "\n".join(printed(many, Viewer(), 120, 24))
    assert "light16" in text and "light39" not in text and "and 23 more" in text


def test_several_units_stand_behind_all_values_of_a_laser() -> None:
    scan = Scan(-3.0, 0.01, 0.0, np.where(np.arange(601) < 500, np.float32(2.0 / 3.0), np.float32(np.inf)), 0.1, 5.0)
    sensor = full()[SENSORS][0]._replace(values=scan.summary(), units=scan_topic("laser").units)
    assert values_of(sensor) == "nearest 0.667  at -171.887  hits 500 (m, degrees)"


def test_a_small_value_of_a_sensor_is_not_rounded_to_nothing() -> None:
    sensor = full()[SENSORS][0]._replace(values={"a": -0.0004, "b": 1.23456, "c": 0.0}, units="m")
    assert values_of(sensor) == "a -0.0004  b 1.235  c 0 m"


@pytest.mark.parametrize("size", [(20, 5), (40, 10), (1, 1)])
@pytest.mark.parametrize("screen", range(len(installed())))
def test_a_window_that_is_too_small_is_no_error(screen: int, size: tuple[int, int]) -> None:
    assert all(cell_len(line) <= size[0] for line in printed(full(screen=screen), Viewer(), *size))


def test_values_are_written_for_people() -> None:
    assert [duration(s) for s in (0.0, 3e-7, 12e-6, 9.996e-4, 0.0123, 0.0999, 0.3, 2.5, 1000.0)] == [
        "0",
        "300ns",
        "12µs",
        "1.0ms",
        "12.3ms",
        "99.9ms",
        "300ms",
        "2.50s",
        "1000s",
    ]
    assert number(-0.001, 2) == "0.00"
    assert number(None, 2, "V") == "–"
    assert number(11.836, 2, "V") == "11.84 V"
    assert run_time(3725.67) == "1:02:05.6"
    assert [count(n, 4) for n in (0, 9999, 10_000, 12_345_678)] == ["0", "9999", "10k", "12M"]
    assert count(123_456_789, 7) == "123457k" or count(123_456_789, 7) == "123.5M"


def test_brackets_in_an_event_a_reason_or_a_name_are_shown_unchanged() -> None:
    told = full().replaced({EVENTS: (Event(1.0, r"[bold]gains[/] of [0.5] \[x] \ "),)}, name="[red]")
    text = "\n".join(printed(mode(told, reason="[/nothing]", armed=False), Viewer(), 120, 24))
    assert r"[bold]gains[/] of [0.5] \[x] \ " in text
    assert "\n [/nothing]" in text and " [red] " in text and "failed" not in text
