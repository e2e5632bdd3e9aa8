"""Several simulated robots in one world and one process, with their events and a stop of all."""

import asyncio
import os
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

from txt1.config import Config, load
from txt1.driver import REFRESH, SOURCES, CommandSource
from txt1.errors import HalError, NotArmed
from txt1.fleet.cooperation import Cooperation, body_of, see_simulated
from txt1.fleet.law import make_law
from txt1.fleet.plan import FleetPlan, plan_of
from txt1.fleet.radio import Radio
from txt1.hal.registry import in_world, world_of
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sim.world import World

LINKED_WITHIN = 10.0  # s


class Fleet:
    """Running robots. Get one from `Fleet.open`."""

    def __init__(self, plan: FleetPlan, robots: Mapping[str, Robot], world: World) -> None:
        self.plan = plan
        """The plan, as written."""
        self.robots = robots
        """The robots by name, in the order of the plan."""
        self.world = world
        """The world of all robots."""
        self.cooperations: dict[str, Cooperation] = {}
        """Each robot's part in a common law, by name; empty without a law."""

    @staticmethod
    @asynccontextmanager
    async def open(
        fleet: FleetPlan | str | os.PathLike[str] | int,
        *,
        config: str | os.PathLike[str] | Config | None = None,
        seed: int | None = None,
        settings: Sequence[str] = (),
        ready: bool = True,
        attach: Callable[[Runtime], None] | None = None,
    ) -> AsyncIterator["Fleet"]:
        """Open a fleet: its gains are loaded and all robots are armed; they are stopped safely when the block is left.

        Every robot draws random values of its own from the same seed, by its name. So they do not depend on the number
        and the order of the robots. When a task of any robot fails, all are stopped and the block is left with a
        TaskFault.

        Args:
            fleet: a plan, a file with a plan, or a number of robots, called txt01, txt02 and so on.
            config: of all robots; the plan's settings win over it: a YAML file or a ready configuration.
            seed: repeats every random value.
            settings: ``a.b=c`` each, as with ``--set``; they win.
            ready: whether to wait for the links, load the gains and arm; otherwise the caller does so.
            attach: called with each runtime before it starts, for example to record it.

        Raises ConfigError: the plan or a setting is wrong, or two robots would stand in one place; TaskFault.

        """
        plan = plan_of(fleet)
        if isinstance(config, Config):
            base = config
        else:
            options = {} if seed is None else {"seed": seed}
            base = load(config, [*plan.overrides, *settings], os.environ, options).config
        async with Fleet.of(plan, plan.configs(base), attach) as team:
            if ready:
                await team.get_ready()
            yield team

    @staticmethod
    @asynccontextmanager
    async def of(
        plan: FleetPlan, configs: Mapping[str, Config], attach: Callable[[Runtime], None] | None = None
    ) -> AsyncIterator["Fleet"]:
        """Open a fleet of these configurations, one for each robot; it is disarmed, and its links may not be up yet."""
        world = world_of(next(iter(configs.values())))
        async with AsyncExitStack() as stack:
            robots = {}
            for name, own in configs.items():
                opened = Robot.open(config=in_world(own, world), world=world, arm=False, patience=0.0, attach=attach)
                robots[name] = await stack.enter_async_context(opened)
            yield Fleet(plan, robots, world)

    async def get_ready(self, *, arm: bool = True) -> None:
        """Wait for all the links, arm and load the gains; HalError or NotArmed: a robot cannot be made ready."""
        await asyncio.gather(*(robot.linked(LINKED_WITHIN) for robot in self.robots.values()))
        if arm:
            self.arm_all()
        loaded = await asyncio.gather(*(robot.load_gains() for robot in self.robots.values()))
        for name, done in zip(self.robots, loaded, strict=True):
            if not done:
                raise HalError(f"{name}: its gains were not acknowledged; check control.linear and control.angular")

    def begin_tasks(self) -> list[asyncio.Task[None]]:
        """Start every robot's own task, or the common task; return the tasks that are sources of commands.

        Raises ConfigError: there is no source of commands of that name, or no such law.
        """
        steering = []
        if self.plan.cooperate:
            self.cooperate(self.plan.cooperate)
        for name, member in self.plan.robots.items():
            robot = self.robots[name]
            if member.drive is not None:
                robot.add_task("script", REFRESH, partial(_drive, robot.source("script"), member.drive))
            if member.source is not None:
                steer, _ = SOURCES.find(f"robots.{name}.source", member.source)
                steering.append(asyncio.ensure_future(steer(robot)))
        return steering

    def cooperate(self, settings: Mapping[str, Any], air: Radio | None = None) -> None:
        """Let all robots drive by a law of `txt1.fleet.law`: ``law`` and its settings; raises ConfigError."""
        air = air or Radio()
        room, team = (self.world.room.length, self.world.room.width), list(self.robots)
        for name, robot in self.robots.items():
            law = make_law(name, team, room, settings, body_of(robot.config))
            self.cooperations[name] = Cooperation(robot, air.voice(name), law, room, see_simulated)
        for each in self.cooperations.values():
            each.begin()

    @property
    def now(self) -> float:
        """Seconds since the first robot's run started."""
        return next(iter(self.robots.values())).now

    def stop_all(self) -> None:
        """Emergency stop of every robot: neutral outputs at once, latched until armed again."""
        for robot in self.robots.values():
            robot.stop()

    def arm_all(self) -> None:
        """Arm every robot; NotArmed: some robot may not be armed, and then none is."""
        try:
            for robot in self.robots.values():
                robot.arm()
        except NotArmed:
            self.disarm("another robot of the fleet cannot be armed")
            raise

    def disarm(self, reason: str = "disarmed by the program") -> None:
        """Disarm every robot."""
        for robot in self.robots.values():
            robot.disarm(reason)


async def _drive(source: CommandSource, velocity: tuple[float, float], ticks: Ticks) -> None:
    async for _ in ticks:
        source.command(*velocity)
