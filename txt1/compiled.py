"""Whether what was compiled may be used.

`make compiled` puts a C extension beside each of the modules that a simulation spends its time in, and Python prefers
it to the source. They are one library with a digest in its name: of the sources in all the folders they come from, as
constants of the one are compiled into the other. When a source there has been edited since, all of the extensions are
left aside and the sources run, as they do with ``PURE_PYTHON=1`` in the environment.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from hashlib import sha256
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, FileFinder, ModuleSpec, SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

SUFFIX = EXTENSION_SUFFIXES[0]
"""Of this Python's own extensions."""


def library(folders: Iterable[Path]) -> str:
    """The name of the library that is compiled from the sources in these folders."""
    digest = sha256()
    for folder in sorted(set(folders)):
        for source in sorted(folder.glob("*.py")):
            digest.update(source.read_bytes())
    return f"compiled_{digest.hexdigest()[:16]}"


def library_file(package: Path, name: str) -> Path:
    """Where that library is, as mypyc names it."""
    return package / f"{name}__mypyc{SUFFIX}"


def is_current(package: Path) -> bool:
    """Whether the package in this folder is compiled, from the sources that stand there now."""
    folders = [extension.parent for extension in package.rglob(f"*{SUFFIX}")]
    return library_file(package, library(folders)).exists()


class SourceFinder:
    """Finds the package's modules by their sources alone."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Where the source of one of the package's modules is; None for everything else."""
        if not name.startswith("txt1.") or path is None:
            return None
        for folder in path:
            spec = FileFinder(folder, (SourceFileLoader, SOURCE_SUFFIXES)).find_spec(name, target)
            if spec is not None:
                return spec
        return None


def source_module(name: str) -> ModuleType:
    """One of the package's modules once more, as its source says: for who needs functions that Python itself runs."""
    source = Path(__file__).parent.joinpath(*name.split(".")[1:]).with_suffix(".py")
    spec = spec_from_file_location(name, source)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def prepare(package: Path) -> bool:
    """Whether the compiled modules are used; the sources take their place where they must not be."""
    used = not os.environ.get("PURE_PYTHON") and is_current(package)
    if not used:
        sys.meta_path.insert(0, SourceFinder)
    return used
