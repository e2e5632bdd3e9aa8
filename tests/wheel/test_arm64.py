"""Everything that a Raspberry Pi needs has a wheel for Linux on arm64; skipped where there is no package index."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
# of 64-bit Raspberry Pi OS 12 (glibc 2.36) and what is older
PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_28_aarch64", "manylinux_2_34_aarch64")
EXTRAS = ("", "pi", "record", "view", "gps", "gamepad", "web", "camera")


@pytest.mark.long
@pytest.mark.parametrize("extra", EXTRAS, ids=[extra or "base" for extra in EXTRAS])
def test_there_are_wheels_for_arm64(extra: str, tmp_path: Path) -> None:
    needed = PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"]
    words = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--only-binary=:all:",
        "--no-deps",
        "--python-version",
        "3.11",
    ]
    words += [word for platform in PLATFORMS for word in ("--platform", platform)]
    found = subprocess.run([*words, "--dest", str(tmp_path), *needed], capture_output=True, text=True, check=False)
    if any(sign in found.stderr for sign in ("Max retries", "NewConnectionError", "Temporary failure in name")):
        pytest.skip("no package index")
    assert found.returncode == 0, found.stderr
    assert len(list(tmp_path.iterdir())) == len(needed)
