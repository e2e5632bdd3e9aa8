"""A robot that only writes down what the terminal does to it: ``python ui_fake_robot.py LOG [SPEED]``."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from blockbuster import BlockBuster
from ui_snapshots import full

from tests.patience import LIMIT
from txt1.errors import CommandRefused
from txt1.hal.base import Button
from txt1.kernel.loop import run
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import terminal
from txt1.ui.terminal import Terminal


class FakeRobot:
    def __init__(self, log: Path) -> None:
        self._log = log.open("w", buffering=1)
        self.now = 0.0
        self.screen = 0

    @property
    def snapshot(self) -> Snapshot:
        return full(self.now, self.screen)

    def write(self, line: str) -> None:
        self._log.write(line + "\n")

    def hold(self, v: float, omega: float, time: float) -> None:
        self.write(f"command {v:.2f} {omega:.2f}")

    def release(self) -> None:
        self.write("release")

    def stop(self) -> None:
        self.write("stop")

    def arm(self) -> None:
        self.write("arm")
        raise CommandRefused("not today")

    def disarm(self, reason: str) -> None:
        self.write(f"disarm {reason}")

    def press(self, button: Button) -> None:
        self.write(f"press {button.name}")
        self.screen += {Button.RIGHT: 1, Button.LEFT: -1}.get(button, 0)

    def tell(self, text: str) -> None:
        self.write(f"tell {text}")


async def live(robot: FakeRobot) -> None:
    while True:
        await asyncio.sleep(0.05)
        robot.now += 0.05


async def main() -> None:
    robot = FakeRobot(Path(sys.argv[1]))
    living = asyncio.ensure_future(live(robot))
    blocker = BlockBuster()
    # The log is written to. And a patched type of file keeps stdout until Debian's Python 3.11.2 crashes at its end.
    for name in [each for each in blocker.functions if each.startswith("io.") and each.endswith(".write")]:
        del blocker.functions[name]
    # the kernel lists the threads of a process from memory
    blocker.functions["os.listdir"].can_block_in("txt1/kernel/timeslice.py", {"_threads"})
    blocker.activate()
    try:
        async with Terminal(robot, keys=robot) as screens:
            reason = await screens.wait()
            robot.write(f"reason {reason}")
            await asyncio.sleep(0.25)
    finally:
        blocker.deactivate()
    living.cancel()
    robot.write("end")


if __name__ == "__main__":
    terminal.KEY_AGE_MAX = LIMIT  # s that a key may have waited for a machine that was busy
    run(main(), speed=float(sys.argv[2]) if len(sys.argv) > 2 else None)
