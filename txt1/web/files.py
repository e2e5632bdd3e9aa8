"""The page's files as they go over the wire: read and compressed once, found by their names and by nothing else."""

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
    """One of them."""

    # its MIME type
    kind: str
    # compressed by gzip
    body: bytes
    # another one when the content is another
    tag: str


@cache
def page_files() -> dict[str, File]:
    """All files of the page, by name."""
    found = {}
    for each in files("txt1.web").joinpath("static").iterdir():
        kind = TYPES.get(each.name.rpartition(".")[2])
        if kind is not None:
            content = each.read_bytes()
            found[each.name] = File(kind, gzip.compress(content, mtime=0), f'"{sha256(content).hexdigest()[:16]}"')
    return found
