"""The command line, as a user or a script meets it: what it prints, and the exit code it ends with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from array import array
from collections.abc import Sequence
from contextlib import ExitStack
from fcntl import ioctl
from functools import partial
from pathlib import Path
from termios import FIONREAD
from typing import Any

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import may_block
from tests.examples import some
from tests.patience import LIMIT, TXT1, wait_until
from txt1.board.board import Board
from txt1.cli import COMMANDS, execute
from txt1.config import Config
from txt1.errors import HalError
from txt1.hal import registry
from txt1.hal.base import Capabilities
from txt1.hal.registry import create
from txt1.hal.sim import SimHal

ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "txt1")
SIM = ("run", "--hal", "sim", "--headless", "--speed", "max")

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def no_settings_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in os.environ:
        if name.startswith("TXT1_"):
            monkeypatch.delenv(name)


@pytest.fixture(autouse=True)
def a_status_line_may_block(blocking_calls_fail: BlockBuster) -> None:
    """It is written only where it fits."""
    may_block(blocking_calls_fail, "txt1/kit/app.py", "_put")


def report(capsys: Capture, *words: str, code: int = 0) -> dict[str, Any]:
    """The JSON object a run prints, which is all it prints on stdout."""
    assert execute([*SIM, *words, "--json"]) == code
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1
    parsed = json.loads(lines[0])
    assert isinstance(parsed, dict)
    return parsed


def without_wall_clock(parsed: dict[str, Any]) -> dict[str, Any]:
    """What of a report must repeat."""
    tasks = {name: {k: v for k, v in task.items() if k != "run_time_s"} for name, task in parsed["tasks"].items()}
    return {k: v for k, v in parsed.items() if k != "wall_time_s"} | {"tasks": tasks}


def complaint(capsys: Capture, words: Sequence[str], code: int = 2) -> str:
    """The one line on stderr with which a command is refused."""
    ended = execute(words)
    out, err = capsys.readouterr()
    assert (ended, out) == (code, "")
    assert err.count("\n") == 1 and err.startswith("txt1: ")
    return err.removesuffix("\n")


def start(
    *words: str, program: Sequence[str] = (sys.executable, "-m", "txt1"), **options: Any
) -> subprocess.Popen[str]:
    """`txt1` as a process of its own."""
    return subprocess.Popen(
        [*program, *words],
        cwd=ROOT,
        text=True,
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        **options,
    )


# -- txt1 run --------------------------------------------------------------------------------------------------


def test_a_minute_costs_every_task_its_cycles_and_none_is_missed(capsys: Capture) -> None:
    parsed = report(capsys, "--duration", "60", "--seed", "1")
    cycles = {name: task["cycles"] for name, task in parsed["tasks"].items()}
    assert cycles["controller"] == cycles["encoder"] == 3000
    assert cycles["display"] == cycles["button"] == 600
    assert cycles["mode"] == cycles["battery"] == 60
    assert cycles["odometry"] == 1200
    assert {name: task["misses"] for name, task in parsed["tasks"].items()} == dict.fromkeys(parsed["tasks"], 0)
    assert parsed["sim_time_s"] == 60.0
    assert parsed["seed"] == 1
    assert {fault for fault, count in parsed["faults"].items() if count} == set()


def test_the_report_has_the_documented_shape(capsys: Capture) -> None:
    parsed = report(capsys, "--duration", "2")
    assert {"sim_time_s", "wall_time_s", "seed", "tasks", "odometry", "battery", "faults"} <= set(parsed)
    for task in parsed["tasks"].values():
        assert set(task) == {"cycles", "misses", "lateness_s", "run_time_s"}
        for times in (task["lateness_s"], task["run_time_s"]):
            assert list(times) == ["p50", "p99", "p999", "max"]
            assert 0.0 <= times["p50"] <= times["p99"] <= times["p999"] <= times["max"]
    assert set(parsed["odometry"]) == {"x", "y", "theta", "v", "omega"}
    assert parsed["battery"]["state"] == "good"


def test_the_same_seed_repeats_the_run_and_another_does_not(capsys: Capture) -> None:
    words = ("--duration", "4", "--drive", "0.4,0.3")
    one, again, other = (report(capsys, *words, "--seed", seed) for seed in ("1", "1", "2"))
    assert without_wall_clock(one) == without_wall_clock(again)
    assert one["odometry"] != other["odometry"]
    assert one["battery"] != other["battery"]


def test_drive_moves_the_robot_at_the_velocity_asked_for(capsys: Capture) -> None:
    parsed = report(capsys, "--duration", "5", "--drive", "0.5,0")
    assert 1.7 < parsed["odometry"]["x"] < 2.0  # four of the five seconds, the first being the link's
    assert parsed["odometry"]["v"] == pytest.approx(0.5, abs=0.05)
    turned = report(capsys, "--duration", "3", "--drive", "0.5,-0.5")
    assert turned["odometry"]["theta"] < -0.5


def test_driving_into_a_wall_ends_with_exit_code_3_and_says_why(capsys: Capture) -> None:
    assert execute([*SIM, "--duration", "12", "--drive", "0.5,0", "--json"]) == 3
    out, err = capsys.readouterr()
    remedy = "look what is in its way, arm (m), drive back (s)"
    assert err == f"txt1: the robot was stopped: {remedy}: blocked: a wall of the 5 x 5 m room\n"
    parsed = json.loads(out)
    assert (parsed["armed"], parsed["faults"]["runaway"], parsed["odometry"]["v"]) == (False, 1, 0.0)
    assert parsed["sim_time_s"] == 12.0


def test_a_robot_that_was_not_armed_does_not_move(capsys: Capture) -> None:
    parsed = report(capsys, "--duration", "4", "--drive", "0.5,0", "--no-arm")
    assert parsed["armed"] is False
    assert set(parsed["odometry"].values()) == {0.0}
    never = report(capsys, "--duration", "4", "--drive", "0.5,0", "--set", "safety.auto_arm=never")
    assert set(never["odometry"].values()) == {0.0}
    armed = report(capsys, "--duration", "4", "--drive", "0.5,0", "--set", "safety.auto_arm=never", "--arm")
    assert armed["odometry"]["x"] > 1.0


def test_without_a_terminal_a_status_line_a_second_and_the_event_log_are_printed(
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert execute([*SIM, "--duration", "5.5"]) == 0
    out, err = capfd.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert [line.split(" s ")[0] for line in lines if "battery=" in line] == [f"t={float(t):8.2f}" for t in range(6)]
    assert [line.split(" s  ")[1] for line in lines if "battery=" not in line] == [
        "armed",
        "disarmed: the run has ended",
    ]


def test_a_velocity_beyond_the_limits_is_clipped_and_counted(capsys: Capture) -> None:
    parsed = report(capsys, "--duration", "1.5", "--drive", "10,0")
    assert parsed["faults"]["speed_clipped"] > 0
    parsed = report(capsys, "--duration", "1.5", "--drive", "0,3")
    assert parsed["faults"]["yaw_rate_clipped"] > 0
    assert parsed["odometry"]["theta"] == 0.0


def test_settings_reach_the_run(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("seed: 5\n")
    assert report(capsys, "--duration", "1", "--config", str(file))["seed"] == 5
    monkeypatch.setenv("TXT1_SEED", "6")
    assert report(capsys, "--duration", "1", "--config", str(file))["seed"] == 6
    assert report(capsys, "--duration", "1", "--config", str(file), "--set", "seed=7")["seed"] == 7
    assert report(capsys, "--duration", "1", "--config", str(file), "--set", "seed=7", "--seed", "8")["seed"] == 8


# -- mistakes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--hal", "nonsense"], ["hal", "'nonsense'", "installed:", "sim"]),
        (["--hal", "simm"], ["'simm'", "did you mean 'sim'?"]),
        (["--set", "control.linear.kp=abc"], ["control.linear.kp", "'abc'", "valid number", "--set", "config show"]),
        (["--set", "control.linear.kpp=1"], ["control.linear.kpp", "unknown key", "did you mean 'control.linear.kp'?"]),
        (["--set", "seed"], ["--set seed", "key=value"]),
        (["--set", "sim.start=[9, 0, 0]"], ["sim.start", "(9, 0, 0)", "wall", "another start"]),
        (["--config", "/no/such.yaml"], ["/no/such.yaml", "No such file", "check --config"]),
        (["--seed", "-1"], ["seed", "-1", "whole number from 0", "--seed"]),
        (["--seed", "x"], ["--seed", "'x'"]),
        (["--drive", "1"], ["--drive", "'1'", "V,OMEGA"]),
        (["--drive", "nan,0"], ["--drive", "'nan'", "finite"]),
        (["--duration", "0"], ["--duration", "'0'", "positive"]),
        (["--speed", "fast"], ["--speed", "'fast'", "number"]),
        (["--arm", "--no-arm"], ["--no-arm", "--arm"]),
        (["--fly"], ["--fly"]),
    ],
)
def test_a_mistake_is_one_line_that_names_field_value_and_remedy(
    capsys: Capture, words: list[str], told: list[str]
) -> None:
    message = complaint(capsys, ["run", "--headless", "--duration", "1", *words])
    assert [word for word in told if word not in message] == []


def test_a_yaml_mistake_is_one_line_with_the_place(capsys: Capture, tmp_path: Path) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text("seed: 1\ncontrol: [1,\n")
    for words in (
        ["run", "--config", str(file)],
        ["config", "check", str(file)],
        ["config", "show", "--config", str(file)],
    ):
        assert complaint(capsys, words).startswith(f"txt1: {file}:3:1: not valid YAML: ")


def test_virtual_time_is_refused_where_time_is_real(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    class Real(SimHal):
        name = "floor"
        capabilities = Capabilities(ticks=True, pwm=True)

    vehicle = create(Config()).vehicle  # type: ignore[attr-defined]
    monkeypatch.setitem(registry.HALS.table, "floor", lambda config: Real(vehicle))
    message = complaint(capsys, ["run", "--hal", "floor", "--speed", "max"])
    assert "--speed" in message and "'floor'" in message


@pytest.mark.long
def test_a_reader_that_stops_reading_cannot_keep_the_run_alive(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "txt1", "run", "--headless", "--speed", "max"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, cwd=ROOT) as process:
        assert process.stdout is not None
        process.stdout.readline()
        wait_until(partial(full, process.stdout.fileno()))  # nobody reads
        process.send_signal(signal.SIGTERM)
        assert process.wait(LIMIT) == 143


def full(pipe: int) -> bool:
    """Whether there is no room in a pipe for another line."""
    waiting = array("i", [0])
    ioctl(pipe, FIONREAD, waiting)
    return waiting[0] > 60_000


@pytest.mark.parametrize("words", [["fly"], ["config"], ["config", "check"], ["--fly"]])
def test_a_command_that_does_not_exist_is_one_line(capsys: Capture, words: list[str]) -> None:
    assert "--help" in complaint(capsys, words)


class Broken(Exception):
    """What a driver of another package may raise."""


@pytest.mark.parametrize(
    ("method", "error", "told"),
    [
        ("open", HalError("the port is busy: close the other program"), "txt1: the port is busy: "),
        ("read", HalError("unplugged: plug it in"), "txt1: task 'encoder' failed: HalError: unplugged"),
        ("read", Broken("no answer"), "txt1: task 'encoder' failed: Broken: no answer"),
    ],
)
def test_hardware_that_fails_ends_the_run_with_exit_code_1_and_one_line(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, method: str, error: Exception, told: str
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(SimHal, method, fail)
    assert complaint(capsys, [*SIM, "--duration", "5"], code=1).startswith(told)


# -- txt1 config and help ----------------------------------------------------------------------------------------


def test_config_show_prints_every_value_and_its_origin(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("control: {linear: {kp: 9}}\n")
    monkeypatch.setenv("TXT1_SAFETY__V_MAX", "1")
    assert execute(["config", "show", "--config", str(file), "--set", "seed=3"]) == 0
    rows = {}
    for line in capsys.readouterr().out.splitlines():
        row, _, origin = line.partition("  # ")
        key, _, value = row.partition(":")
        rows[key] = (json.loads(value), origin)
    assert rows["control.linear.kp"] == (9.0, str(file))
    assert rows["control.linear.ki"] == (18.0, "default")
    assert rows["safety.v_max"] == (1.0, "environment TXT1_SAFETY__V_MAX")
    assert rows["seed"] == (3, "--set seed=3")
    assert len(rows["control.angular"][0]) == 14


def test_config_check_says_whether_a_file_is_valid(capsys: Capture, tmp_path: Path) -> None:
    assert execute(["config", "check", str(ROOT / "config" / "txt1.yaml")]) == 0
    assert capsys.readouterr().out.endswith("txt1.yaml: valid\n")
    file = tmp_path / "robot.yaml"
    file.write_text("safety: {v_max: 20}\n")
    assert complaint(capsys, ["config", "check", str(file)]).startswith("txt1: safety.v_max: 20: ")


@pytest.mark.parametrize("words", ["", *COMMANDS, "config show", "log cat", "hal check"])
def test_every_command_has_help(capsys: Capture, words: str) -> None:
    assert execute([*words.split(), "--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith("usage: txt1")


def test_the_exit_codes_are_documented(capsys: Capture) -> None:
    assert execute(["run", "--help"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "Exit codes: 0" in out and "129/130/143" in out


# -- the process -------------------------------------------------------------------------------------------------


WITNESS = """
import asyncio

