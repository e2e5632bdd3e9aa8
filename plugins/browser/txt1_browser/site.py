"""Makes the folder of files that a browser needs: Python (Pyodide), packages, txt1, and the page of `txt1 run --web`.

How it works. Pyodide comes from npm; of its files five are needed. pydantic's compiled half has a wheel for browsers at
the index of Python's packages. All other packages are plain Python, and are taken from this computer's environment, so
the browser runs what was tested here. They become one archive, with their bytecode by Pyodide's own Python where there
is node. The page's files are those of txt1/web/static; index.html has another script, which makes the page's line to
the robot's worker in place of a socket.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from txt1.errors import ConfigError
from txt1.resources import PACKAGE, resource

PYODIDE: Final = "314.0.7"
"""Version at npm; its Python is 3.14."""
PLATFORM: Final = ("pyemscripten_2026_0_wasm32", "314", "cp314")
NEEDED: Final = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
PACKAGES: Final = (
    "annotated-types",
    "mcap",
    "mcap-ros2-support",
    "mypy-extensions",
    "pydantic",
    "PyYAML",
    "typing-extensions",
    "typing-inspection",
)
COMPILED: Final = "pydantic-core"
# folders of the source tree that a wheel of txt1 has inside (setup.py)
SHIPPED: Final = ("config/vehicles", "config/maps")
HERE: Final = Path(__file__).parent
# a browser loads no module from disk, so the page says it by itself
FROM_DISK: Final = """<script>
if (location.protocol === "file:") addEventListener("load", () => {
  reason.hidden = false
  reason.textContent = "a file on disk cannot run the robot: python -m http.server in this folder, then http://localhost:8000"
})
</script>"""
SCRIPT: Final = '<script type="module" src="app.js"></script>'


def build(folder: Path, pyodide: Path | None, tell: Callable[[str], None]) -> int:
    """Make the folder, which must be new, empty or an earlier one; return its size in bytes.

    `pyodide` is a folder or an npm package of Pyodide; None gets it from npm. Raises ConfigError.
    """
    if folder.exists() and (not folder.is_dir() or (any(folder.iterdir()) and not (folder / "files.json").exists())):
        raise ConfigError(f"-o {folder}: something else is there; name a new folder")
    with TemporaryDirectory() as temporary:
        work = Path(temporary, "site")
        work.mkdir()
        tell("getting Pyodide from npm" if pyodide is None else f"taking Pyodide from {pyodide}")
        _pyodide(work / "pyodide", pyodide, Path(temporary))
        tell("getting pydantic's compiled half for browsers")
        wheel = _wheel(Path(temporary))
        tell("packing Python's packages and txt1")
        archive(work / "packages.zip", wheel)
        if shutil.which("node"):
            tell("compiling them by Pyodide's Python")
            run(["node", str(HERE / "compile.mjs"), str(work / "pyodide"), str(work / "packages.zip")], work, "node")
        else:
            tell("node is not installed here, so the browser compiles them at each start, which takes some seconds")
        for each in (*(PACKAGE / "web" / "static").iterdir(), *(HERE / "static").iterdir()):
            if each.is_file() and not each.name.startswith("sign-in"):
                shutil.copyfile(each, work / each.name)
        _index(work / "index.html")
        _list(work)
        if folder.exists():
            shutil.rmtree(folder)
        shutil.copytree(work, folder)
    return sum(each.stat().st_size for each in folder.rglob("*") if each.is_file())


def _pyodide(target: Path, given: Path | None, work: Path) -> None:
    """Put Pyodide's files into a folder; raises ConfigError."""
    if given is None:
        given = work / run(["npm", "pack", "--silent", f"pyodide@{PYODIDE}"], work, "npm").splitlines()[-1]
    folder = given
    if given.is_file():
        folder = work / "package"
        try:
            shutil.unpack_archive(given, work, "gztar", filter="data")
        except (OSError, shutil.ReadError) as error:
            raise ConfigError(f"--pyodide {given}: no package 'pyodide' of npm: {error}") from None
    target.mkdir()
    for name in NEEDED:
        if not (folder / name).is_file():
            raise ConfigError(f"--pyodide {given}: {name} is not in it; give the package 'pyodide' of npm")
        shutil.copyfile(folder / name, target / name)


def _wheel(work: Path) -> Path:
    """Return the wheel of pydantic's compiled half for browsers, of the version that is installed here."""
    platform, python, abi = PLATFORM
    wanted = f"{COMPILED}=={distribution(COMPILED).version}"
    options = ["--no-deps", "--only-binary", ":all:", "--platform", platform, "--python-version", python, "--abi", abi]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", *options]
    run([*command, "--dest", str(work), wanted], work, "pip")
    return next(work.glob("pydantic_core-*.whl"))


def run(command: list[str], work: Path, program: str) -> str:
    """Run a program and return what it prints; raises ConfigError, with the last line of its error."""
    try:
        done = subprocess.run(command, cwd=work, capture_output=True, text=True, check=False)  # noqa: S603
    except FileNotFoundError:
        raise ConfigError(f"{program}: it is not installed here; install it, or give --pyodide a folder") from None
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no reason was given"]
        raise ConfigError(f"'{' '.join(command[:3])} ...' failed: {lines[-1]}")
    return done.stdout


def archive(target: Path, wheel: Path) -> None:
    """Write the archive of all packages: those of the environment, the wheel, txt1, and this package."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for place, file in sorted({**dict(_installed()), **dict(_own())}.items()):
            archive.write(file, place)
        with zipfile.ZipFile(wheel) as compiled:
            for name in compiled.namelist():
                archive.writestr(name, compiled.read(name))


def _installed() -> Iterator[tuple[str, Path]]:
    """Yield place and file of each plain-Python file of the packages, and their metadata."""
    for name in PACKAGES:
        try:
            found = distribution(name).files or []
        except PackageNotFoundError:
            raise ConfigError(f"{name}: it is not installed here; pip install {name}") from None
        for each in found:
            if each.suffix == ".py" or each.name in ("METADATA", "py.typed"):
                yield each.as_posix(), Path(str(each.locate()))


def _own() -> Iterator[tuple[str, Path]]:
    """Yield place and file of everything of txt1 that a robot in a browser may need."""
    for file in sorted(PACKAGE.rglob("*")):
        inside = file.relative_to(PACKAGE)
        if file.is_file() and "__pycache__" not in inside.parts and "static" not in inside.parts:
            yield f"txt1/{inside.as_posix()}", file
    for name in SHIPPED:
        for file in sorted(resource(name).rglob("*")):
            if file.is_file():
                yield f"txt1/data/{name}/{file.relative_to(resource(name)).as_posix()}", file
    for file in HERE.glob("*.py"):
        yield f"txt1_browser/{file.name}", file


def _index(page: Path) -> None:
    text = page.read_text()
    assert text.count(SCRIPT) == 1
    page.write_text(text.replace(SCRIPT, f'<script type="module" src="boot.js"></script>\n{FROM_DISK}'))


def _list(folder: Path) -> None:
    """Write files.json, the names of all files, and a version that changes with them; offline.js has the same."""
    files = sorted(each.relative_to(folder).as_posix() for each in folder.rglob("*") if each.is_file())
    digest = hashlib.sha256()
    for each in files:
        digest.update(each.encode() + b"\0" + hashlib.sha256((folder / each).read_bytes()).digest())
    listed = json.dumps({"version": digest.hexdigest()[:16], "files": files})
    (folder / "files.json").write_text(listed)
    offline = folder / "offline.js"
    offline.write_text(f"const site = {listed}\n{offline.read_text()}")
