"""Recordings on the page: their list, and playing a recording in place of the robot."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from txt1.errors import RecordingError

if TYPE_CHECKING:
    from txt1.record.snapshots import Snapshots

# s between two snapshots
PLAYER_PERIOD: Final = 0.1
# largest recording to be shown, bytes: it is held in memory
RECORDING_BYTES_MAX: Final = 200 << 20
PLAY_SPEED_MAX: Final = 16.0
LISTED_MAX: Final = 200
# pattern of a recording's name
RECORDING_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}\.mcap")


def recordings(folder: Path) -> list[dict[str, object]]:
    """Return name, size in bytes and time (s since 1970) of the recordings in a folder, the newest first."""
    try:
        found = [
            (each.stat(), each.name)
            for each in folder.iterdir()
            if RECORDING_NAME.fullmatch(each.name) and each.is_file()
        ]
    except OSError:
        return []
    found.sort(key=lambda each: -each[0].st_mtime)
    return [{"name": each, "size": stat.st_size, "time": stat.st_mtime} for stat, each in found[:LISTED_MAX]]


def strict(line: str) -> str:
    """Return a line of JSON with null for NaN and infinities, which browsers do not accept."""
    if "NaN" not in line and "Infinity" not in line:
        return line
    return json.dumps(json.loads(line, parse_constant=lambda _: None), separators=(",", ":"))


@dataclass(eq=False)
class PagePlayer:
    """Plays a recording for one page."""

    name: str
    recording: Snapshots
    position: float  # s of the run
    # times real time; 0: paused
    speed: float = 1.0
    _stopped: bool = False
    # set when the position or the speed has changed
    _moved: bool = False

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read a recording, in a thread; raises RecordingError."""
        if path.is_symlink() or not path.is_file():
            raise RecordingError("there is no such recording")
        if path.stat().st_size > RECORDING_BYTES_MAX:
            raise RecordingError(
                f"it is larger than {RECORDING_BYTES_MAX >> 20} MB: fetch it, and 'txt1 replay' shows it"
            )
        # it takes a while to load, and few pages need it
        from txt1.record.snapshots import Snapshots

        recording = Snapshots(path)
        return cls(path.name, recording, recording.start)

    def status(self) -> dict[str, object]:
        """Return the position and the speed."""
        start, end = self.recording.start, self.recording.end
        return {"name": self.name, "start": start, "end": end, "position": self.position, "speed": self.speed}

    def wind(self, to: Any, speed: Any) -> None:
        """Go to a time of the run, and set the speed; raises ValueError for a number that is not finite."""
        given = [None if each is None else float(each) for each in (to, speed)]
        if not all(each is None or isfinite(each) for each in given):
            raise ValueError("not finite")
        if given[0] is not None:
            self.position = min(max(given[0], self.recording.start), self.recording.end)
        if given[1] is not None:
            self.speed = min(max(given[1], 0.0), PLAY_SPEED_MAX)
        self._moved = True

    def stop(self) -> None:
        """End `play`."""
        self._stopped = True

    async def play(self, show: Callable[[str], None], now: Callable[[], float]) -> None:
        """Pass on line after line until it is stopped; at the end it waits."""
        before = now()
        while not self._stopped:
            present = now()
            position = min(self.position + self.speed * (present - before), self.recording.end)
            if position != self.position or self._moved or before == present:
                self.position, self._moved = position, False
                show(strict(self.recording.at(position).encode().decode()))
            before = present
            await asyncio.sleep(PLAYER_PERIOD)
