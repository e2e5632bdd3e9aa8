"""Everything that a Raspberry Pi needs has a wheel for Linux on arm64; skipped where there is no package index."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
# of 64-bit Raspberry Pi OS 12 (Python 3.11, glibc 2.36), which 13 (Python 3.13, glibc 2.41) runs, too
PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_28_aarch64", "manylinux_2_34_aarch64", "manylinux_2_36_aarch64")
EXTRAS = ("", "camera", "devices", "fast", "fleet", "gamepad", "gym", "plots", "record", "teach", "view", "web")


def needed(extra: str, python: str) -> list[str]:
    """What an extra, or the base install, asks for on a Raspberry Pi with that Python."""
    there = {"python_version": python, "platform_machine": "aarch64", "sys_platform": "linux"}
    asked = map(Requirement, PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"])
    return [f"{each.name}{each.specifier}" for each in asked if each.marker is None or each.marker.evaluate(there)]


@pytest.mark.long
@pytest.mark.parametrize("python", ["3.11", "3.13"])
@pytest.mark.parametrize("extra", EXTRAS, ids=[extra or "base" for extra in EXTRAS])
def test_there_are_wheels_for_arm64(extra: str, python: str, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:", "--python-version", python]
    words += [word for platform in PLATFORMS for word in ("--platform", platform)]
    names = needed(extra, python)
    found = subprocess.run([*words, "--dest", str(tmp_path), *names], capture_output=True, text=True, check=False)
    if any(sign in found.stderr for sign in ("Max retries", "NewConnectionError", "Temporary failure in name")):
        pytest.skip("no package index")
    assert found.returncode == 0, found.stderr
    assert len(list(tmp_path.iterdir())) >= len(names)  # and what these need


def test_lgpio_is_asked_for_where_it_has_a_wheel() -> None:
    assert "lgpio>=0.2.2" in needed("devices", "3.11")
    assert not any(each.startswith("lgpio") for each in needed("devices", "3.13"))
