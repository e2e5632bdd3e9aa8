"""How far the robot drives after the hand is gone: ``python -m benchmarks.holds``.

Each input drives a simulated robot at 1.5 m/s in real time. Then the hand lets go, or it is gone in a way that the
computer does not tell. Counted is from the last sign of the hand to the last set-point that is not zero, and the way
until the robot stands. The page runs in a real browser (Debian's chromium through playwright), which gets its own
input events, and reaches the robot over its connection. The terminal is a pseudo-terminal of `txt1 run`, and the
gamepad is SDL's virtual one, in the process of `--gamepad`. A browser's pad replaces `navigator.getGamepads`. The
results are kept in out/holds.jsonl, so a command that was ended goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import median
from time import monotonic, sleep
from typing import Any, Final, NamedTuple

from playwright.sync_api import sync_playwright

from benchmarks.rounds import table
from rigs import page_parts
from rigs.browser_hands import COMMAND, META, PAD, A, W, at, down, finger, hands, repeats, up
from rigs.live_browser import CHROMIUM, FLAGS, Live, live
from txt1.bridges.registry import BRIDGES, bridge
from txt1.control.holding import HOLD_LASTS
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf", "teleop.speed=1.5")
SPEED: Final = 1.5  # m/s
HELD: Final = 1.2  # s that the hand is there before it goes
WATCHED: Final = 6.0  # s after the hand is gone in which the robot is watched
KEPT: Final = Path("out/holds.jsonl")
TRIES: Final = 10  # of a round: a busy computer has a page let go by itself


class Tick(NamedTuple):
    """One tick of the controller: when, s; the set-point, m/s; the way along x, m."""

    time: float
    v: float
    x: float


class Drive(NamedTuple):
    """How long and how far the robot drove after the hand was gone: s, m."""

    seconds: float
    way: float


def drive(ticks: Sequence[Tick], gone: float) -> Drive | None:
    """Measure a drive; None: the robot did not drive when the hand went."""
    moving = [each.time for each in ticks if each.v and each.time > gone - 0.2]
    after = [each for each in ticks if each.time >= gone]
    if not moving or not after:
        return None
    return Drive(max(0.0, max(moving) - gone), after[-1].x - after[0].x)


# -- the page ----------------------------------------------------------------------------------------------------


class Page:
    """A page in a browser, and the ticks of its robot."""

    def __init__(self, browser: Any, car: Live) -> None:
        self.car, self.ticks = car, list[Tick]()
        context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
        self.page = hands(context.new_page())
        self.page.goto(car.url)
        self.page.wait_for_function("() => document.getElementById('link').textContent.endsWith('ms')")
        self.page.evaluate(f"{PAD}; speed.value = {SPEED}; speed.dispatchEvent(new Event('input'))")
        # a pad that has just appeared counts as a new one for a moment
        self.page.wait_for_timeout(700)
        self.stick = at(self.page, "#stick")
        car.call(self._watch)

    def _watch(self, robot: Robot) -> None:
        ticks, name = self.ticks, f"watch {id(self)}"

        async def watch(each_tick: Ticks) -> None:
            async for _ in each_tick:
                ticks.append(Tick(monotonic(), robot.runtime.state.control.v, robot.pose[0]))

        robot.add_task(name, 0.02, watch, -20)

    def close(self) -> None:
        """Close the browser's window."""
        with suppress(Exception):
            self.page.context.close()

    def keys_down(self) -> None:
        """Press w."""
        down(self.page, *W)

    def keys_up(self) -> None:
        """Release w."""
        up(self.page, *W)

    def lost(self) -> None:
        """The computer keeps the release to itself, and repeats the key."""
        repeats(self.page, W, WATCHED)

    def command(self) -> None:
        """Command goes down: macOS tells no release of w then."""
        down(self.page, *COMMAND, META)
        up(self.page, *COMMAND)
        repeats(self.page, W, 1.0)

    def mouse_down(self) -> None:
        """Push the stick to its stop."""
        x, y = self.stick
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x, y - 100)

    def finger_down(self) -> None:
        """Push the stick to its stop."""
        x, y = self.stick
        finger(self.page, "touchStart", (x, y))
        finger(self.page, "touchMove", (x, y - 100))

    def finger_up(self) -> None:
        """Lift the finger."""
        finger(self.page, "touchEnd")

    def pad_down(self) -> None:
        """Hold the dead-man, and push the stick to its stop."""
        self.page.evaluate(f"pads[0].axes = [0, -1, 0, 0]; press({A}, 1)")

    def pad_up(self) -> None:
        """Release the dead-man."""
        self.page.evaluate(f"press({A}, 0)")

    def nothing(self) -> None:
        """Nothing is told."""


