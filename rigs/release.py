"""The number of a release, and its files beside wheels and sdist: tested versions as constraints, and checksums.

    python -m rigs.release version 0.3.0
    python -m rigs.release constraints dist/constraints.txt build/users/bin/python
    python -m rigs.release sums dist

The constraints are read from the environment that runs this command. `make release` runs it in the environment in which
the tests have just passed. From the requirements of txt1 and its plug-ins, the base and every extra, it follows each
requirement to the packages that are installed, and names their versions. What the tests replace by fakes is installed
in the environment of the other Python, a user's with all extras: there everything that our modules import of it is
imported, and its line says so. What is in neither stands in a comment: the packages that need PyTorch.
"""

import ast
import json
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from datetime import date
from hashlib import sha256
from importlib.metadata import Distribution, PackageNotFoundError, distribution, packages_distributions
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from txt1.installing import distribution_of
from txt1.unknown import PLUGINS

ROOT: Final = Path(__file__).parents[1]
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
    if shutil.which("git") is None:
        return "unknown"
    told = []
    for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"]):
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode:
            return "unknown"
        told.append(done.stdout.strip())
    return f"{told[0]} and changes" if told[1] else told[0]


def imports_of(modules: Sequence[str]) -> list[str]:
    """Return the import statements of txt1 and its plug-ins that bring something of these modules."""
    found = set()
    for file in (*ROOT.glob("txt1/**/*.py"), *ROOT.glob("plugins/*/*/**/*.py")):
        text = file.read_text("utf-8")
        # few files name one, and each takes milliseconds to parse
        for node in ast.walk(ast.parse(text)) if any(module in text for module in modules) else ():
            if isinstance(node, ast.Import):
                node.names = [one for one in node.names if one.name.partition(".")[0] in modules]
                found |= {ast.unparse(node)} if node.names else set()
            elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in modules:
                found.add(ast.unparse(node))
    return sorted(found)


def imported() -> dict[str, str]:
    """Import what our modules import of the packages in this environment, and return the packages' versions."""
    found, _ = versions()
    modules = [
        module for module, owners in packages_distributions().items() if found.keys() & map(canonicalize_name, owners)
    ]
    for statement in imports_of(modules):
        try:
            exec(statement, {})
        except ImportError as error:
            raise SystemExit(f"{statement}: {error}; for libusb-1.0.so.0: apt-get install libusb-1.0-0") from None
    return found


def users_versions(python: str) -> dict[str, str]:
    """Return what another Python imports so."""
    words = [python, "-m", "rigs.release", "imported"]
    done = subprocess.run(words, cwd=ROOT, check=False, stdout=subprocess.PIPE, text=True)
    # it has told why
    return dict(json.loads(done.stdout)) if done.returncode == 0 else sys.exit(done.returncode)


def constraints(users: dict[str, str] | None = None) -> str:
    """Return the text of the constraints file; `users` are the versions that a user's environment imported."""
    found, missing = versions()
    alone = {name: version for name, version in (users or {}).items() if name not in found}
    missing = [name for name in missing if name not in alone]
    return "\n".join(
        [
            f"# txt1 {distribution('txt1').version} was tested with these versions.",
            f"# Python {platform.python_version()}, {platform.system()} {platform.machine()}, commit {commit()}.",
            "# python -m pip install -c constraints.txt WHEEL",
            *(f"# not tested with these, as it was not installed: {name}" for name in missing),
            *(f"{name}=={version}" for name, version in found.items()),
            *(
                f"{name}=={version}  # in a user's environment: our imports of it work"
                for name, version in alone.items()
            ),
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


def set_version(root: Path, version: str, day: str) -> None:
    """Write a version and its day into each file that names it; the changelog's "Unreleased" becomes its section.

    Raises:
        ValueError: the version is none, the changelog has no "Unreleased", or changes/ has files that are not in it.

    """
    if re.fullmatch(r"\d+\.\d+\.\d+", version) is None:
        raise ValueError(f"{version!r} is no version: give it as 1.2.3")
    if waiting := sorted(file.name for file in (root / "changes").glob("*.*.md")):
        raise ValueError(f'changes/ has {", ".join(waiting)}: fold them into CHANGELOG.md\'s "Unreleased"')
    named = {
        "pyproject.toml": [(r'(?m)^(version = ")[\d.]+', rf"\g<1>{version}")],
        "txt1/version.py": [(r'(__version__ = ")[\d.]+', rf"\g<1>{version}")],
        "CITATION.cff": [(r"(?m)^(version: ).*", rf"\g<1>{version}"), (r"(?m)^(date-released: ).*", rf"\g<1>{day}")],
        "CHANGELOG.md": [(r"(?m)^## Unreleased$", f"## {version} ({day})")],
    }
    for plugin in root.glob("plugins/*/pyproject.toml"):
        needs = (r'(?m)^(dependencies = \["txt1==)[\d.]+', rf"\g<1>{version}")
        named[str(plugin.relative_to(root))] = [*named["pyproject.toml"], needs]
    written = {}
    for name, changes in named.items():
        text = (root / name).read_text("utf-8")
        for pattern, new in changes:
            text, count = re.subn(pattern, new, text)
            if count != 1:
                raise ValueError(f"{name} has {count} lines like {pattern!r}, it needs one")
        written[name] = text
    for name, text in written.items():
        (root / name).write_text(text, encoding="utf-8")


def main(words: list[str]) -> None:
    """Write constraints or checksums, or print versions or a section of the changelog."""
    match words:
        case ["constraints", file, *users]:
            Path(file).parent.mkdir(parents=True, exist_ok=True)
            Path(file).write_text(constraints(users_versions(*users) if users else None), encoding="utf-8")
        case ["version", version]:
            set_version(ROOT, version, date.today().isoformat())
        case ["imported"]:
            print(json.dumps(imported()))
        case ["sums", folder]:
            (Path(folder) / SUMS).write_text(sums(Path(folder)), encoding="utf-8")
        case ["notes", version]:
            print(notes((ROOT / "CHANGELOG.md").read_text("utf-8"), version), end="")
        case _:
            raise SystemExit(
                "python -m rigs.release constraints FILE [PYTHON] | imported | sums FOLDER | notes VERSION"
            )


if __name__ == "__main__":
    main(sys.argv[1:])
