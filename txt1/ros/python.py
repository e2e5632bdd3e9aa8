"""The Python of ROS: an installed ROS 2 first, else the virtual environment of `txt1 ros2 install`."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from txt1.errors import ConfigError

INSTALLED: Final = Path("/opt/ros")
# newest first; older ones have an older Python
DISTRIBUTIONS: Final = ("rolling", "lyrical", "kilted", "jazzy", "iron", "humble")
# versions whose Python or rclpy cannot run the node
OLDER: Final = ("foxy", "galactic")
# versions with Python 3.10, which has no -P; the start takes its own folder out of the search path, too
WITHOUT_P: Final = ("humble", "iron")
OWN: Final = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
"""Variables of this program's environment that another Python must not see."""
REMEDY: Final = "install ROS 2 Humble or later, or 'txt1 ros2 install' for one of its own (Linux on x86-64)"


class RosPython(NamedTuple):
    """A Python of ROS, its environment, and its origin, for people."""

    program: tuple[str, ...]
    environment: Mapping[str, str]
    where: str
    # made by `txt1 ros2 install`
    ours: bool = False


def home() -> Path:
    """Return the folder in which `txt1 ros2 install` makes its environment."""
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(os.environ.get("TXT1_ROS2_HOME") or Path(data) / "txt1" / "ros2")


def clean(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without this program's Python, whose folder in PATH would otherwise come first."""
    kept = {name: value for name, value in environment.items() if name not in OWN}
    if sys.prefix != sys.base_prefix and "PATH" in kept:
        ours = f"{sys.prefix}/bin"
        kept["PATH"] = os.pathsep.join(place for place in kept["PATH"].split(os.pathsep) if place != ours)
    return kept


def ros2() -> RosPython:
    """Return the Python for ROS 2; raises ConfigError, with the remedy, if there is none."""
    # the user has sourced a setup, perhaps with a workspace on top
    if os.environ.get("AMENT_PREFIX_PATH"):
        if (name := os.environ.get("ROS_DISTRO")) in OLDER:
            raise ConfigError(f"--ros2: this shell's is {name}: source Humble or later, or use a shell without it")
        kept = {name: os.environ[name] for name in ("LD_LIBRARY_PATH", "PYTHONPATH") if name in os.environ}
        return RosPython(_program(name), clean(os.environ) | kept, "the ROS 2 of this shell")
    for name in DISTRIBUTIONS:
        setup = INSTALLED / name / "setup.bash"
        if setup.exists():
            return RosPython(_program(name), _sourced(setup), str(INSTALLED / name))
    python = home() / "bin" / "python"
    if python.exists():
        return RosPython((str(python), "-P"), clean(os.environ), str(home()), ours=True)
    raise ConfigError(f"--ros2: there is no ROS 2 on this machine: {REMEDY}")


def _program(distribution: str | None) -> tuple[str, ...]:
    """Return the words that start the Python of a distribution."""
    return ("python3",) if distribution in WITHOUT_P else ("python3", "-P")


def _sourced(setup: Path) -> dict[str, str]:
    """Return the environment that ROS's own setup makes."""
    script = f". {shlex.quote(str(setup))} >&2 && env -0"
    done = subprocess.run(  # noqa: S603
        ["/bin/bash", "-c", script], env=clean(os.environ), capture_output=True, check=False
    )
    if done.returncode != 0:
        raise ConfigError(
            f"--ros2: {setup} fails: {done.stderr.decode(errors='replace').strip()[-200:]}; source it yourself"
        )
    pairs = (line.partition("=") for line in done.stdout.decode(errors="replace").split("\0") if "=" in line)
    return {name: value for name, _, value in pairs}