Does = Callable[[Page], None]
PAGE: Final[Sequence[tuple[str, str, Does, Does, bool]]] = (
    ("page, key", "lets go", Page.keys_down, Page.keys_up, False),
    ("page, key", "Command takes the release", Page.keys_down, Page.command, False),
    ("page, key", "the release is lost", Page.keys_down, Page.lost, True),
    ("page, key", "the window is closed", Page.keys_down, Page.close, False),
    ("page, stick by mouse", "lets go", Page.mouse_down, lambda page: page.page.mouse.up(), False),
    ("page, stick by mouse", "the release is lost", Page.mouse_down, Page.nothing, True),
    ("page, stick by finger", "lets go", Page.finger_down, Page.finger_up, False),
    ("page, stick by finger", "the release is lost", Page.finger_down, Page.nothing, True),
    ("page, gamepad", "lets go", Page.pad_down, Page.pad_up, False),
    ("page, gamepad", "out of reach", Page.pad_down, Page.nothing, True),
)
"""Input, how the hand goes, the press, the end, and whether the press is the last sign of the hand."""


def by_page(browser: Any, car: Live, press: Does, end: Does, from_press: bool) -> Drive | None:
    """One round of the page."""
    car.call(lambda robot: robot.arm())
    page = Page(browser, car)
    pressed = monotonic()
    press(page)
    with suppress(TimeoutError):
        car.until(lambda robot: robot.runtime.state.control.v > SPEED - 0.1, 5.0)
    sleep(HELD)
    gone = pressed if from_press else monotonic()
    end(page)
    sleep(WATCHED if from_press else 2.5)
    page.close()
    found = drive(page.ticks, gone)
    if found is not None and from_press and found.seconds < HOLD_LASTS - 0.3:
        # a busy computer held the page up, and the page let go
        return None
    return found


# -- the gamepad and the terminal --------------------------------------------------------------------------------


