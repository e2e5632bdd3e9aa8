"""Runs a robot under an operator's eyes, for `txt1 run`."""

from __future__ import annotations

import argparse
import asyncio
import warnings
from collections.abc import Awaitable, Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Final

from txt1.additions import blamed
from txt1.cli import practice
from txt1.cli.service_manager import served
from txt1.commands import DISARMED, FAULT, OK, say, view_of
from txt1.config import Config
from txt1.config.sources import with_values
from txt1.control.guarding import GuardWatch
from txt1.control.limits import SetpointBounds
from txt1.driver import REFRESH, SOURCES, CommandSource
from txt1.errors import ConfigError, HalError, TaskFault, Txt1Error
from txt1.hal.base import Button
from txt1.installing import installs
from txt1.kernel.ticks import Ticks
from txt1.kit import options
from txt1.kit.app import DISARMING, App, conclude, real_time, refusal_of_gains
from txt1.robot import Robot
from txt1.ui.teleop import Teleop
from txt1.ui.terminal import Terminal
from txt1.ui.viewer import DRIVING

# MAP
PRACTICE_SCREEN: Final = 5
Steer = Callable[[Robot], Awaitable[None]]


def run(arguments: argparse.Namespace, steer: Steer | None = None) -> int:
    """Run the robot until the duration is over, the operator quits or a signal comes.

    `steer` drives it in place of a source of commands that the command line names.
    """
    config = practice.configured(arguments) if arguments.practice else options.loaded(arguments).config
    if arguments.name is not None:
        config = with_values(config, {"name": arguments.name})
    if arguments.drive is not None:
        _tell_limits(arguments.drive, config)
    if config.hal == "sim" and config.sim.room.map is not None:
        # it needs numpy, and a room without a map does not
        from txt1.maps.files import read as read_map

        for remark in read_map(config.sim.room.map).remarks:
            say(remark)
        if find_spec("numba") is None and any(each.driver == "sim_laser" for each in config.sensors.values()):
            say(f"the laser's rays against the map take long without numba: {installs('fast')}")
            warnings.filterwarnings("ignore", "rays against a map", RuntimeWarning)
    if arguments.realtime and arguments.speed is not None:
        raise ConfigError("--realtime: in virtual time (--speed) nothing is late; leave one of them out")
    if arguments.screen is not None:
        _refuse_screen(arguments)
    elif arguments.practice:
        arguments.screen = PRACTICE_SCREEN
    asked: dict[str, object] = {}
    for name, told in arguments.optional.items():
        with blamed(name, "options"):
            settings = told.asked(arguments, config)
        if settings is not None:
            asked[name] = settings
    # an addition takes a source of its own, as teaching takes a policy's file
    if arguments.source is not None:
        steer = SOURCES.find("--source", arguments.source)[0]
    app = App(arguments.speed)
    app.run(_operate(app, arguments, config, steer, asked))
    return conclude(app, arguments.json)


def _refuse_screen(arguments: argparse.Namespace) -> None:
    """Raise ConfigError if there is no screen of the requested number, or none at all."""
    if arguments.headless or arguments.json:
        raise ConfigError("--screen: without screens it has no effect; leave it out")
    from txt1.ui.screens import installed

    names = list(installed())
    if arguments.screen > len(names):
        there = ", ".join(f"{number} {name}" for number, name in enumerate(names, 1))
        raise ConfigError(f"--screen {arguments.screen}: there is none of this number; there are {there}")


def _idle(robot: Robot) -> str:
    """Return why the driving keys move nothing, with the remedy first; "" if they do."""
    if not robot.armed:
        return "press m to arm: w, s, a, d move nothing before"
    if robot.runtime.state.panel.manual:
        return "press c for controller mode: in manual mode keys do not drive"
    return "press e to switch the ESC on: it is off" if robot.runtime.state.power.esc is False else ""


def _tell_limits(drive: tuple[float, float], config: Config) -> None:
    """Print the set-point (m/s, rad/s) that the safety gate makes of this one, if the car cannot drive it."""
    nearest = SetpointBounds(config.limits()).nearest(*drive)
    if nearest != drive:
        radius, limits = config.geometry.radius_min, config.safety
        say(
            "--drive {:g},{:g}: it will be {:.3g},{:.3g}".format(*drive, *nearest)
            + f", as this car turns with a radius of at least {radius:g} m, at {limits.v_max:g} m/s and "
            f"{limits.omega_max:g} rad/s at most"
        )


