"""Two computers and a cable between them, as Linux's network namespaces."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

HOST, GUEST = f"txt1-here-{os.getpid()}", f"txt1-there-{os.getpid()}"
ADDRESSES = {HOST: "10.77.0.1", GUEST: "10.77.0.2"}


def within(place: str) -> list[str]:
    """The words before a command that have it run on that computer."""
    return ["ip", "netns", "exec", place]


def plug_in() -> None:
    """Connect the two."""
    _ip("link", "add", "txt1-a", "netns", HOST, "type", "veth", "peer", "name", "txt1-b", "netns", GUEST)
    for place, name in ((HOST, "txt1-a"), (GUEST, "txt1-b")):
        _ip("-n", place, "address", "add", f"{ADDRESSES[place]}/24", "dev", name)
        _ip("-n", place, "link", "set", name, "up")
    for place in ADDRESSES:  # it takes a second until it is at work
        while (
            "UP"
            not in subprocess.run(
                ["ip", "-n", place, "-brief", "link", "show", "type", "veth"],
                capture_output=True,
                text=True,
                check=True,
            ).stdout.split()
        ):
            time.sleep(0.1)


def pull_out() -> None:
    """Take the network interface away, as if it were a stick."""
    _ip("-n", HOST, "link", "delete", "txt1-a")


@contextmanager
def two_computers() -> Iterator[None]:
    """Two that are connected; the test is skipped where they cannot be had."""
    if shutil.which("ip") is None:
        pytest.skip("did not run: no network namespaces here: 'apt install iproute2'")
    for place in ADDRESSES:
        done = subprocess.run(["ip", "netns", "add", place], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            pytest.skip(f"did not run: no network namespaces here: {done.stderr.strip()}")
        _ip("-n", place, "link", "set", "lo", "up")
    try:
        plug_in()
        yield
    finally:
        for place in ADDRESSES:
            _ip("netns", "delete", place)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)
