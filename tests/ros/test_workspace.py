"""The example in a workspace: colcon finds and builds it. `make test-ros` installs colcon's wheels."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from txt1.ros.python import clean

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]


def test_colcon_finds_both_packages_and_builds_the_example(tmp_path: Path) -> None:
    colcon = shutil.which("colcon", path=os.environ.get("TXT1_COLCON") or os.environ["PATH"])
    if colcon is None:
        pytest.skip("did not run: no colcon here: 'make test-ros' installs it where it can be had")
    source, environment = tmp_path / "src", {**clean(os.environ), "PYTHONWARNINGS": "ignore"}
    shutil.copytree(ROOT / "examples" / "ros" / "txt1_bringup", source / "txt1_bringup")
    subprocess.run([sys.executable, "-m", "txt1", "ros2", "package", str(source)], cwd=ROOT, check=True)

    def ask(*words: str) -> str:
        done = subprocess.run([colcon, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    told = [line.split() for line in ask("list").splitlines()]
    assert told == [
        ["txt1_bringup", "src/txt1_bringup", "(ros.ament_python)"],
        ["txt1_msgs", "src/txt1_msgs", "(ros.ament_cmake)"],
    ]
    ask("build", "--packages-select", "txt1_bringup")
    share = tmp_path / "install" / "txt1_bringup" / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "txt1_bringup").is_file()
    installed = {str(path.relative_to(share / "txt1_bringup")) for path in (share / "txt1_bringup").rglob("*.*")}
    names = ("txt1", "slam", "nav2", "localization", "teleop")
    assert {"config/nav2.yaml", "package.xml", *(f"launch/{name}.launch.py" for name in names)} <= installed
