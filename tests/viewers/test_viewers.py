"""A recording in the viewers that can be had from PyPI, which `make test-viewers` installs."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.patience import LIMIT, TXT1

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]
SENSORS = ("imu", "laser", "camera", "depth", "gps", "vicon")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive with every simulated sensor, as a file."""
    path = tmp_path_factory.mktemp("viewers") / "run.mcap"
    sensors = [word for name in SENSORS for word in ("--set", f"sensors.{name}.driver=sim_{name}")]
    run = ["run", "--headless", "--speed", "max", "--seed", "1", "--duration", "4", "--drive=0.5,0.5"]
    subprocess.run(
        [*TXT1, *run, *sensors, "--log", str(path)], cwd=ROOT, check=True, capture_output=True, timeout=LIMIT
    )
    return path


def rerun() -> str:
    """The program `rerun`."""
    found = shutil.which("rerun", path=os.environ.get("TXT1_VIEWERS") or os.environ["PATH"])
    if found is None:
        pytest.skip("did not run: no Rerun here: 'make test-viewers' installs it where it can be had")
    return found


def said(*words: str) -> str:
    """All that a command says; it must end well."""
    done = subprocess.run(words, capture_output=True, text=True, timeout=4.0 * LIMIT)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_rerun_resolves_every_topic(recording: Path) -> None:
    told = said(rerun(), "mcap", "convert", str(recording), "-o", str(recording.with_suffix(".rrd")))
    assert "cannot be resolved" not in told and "raw data" not in told, told


def test_rerun_finds_no_fault(recording: Path) -> None:
    lines = said(rerun(), "mcap", "check", str(recording)).splitlines()
    channels = [line for line in lines if " /" in line]
    assert len(channels) > 20
    assert all(line.startswith("ok") for line in channels), channels


def test_log_view_gives_rerun_a_layout_and_scans_as_points(recording: Path, tmp_path: Path) -> None:
    program, saved = rerun(), tmp_path / "run.rrd"
    path = f"{Path(program).parent}:{os.environ['PATH']}"
    words = [*TXT1, "log", "view", str(recording), "--save", str(saved)]
    done = subprocess.run(words, cwd=ROOT, env=os.environ | {"PATH": path}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    told = said(program, "rrd", "print", str(saved))
    assert "verified without error" in said(program, "rrd", "verify", str(saved))
    lines = told.splitlines()
    assert any("/sensors/laser/points" in line and "Points3D:positions" in line for line in lines)
    assert any("/tf_static" in line and "Transform3D" in line for line in lines)
    for drawn in ("/markers/base_footprint", "/markers/room", "/odom/points"):
        assert any(drawn in line and "Points3D:positions" in line for line in lines), drawn
    for plotted in ("/odom/speeds", "/setpoint/speeds", "/pwm/outputs"):
        assert any(plotted in line and "Scalars" in line for line in lines), plotted
    assert "Blueprint" in said(program, "rrd", "stats", str(saved)) or "blueprint" in told.lower()
