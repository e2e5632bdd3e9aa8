"""Hands at a struck robot that go without a word: a terminal's key, and gamepads.

Each of them watches itself: a hand that gave its last sign long ago must not have the wheel.
"""

import asyncio
from typing import Final

from numpy.random import Generator

from torture.struck_robot import Broken, Desk
from txt1.control.hand import Hand
from txt1.control.holding import HOLD_LASTS
from txt1.gamepad.pad import APPEARS, PadParameters, Pads, PadState
from txt1.sidecar import Request
from txt1.ui.teleop import DECAY, Teleop
from txt1.ui.terminal import Terminal

REPEAT: Final = 0.04  # s between two repeats of a key
LOOK: Final = 0.02  # s between two looks at the pads
LATE: Final = 0.5  # s that a stall of the clock may add
REST: Final = PadState()
HELD: Final = frozenset({PadParameters().dead_man})


class HandAt:
    """A hand at the robot, by the name of its source, which several strikes may share."""

    def __init__(self, desk: Desk, name: str, lasts: float) -> None:
        self._desk, self._name, self._lasts = desk, name, lasts
        self.sign()

    def sign(self) -> None:
        """Give a sign of the hand."""
        self._desk.signs[self._name] = self._desk.now

    def hold(self, v: float, omega: float, time: float | None = None) -> None:
        """Command a velocity, m/s and rad/s."""
        self._desk.hold(self._name, v, omega, time)

    def release(self) -> None:
        """Let go."""
        self._desk.let_go(self._name)

    def check(self) -> None:
        """Raise Broken: the hand is gone, and drives."""
        gone = self._desk.now - self._desk.signs[self._name]
        if gone > self._lasts + LATE and self._desk.robot.driver.name == self._name:
            raise Broken(f"{self._name} drives {gone:.2f} s after the last sign of a hand")


async def key_repeats(desk: Desk, key: str, seconds: float, speed: float) -> None:
    """A key is pressed, its release is lost, and the computer repeats it for so many s."""
    hand = HandAt(desk, "hand", HOLD_LASTS + DECAY)
    terminal = Terminal(desk.robot, hand, teleop=Teleop(speed, desk.robot.config.hand()))
    ends = desk.now + seconds
    while desk.now < ends:
        terminal.request(Request("keys", {"keys": [key]}, 0.0))
        hand.check()
        await asyncio.sleep(REPEAT)
    hand.release()


async def pad_freezes(desk: Desk, rng: Generator, returns: bool) -> None:
    """A pad drives, and its radio is out of reach; perhaps it comes back as another, while the old one is still there.

    The other pad may be down from the first, or be pressed and released.
    """
    numbers: Hand = desk.robot.config.hand()
    pads, hand = Pads(PadParameters(), numbers), HandAt(desk, "radio pad", HOLD_LASTS)
    began, driving = desk.now, False
    presses, freezes = began + APPEARS + 0.1, began + APPEARS + float(rng.uniform(0.3, 2.0))
    comes, down_at_once = freezes + float(rng.uniform(0.1, 4.0)), bool(rng.random() < 0.3)
    there: dict[int, tuple[PadState, float]] = {1: (REST, began)}
    while (now := desk.now) < freezes + HOLD_LASTS + 5.0:
        if presses <= now < freezes:
            axes = {"lefty": float(rng.uniform(-1.0, 1.0)), "leftx": float(rng.uniform(-1.0, 1.0))}
            there[1] = PadState(HELD, axes), now
            hand.sign()
        if returns and now >= comes:
            held = down_at_once or APPEARS + 0.2 < now - comes < APPEARS + 1.0
            state = PadState(HELD, {"lefty": -1.0}) if held else REST
            if there.get(2, (None, 0.0))[0] != state:
                there[2] = state, now
                if not down_at_once:
                    hand.sign()
        wish = pads.take(there, now)
        if wish.velocity is not None:
            hand.hold(*wish.velocity)
        elif driving:
            hand.release()
        driving = wish.velocity is not None
        if returns and not down_at_once and now > comes + APPEARS + 1.1 and driving:
            raise Broken("the old pad drives after the release of the new one")
        hand.check()
        await asyncio.sleep(LOOK)
    hand.release()
