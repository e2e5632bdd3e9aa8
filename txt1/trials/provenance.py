"""What a result came from: versions, platform, and a hash of the program's code."""

import hashlib
import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("txt1", "numpy", "numba", "pydantic", "stable-baselines3", "torch")


@cache
def code_hash() -> str:
    """SHA-256 of all of the package's Python files, in order of their paths; the first 16 digits."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def provenance() -> dict[str, str]:
    """Versions of what a result depends on, the platform, and the code's hash."""
    found = {"code": code_hash(), "python": sys.version.split()[0], "platform": platform.platform()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
