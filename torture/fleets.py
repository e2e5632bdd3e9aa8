"""Faults of a fleet on one computer, in real time: a robot with its bridge, a console that drives and stops it, and
whoever else is there.

What has to hold: a stop closes the gate of the robot that hears it, whatever was said before; who says that the robot
stands is right; and no command moves the robot that is older than the gate allows.
"""

import asyncio
import json
import os
import random
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple
from unittest.mock import patch

from torture.struck_robot import ENDLESS, Broken
from txt1.bridges.registry import bridge
from txt1.fleet.key import SIGNATURE, FleetKey, fleet_key
from txt1.fleet.link import FleetLink
from txt1.fleet.members import NEW
from txt1.fleet.network import Hooks, Peer, configuration, need_zenoh
from txt1.fleet.stopping import Standing
from txt1.kernel.clock import NS_PER_S, RealClock
from txt1.robot import Robot
from txt1.sidecar import Sidecar

FAULTS: Final = (
    "console started again",
    "stops forged and repeated",
    "hostile peer",
    "bridge stood still",
    "two fleets",
    "name taken",
)
STALE: Final = 0.25  # s after which a command drives no more
STOPPED: Final = 0.5  # s from a stop's first saying to a closed gate, with a third of the messages lost
BUSY: Final = 3.0  # s that a busy machine may be late
COMING: Final = 60.0  # s for a process to come up on a busy machine
REST: Final = 0.05  # m/s
TICK: Final = 0.01
PATIENT: Final = ("safety.missed_ticks_max=1000000",)  # a busy machine is no fault


class Shifted(RealClock):
    """The clock of a computer that was started at another time; `by` s ahead of this one's."""

    def __init__(self, by: float) -> None:
        self._by = int(by * NS_PER_S)

    def now_ns(self) -> int:
        """The time, in ns since that computer's start."""
        return max(0, super().now_ns() + self._by)


class Stranger:
    """Somebody who puts anything on any of a fleet's Zenoh keys, and hears all of them."""

    def __init__(self, key: FleetKey) -> None:
        config = configuration()
        config.insert_json5("listen/endpoints", json.dumps(["tcp/127.0.0.1:0"]))
        self._session, self._key = need_zenoh().open(config), key
        self.heard: dict[str, list[bytes]] = {}
        self._session.declare_subscriber(f"{key.space}/**", self._hear)

    def _hear(self, sample: Any) -> None:
        where = str(sample.key_expr).removeprefix(f"{self._key.space}/")
        self.heard.setdefault(where.split("/")[0], []).append(bytes(sample.payload))

    def put(self, where: str, payload: bytes, signed: bool = True) -> None:
        """Say something, with the fleet's key or without."""
        self._session.put(f"{self._key.space}/{where}", self._key.signed(where, payload) if signed else payload)

    def close(self) -> None:
        """Leave."""
        self._session.close()


class Scene(NamedTuple):
    """What a fault strikes."""

    robot: Robot
    beside: Sidecar
    stack: AsyncExitStack
    name: str
    key: FleetKey

    async def console(self, name: str = "console1", **options: Any) -> Peer:
        """A console of the robot's fleet that hears it."""
        peer = await asyncio.to_thread(Peer, name, fleet=self.key.fleet, console=True, **options)
        self.stack.callback(peer.close)
        await within(COMING, lambda: self.name in peer.heard(), "the console does not hear the robot")
        return peer

    async def drives(self, console: Peer) -> "asyncio.Task[None]":
        """Have a console drive the robot, until it moves and from then on."""

        async def drive() -> None:
            while True:
                console.drive(self.name, 0.6, 0.3)
                await asyncio.sleep(0.05)

        # after a stop a hand lets go before it drives again; a message may be lost
        for _ in range(10):
            console.drive(self.name, 0.0, 0.0)
            await asyncio.sleep(0.05)
        self.robot.arm()
        driving = asyncio.ensure_future(drive())
        self.stack.callback(driving.cancel)
        await within(COMING, lambda: self.robot.odometry.v > 0.3, "the console does not drive the robot")
        return driving

    async def stops(self, console: Peer) -> float:
        """Have a console stop the robot; how long it takes, s, until the gate is closed."""
        asked = self.robot.armed
        console.stop_all([self.name])
        took = await within(STOPPED + BUSY, lambda: not self.robot.armed, "a stop was not obeyed")
        if not asked:
            raise Broken("the robot was not armed")

        def told() -> Standing:
            return (console.standing() or (Standing(), 0.0))[0]

        await within(COMING, lambda: told().stands == (self.name,), "the console does not say that it stands")
        if abs(self.robot.odometry.v) > REST or self.robot.armed:
            raise Broken(f"said to stand at {self.robot.odometry.v:.2f} m/s")
        return took


