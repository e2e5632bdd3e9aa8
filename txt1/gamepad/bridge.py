"""Gamepads through SDL, in a process of their own.

It reads them fifty times a second, and commands while one is held.
"""

import os
import select
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from txt1.control.hand import Hand
from txt1.control.holding import HOLD_LASTS
from txt1.gamepad.pad import AXES, BUTTONS, PadParameters, Pads, PadState
from txt1.kernel.clock import RealClock, seconds
from txt1.sidecar import Connection

# s between two readings
PAD_PERIOD: Final = 0.02
# SDL's number for a full deflection
AXIS_FULL: Final = 32767.0

_clock: Final = RealClock()


def now() -> float:
    """Seconds on this process's clock."""
    return seconds(_clock.now_ns())


class Devices:
    """The plugged-in game controllers, by SDL's instance numbers."""

    def __init__(self, mapping: str | None = None) -> None:
        os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"
        # the process has no window
        os.environ["SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS"] = "1"
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
        if mapping is not None:
            os.environ["SDL_GAMECONTROLLERCONFIG_FILE"] = mapping
        import pygame
        from pygame._sdl2 import controller

        self._pygame: Any = pygame
        self._controller: Any = controller
        # SDL needs its video part for events, though nothing is shown
        pygame.display.init()
        controller.init()
        self._open: dict[int, Any] = {}
        self._heard: dict[int, float] = {}
        self.names: dict[int, str] = {}
        """Names of the pads, by number."""
        self.unknown: dict[int, Any] = {}
        """Joysticks without a mapping in SDL, by number. They cannot drive; each of their buttons stops."""
        self.unknown_pressed = False
        """Whether a button of a joystick without a mapping was pressed before the last look."""

    def look(self) -> dict[int, tuple[PadState, float]]:
        """Return the reading of each pad, and the time of its last report, by number."""
        pygame, present = self._pygame, now()
        self.unknown_pressed = False
        for event in pygame.event.get():
            if event.type == pygame.JOYDEVICEADDED:
                self._add(event.device_index)
            elif event.type in (pygame.JOYDEVICEREMOVED, pygame.CONTROLLERDEVICEREMOVED):
                self._remove(event.instance_id)
            elif event.type == pygame.JOYBUTTONDOWN and event.instance_id in self.unknown:
                self.unknown_pressed = True
            elif (instance := getattr(event, "instance_id", None)) in self._heard:
                self._heard[instance] = present
        for instance, pad in tuple(self._open.items()):
            if not pad.attached():
                self._remove(instance)
        return {instance: (self._read(pad), self._heard[instance]) for instance, pad in self._open.items()}

    def sticks(self) -> list[Any]:
        """The pads as plain joysticks, with buttons and axes by number."""
        return [pad.as_joystick() for pad in self._open.values()]

    def close(self) -> None:
        """Close all pads."""
        self._open.clear()
        self._pygame.quit()

    def _add(self, index: int) -> None:
        if not self._controller.is_controller(index):
            with suppress(self._pygame.error):
                stick = self._pygame.joystick.Joystick(index)
                self.unknown[stick.get_instance_id()] = stick
            return
        # the pad has gone again
        with suppress(self._pygame.error):
            pad = self._controller.Controller(index)
            instance = pad.as_joystick().get_instance_id()
            self._open[instance], self._heard[instance], self.names[instance] = pad, now(), str(pad.name)

    def _remove(self, instance: int) -> None:
        known: tuple[dict[int, Any], ...] = (self._open, self._heard, self.names, self.unknown)
        for each in known:
            each.pop(instance, None)

    def _read(self, pad: Any) -> PadState:
        down = frozenset(name for number, name in enumerate(BUTTONS) if pad.get_button(number))
        return PadState(down, {name: max(-1.0, pad.get_axis(number) / AXIS_FULL) for number, name in enumerate(AXES)})


def main(robot: Connection, hand: Mapping[str, Any] | None = None, **parameters: Any) -> None:
    """Command the velocities of the pads until the robot's process ends; `parameters` are those of `PadParameters`."""
    given = PadParameters(**parameters)
    devices, pads = Devices(given.mapping), Pads(given, Hand(**(hand or {})))
    known: dict[int, str] = {}
    strangers: set[int] = set()
    driving = False
    try:
        while True:
            robot.receive()
            readings = devices.look()
            for number, name in devices.names.items() - known.items():
                robot.request("tell", text=f"pad {number} is there: {name}")
            for number, name in known.items() - devices.names.items():
                robot.request("tell", text=f"pad {number} has gone: {name}")
            known = dict(devices.names)
            for number in devices.unknown.keys() - strangers:
                name = devices.unknown[number].get_name()
                robot.request("tell", text=f"'{name}' is not known to SDL: it cannot drive; each of its buttons stops")
            strangers = set(devices.unknown)
            wish = pads.take(readings, now())
            if wish.stop or devices.unknown_pressed:
                robot.request("stop")
            if wish.velocity is not None:
                v, omega = wish.velocity
                robot.request("drive", v=v, omega=omega, held=True)
            elif driving:
                robot.request("release")
                if pads.expired:
                    robot.request(
                        "tell", text=f"no sign of a hand for {given.silence or HOLD_LASTS:g} s: let go and press again"
                    )
            driving = wish.velocity is not None
            if wish.arm:
                robot.request("arm")
            if wish.screen:
                robot.request("press", button="right")
            if wish.manual:
                robot.request("press", button="centre")
            select.select([robot], [], [], PAD_PERIOD)
    finally:
        devices.close()
