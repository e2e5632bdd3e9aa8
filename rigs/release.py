"""The files that a release has beside wheels and sdist: tested versions as constraints for pip, and checksums.

    python -m rigs.release constraints dist/constraints.txt
    python -m rigs.release sums dist

The constraints are read from the environment that runs this command. `make release` runs it in the environment in which
the tests have just passed. From the requirements of txt1 and its plug-ins, the base and every extra, it follows each
requirement to the packages that are installed, and names their versions. What is not installed was not tested: it
stands in a comment.
"""

import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from hashlib import sha256
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from txt1.installing import distribution_of
from txt1.unknown import PLUGINS

SUMS: Final = "SHA256SUMS"

OURS: Final = ("txt1", *map(distribution_of, PLUGINS))
"""The distributions of this repository."""


def wanted(package: Distribution, extras: set[str]) -> list[Requirement]:
    """Return the requirements of a package with these extras that hold on this computer."""
    each = map(Requirement, package.requires or [])
    return [
        one
        for one in each
        if one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in ("", *extras))
    ]


def versions(names: Sequence[str] = OURS) -> tuple[dict[str, str], list[str]]:
    """Return the version of each installed package that `names` need, and the names of those that are missing.

    All extras of `names` are counted. The packages themselves are not among the versions.
    """
    found: dict[str, str] = {}
    missing: set[str] = set()
    seen: set[tuple[str, frozenset[str]]] = set()
    waiting: list[Requirement] = []
    for root in map(distribution, names):
        waiting += wanted(root, set(root.metadata.get_all("Provides-Extra") or ()))
    while waiting:
        one = waiting.pop()
        key = canonicalize_name(one.name), frozenset(one.extras)
        if key in seen:
            continue
        seen.add(key)
        try:
            package = distribution(one.name)
        except PackageNotFoundError:
            missing.add(key[0])
            continue
        found[key[0]] = package.version
        waiting += wanted(package, one.extras)
    for name in names:
        found.pop(canonicalize_name(name), None)
    return dict(sorted(found.items())), sorted(missing)


def commit() -> str:
    """Return the commit of the sources with "and changes" where files differ from it; "unknown" without git."""
    root = Path(__file__).parents[1]
    if shutil.which("git") is None:
        return "unknown"
    told = []
    for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"]):
        done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
        if done.returncode:
            return "unknown"
        told.append(done.stdout.strip())
    return f"{told[0]} and changes" if told[1] else told[0]


def constraints() -> str:
    """Return the text of the constraints file."""
    found, missing = versions()
    return "\n".join(
        [
            f"# txt1 {distribution('txt1').version} was tested with these versions.",
            f"# Python {platform.python_version()}, {platform.system()} {platform.machine()}, commit {commit()}.",
            "# python -m pip install -c constraints.txt WHEEL",
            *(f"# not tested, as it was not installed: {name}" for name in missing),
            *(f"{name}=={version}" for name, version in found.items()),
            "",
        ]
    )


def sums(folder: Path) -> str:
    """Return a line for each file of the folder, as `sha256sum --check` reads them."""
    files = sorted(each for each in folder.iterdir() if each.is_file() and each.name != SUMS)
    return "".join(f"{sha256(each.read_bytes()).hexdigest()}  {each.name}\n" for each in files)


def notes(changelog: str, version: str) -> str:
    """Return the changelog's section of a version, without its heading.

    Raises:
        ValueError: there is none.

    """
    found = re.search(rf"(?ms)^## {re.escape(version)}\b[^\n]*\n(.*?)(?=^## |\Z)", changelog)
    if found is None:
        raise ValueError(f"CHANGELOG.md has no section '## {version}': write one")
    return found[1].strip() + "\n"


def main(words: list[str]) -> None:
    """Write the constraints to a file, a folder's checksums into it, or print a version's section of the changelog."""
    match words:
        case ["constraints", file]:
            Path(file).parent.mkdir(parents=True, exist_ok=True)
            Path(file).write_text(constraints(), encoding="utf-8")
        case ["sums", folder]:
            (Path(folder) / SUMS).write_text(sums(Path(folder)), encoding="utf-8")
        case ["notes", version]:
            changelog = Path(__file__).parents[1] / "CHANGELOG.md"
            print(notes(changelog.read_text("utf-8"), version), end="")
        case _:
            raise SystemExit("python -m rigs.release constraints FILE | sums FOLDER | notes VERSION")


if __name__ == "__main__":
    main(sys.argv[1:])