async def _operate(
    app: App, arguments: argparse.Namespace, config: Config, steer: Steer | None, asked: Mapping[str, object]
) -> None:
    """Bring the robot up with everything requested, and watch it to the end."""
    async with app.robot(config, additions=asked) as robot:
        teleop = Teleop(config.teleop.speed, config.hand())
        if arguments.duration is not None:
            robot.runtime.scheduler.end_at(arguments.duration)
        keys = {name: key.meaning for name, key in robot.keys.items()}
        shown = {"SPACE": DRIVING["SPACE"]} | keys | DRIVING if keys else None
        more = {"m": robot.arm_by_hand, "e": robot.toggle_esc, **{name: key.do for name, key in robot.keys.items()}}
        for _ in range((arguments.screen or 1) - 1):
            robot.press(Button.RIGHT)
        start = RunStart(robot, arguments.arm, arguments.drive, steer)

        async def prepare() -> None:
            await start.get_ready()
            # only an error of this future ends the run
            await asyncio.Future()

        getting_ready = asyncio.ensure_future(prepare())
        idle, waits = partial(_idle, robot), robot.runtime.scheduler.waits
        terminal = partial(Terminal, robot, robot.source("keys"), app.beat, teleop, shown, more, idle, waits)
        with served(robot.runtime), real_time(robot) if arguments.realtime else nullcontext():
            try:
                guards = robot.runtime.part(GuardWatch)
                ends = robot.alongside if guards is None else [*robot.alongside, guards.fault]
                await app.watch(robot.runtime, terminal, view_of(arguments), getting_ready, *ends)
            finally:
                getting_ready.cancel()
        # who ends the run has seen why it was disarmed; a car that is not known to stand has a code of its own
        if app.code == OK and not app.quit:
            app.code, app.reason = start.verdict(arguments.duration)
            if app.code == FAULT:
                say(app.reason)


@dataclass
class RunStart:
    """The start of a run, with a robot whose link may not be up yet."""

    robot: Robot
    # None leaves arming to safety.auto_arm
    arm: bool | None
    # m/s and rad/s to command throughout
    drive: tuple[float, float] | None = None
    steer: Steer | None = None
    linked: bool = False
    armed: bool = False

    async def get_ready(self) -> None:
        """Wait for the link, arm if requested, load the gains, start the script or the learning."""
        robot = self.robot
        await robot.linked()
        self.linked = True
        if self._to_be_armed():
            robot.arm()
            self.armed = True
        while not await robot.load_gains():
            if robot.gains_rejected:
                raise HalError(refusal_of_gains(robot))
            robot.tell("the board has not acknowledged the gains yet; they are sent again and again")
        if self.drive is not None:
            robot.add_task("script", REFRESH, partial(_script, robot.source("script"), self.drive))
        for begin in robot.on_ready:
            await begin()
        if self.steer is not None:
            try:
                await self.steer(robot)
            except Txt1Error:
                raise
            except Exception as error:
                raise TaskFault("source of commands", error) from error

    def _to_be_armed(self) -> bool:
        """Return whether arming was requested, and the robot was not stopped since."""
        return (self.robot.arms_by_itself if self.arm is None else self.arm) and not self.robot.touched

    def verdict(self, duration: float | None) -> tuple[int, str]:
        """Return the exit code of a run that ended by itself, and the reason."""
        runtime = self.robot.runtime
        gate, board = runtime.gate, runtime.state.board
        if any(gate.counts[fault] for fault in DISARMING):
            return DISARMED, gate.told
        if board is not None and self._to_be_armed() and not self.armed:
            return DISARMED, f"never armed: {board.text}"
        if board is not None and duration is not None and not self.linked:
            return FAULT, f"there was no link to the board in {duration:g} s: {board.text}"
        for why in self.robot.unfinished:
            if reason := why():
                return FAULT, reason
        return OK, gate.reason


async def _script(source: CommandSource, velocity: tuple[float, float], ticks: Ticks) -> None:
    async for _ in ticks:
        source.command(*velocity)
