"""Debian's mrpt-apps on a log: icp-slam and rbpf-slam, with settings that come with them (mrpt-common).

    apt-get install mrpt-apps mrpt-common

Neither closes loops. Only windows and pictures are switched off in their settings.
"""

import re
import resource
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

import numpy as np

from txt1.mapping.carmen_logs import Array, Log

SETTINGS: Final = Path("/usr/share/mrpt/config_files")
PROGRAMS: Final = {
    "icp-slam": "icp-slam/icp-slam_demo_classic.ini",
    "rbpf-slam": "rbpf-slam/gridmapping_RBPF_ICPbased_intel.ini",
}
QUIET: Final = r"^(SHOW_PROGRESS_3D_REAL_TIME|SHOW_PROGRESS_IN_WINDOW|SAVE_3D_SCENE|SAVE_MAP_IMAGES)\s*=.*"
PATIENCE: Final = 1800.0  # s


class Mapped(NamedTuple):
    """What a program made of a log."""

    poses: Array | None
    """None: it did not run."""
    spent: float
    """Processor time of a scan, s."""
    told: str
    """Why it did not run."""


def mapped(program: str, log: Log, odometry: Array) -> Mapped:
    """Have a program map a log."""
    settings = SETTINGS / PROGRAMS[program]
    if shutil.which(program) is None or shutil.which("carmen2rawlog") is None or not settings.exists():
        return Mapped(None, 0.0, "not installed: apt-get install mrpt-apps mrpt-common")
    with TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / "drive.log").open("w", encoding="ascii") as file:
            for scan, pose in zip(log.scans, odometry, strict=True):
                ranges = " ".join(f"{each:.3f}" for each in scan.ranges)
                place = " ".join(f"{each:.6f}" for each in pose)
                stamp = f"{scan.time:.6f}"
                file.write(f"FLASER {len(scan.ranges)} {ranges} {place} {place} {stamp} host {stamp}\n")
        text = re.sub(QUIET, r"\1=0", settings.read_text("utf-8"), flags=re.MULTILINE)
        text = re.sub(r"^logOutput_dir\s*=.*", f"logOutput_dir={folder}/out", text, flags=re.MULTILINE)
        (folder / "settings.ini").write_text(text, "utf-8")
        rawlog, found = folder / "drive.rawlog", folder / "out" / "log_estimated_path.txt"
        before = 0.0
        for command in (["carmen2rawlog", "-q", "-w", "-i", folder / "drive.log", "-o", rawlog],
                        [program, folder / "settings.ini", rawlog]):  # fmt: skip
            before = _spent()
            try:
                done = subprocess.run(
                    command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE, check=False
                )
            except subprocess.TimeoutExpired:
                return Mapped(None, 0.0, f"{command[0]} was not done in {PATIENCE:g} s")
            if done.returncode:
                return Mapped(None, 0.0, f"{command[0]} ended with {done.returncode}")
        path = np.loadtxt(found, ndmin=2)
        # a step of odometry and a scan take turns, and the pose after the scan counts
        poses = path[1::2, 1:4] if path.shape[1] >= 4 else path[1::2, 1:3]
        if len(poses) != len(log.scans):
            return Mapped(None, 0.0, f"{program} gave {len(poses)} poses for {len(log.scans)} scans")
        return Mapped(poses, (_spent() - before) / len(log.scans), "")


def _spent() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
