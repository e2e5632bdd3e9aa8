"""The page's files, read and compressed once, and found by their names only."""

import gzip
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import Final, NamedTuple

TYPES: Final = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
    "webmanifest": "application/manifest+json",
}


class File(NamedTuple):
    """A file of the page."""

    # its MIME type
    kind: str
    # compressed by gzip
    body: bytes
    # changes with the content
    tag: str


@cache
def page_files() -> dict[str, File]:
    """Return all files of the page, by name."""
    found = {}
    for each in files("txt1.web").joinpath("static").iterdir():
        kind = TYPES.get(each.name.rpartition(".")[2])
        if kind is not None:
            content = each.read_bytes()
            found[each.name] = File(kind, gzip.compress(content, mtime=0), f'"{sha256(content).hexdigest()[:16]}"')
    return found
