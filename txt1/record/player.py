"""A recording on the terminal screens: played at any speed, paused, wound forward and back, looped."""

import asyncio
import os
from collections.abc import Callable
from typing import Final

from txt1.hal.base import Button
from txt1.record.snapshots import Snapshots
from txt1.tasks.fields import GAIN_TABLE, GainTable, Panel
from txt1.tasks.mode import MODE, Mode
from txt1.tasks.panel import press
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import tty
from txt1.ui.summary_line import status_line
from txt1.ui.terminal import Terminal

# s that one press of a or d winds
SEEK: Final = 5.0
SPEED_MIN: Final = 1.0 / 64.0
SPEED_MAX: Final = 64.0

KEYS: Final = {
    "SPACE": "pause",
    "q": "quit",
    "?": "help",
    "a d": "back, forth 5 s",
    "+-": "speed",
    "m": "loop",
    "w": "begin",
    "←→": "screen",
    "↑↓": "gains",
}


class Player:
    """Plays a recording at `speed` times real time, given by `clock` in s; to the terminal it is the robot."""

    def __init__(self, recording: Snapshots, speed: float, loop: bool, clock: Callable[[], float]) -> None:
        self.recording = recording
        self.speed = speed
        self.loop = loop
        self.paused = False
        self._clock = clock
        self._position = recording.start
        self._since = clock()
        self._panel = Panel()

    @property
    def position(self) -> float:
        """Where it is, s of the run."""
        now, begin, end = self._clock(), self.recording.start, self.recording.end
        if not self.paused:
            self._position += (now - self._since) * self.speed
            if self._position > end:
                self._position = begin + (self._position - end) % (end - begin) if self.loop and end > begin else end
        self._since = now
        return self._position

    @property
    def ended(self) -> bool:
        """Whether there is nothing more to come."""
        return not self.loop and self.position >= self.recording.end

    def seek(self, time: float) -> None:
        """Go to a time of the run, s, or as near as the recording goes."""
        self._since = self._clock()
        self._position = min(max(time, self.recording.start), self.recording.end)

    def key(self, key: str, now: float = 0.0) -> None:
        """Carry out a driving key's meaning for the player."""
        position = self.position
        match key:
            case "a" | "d":
                self.seek(position + (SEEK if key == "d" else -SEEK))
            case "w":
                self.seek(self.recording.start)
            case "+" | "-":
                self.speed = min(max(self.speed * (2.0 if key == "+" else 0.5), SPEED_MIN), SPEED_MAX)

    # -- what the terminal needs of a robot --------------------------------------------------------------------

    @property
    def snapshot(self) -> Snapshot:
        """The snapshot that is due, with the panel as the keys have set it."""
        snapshot = self.recording.at(self.position)
        mode = snapshot.get(MODE, Mode())
        mode = mode._replace(panel=self._panel._replace(manual=mode.panel.manual))
        state = f"{'paused' if self.paused else 'replay'}{' loop' if self.loop else ''} x{self.speed:.3g}"
        return snapshot.replaced({MODE: mode}, name=state)

    @property
    def now(self) -> float:
        """Real time, s, for keys and snapshots."""
        return self._clock()

    def stop(self) -> None:
        """Pause, or go on."""
        self._position, self.paused = self.position, not self.paused

    def arm(self) -> None:
        """Loop, or play once."""
        self._position, self.loop = self.position, not self.loop

    def disarm(self, reason: str) -> None:
        """Nothing moves."""

    def release(self) -> None:
        """Nothing is held."""

    def command(self, now: float) -> None:
        """No key drives."""

    def press(self, button: Button) -> None:
        """The joystick changes the screen and scrolls the gains."""
        rows = len(self.recording.at(self.position).get(GAIN_TABLE, GainTable()).angular.sets)
        self._panel = press(self._panel, button, rows, has_pwm=False)

    def tell(self, text: str) -> None:
        """There is no log to add to."""


async def play(recording: Snapshots, speed: float, start: float | None, loop: bool) -> None:
    """Show a recording on the screens until the user quits; without a terminal, print a line for each second."""
    player = Player(recording, speed, loop, asyncio.get_running_loop().time)
    if start is not None:
        player.seek(start)
    if tty.drawable():
        async with Terminal(player, teleop=player, shown=KEYS) as terminal:
            await terminal.wait()
        return
    told, ended = -1, False
    while not ended:
        ended, position = player.ended, player.position
        if int(position) != told:
            told = int(position)
            os.write(tty.OUT, f"{status_line(recording.at(position))}\n".encode())
        await asyncio.sleep(0.0 if ended else min(0.1, 0.2 / speed))
