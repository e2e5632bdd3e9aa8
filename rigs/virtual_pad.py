"""Pads that SDL makes up: pygame has no words for them, so they are asked of its library."""

from __future__ import annotations

import ctypes
from pathlib import Path
from time import monotonic
from typing import Any

import pygame

from txt1.gamepad import bridge as gamepad
from txt1.gamepad.pad import AXES, BUTTONS
from txt1.sidecar import Connection

GAME_CONTROLLER = 1


def sdl() -> Any:
    """The library that pygame has loaded."""
    folder = Path(pygame.__file__).parent
    found = [*folder.parent.glob("pygame_ce.libs/libSDL2-2*"), *folder.glob(".dylibs/libSDL2-2*")]
    library = ctypes.CDLL(str(found[0]))
    library.SDL_JoystickOpen.restype = ctypes.c_void_p
    library.SDL_JoystickClose.argtypes = [ctypes.c_void_p]
    for name in ("SDL_JoystickSetVirtualAxis", "SDL_JoystickSetVirtualButton"):
        getattr(library, name).argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int16]
    return library


class VirtualPad:
    """One of them, plugged in."""

    def __init__(self) -> None:
        self._sdl = sdl()
        index = self._sdl.SDL_JoystickAttachVirtual(GAME_CONTROLLER, len(AXES), len(BUTTONS), 0)
        assert index >= 0
        self._instance = self._sdl.SDL_JoystickGetDeviceInstanceID(index)
        self._stick = self._sdl.SDL_JoystickOpen(index)
        for name in ("lefttrigger", "righttrigger"):
            self.push(name, -1.0)

    def push(self, name: str, value: float) -> None:
        """Move an axis; a trigger's way is from -1 to 1 on the device."""
        assert self._sdl.SDL_JoystickSetVirtualAxis(self._stick, AXES.index(name), int(value * 32767)) == 0

    def press(self, name: str, down: bool = True) -> None:
        assert self._sdl.SDL_JoystickSetVirtualButton(self._stick, BUTTONS.index(name), int(down)) == 0

    def unplug(self) -> None:
        self._sdl.SDL_JoystickClose(self._stick)
        numbers = range(self._sdl.SDL_NumJoysticks())  # they move up when one before them goes
        here = next(k for k in numbers if self._sdl.SDL_JoystickGetDeviceInstanceID(k) == self._instance)
        self._sdl.SDL_JoystickDetachVirtual(here)


def driven(robot: Connection, unplugged: bool = False, **options: Any) -> None:
    """The bridge with such a pad, which is held at full speed after a second, and may be unplugged after another.

    Otherwise it says nothing more, as a pad whose radio is out of reach.
    """
    held(robot, 1.0, "unplugged" if unplugged else "out of reach", **options)


def held(robot: Connection, held: float, how: str, note: str = "", **options: Any) -> None:
    """The bridge with such a pad: held at full speed after a second, for `held` s; then it "lets go", is "unplugged",
    or "out of reach", and says nothing more. `note` is a file for the time of the last sign of a hand.
    """

    def sign() -> None:
        if note:
            Path(note).write_text(str(monotonic()))

    class Scripted(gamepad.Devices):
        def __init__(self, mapping: str | None) -> None:
            super().__init__(mapping)
            self.pad, self.began, self.gone = VirtualPad(), gamepad.now(), False
            self.down = False

        def look(self) -> Any:
            since = gamepad.now() - self.began
            if since > 1.0 + held and how != "out of reach":
                if not self.gone:
                    sign()
                    if how == "unplugged":
                        self.pad.unplug()
                    else:
                        self.pad.press("a", False)
                self.gone = True
            elif since > 1.0 and not self.down:
                self.down = True
                self.pad.push("lefty", -1.0)
                self.pad.press("a")
                sign()
            return super().look()

    gamepad.Devices = Scripted  # type: ignore[misc]
    gamepad.main(robot, **options)
