"""A source distribution holds everything that the repository does, so its tests run from it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.long
REPOSITORY = Path(__file__).parents[2]


def test_a_source_distribution_holds_every_file_of_the_repository(tmp_path: Path) -> None:
    if shutil.which("git") is None or not (REPOSITORY / ".git").exists():
        pytest.skip("did not run: this is no repository, or git is not installed")
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(words, cwd=REPOSITORY, check=True, capture_output=True, text=True).stdout.splitlines()
    build = f"from setuptools.build_meta import build_sdist; build_sdist({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=REPOSITORY, check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        held = {name.partition("/")[2] for name in opened.getnames()}
    assert {name for name in listed if (REPOSITORY / name).is_file()} - held == set()


def test_a_wheel_holds_the_package_alone(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    copy.mkdir()
    for part in ("setup.py", "pyproject.toml", "README.md", "LICENSE", "config", "firmware", "txt1"):
        (copy / part).symlink_to(REPOSITORY / part)
    build = f"from setuptools.build_meta import build_wheel; build_wheel({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=copy, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        names = opened.namelist()
        (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        told = opened.read(metadata).decode()
    assert {name.partition("/")[0] for name in names} == {"txt1", metadata.partition("/")[0]}
    assert not [name for name in names if "__pycache__" in name or "/tests/" in name]
    assert "txt1/py.typed" in names
    assert any(name.startswith("txt1/data/config/vehicles/") for name in names)
    assert "](docs/" not in told, "links of the README lead somewhere, or are none"
