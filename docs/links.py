"""Try every link that leads out of the site: `make docs-links`, where there is a network.

    python docs/links.py build/site

`make docs` has checked those inside. Each address is asked for once, eight at a time; printed are those that do not
answer, with the pages that have them, and the end is 1 if there are any.
"""

import sys
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from http.client import HTTPException
from pathlib import Path
from typing import Final
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

PATIENCE: Final = 20.0  # s
REFUSES: Final = (401, 403, 405, 429)  # is there, and not for programs


class Links(HTMLParser):
    """The addresses that a page links to."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take the address of an anchor."""
        address = dict(attrs).get("href")
        if tag == "a" and address and address.startswith(("http://", "https://")):
            self.found.add(address.partition("#")[0])


def complaint(address: str) -> str:
    """Return why an address does not answer; nothing where it does."""
    try:
        with urlopen(Request(address, headers={"User-Agent": "txt1-docs"}), timeout=PATIENCE):  # noqa: S310
            return ""
    except HTTPError as error:
        return "" if error.code in REFUSES else str(error)
    except (URLError, HTTPException, OSError, ValueError) as error:
        return str(error)


def main(site: Path) -> int:
    """Try them all."""
    pages: dict[str, list[str]] = defaultdict(list)
    for page in sorted(site.rglob("*.html")):
        links = Links()
        links.feed(page.read_text("utf-8"))
        for address in links.found:
            pages[address].append(str(page.relative_to(site)))
    with ThreadPoolExecutor(8) as pool:
        told = dict(zip(pages, pool.map(complaint, pages), strict=True))
    lost = {address: why for address, why in told.items() if why}
    for address, why in lost.items():
        print(f"{address}: {why} ({', '.join(pages[address][:3])})")
    hint = "; is there a network?" if lost and len(lost) == len(pages) else ""
    print(f"{len(pages)} links lead out, {len(lost)} do not answer{hint}")
    return bool(lost)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
