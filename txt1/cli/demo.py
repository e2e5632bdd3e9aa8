"""`txt1 demo`: ninety seconds of a simulated car that nobody drives, and at each step the command to do the same.

It drives, finds the light by what it has learned meanwhile, is stopped by a box, shows what its laser sees, and gives a
drive to the same code again, which must decide the same to the last bit. The screens and the page show every step; q
ends it at any time. Without a terminal it runs in virtual time and prints its lines.
"""

import argparse
import asyncio
import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from txt1.cli import operated_robot, parsed
from txt1.commands import OK, add, path, takes, unused
from txt1.driver import REFRESH
from txt1.experiments import run_folder
from txt1.hal.base import Button
from txt1.installing import installs
from txt1.kit.options import SEED
from txt1.robot import Robot
from txt1.ui import tty

ROOM: Final = (
    "sim.room.length=7",
    "sim.room.width=6",
    "sim.start=[0.0, -1.6, 0.0]",
    "sim.obstacles=[{kind: box, x: 2.6, y: -2.0, length: 0.6, width: 0.8}]",
)
CIRCLE: Final = (0.5, 0.4)  # m/s, rad/s
BEFORE_THE_BOX: Final = (-0.6, -2.0, 0.0)  # m, m, rad
EPISODES: Final = 31
RECORDING: Final = ("mcap", "mcap_ros2", "zstandard", "lz4")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder for results, and the seed."""
    about = "folder for recordings and what it learned; by default out/demo, then out/demo-2 and so on"
    add(parser, {"--out": takes("DIR", about, path)} | SEED)


def main(arguments: argparse.Namespace) -> int:
    """Show all steps, and return the exit code of the run."""
    out = arguments.out or unused(Path("out/demo"))
    run_folder.make(out)
    seed = str(arguments.seed or 1)
    demo = Demo(out, seed)
    words = ["run", "--practice", "--seed", seed, *(word for each in ROOM for word in ("--set", each))]
    if not tty.drawable():
        words += ["--headless", "--speed", "max"]
    if demo.records:
        words += ["--log", str(out / "demo.mcap")]
    try:
        code = operated_robot.run(parsed(words), demo.show)
    finally:
        demo.close()
    if code == OK:
        shown = f"look at it: txt1 report {out / 'demo.mcap'}; d" if demo.records else "D"
        print(f"That was the demo; {shown}rive yourself: txt1 run --practice")
    return code


class Demo:
    """The steps of the demo; `line` is what it does now, and `typed` what to type to do that."""

    def __init__(self, out: Path, seed: str) -> None:
        self._out, self._seed = out, seed
        self.records = all(find_spec(module) for module in RECORDING)
        self.line, self.typed = "", ""
        self._beside: list[subprocess.Popen[bytes]] = []

    def close(self) -> None:
        """End the commands that still run beside it."""
        for each in self._beside:
            if each.poll() is None:
                each.kill()
            each.wait()

    async def show(self, robot: Robot) -> None:
        """Drive a robot through all steps, then end the run."""
        # learning and numpy, which no other command of this package needs
        from txt1.learning.registry import agent_of
        from txt1.learning.task import need_light, start

        self._robot, self._wheel = robot, robot.source("script")
        robot.runtime.state.warnings += (lambda: self.line, lambda: self.typed)
        learned = self._out / "learned"
        learns = self._command("learn", "--trials", "1", "--episodes", EPISODES)
        learning = self._start(*learns, "--seed", self._seed, "--out", str(learned))

        v, omega = CIRCLE
        drive = self._command("run", "--drive", f"{v:g},{omega:g}")
        self._say("1/5 It drives, and nobody holds the wheel.", drive)
        await self._drive(v, omega, 14.0)

        self._say(f"2/5 It tries {EPISODES} times to find the light.", learns)
        await self._ended(learning)
        await need_light(robot)
        policy = self._command("run", "--policy", learned / "qtable.json")
        self._say(f"2/5 It finds the light by what it learned in {EPISODES} tries.", policy)
        agent = agent_of(robot.config, None, learned / "qtable.json")
        # a table is given
        assert agent is not None
        task = start(robot, agent, episodes=2)
        await task.ended.wait()

        part = self._out / "part.mcap"
        verified = self._command("replay", "--verify", part)
        if self.records:
            again = [
                *drive,
                "--seed",
                self._seed,
                "--headless",
                "--speed",
                "max",
                "--duration",
                "12",
                "--log",
                str(part),
            ]
            recording = self._start(*again)
        robot.place(*BEFORE_THE_BOX)
        self._say("3/5 A box is in its way: the laser sees it, and it stops.", self._command("run", "--practice"))
        await self._drive(0.5, 0.0, 14.0)

        self._say("4/5 MAP has the laser's points, SENSORS its numbers.", self._command("run", "--practice"))
        await self._drive(-0.25, 0.0, 8.0)
        robot.press(Button.RIGHT)
        await self._drive(0.0, 0.0, 8.0)
        robot.press(Button.LEFT)

        if self.records:
            self._say("5/5 The same code gets a recorded drive again.", verified)
            await self._ended(recording)
            same = await self._ended(self._start(*verified)) == OK
            how = "the same, bit for bit" if same else "not the same"
            self._say(f"5/5 A recorded drive again, and all that it decides is {how}.", verified)
        else:
            self._say("5/5 A drive can be repeated bit for bit.", shlex.split(installs("record")))
        await self._drive(0.0, 0.0, 12.0)
        self._say("That was the demo.", self._command("run", "--practice"))
        await self._drive(0.0, 0.0, 5.0)
        robot.runtime.scheduler.end_at(robot.now)

    @staticmethod
    def _command(*words: object) -> list[str]:
        return ["txt1", *map(str, words)]

    def _say(self, what: str, typed: Sequence[str]) -> None:
        """Show a step and what to type on every screen and on the page, and log both."""
        self.line, self.typed = what, f"You: {shlex.join(typed)}"
        self._robot.tell(f"{what} {self.typed}")

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        """Start a command of txt1, given with its first word, beside the robot, at a low priority."""
        program = [sys.executable, "-m", "txt1", *words[1:]]
        nothing = subprocess.DEVNULL
        child = subprocess.Popen(program, stdin=nothing, stdout=nothing, stderr=nothing)  # noqa: S603 - ourselves
        self._beside.append(child)
        return child

    async def _ended(self, child: subprocess.Popen[bytes]) -> int:
        """Wait for a command, at a standstill, and return its exit code; virtual time waits, too."""
        return await asyncio.to_thread(child.wait)

    async def _drive(self, v: float, omega: float, duration: float) -> None:
        """Command a velocity for so many s of the robot's time while it is armed and nobody else drives."""
        robot, left, before = self._robot, duration, self._robot.now
        while left > 0.0:
            if robot.armed and self._wheel.request() and self._wheel.command(v, omega):
                left -= robot.now - before
            before = robot.now
            await asyncio.sleep(REFRESH)
        self._wheel.release()