def by_gamepad(how: str) -> Drive | None:
    """One round of SDL's virtual pad."""
    ticks: list[Tick] = []

    async def main() -> None:
        import asyncio

        async with Robot.open(hal="sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()

            async def watch(each_tick: Ticks) -> None:
                async for _ in each_tick:
                    ticks.append(Tick(monotonic(), robot.runtime.state.control.v, robot.pose[0]))

            robot.add_task("watch", 0.02, watch, -20)
            async with bridge(robot, "gamepad", {"held": HELD, "how": how, "note": str(note)}):
                while not (ticks and ticks[-1].v):
                    await asyncio.sleep(0.01)
                await asyncio.sleep(HELD + WATCHED)

    os.environ["PYTHONPATH"] = str(Path.cwd())
    BRIDGES.table["gamepad"] = "rigs.virtual_pad:held"  # type: ignore[index]
    with tempfile.TemporaryDirectory() as folder:
        note = Path(folder) / "sign"
        run(main())
        return drive(ticks, float(note.read_text()))


def by_terminal(how: str) -> Drive | None:
    """One round of `txt1 run` in a pseudo-terminal."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.mcap"
        settings = [word for each in ENDLESS for word in ("--set", each)]
        words = [sys.executable, "-m", "txt1", "run", "--seed", "1", *settings, "--log", str(file)]
        child, terminal = pty.fork()
        if not child:
            os.execvp(words[0], words)
        _read(terminal, 4.0)
        began = monotonic()
        last = began
        while monotonic() < began + (WATCHED if how == "the release is lost" else HELD):
            os.write(terminal, b"w")
            last = monotonic()
            _read(terminal, 0.033)
        if "closed" in how:
            os.close(terminal)
            sleep(3.0)
        else:
            _read(terminal, 3.0)
            os.write(terminal, b"q")
            _read(terminal, 1.0)
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGINT)
        os.waitpid(child, 0)
        found = subprocess.run(
            [sys.executable, "-m", "txt1", "log", "cat", str(file), "--topic", "/setpoint", "--topic", "/odom"],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
    ticks, x = list[Tick](), 0.0
    for line in found.stdout.splitlines():
        said = json.loads(line)
        message = said["message"]
        if said["topic"] == "/odom":
            x = message["pose"]["pose"]["position"]["x"]
        else:
            ticks.append(Tick(said["time"], message["twist"]["linear"]["x"], x))
    first = next(each.time for each in ticks if each.v)
    return drive(ticks, first if how == "the release is lost" else first + last - began)


def _read(terminal: int, seconds: float) -> None:
    """Take what is drawn, for so long."""
    import select

    ends = monotonic() + seconds
    while (left := ends - monotonic()) > 0.0:
        if select.select([terminal], [], [], left)[0]:
            with suppress(OSError):
                os.read(terminal, 65536)


# -- the table ---------------------------------------------------------------------------------------------------

INPUTS: Final = (*dict.fromkeys(what for what, *_ in PAGE), "gamepad (SDL)", "terminal")
HEAD: Final = ("input", "how the hand goes", "s until the set-point is 0", "m until it stands")


def main() -> None:
    """Measure, print, and write the page."""
    parser = argparse.ArgumentParser(prog="benchmarks.holds", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="of each case")
    parser.add_argument("--page", action="store_true", help="write the table to docs/safety.md")
    arguments = parser.parse_args()
    found: dict[tuple[str, str], list[Drive]] = {}
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    for line in KEPT.read_text().splitlines() if KEPT.exists() else ():
        what, how, *numbers = json.loads(line)
        found.setdefault((what, how), []).append(Drive(*numbers))

    def note(what: str, how: str, one: Callable[[], Drive | None]) -> None:
        if len(found.get((what, how), ())) >= arguments.rounds:
            return
        for _ in range(TRIES):
            if (result := one()) is not None:
                found.setdefault((what, how), []).append(result)
                with KEPT.open("a") as kept:
                    kept.write(json.dumps([what, how, *result]) + "\n")
                print(f"{what}, {how}: {result.seconds:.2f} s, {result.way:.2f} m", flush=True)
                return
        raise RuntimeError(f"{what}, {how}: it does not drive")

    for _ in range(arguments.rounds):
        for how in ("lets go", "out of reach", "unplugged"):
            note("gamepad (SDL)", how, lambda how=how: by_gamepad(how))  # type: ignore[misc]
        for how in ("lets go", "the release is lost", "the window is closed, the run ends"):
            note("terminal", how, lambda how=how: by_terminal(how))  # type: ignore[misc]
    with sync_playwright() as playwright, live(ENDLESS) as car:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        for _ in range(arguments.rounds):
            for what, how, press, end, from_press in PAGE:
                note(what, how, lambda p=press, e=end, f=from_press: by_page(browser, car, p, e, f))  # type: ignore[misc]
        browser.close()
    rows = [
        (what, how, _worst([each.seconds for each in some]), _worst([each.way for each in some]))
        for (what, how), some in sorted(found.items(), key=lambda item: INPUTS.index(item[0][0]))
    ]
    table("after the last sign of a hand, at 1.5 m/s: median (worst)", HEAD, rows)
    load = os.getloadavg()[0]
    text = (
        f"At {SPEED:g} m/s, from the last sign of the hand; median (worst), n >= {min(map(len, found.values()))}. "
        "In the terminal from when the robot has the sign, at most 0.1 s later. The simulated car coasts after the "
        f"set-point is 0. Load of the machine of {os.cpu_count()} processors, after it: {load:.1f}."
    )
    print(f"\n{text}")
    if arguments.page:
        # of each input the longest drive
        worst = [
            max((row for row in rows if row[0] == what), key=lambda row: float(row[2].split()[0])) for what in INPUTS
        ]
        lines = [HEAD, ("---", "---", "--:", "--:"), *worst]
        drawn = "\n".join(f"| {' | '.join(each)} |" for each in lines)
        page_parts.write(Path("docs/safety.md"), "holds", f"{drawn}\n\n{text}", "benchmarks.holds")


def _worst(values: Sequence[float]) -> str:
    return f"{median(values):.2f} ({max(values):.2f})"


if __name__ == "__main__":
    main()