from txt1.hal.registry import create_sim

def create(config):
    hal = create_sim(config)
    write, close, seen = hal.write, hal.close, []

    def watched_write(outputs, now):
        seen.append(outputs)
        write(outputs, now)

    async def watched_close():
        open(config.hal_options["report"] + ".closing", "w").close()
        await asyncio.sleep(config.hal_options.get("lasts", 0.0))
        await close()
        with open(config.hal_options["report"], "w") as report:
            report.write(f"{max(o.motor for o in seen)} {seen[-1][:5]}")

    hal.write, hal.close = watched_write, watched_close
    return hal
"""


@pytest.fixture
def witness(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory with a HAL `witness` in it, which writes down what it was told last."""
    (tmp_path / "witness.py").write_text(WITNESS)
    info = tmp_path / "witness-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: witness\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[txt1.hal]\nwitness = witness:create\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(tmp_path)]))
    return tmp_path


def test_a_signal_ends_a_driving_robot_with_its_code_and_neutral_outputs(witness: Path) -> None:
    signals = {signal.SIGHUP: 129, signal.SIGINT: 130, signal.SIGTERM: 143}
    with ExitStack() as stack:
        runs = {
            number: stack.enter_context(
                start(
                    "run",
                    "--hal",
                    "witness",
                    "--headless",
                    "--duration",
                    "3600",
                    "--drive",
                    "0.5,0",
                    "--set",
                    f"hal_options.report={witness / number.name}",
                    program=TXT1,
                    stdout=subprocess.PIPE,
                )
            )
            for number in signals
        }
        for run in runs.values():
            stack.callback(run.kill)
        for number, run in runs.items():
            assert run.stdout is not None
            while (line := run.stdout.readline()) and ("v=" not in line or "v=+0.0" in line):
                pass
            run.send_signal(number)
        for number, run in runs.items():
            _, err = run.communicate(timeout=LIMIT)
            assert (run.returncode, err) == (signals[number], "")
            driven, last = (witness / number.name).read_text().split(" ", 1)
            assert int(driven) > 500
            assert last == "(0, 0, 0, 0, 0)"


