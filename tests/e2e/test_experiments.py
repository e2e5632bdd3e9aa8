"""The drive tests, as a user runs them: simulated, behind the virtual line, interrupted, tuned and compared."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import cache
from math import hypot
from pathlib import Path
from typing import Any

import pytest

from tests.patience import LIMIT
from txt1.cli import execute
from txt1.config import Config, load
from txt1.experiments import figures, run_folder
from txt1.experiments.command.experiment import ENDLESS, drive
from txt1.experiments.identify import HeldOutputs, identify, try_out
from txt1.experiments.metrics import QUANTUM, difference, measure
from txt1.experiments.profile import load_profile
from txt1.experiments.run_folder import Run
from txt1.installing import installs
from txt1.kernel.loop import run
from txt1.model.battery import pack_voltage
from txt1.robot import Robot

SERIAL = ("hal=serial", "serial.port=virtual")
EITHER = (pytest.param((), id="sim"), pytest.param(SERIAL, marks=pytest.mark.long, id="serial"))
"""The robot behind a wire differs by its delay alone: see test_behind_the_wire_all_comes_later."""
WEAK_AND_SLOW = (
    "sim.vehicle.speed_gain=0.000231",
    "sim.vehicle.speed_time_constant=0.6",
    "sim.vehicle.servo_rate=3.490658503988659",
)


REPEATS = int(os.environ.get("TUNE_REPEATS", "4"))
"""Runs of each test whose mean is judged. 30, as in docs/results, know settling times to some ms; 4 do not."""


def configured(*settings: str) -> Config:
    return load(None, [*ENDLESS, *settings], {}).config


@cache
def measured(name: str, *settings: str, safe_end: bool = True) -> Run:
    profile = load_profile(name)
    outcome, _ = drive(configured(*settings), profile, "max", safe_end=safe_end)
    assert outcome is not None
    return Run(name, profile, outcome.recording, measure(outcome, profile))


@pytest.mark.parametrize("hal", [(), SERIAL], ids=["sim", "serial"])
def test_the_speed_follows_steps_of_both_signs(hal: tuple[str, ...]) -> None:
    metrics = measured("linear-steps", *hal).metrics
    steps = metrics["steps"]
    assert [step["after"] for step in steps] == [0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0]
    for step in steps:
        assert step["rise"] < 0.8
        assert step["settling"] < 1.5
        assert step["overshoot"] < (0.02 if not hal else 0.05)
        assert abs(step["steady_error"]) < 0.01
    assert len(metrics["stops"]) == 8


@pytest.mark.parametrize("hal", EITHER)
def test_the_yaw_rate_follows_steps_and_costs_little_speed(hal: tuple[str, ...]) -> None:
    metrics = measured("angular-steps", *hal).metrics
    turns = [step for step in metrics["steps"] if step["channel"] == "omega"]
    assert [step["after"] for step in turns] == [0.3, 0.4, 0.6, 0.8, -0.3, -0.4, -0.6, -0.8]
    assert all(step["settling"] is not None and step["settling"] < 1.0 for step in turns)
    assert all(droop["droop"] <= 0.1 for droop in metrics["droop"])


@pytest.mark.parametrize("hal", [(), SERIAL], ids=["sim", "serial"])
@pytest.mark.parametrize(
    ("name", "radius"), [pytest.param("circle-slow", 2.0, marks=pytest.mark.long), ("circle-fast", 1.0)]
)
def test_a_circle_has_its_radius_and_overlaps(name: str, radius: float, hal: tuple[str, ...]) -> None:
    circle = measured(name, *hal).metrics["circle"]
    assert circle["asked"] == radius
    assert circle["radius"] == pytest.approx(radius, rel=0.035)
    assert circle["lap_to_lap"] < 0.05


@pytest.mark.parametrize("hal", EITHER)
def test_waypoints_are_followed_by_odometry(hal: tuple[str, ...]) -> None:
    metrics = measured("waypoints", *hal).metrics
    assert metrics["pose_source"] == "odometry"
    assert len(metrics["legs"]) == 12
    assert all(leg["rms"] < 0.15 for leg in metrics["legs"])


@pytest.mark.long
def test_the_battery_run_stops_at_the_safe_end_and_finds_the_discharge_line() -> None:
    """Of a pack that has given 38 minutes; docs/results/drive-tests.md has the whole of it."""
    metrics = measured("battery-run", "sim.battery.used_1=38").metrics
    assert metrics["stopped_by"] == "the safe end of the battery"
    assert metrics["duration_s"] / 60.0 == pytest.approx(8.0, abs=0.5)
    assert abs(metrics["battery"]["slope_error"]) < 0.02
    assert metrics["battery"]["intercept"] == pytest.approx(pack_voltage(38.0), rel=0.002)


@pytest.mark.parametrize("hal", EITHER)
def test_with_the_stop_off_the_battery_warns_and_cuts_off(hal: tuple[str, ...]) -> None:
    metrics = measured("battery-run", "sim.battery.used_1=48.5", *hal, safe_end=False).metrics
    assert metrics["battery_warning_s"] is not None
    assert metrics["stopped_by"] == "the battery's cut-off"
    assert metrics["duration_s"] / 60.0 == pytest.approx(1.5, abs=0.3)


def test_a_wall_is_told_apart_from_the_end() -> None:
    profile = load_profile("linear-steps")
    outcome, code = drive(load(None, ["sim.room.length=3"], {}).config, profile, "max")
    assert outcome is not None
    assert outcome.stopped_by.startswith("the safety gate: blocked: a wall")
    assert code == 3


@pytest.mark.parametrize(
    "name",
    [
        "linear-steps",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("angular-steps", "circle-slow", "circle-fast")),
    ],
)
def test_behind_the_wire_all_comes_later_and_is_the_same_within_noise(name: str) -> None:
    sim, wire = measured(name).recording.without_truth(), measured(name, *SERIAL).recording
    for channel in ("v", "omega"):
        apart = difference(sim, wire, channel)
        if apart is None:  # of the yaw rate in linear-steps
            continue
        assert 0.0 <= apart.delay[0] <= apart.delay[1] < 0.1
        assert apart.rms < 0.25 * QUANTUM[channel], "a quarter of a count in a single reading"
        assert apart.largest < 2.0 * QUANTUM[channel]


@pytest.mark.long
def test_a_profile_of_ones_own_is_driven_measured_and_drawn(tmp_path: Path, capsys: Any) -> None:
    profile = tmp_path / "own.yaml"
    profile.write_text("title: Mine\nfigure: velocities\nsteps: [{v: 0.3, omega: 0.2, seconds: 3}]\n")
    assert execute(["experiment", str(profile), "--out", str(tmp_path / "a"), "--seed", "1"]) == 0
    assert "ended by the end of the profile" in capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "a").iterdir()) == ["figure.svg", "metrics.json", "samples.csv"]
    steps = json.loads((tmp_path / "a" / "metrics.json").read_text())["steps"]
    assert {step["channel"]: step["after"] for step in steps} == {"v": 0.3, "omega": 0.2}
    assert execute(["experiment", str(profile), "--out", str(tmp_path / "b"), "--seed", "1"]) == 0
    for name in ("samples.csv", "figure.svg", "metrics.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), "the seed repeats it all"
    capsys.readouterr()
    words = ["experiment", "compare", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(tmp_path / "c"), "--json"]
    assert execute(words) == 0
    assert len(json.loads(capsys.readouterr().out)) == 2
    assert (tmp_path / "c" / "figure.svg").exists()


@pytest.mark.long
def test_runs_with_and_without_truth_are_compared_by_their_encoders(tmp_path: Path) -> None:
    profile = load_profile("circle-fast")
    runs = []
    for label, settings in (("sim", ()), ("serial", SERIAL)):
        outcome, _ = drive(configured(*settings), profile, "max")
        assert outcome is not None
        run = Run(label, profile, outcome.recording, measure(outcome, profile))
        run_folder.write(run, tmp_path / label)
        runs.append(run_folder.read(tmp_path / label))
    assert [run.recording.knows_truth for run in runs] == [True, False]
    alike = run_folder.alike(runs)
    assert not any(run.recording.knows_truth for run in alike)
    assert alike[0].metrics["circle"]["radius"] == pytest.approx(alike[1].metrics["circle"]["radius"], abs=0.005)
    figures.draw(alike, tmp_path / "both.png")
    assert (tmp_path / "both.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["experiment", "linear-step"], "did you mean 'linear-steps'"),
        (["experiment", "compare", "nowhere"], "takes the folders of two to four runs, not of 1"),
        (["experiment", "compare", "nowhere", "there"], "nowhere/metrics.json"),
        (["experiment", "circle-fast", "folder"], "only 'compare' takes folders"),
        (["experiment", "circle-fast", "--out", "/proc/nowhere"], "/proc/nowhere: cannot write results there"),
        (["experiment", "compare", "a", "b", "--out", "/proc/nowhere"], "a/metrics.json"),
        (["tune", "--out", "/proc/nowhere"], "/proc/nowhere: cannot write results there"),
        (["tune", "--write", "/proc/nowhere/gains.yaml"], "/proc/nowhere: cannot write results there"),
    ],
)
def test_a_mistake_is_told_in_one_line(words: list[str], complaint: str, capsys: Any) -> None:
    assert execute(words) == 2
    told = capsys.readouterr().err
    assert complaint in told
    assert told.count("\n") == 1


def test_without_matplotlib_it_names_the_extra(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr(figures, "find_spec", lambda name: None)
    assert execute(["experiment", "circle-fast"]) == 2
    assert installs("plots") in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_a_signal_stops_the_robot_and_keeps_what_was_measured(tmp_path: Path, number: signal.Signals) -> None:
    after = 1.0
    while (metrics := stopped(number, after, tmp_path))["samples"] <= 100:
        after *= 2.0  # it had no turn on the processor
    assert metrics["stopped_by"] == "the operator"
    assert (tmp_path / "figure.svg").exists()


def stopped(number: signal.Signals, after: float, folder: Path) -> dict[str, Any]:
    """The metrics of an experiment that gets a signal `after` so many s."""
    process = subprocess.Popen(
        [sys.executable, "-m", "txt1", "experiment", "linear-steps", "--speed", "20", "--out", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, "COLUMNS": "100"},
    )
    assert process.stderr is not None
    assert b"Ctrl-C" in process.stderr.readline()
    time.sleep(after)
    process.send_signal(number)
    _, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 128 + number, errors.decode()
    metrics: dict[str, Any] = json.loads((folder / "metrics.json").read_text())
    return metrics


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGTERM])
def test_a_signal_ends_tuning_and_writes_nothing(tmp_path: Path, number: signal.Signals) -> None:
    file = tmp_path / "gains.yaml"
    process = subprocess.Popen(
        [sys.executable, "-m", "txt1", "tune", "--speed", "20", "--write", str(file)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    assert process.stderr is not None
    assert b"trying out the vehicle" in process.stderr.readline()
    time.sleep(1.0)
    process.send_signal(number)
    assert process.wait(timeout=LIMIT) == 128 + number, process.stderr.read().decode()
    process.stderr.close()
    assert not file.exists()


@pytest.mark.long
@pytest.mark.parametrize("vehicle", [(), WEAK_AND_SLOW], ids=["nominal", "30 % less gain and twice the lag"])
def test_tuned_gains_settle_sooner_on_every_step_with_no_more_overshoot(
    tmp_path: Path, capsys: Any, vehicle: tuple[str, ...]
) -> None:
    settings = [word for setting in vehicle for word in ("--set", setting)]
    file = tmp_path / "gains.yaml"
    words = ["tune", "--seed", "1", "--repeats", str(REPEATS), "--out", str(tmp_path), "--write", str(file), *settings]
    assert execute(words) == 0
    assert "lag" in capsys.readouterr().out
    assert load(file).config.control != Config().control
    for test in ("linear-steps", "angular-steps"):
        old, new = (run_folder.read(tmp_path / f"{test}-{which}").metrics for which in ("old", "new"))
        for before, after in zip(old["steps"], new["steps"], strict=True):
            assert after["settling"] < before["settling"] + (0.03 if REPEATS < 20 else 0.0), before
            # the standard error of four runs is itself known to a third only
            errors = (6.0 if REPEATS < 20 else 2.0) * hypot(before["overshoot_error"], after["overshoot_error"])
            assert after["overshoot"] <= before["overshoot"] + errors, before
        assert (tmp_path / f"{test}-steps.svg").exists()


def test_tuning_is_refused_where_neither_outputs_nor_gains_can_be_set(capsys: Any) -> None:
    by_host = ("--set", "serial.control=host", "--set", "serial.allow_host=true")
    assert execute(["tune", "--hal", "serial", "--port", "virtual", *by_host]) == 1
    told = capsys.readouterr().err
    assert "a board that takes gains" in told
    assert "--hal sim" in told


def test_the_vehicle_behind_a_board_is_found_by_driving_with_k_p_alone() -> None:
    async def drive_it() -> list[HeldOutputs]:
        async with Robot.open(config=config) as robot:
            return await try_out(robot)

    config = configured(*SERIAL, "seed=1")
    found, vehicle = identify(run(drive_it(), speed="max")), config.sim.vehicle
    assert found.speed_gain == pytest.approx(vehicle.speed_gain, rel=0.05)
    assert found.dead_band == pytest.approx(vehicle.dead_band, rel=0.2)  # where the line meets zero
    assert found.time_constant == pytest.approx(vehicle.speed_time_constant, rel=0.1)
    assert found.steering_gain == pytest.approx(9.42e-5, rel=0.05)  # as it is found by hand
    assert 0.01 < found.steering_lag < 0.05