async def within(patience: float, condition: Callable[[], bool], what: str) -> float:
    """How long it takes, s, until something is true."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    while not condition():
        if loop.time() - began > patience:
            raise Broken(f"{what}: not within {patience:.2f} s")
        await asyncio.sleep(TICK)
    return loop.time() - began


@asynccontextmanager
async def scene(folder: Path, rng: random.Random) -> AsyncIterator[Scene]:
    """A robot in a fleet of its own, whose messages are lost now and then."""
    name, fleet = "net01", f"torture{rng.randrange(10**9)}"
    with patch.dict(os.environ, XDG_CONFIG_HOME=str(folder)):
        async with Robot.open(hal="sim", name=name, settings=(*ENDLESS, *PATIENT)) as robot, AsyncExitStack() as stack:
            link = FleetLink(robot)
            options = {"name": name, "fleet": fleet, "loss": rng.choice((0.0, 0.3))}
            beside = await stack.enter_async_context(bridge(robot, "fleet", options, link.requests, silence=COMING))
            robot.arm()
            await robot.load_gains(timeout=20.0)
            yield Scene(robot, beside, stack, name, fleet_key("", None, fleet))
            if beside.counts["restarts"] > 0:
                told = [event.text for event in robot.runtime.state.events if "bridge" in event.text]
                raise Broken(f"the bridge had to be started again: {told}")


async def strike(fault: str, rng: random.Random, folder: Path, seen: dict[str, float]) -> None:
    """Strike a fleet; the longest time until a gate was closed, s."""
    async with scene(folder, rng) as struck:
        seen["neutral"] = max(await ACTS[fault](struck, rng))


async def _console_started_again(struck: Scene, rng: random.Random) -> list[float]:
    """Its computer was started anew, and has another clock each time."""
    took = []
    for _ in range(3):
        console = await struck.console(clock=Shifted(rng.uniform(-1e3, 1e6)))
        driving = await struck.drives(console)
        await asyncio.sleep(rng.uniform(0.0, 0.5))
        took.append(await struck.stops(console))
        driving.cancel()
        console.close()
    return took


async def _forged(struck: Scene, rng: random.Random) -> list[float]:
    """Stops of others, made up, signed or not, and those that were heard before, again and again."""
    stranger = Stranger(struck.key)
    struck.stack.callback(stranger.close)
    console = await struck.console()
    took = []
    for _ in range(3):
        for _ in range(rng.randrange(1, 60)):
            made = {
                "from": "console1",
                "stop": rng.choice(["f" * 32, f"{rng.getrandbits(128):032x}", None, 7]),
                "number": rng.choice([2**60, -1, 0, 10**30, None]),
            }
            stranger.put("stop/console1", json.dumps(made).encode(), signed=rng.random() < 0.5)
        old = stranger.heard.get("stop", [b""])
        for _ in range(rng.randrange(1, 60)):
            stranger.put("stop/console1", rng.choice(old)[SIGNATURE:])
        await asyncio.sleep(0.5)
        driving = await struck.drives(console)
        took.append(await struck.stops(console))
        driving.cancel()
    return took


async def _hostile(struck: Scene, rng: random.Random) -> list[float]:
    """One who has the key floods the robot with all that there is, in its own name, too, while it is stopped."""
    stranger = Stranger(struck.key)
    struck.stack.callback(stranger.close)
    console = await struck.console()
    places = ("state", "learned", "drive", "ping", "pong", "stopped", "alive")
    settled = rng.random() < 0.2  # the robot has been in the fleet for so long that nobody's word turns it out
    names = ["net99", "name1", *([struck.name] if settled else [])]

    async def flood() -> None:
        while True:
            for _ in range(20):
                message = {
                    "from": rng.choice(names), "id": "0", "up": 1e5,
                    "sent": rng.choice([0, 2**62, -1, "x"]), "given": rng.choice([0, 2**62, -1, None]),
                    "v": rng.choice([1.5, -1.5, 1e300, "x"]), "omega": rng.choice([0.0, 10**400]),
                    "stop": rng.choice(["0" * 32, 1]), "closed": True, "stands": True, "x": rng.choice([0.0, "boom"]),
                }  # fmt: skip
                where = f"{rng.choice(places)}/{rng.choice(['net01', 'console1', 'net99'])}"
                stranger.put(where, json.dumps(message).encode(), signed=rng.random() < 0.8)
            await asyncio.sleep(0.02)

    await struck.drives(console)
    await asyncio.sleep(NEW + 1.0 if settled else 0.0)
    flooding = asyncio.ensure_future(flood())
    struck.stack.callback(flooding.cancel)
    await asyncio.sleep(rng.uniform(0.5, 2.0))
    took = [await struck.stops(console)]
    flooding.cancel()
    return took


async def _stood_still(struck: Scene, rng: random.Random) -> list[float]:
    """The bridge's process stands still while a console drives, and goes on after the last key: nothing may move."""
    console = await struck.console()
    driving = await struck.drives(console)
    child = struck.beside.pid
    os.kill(child, signal.SIGSTOP)
    try:
        await asyncio.sleep(rng.uniform(0.8, 2.0))
        driving.cancel()
        await asyncio.sleep(rng.uniform(STALE, 0.8))
        await within(COMING, lambda: abs(struck.robot.odometry.v) < REST, "standing")
    finally:
        os.kill(child, signal.SIGCONT)
    ends = struck.robot.now + 1.5
    while struck.robot.now < ends:
        if abs(struck.robot.odometry.v) > REST:
            raise Broken(f"a stale command drove it, at {struck.robot.odometry.v:.2f} m/s")
        await asyncio.sleep(TICK)
    await struck.drives(console)
    return [await struck.stops(console)]