@pytest.mark.parametrize("second", some(signal.SIGTERM, rest=[signal.SIGINT]))
def test_a_second_signal_does_not_cut_the_stop_short(witness: Path, second: signal.Signals) -> None:
    report = witness / "report"
    words = ("--hal", "witness", "--headless", "--drive", "0.5,0", "--duration", "3600")
    settings = ("--set", f"hal_options.report={report}", "--set", "hal_options.lasts=1.0")
    with start("run", *words, *settings, program=TXT1, stdout=subprocess.PIPE) as run:
        assert run.stdout is not None
        while (line := run.stdout.readline()) and ("v=" not in line or "v=+0.0" in line):
            pass
        run.send_signal(signal.SIGINT)
        wait_until((witness / "report.closing").exists)
        run.send_signal(second)
        _, err = run.communicate(timeout=LIMIT)
    assert (run.returncode, err) == (130, "txt1: the robot is being stopped; that takes some seconds\n")
    assert report.read_text().endswith("(0, 0, 0, 0, 0)")


@pytest.mark.parametrize("speed", some(["--speed", "max"], rest=[[]]), ids=["virtual time", "real time"])
def test_a_signal_ends_a_run_that_has_no_end(speed: list[str]) -> None:
    with start("run", "--headless", *speed, program=TXT1, stdout=subprocess.PIPE) as run:
        assert run.stdout is not None
        assert run.stdout.readline().startswith("t=")
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=LIMIT)
    assert (run.returncode, err) == (130, "")


