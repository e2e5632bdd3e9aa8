"""Copies the firmware to a Pico, and asks the firmware that runs there for its name, its health and its last fault.

Files are copied under new names, and verified by their digests on the board. Only then they replace the old files. The
program that starts at power-up comes last. If the cable is pulled halfway, the old firmware stays complete.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from txt1.errors import CommandRefused, HalError, MissingExtra
from txt1.link.device import open_link
from txt1.link.receiver import Receiver
from txt1.link.virtual_device import VirtualDevice
from txt1.protocol.decoder import Event
from txt1.protocol.layout import HEADER, Role, checksum
from txt1.protocol.messages import BatteryLevels, EncoderOdometry
from txt1.resources import resource

IDENTITY: Final = 0x7F
RELEASE: Final = b"REPL"
"""The request for the identity of txt1's boards, and the data that end their program."""

BOARD_PATIENCE: Final = 1.5
"""s within which a board answers."""
MPREMOTE_PATIENCE: Final = 60.0
NEW: Final = ".new"
DIGESTS: Final = """
import os, hashlib, binascii, json
found = {}
for name in %s:
    try:
        with open(name, "rb") as file:
            found[name] = str(binascii.hexlify(hashlib.sha256(file.read()).digest()), "ascii")
    except OSError:
        found[name] = None
print(json.dumps(found))
"""
FOLDER: Final = """
import os
try:
    os.mkdir("txt1pico")
except OSError:
    pass
"""
PLACE: Final = """
import os
for name in %s:
    os.rename(name + ".new", name)
"""
LOG: Final = """
try:
    print(open("fault.log").read())
except OSError:
    print("no fault was noted")
"""


def folder() -> Path:
    """Return the folder of the firmware's files: in the installed package, or in the source tree."""
    return resource("firmware/pico")


def files() -> list[str]:
    """Return the names of the firmware's files, the startup file last."""
    package = sorted(f"txt1pico/{path.name}" for path in (folder() / "txt1pico").glob("*.py"))
    return [*package, "main.py"]


class Files(Protocol):
    """A board's files, while its program does not run."""

    def run(self, script: str) -> str:
        """Run a script on the board and return what it prints."""

    def put(self, source: Path, name: str) -> None:
        """Copy a file to the board."""


class OverMpremote:
    """The files of a board on a serial port, through the program mpremote.

    Raises MissingExtra: mpremote is not installed.
    """

    def __init__(self, port: str) -> None:
        if find_spec("mpremote") is None:
            raise MissingExtra("txt1 firmware", "devices")
        self._port = port

    def run(self, script: str) -> str:
        """Run a script on the board and return what it prints."""
        return self._call("exec", script)

    def put(self, source: Path, name: str) -> None:
        """Copy a file to the board."""
        self._call("fs", "cp", str(source), f":{name}")

    def _call(self, *words: str) -> str:
        command = [sys.executable, "-m", "mpremote", "connect", self._port, "resume", *words]
        try:
            done = subprocess.run(  # noqa: S603 - a list of words, no shell
                command, capture_output=True, text=True, timeout=MPREMOTE_PATIENCE, check=False
            )
        except subprocess.TimeoutExpired:
            raise HalError(
                f"{self._port}: MicroPython does not answer; unplug the board and plug it in again"
            ) from None
        if done.returncode:
            last = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["no reason given"]
            raise HalError(f"{self._port}: mpremote: {last[0]}; does MicroPython run on the board?")
        return done.stdout


class Installed(NamedTuple):
    """Names of the files that an installation copied, and of the files that were the same already."""

    copied: list[str]
    same: list[str]


def digest(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    return sha256(path.read_bytes()).hexdigest()


def digests(board: Files, names: list[str]) -> dict[str, str | None]:
    """Return the digest of each of these files on the board; None for a missing file."""
    said = board.run(DIGESTS % json.dumps(names)).strip().splitlines()
    try:
        found: dict[str, str | None] = json.loads(said[-1])
    except (IndexError, ValueError):
        raise HalError(f"the board's answer is no list of digests: {said[-1:]}; try again") from None
    return found


def install(board: Files, told: Callable[[str], None] = lambda _: None) -> Installed:
    """Copy the files that differ, verify them, and put them in their places.

    Raises:
        HalError: the board does not answer, or a file arrived damaged; the old files stay.

    """
    names = files()
    wanted = {name: digest(folder() / name) for name in names}
    there = digests(board, names)
    changed = [name for name in names if there.get(name) != wanted[name]]
    if changed:
        board.run(FOLDER)
        for name in changed:
            told(name)
            board.put(folder() / name, name + NEW)
        arrived = digests(board, [name + NEW for name in changed])
        for name in changed:
            if arrived.get(name + NEW) != wanted[name]:
                raise HalError(f"{name}: a file arrived damaged on the board; the old firmware stays, try again")
        board.run(PLACE % json.dumps(changed))
    return Installed(changed, [name for name in names if name not in changed])


# -- asking the running firmware -------------------------------------------------------------------------------


class Heard(NamedTuple):
    """A board's name and version, if its firmware is txt1's, and the number of messages and bytes from it."""

    identity: str | None
    odometry: int
    batteries: int
    octets: int


class _Ear(VirtualDevice):
    """The end of the line that asks and listens."""

    def __init__(self) -> None:
        self.data = b""
        self.odometry = self.batteries = 0
        self._receiver = Receiver(Role.HOST, self._take)

    def received(self, data: bytes) -> None:
        self.data += data
        self._receiver.feed(data)

    def _take(self, event: Event) -> None:
        self.odometry += isinstance(event, EncoderOdometry)
        self.batteries += isinstance(event, BatteryLevels)

    def hang_up(self) -> None:
        self._receiver.close()
        super().hang_up()


def frame(data: bytes) -> bytes:
    """Return the frame that asks a board for its identity, or with RELEASE ends its program."""
    body = bytes((IDENTITY,)) + data
    return HEADER + bytes((len(data),)) + body + checksum(body).to_bytes(2, "big")


def identities(data: bytes) -> Iterator[str]:
    """Yield the boards' names in a stream of bytes."""
    start = data.find(HEADER)
    while start >= 0:
        if len(data) > start + 4 and data[start + 3] == IDENTITY:
            end = start + 4 + data[start + 2]
            body = data[start + 3 : end]
            if data[end : end + 2] == checksum(body).to_bytes(2, "big"):
                yield body[1:].decode("ascii", "replace")
        start = data.find(HEADER, start + 1)


async def listen(port: str, baud: int, data: bytes = b"", patience: float = BOARD_PATIENCE) -> Heard:
    """Ask the device at a port for its identity, and return its answers within `patience` s.

    Raises:
        HalError: the port cannot be opened.

    """
    ear = _Ear()
    await open_link(port, ear, baud)
    await asyncio.sleep(0.0)
    try:
        ear.send(frame(data))
        await asyncio.sleep(patience)
    finally:
        ear.hang_up()
    return Heard(next(identities(ear.data), None), ear.odometry, ear.batteries, len(ear.data))


async def release(port: str, baud: int) -> None:
    """End the program of the firmware at a port, so that its files can be reached; nothing happens if none runs.

    Raises:
        CommandRefused: the board drives, or hears a host.
        HalError: the port cannot be opened.

    """
    if (await listen(port, baud)).identity is None:
        return
    await listen(port, baud, RELEASE, 0.3)
    if (await listen(port, baud)).identity is not None:
        raise CommandRefused(
            f"{port}: the board hears a host or moves, so its program is not ended; stop the host, then try again"
        )
