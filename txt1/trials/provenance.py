"""The origin of a result: versions, platform, and a hash of the code that made it."""

import hashlib
import platform
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Final

from txt1.unknown import PLUGINS

PACKAGES: Final = ("txt1", "numpy", "numba", "pydantic")
SHOWS: Final = (
    "__main__.py", "bridges/", "cli/", "experiments/figures.py", "experiments/report.py", "fleet/console.py",
    "fleet/page.py", "fleet/screen.py", "gamepad/", "kit/far_end.py", "kit/options.py", "kit/findings.py",
    "kit/verdicts.py", "learning/plots.py", "record/", "ros/", "sidecar.py", "ui/", "web/",
)  # fmt: skip
"""Code that only shows, stores or passes on the robot's behaviour, so no result depends on it.

All other code is hashed.
"""


@cache
def code_hash(*more: Path) -> str:
    """Return the SHA-256 of the package's code that makes results (see `SHOWS`), of the installed plug-ins' code, and
    of more files; the first 16 digits.
    """
    specs = filter(None, (find_spec(f"txt1_{plugin}") for plugin in PLUGINS))
    folders = [Path(folder) for spec in specs for folder in spec.submodule_search_locations or ()]
    beside = {f"{one.name}/{file.relative_to(one).as_posix()}": file for one in folders for file in one.rglob("*.py")}
    return hash_of(Path(__file__).parents[1], beside | {f"beside/{file.name}": file for file in more})


def hash_of(root: Path, more: Mapping[str, Path] = MappingProxyType({})) -> str:
    """Return the same hash for a package in a folder, and of more files by their names."""
    digest = hashlib.sha256()
    files = {path.relative_to(root).as_posix(): path for path in root.rglob("*.py")}
    made = {name: path for name, path in files.items() if not name.startswith(SHOWS)}
    for name, path in sorted((made | dict(more)).items()):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def provenance(*packages: str) -> dict[str, str]:
    """Return the versions on which a result depends, also of these packages, the platform, and the hash of the code."""
    found = {"code": code_hash(), "python": sys.version.split()[0], "platform": platform.platform()}
    for name in (*PACKAGES, *packages):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
