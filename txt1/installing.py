"""The command that installs an optional dependency or a plug-in into the environment in which this program runs.

txt1 is on no package index, so the command names the place that it was installed from: a checkout, a wheel, an address.
If the place is gone or unknown, the command names the packages of the extra.
"""

import json
import os
import re
import shutil
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import Any
from urllib.parse import unquote, urlsplit

from txt1.version import __version__


def installs(extras: str) -> str:
    """Return the command that installs extras, such as "record,plots", from the current directory.

    It uses the interpreter's own pip. Without pip it uses the program that made the environment: pipx or uv.
    """
    prefix = Path(sys.prefix)
    if sys.prefix != sys.base_prefix:
        # pipx leaves this file in each environment, wherever PIPX_HOME is
        if (prefix / "pipx_metadata.json").exists():
            if prefix.parent.name == "venvs":
                # pipx runs its installer in the environment's folder
                return f"pipx runpip {quote(prefix.name)} install {_source(extras, near=False)}"
            return f"pipx run --spec {_source(extras)} txt1"
        # folder of uv's environments for a single run
        if "archive-v0" in prefix.parts:
            return f"uvx --from {_source(extras)} txt1"
    return f"{_installer()} {_source(extras)}"


def installs_package(name: str, options: str = "") -> str:
    """Return the command that installs a package, or the package in a folder, into this environment.

    `options` are pip's, such as "-e ".
    """
    prefix, words = Path(sys.prefix), f"{options}{quote(name)}"
    if (prefix / "pipx_metadata.json").exists() and prefix.parent.name == "venvs":
        return f"pipx runpip {quote(prefix.name)} install {words}"
    return f"{_installer()} {words}"


def _installer() -> str:
    """Return the beginning of a command that installs into this environment: pip's, or that of whoever made it."""
    pip = f"{interpreter()} -m pip install"
    if find_spec("pip") is not None:
        return pip
    if (Path(sys.prefix) / "conda-meta").is_dir():
        return f"conda install --prefix {quote(sys.prefix)} pip && {pip}"
    if sys.prefix != sys.base_prefix or shutil.which("uv"):
        return f"uv pip install --python {quote(sys.executable)}"
    return f"{interpreter()} -m ensurepip && {pip}"


def distribution_of(plugin: str) -> str:
    """Return the name of a plug-in's distribution; LeRobot finds its plug-ins by the beginning of theirs."""
    return "lerobot_robot_txt1" if plugin == "lerobot" else f"txt1-{plugin}"


def installs_plugin(name: str, extra: str = "") -> str:
    """Return the command that installs a plug-in of this repository, the folder `name` below plugins/, with an extra.

    A plug-in comes from where txt1 came: the folder of a checkout, the wheel beside txt1's, or the same address. Only
    if txt1 came from an index, it is the distribution of this name there.
    """
    prefix = Path(sys.prefix)
    if (prefix / "pipx_metadata.json").exists() and prefix.parent.name == "venvs":
        # pipx runs its installer in the environment's folder
        return f"pipx runpip {quote(prefix.name)} install {_plugin_source(name, extra, near=False)}"
    return f"{_installer()} {_plugin_source(name, extra)}"


def needs_extra(extra: str, plugin: str = "") -> str:
    """Return the end of a sentence about what needs an extra, of txt1 or of a plug-in: the command that installs it.

    While an import fails although its package is there, it is the fault of that package: a library of the system.
    """
    fault = sys.exception()
    if isinstance(fault, ImportError) and not isinstance(fault, ModuleNotFoundError):
        return f"has its package, but that does not load: {fault}; install what it names"
    if not plugin:
        return f"needs the extra '{extra}': {installs(extra)}"
    return f"needs the extra '{extra}' of {distribution_of(plugin)}: {installs_plugin(plugin, extra)}"


def _plugin_source(name: str, extra: str, near: bool = True) -> str:
    """Return the requirement for pip that installs a plug-in, quoted; a path is relative if `near`."""
    told, path = _origin()
    named, with_extra = distribution_of(name), f"[{extra}]" if extra else ""
    wheel = f"{named.replace('-', '_')}-{__version__}-py3-none-any.whl"
    folder = os.path.join(path, "plugins", name)
    if path.endswith(".whl"):
        return quote(f"{_place(os.path.join(os.path.dirname(path), wheel), near)}{with_extra}")
    if not path and str(told["url"]).endswith(".whl"):
        return quote(f"{named}{with_extra} @ {str(told['url']).rpartition('/')[0]}/{wheel}")
    if not path and "vcs_info" in told:
        address = f"{told['vcs_info']['vcs']}+{told['url']}#subdirectory=plugins/{name}"
        return quote(f"{named}{with_extra} @ {address}")
    if path and os.path.isfile(os.path.join(folder, "pyproject.toml")):
        editable = "-e " if told.get("dir_info", {}).get("editable") else ""
        return editable + quote(f"{_place(folder, near)}{with_extra}")
    return quote(f"{named}{with_extra}")


def interpreter() -> str:
    """Return the shell word for this Python in the current directory, as short as possible."""
    for name in ("python", "python3"):
        if shutil.which(name) == sys.executable:
            return name
    return quote(_near(sys.executable))


def _near(path: str) -> str:
    """Return a path relative to the current directory if it lies inside."""
    inside = os.path.relpath(path)
    return path if inside.startswith("..") else inside


def _source(extras: str, near: bool = True) -> str:
    """Return the requirement for pip that installs extras, quoted: an existing folder or wheel, an address, or
    packages.

    The path is relative to the current directory if `near`, else absolute.
    """
    told, path = _origin()
    if not path:
        return quote(f"txt1[{extras}] @ {told['url']}")
    if os.path.isfile(path) or os.path.isfile(os.path.join(path, "pyproject.toml")):
        place = _place(path, near)
        return f"{'-e ' if told.get('dir_info', {}).get('editable') else ''}{quote(f'{place}[{extras}]')}"
    try:
        requires = distribution("txt1").requires or []
    except PackageNotFoundError:
        requires = []
    return " ".join(quote(each) for extra in extras.split(",") for each in _packages(extra, requires)) or extras


def _origin() -> tuple[dict[str, Any], str]:
    """Return what pip noted of txt1's origin, and its folder or file; "" if it came from an address."""
    try:
        told: dict[str, Any] = json.loads(distribution("txt1").read_text("direct_url.json") or "{}")
    except PackageNotFoundError:
        told = {}
    address = str(told.get("url", ""))
    if address and not address.startswith("file:"):
        return told, ""
    return told, unquote(urlsplit(address).path) or str(Path(__file__).parents[1])


def _word(place: str) -> str:
    """Return a path that pip does not take for the name of a package."""
    return place if place == "." or os.path.isabs(place) else f"./{place}"


def _place(path: str, near: bool) -> str:
    """Return a path for pip, relative to the current directory if `near`."""
    return _word(_near(path)) if near else path


def _packages(extra: str, requires: list[str]) -> list[str]:
    """Return the requirements of an extra for pip's command line, without the markers that make them optional."""
    own = re.compile(rf"""\s*;?\s*(?:\band\s+)?extra == ["']{re.escape(extra)}["']$""")
    return [re.sub(r"; \((.*)\)$", r"; \1", own.sub("", each)) for each in requires if own.search(each)]
