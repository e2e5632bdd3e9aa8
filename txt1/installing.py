"""The command that installs an optional dependency into the environment in which this program runs."""

import json
import os
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from urllib.parse import unquote, urlsplit


def installs(extras: str) -> str:
    """Return the command that installs extras, which works from the current directory.

    By this environment's own pip; where it has none, by who made the environment: pipx or uv, also for one run alone.
    """
    what = f"'txt1[{extras}]'"
    folder = os.path.dirname(sys.executable)
    own = os.path.join(folder, "pip")
    if os.access(own, os.X_OK):
        first = next((each for each in os.get_exec_path() if os.access(os.path.join(each, "pip"), os.X_OK)), folder)
        if first == folder:
            return f"pip install {what}"
        inside = os.path.relpath(own)
        return f"{quote(own if inside.startswith('..') else inside)} install {what}"
    if sys.prefix == sys.base_prefix:
        return f"pip install {what}"
    parts = Path(sys.prefix).parts
    if "pipx" in parts:
        return f"pipx inject txt1 {what}" if "venvs" in parts else f"pipx run --spec {_source(extras)} txt1"
    if "archive-v0" in parts:  # where uv keeps environments of one run
        return f"uvx --from {_source(extras)} txt1"
    if find_spec("pip") is not None:
        return f"{quote(sys.executable)} -m pip install {what}"
    return f"uv pip install --python {quote(sys.executable)} {what}"


def _source(extras: str) -> str:
    """Return where txt1 was installed from, with extras: a file, else its name on the package index."""
    try:
        url = urlsplit(json.loads(distribution("txt1").read_text("direct_url.json") or "{}").get("url", ""))
    except PackageNotFoundError:
        url = urlsplit("")
    return quote(f"{unquote(url.path) if url.scheme == 'file' else 'txt1'}[{extras}]")
