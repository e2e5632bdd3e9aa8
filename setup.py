"""Makes C of what a simulation spends its time in, when a wheel is built with ``COMPILE_TXT1=1``; else does nothing.

mypyc compiles the modules below into one extension, with the same results to the last bit. The wheel has their sources
too, so tracebacks show them.
"""

import os
import re
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

from setuptools import setup
from setuptools.command.build_py import build_py

ADDRESS = os.environ.get("TXT1_ADDRESS", "")
"""Of the public repository, such as https://example.org/lab/txt1: given by whoever publishes, for links and URLs."""
PAGES = {"Documentation": "docs/index.md", "Changelog": "CHANGELOG.md"}
LINK = re.compile(r"(!?)\[([^][]*)\]\((?!https?://|#)([^)]*)\)")


def long_description(text, address):
    """Return the README with links that lead to `address`; without one they are the names of files, and no pictures."""

    def link(found):
        picture, words, place = found.groups()
        if address:
            return f"{picture}[{words}]({address}/{'raw' if picture else 'blob'}/main/{place})"
        if picture:
            return ""
        return words if words == place else f"{words} ({place})"

    return LINK.sub(link, text)


SHIPPED = ("firmware/pico", "config/vehicles", "config/maps", "config/foxglove")


class WithFiles(build_py):
    """Puts these folders into the package; an editable install finds them in the source tree (txt1/resources.py)."""

    def run(self) -> None:
        """Build."""
        super().run()
        if not self.editable_mode:
            for folder in filter(os.path.isdir, SHIPPED):
                there = Path(self.build_lib, "txt1", "data", folder)
                copytree(folder, there, ignore=ignore_patterns("__pycache__"), dirs_exist_ok=True)


MODULES = {
    "kernel": ["clock", "jumps", "scheduler", "statistics", "ticks"],
    "model": ["kinematics", "odometry"],
    "sim": ["battery", "lamp", "obstacles", "room", "vehicle", "dynamics", "sliding", "world"],
    "control": ["commander", "limits", "obedience", "pid", "sight"],
    "estimation": ["filter", "fusion", "hypotheses", "judging", "sensors", "task"],
    "tasks": ["battery", "controller", "encoder", "panel", "serial", "state"],
    "record": ["mcap_records", "recorder"],
    "telemetry": ["bus"],
    "learning": ["light_direction", "task", "thesis", "trial"],
}
"""By package: what is typed, runs often, and is neither given values of a user's nor replaced in part.

So the driver, the messages and the simulated hardware layer are not here, which costs a run of one robot 1.5 per cent:
compiled, they would refuse a wrong value with a TypeError of their own, and nobody could replace their methods.
Nor is what a snapshot tells in nested tuples: they would lose the types by which they are read back; nor
`model.light_sensors`: mypyc 2.4 takes a constant of tuples of floats for not set where it is a parameter's default, and
a tuple of floats likewise, unless its type is `tuple[float, ...]`. `estimation.sensors` makes floats of all values.
"""

COMPILE = os.environ.get("COMPILE_TXT1") == "1"


def main() -> None:
    """Build, and compile if that was asked for."""
    extensions = []
    if COMPILE and "egg_info" not in sys.argv:  # by which pip asks what it needs for that, before it has mypy
        from mypyc.build import mypycify

        sources = [str(Path("txt1", package, f"{name}.py")) for package, names in MODULES.items() for name in names]
        extensions = mypycify(["--follow-imports=silent", *sources], opt_level="2", group_name="txt1.compiled")
        for extension in extensions:
            # a warning of tomorrow's compiler is no error; a product and a sum are two roundings, as they are in Python
            flags = [flag for flag in extension.extra_compile_args if flag != "-Werror"]
            extension.extra_compile_args = [*flags, "-ffp-contract=off"]
    setup(
        cmdclass={"build_py": WithFiles},
        ext_modules=extensions,
        setup_requires=["mypy>=1.10"] if COMPILE else [],
        long_description=long_description(Path("README.md").read_text(encoding="utf-8"), ADDRESS),
        long_description_content_type="text/markdown",
        project_urls={"Source": ADDRESS, **{name: f"{ADDRESS}/blob/main/{page}" for name, page in PAGES.items()}}
        if ADDRESS
        else {},
    )


if __name__ == "__main__":
    main()
