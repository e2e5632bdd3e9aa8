"""Compiles what a simulation spends its time in, when it is asked to (`make compiled`); else there is nothing to do.

mypyc makes one C extension of the modules below. Their results stay the same to the last bit, and whoever edits one of
them runs them all from their sources again (`txt1/compiled.py`).
"""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from setuptools import Extension, setup

PACKAGE = Path(__file__).parent / "txt1"

MODULES = {
    "kernel": ["clock", "jumps", "scheduler", "statistics", "ticks"],
    "model": ["kinematics", "light", "odometry"],
    "sim": ["battery", "light", "obstacles", "room", "simulator", "vehicle", "world"],
    "control": ["limits", "runaway"],
    "tasks": ["controller", "display", "encoder", "odometry", "serial", "state"],
    "learning": ["light", "policy", "task", "thesis", "trial"],
}
"""By package. What fits is typed, runs often, and holds nothing that others replace."""

FLAGS = ["-ffp-contract=off"]
"""A product and a sum are two roundings, as they are in Python, on every processor."""


def extensions() -> list[Extension]:
    """The library and its modules; none where they are there already."""
    from mypyc.build import mypycify

    spec = spec_from_file_location("compiled", PACKAGE / "compiled.py")
    assert spec is not None and spec.loader is not None
    compiled = module_from_spec(spec)
    spec.loader.exec_module(compiled)
    sources = [PACKAGE / package / f"{module}.py" for package, modules in MODULES.items() for module in modules]
    library = compiled.library(source.parent for source in sources)
    wanted = {compiled.library_file(PACKAGE, library)}
    wanted |= {source.with_name(source.stem + compiled.SUFFIX) for source in sources}
    there = set(PACKAGE.rglob(f"*{compiled.SUFFIX}"))
    if there == wanted:
        return []
    for outdated in there:
        outdated.unlink()
    made: list[Extension] = mypycify(
        ["--follow-imports=silent", *(str(source.relative_to(PACKAGE.parent)) for source in sources)],
        opt_level="2",
        group_name=f"txt1.{library}",
    )
    for one in made:  # a warning of tomorrow's compiler is no reason to do without
        one.extra_compile_args = [flag for flag in one.extra_compile_args if flag != "-Werror"] + FLAGS
    return made


setup(ext_modules=extensions() if "build_ext" in sys.argv else [])