@pytest.mark.long  # a pipe that nobody reads: tests/e2e/test_start.py has one of each kind
@pytest.mark.parametrize(
    "words",
    [
        ["run", "--headless", "--duration", "5"],
        ["config", "show"],
        ["run", "--headless", "--duration", "5", "--speed", "max"],
        ["run", "--json", "--duration", "5", "--speed", "max"],
        ["config", "check", "config/txt1.yaml"],
        ["--help"],
    ],
    ids=" ".join,
)
def test_a_reader_that_has_gone_is_no_traceback(words: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with start(*words, stdout=writing) as process:
        os.close(writing)
        _, err = process.communicate(timeout=LIMIT)
    assert err == ""
    assert process.returncode in (0, 1)  # 0 if there was nothing more to say


def test_the_head_of_a_run_can_be_taken() -> None:
    command = f"{sys.executable} -m txt1 run --headless --duration 600 --speed max | head -1"
    done = subprocess.run(["sh", "-c", command], cwd=ROOT, capture_output=True, text=True, timeout=LIMIT, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("t=") and done.stdout.count("\n") == 1


def test_a_mistake_costs_a_process_no_traceback() -> None:
    with start("run", "--hal", "nonsense", stdout=subprocess.PIPE) as process:
        out, err = process.communicate(timeout=LIMIT)
    assert (process.returncode, out, err) == (
        2,
        "",
        "txt1: hal: there is no HAL 'nonsense'; installed: pi, serial, sim, vesc, waveshare\n",
    )


# -- txt1 decode -------------------------------------------------------------------------------------------------

VELOCITY = bytes.fromhex("FA FB 04 67 01 F4 02 EE 5B ED")


def test_a_capture_is_listed_with_offsets_and_faults(capsys: Capture, tmp_path: Path) -> None:
    file = tmp_path / "capture.bin"
    file.write_bytes(b"\x00" + VELOCITY + VELOCITY[:-1] + b"\x00")
    assert execute(["decode", "--role", "board", str(file)]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[0].split() == ["1", "Velocity", "v=0.5", "omega=0.75"]
    assert "bad checksum" in out.splitlines()[1]
    assert err.startswith("21 bytes, 1 Velocity, 1 bad checksum")


def test_a_capture_is_listed_as_json_from_hexadecimal_text(capsys: Capture, tmp_path: Path) -> None:
    file = tmp_path / "capture.txt"
    file.write_text(VELOCITY.hex(" ") + "  # half a metre a second\n")
    assert execute(["decode", "--role", "board", "--hex", "--json", str(file)]) == 0
    line = capsys.readouterr().out.strip()
    assert json.loads(line) == {"offset": 0, "type": "Velocity", "v": 0.5, "omega": 0.75}


def test_a_capture_that_cannot_be_read_is_one_line(capsys: Capture, tmp_path: Path) -> None:
    file = tmp_path / "capture.txt"
    file.write_text("FA FB\n0G\n")
    assert "line 2, column 2" in complaint(capsys, ["decode", "--role", "host", "--hex", str(file)])
    assert "missing.bin" in complaint(capsys, ["decode", "--role", "host", "missing.bin"])


def test_an_error_in_a_callback_of_the_loop_ends_the_run(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(self: Board, data: bytes) -> None:
        raise RuntimeError("nobody expected this")

    monkeypatch.setattr(Board, "received", fails)
    assert execute(["run", "--hal", "serial", "--port", "virtual", "--json", "--duration", "5", "--speed", "max"]) == 1
    assert "nobody expected this" in capsys.readouterr().err