async def _two_fleets(struck: Scene, rng: random.Random) -> list[float]:
    """Somebody else's fleet of the same names on the same network, who drives and stops."""
    key = Path(os.environ["XDG_CONFIG_HOME"], "another")
    key.touch(mode=0o600)  # noqa: ASYNC240
    key.write_text(f"the key of another user {rng.random()}")  # noqa: ASYNC240
    other = await asyncio.to_thread(Peer, struck.name, "", key, fleet=struck.key.fleet)
    theirs = await asyncio.to_thread(Peer, "console1", "", key, fleet=struck.key.fleet, console=True)
    struck.stack.callback(other.close)
    struck.stack.callback(theirs.close)
    console = await struck.console()
    await struck.drives(console)
    theirs.stop_all()
    for _ in range(20):
        theirs.drive(struck.name, -1.5, 0.0)
        await asyncio.sleep(0.05)
    if not struck.robot.armed or struck.robot.odometry.v < 0.0:
        why = struck.robot.reason or f"{struck.robot.odometry.v:.2f} m/s"
        raise Broken(f"another fleet stopped or drove it: {why}")
    return [await struck.stops(console)]


async def _name_taken(struck: Scene, rng: random.Random) -> list[float]:
    """A second robot of the name comes, on a computer too busy for it to find the first within its look."""
    del rng
    console = await struck.console()
    await struck.drives(console)
    refused: list[str] = []
    with patch("txt1.fleet.network.NAME_CHECK_TIME", 0.0):
        hooks = Hooks(double=refused.append)
        second = await asyncio.to_thread(Peer, struck.name, hooks=hooks, fleet=struck.key.fleet)
    struck.stack.callback(second.close)
    await within(COMING, lambda: bool(refused), "a second robot of the name was not refused")
    second.close()
    if not struck.robot.armed:
        raise Broken("the first robot was stopped")
    return [await struck.stops(console)]


ACTS: Final = dict(
    zip(FAULTS, (_console_started_again, _forged, _hostile, _stood_still, _two_fleets, _name_taken), strict=True)
)
