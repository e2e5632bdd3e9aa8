"""`txt1 fleet`: several simulated robots in one world, or a console for robots on a network."""

import argparse
import asyncio
import json
from collections.abc import Mapping
from contextlib import AsyncExitStack
from functools import partial
from itertools import combinations
from math import dist
from secrets import token_hex
from typing import TYPE_CHECKING, Final

from txt1 import commands
from txt1.bridges.registry import fleet_bridge
from txt1.bridges.services import Services
from txt1.commands import DISARMED, FAULT, OK, UNSTOPPED, flag, need, say, takes, view_of
from txt1.config import Config
from txt1.errors import ConfigError
from txt1.fleet.fleet import Fleet
from txt1.fleet.key import FLEET_NAME
from txt1.fleet.options import NETWORK
from txt1.fleet.plan import FleetPlan, plan_of
from txt1.fleet.selection import KEYS, Selection
from txt1.fleet.stopping import Standing
from txt1.kit import options
from txt1.kit.app import DISARMING, App, report
from txt1.record.options import LOG
from txt1.record.session import recording_together
from txt1.sidecar import Sidecar
from txt1.tasks.fields import PAGE
from txt1.ui import tty
from txt1.ui.terminal import Terminal
from txt1.web.options import WEB, WebPage, web_page

if TYPE_CHECKING:
    from txt1.fleet.network import Peer

# m/s and rad/s up to which a robot counts as standing
STILL: Final = (0.01, 0.02)
# s after which an incomplete stop of all is reported as it stands
REPORT_AFTER: Final = 3.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    commands.add(
        parser.add_mutually_exclusive_group(required=True),
        {
            "plan": {
                "nargs": "?",
                "metavar": "FLEET.yaml",
                "type": commands.existing,
                "help": "names, starts and tasks",
            },
            "--robots": takes("N", "number of robots; their names are txt01, txt02 and so on", commands.count),
            "--join": takes(
                "INTERFACE",
                "watch, stop and drive the fleet on this network interface; loopback by default",
                nargs="?",
                const="",
            ),
        },
    )
    commands.add(
        parser,
        options.CONFIGURATION
        | options.SEED
        | {"--speed": options.ROBOT["--speed"]}
        | LOG
        | {
            "--duration": takes("S", "end after S seconds of the robots' time", commands.positive),
            "--drive": takes("V,OMEGA", "velocity for the robots without a task: m/s, rad/s", commands.velocity),
            "--fleet-key": NETWORK["--fleet-key"],
            "--fleet-name": NETWORK["--fleet-name"],
            "--stop": takes(
                "NAME,NAME,...",
                "with --join: stop all robots, say which stand, and end; robots named here must answer",
                commands.names,
                nargs="?",
                const=[],
            ),
            "--no-arm": {"dest": "arm", "action": "store_false", "help": "do not arm"},
            "--headless": flag("no screens; a status line every second"),
            "--json": flag("no screens; one JSON object at the end"),
        }
        | WEB,
    )


def main(arguments: argparse.Namespace) -> int:
    """Run the fleet until the duration is over, the operator quits or a signal comes."""
    if arguments.join is not None:
        return _console(arguments)
    plan = plan_of(arguments.plan or arguments.robots)
    if arguments.drive is not None:
        robots = {
            name: one
            if one.drive or one.source or plan.cooperate
            else one.model_copy(update={"drive": arguments.drive})
            for name, one in plan.robots.items()
        }
        plan = plan.model_copy(update={"robots": robots})
    loaded = options.loaded(argparse.Namespace(**vars(arguments), hal=None, port=None, baud=None), plan.overrides)
    if loaded.config.hal != "sim":
        raise ConfigError(f"hal: '{loaded.config.hal}'; a fleet in one process is simulated, so choose hal=sim")
    configs = plan.configs(loaded.config)
    page = web_page(arguments)
    app = App(arguments.speed)
    reports: dict[str, object] = {}
    app.run(_operate(app, arguments, plan, configs, page, reports))
    if arguments.json and reports:
        print(json.dumps(reports))
    if app.code in (DISARMED, FAULT) and app.reason:
        say(app.reason)
    return app.code


async def _operate(
    app: App,
    arguments: argparse.Namespace,
    plan: FleetPlan,
    configs: Mapping[str, Config],
    page: WebPage | None,
    reports: dict[str, object],
) -> None:
    told = {"robots": list(configs), "duration": arguments.duration, "arm": arguments.arm}
    async with (
        recording_together(arguments.log, configs, app.speed, told, say) as attach,
        Fleet.of(plan, configs, attach) as fleet,
        AsyncExitStack() as bridges,
    ):
        app.subject = fleet
        robots = list(fleet.robots.values())
        if arguments.duration is not None:
            for robot in robots:
                robot.runtime.scheduler.end_at(arguments.duration)
        if page is not None:
            await _serve(fleet, page, arguments, bridges)
        helm = Selection(fleet)

        async def prepare() -> None:
            await fleet.get_ready(arm=arguments.arm)
            steering = fleet.begin_tasks()
            # only an error of these tasks ends the run
            await asyncio.gather(*steering, asyncio.Future[None]())

        preparing = asyncio.ensure_future(prepare())
        more = {"n": helm.next, "e": helm.toggle_esc}
        terminal = partial(Terminal, helm, helm, app.beat, helm.teleop, shown=KEYS, more=more)
        lines = asyncio.ensure_future(_lines(fleet)) if view_of(arguments) == "lines" else None
        others = [robot.runtime.scheduler.ended for robot in robots[1:]]
        view = "nothing" if view_of(arguments) == "lines" else view_of(arguments)
        try:
            await app.watch(robots[0].runtime, terminal, view, preparing, *others)
        finally:
            preparing.cancel()
            if lines is not None:
                lines.cancel()
            reports.update({name: report(robot.runtime) for name, robot in fleet.robots.items()})
        if app.code == OK:
            app.code, app.reason = verdict(fleet)


async def _serve(fleet: Fleet, page: WebPage, arguments: argparse.Namespace, bridges: AsyncExitStack) -> None:
    """Serve one page for all robots, until the stack is closed."""
    requests = {}
    for name, robot in fleet.robots.items():
        services = Services(robot, robot.config, arguments.speed, page.folder)
        bridges.push_async_callback(services.close)
        requests[name] = services.requests
    told = f"the page is at {'  '.join(page.places)}"
    server: Sidecar | None = None

    def ready() -> None:
        for robot in fleet.robots.values():
            robot.tell(told)
        if view_of(arguments) != "screens" or not tty.drawable():
            say(told)

    for robot in fleet.robots.values():
        robot.runtime.bus.offer(PAGE, lambda: page.places[0] if server is not None and server.answers else None)
    kind, given = page.bridge()
    given = given | {"fleet": list(fleet.robots)}
    server = await bridges.enter_async_context(fleet_bridge(fleet.robots, kind, given, requests, ready=ready))


def _console(arguments: argparse.Namespace) -> int:
    """Run a console of a fleet on a network."""
    need("--join", "fleet", "zenoh")
    from txt1.fleet.console import KEYS as CONSOLE_KEYS
    from txt1.fleet.console import Console
    from txt1.fleet.network import Peer

    page = web_page(arguments)
    fleet = arguments.fleet_name or FLEET_NAME
    peer = Peer(f"console_{token_hex(4)}", arguments.join, arguments.fleet_key, fleet=fleet, console=True)
    try:
        if arguments.stop is not None:
            return _stop_all(peer, arguments.stop)
        if page is not None:
            return App().run(_page(peer, page))
        if arguments.headless or arguments.json or not tty.drawable():
            peer.listen(arguments.duration or 3.0)
            print(json.dumps([one._asdict() for one in peer.members()]))
            return OK
        console = Console(peer)

        async def watch() -> None:
            async with Terminal(
                console, console, teleop=console.teleop, shown=CONSOLE_KEYS, more={"n": console.next}
            ) as terminal:
                await terminal.wait()

        App().run(watch())
        return OK
    finally:
        peer.close()


async def _page(peer: "Peer", page: WebPage) -> None:
    """Serve a page of the fleet on the network until a signal comes."""
    from txt1.fleet.page import Network
    from txt1.web.server import serve

    network = Network(peer)
    try:
        if not network.names():
            say("no robot of the fleet is heard yet; the page opens with the first")
        while not (names := network.names()):
            await asyncio.sleep(0.5)
        _, given = page.bridge()
        say(f"the page will be at {'  '.join(page.places)}")
        await serve(network, **given | {"folder": page.folder, "fleet": names})  # type: ignore[arg-type]
    finally:
        network.close()


def _stop_all(peer: "Peer", expected: list[str]) -> int:
    """Stop all robots and report which stand, which only closed their gates, which did not, and which are silent."""
    saying = peer.stop_all(expected)
    saying.join(REPORT_AFTER)
    if saying.is_alive():
        say(f"{_standing(peer)}; the stop is repeated for half a minute")
    saying.join()
    standing = _standing(peer)
    print(standing)
    if standing == Standing():
        say("nothing was stopped: is the robot's --fleet on this network, with the same key and --fleet-name?")
        return FAULT
    return OK if standing.complete else UNSTOPPED


def _standing(peer: "Peer") -> Standing:
    standing, _ = peer.standing() or (Standing(), 0.0)
    return standing


async def _lines(fleet: Fleet) -> None:
    """Print one line a second."""
    while True:
        print(line(fleet), flush=True)
        await asyncio.sleep(1.0)


def line(fleet: Fleet) -> str:
    """Sum up a fleet in a line: numbers of armed and of moving robots, and the smallest distance between two
    centres.
    """
    robots = list(fleet.robots.values())
    armed = sum(robot.armed for robot in robots)
    moving = sum(abs(robot.odometry.v) > STILL[0] or abs(robot.odometry.omega) > STILL[1] for robot in robots)
    apart = min((dist(a[:2], b[:2]) for a, b in combinations([r.pose for r in robots if r.pose], 2)), default=None)
    near = "" if apart is None else f"  nearest two {apart:.2f} m apart"
    held = "".join(f"; {name} is stuck: {part.stuck}" for name, part in fleet.cooperations.items() if part.stuck)
    warned = held + "".join(f"; {each}" for each in robots[0].runtime.state.warned())
    return f"t={fleet.now:8.2f} s  {len(robots)} robots, {armed} armed, {moving} moving{near}{warned}"


def verdict(fleet: Fleet) -> tuple[int, str]:
    """Return the exit code of a run that ended by itself, and the reason."""
    for name, robot in fleet.robots.items():
        gate = robot.runtime.gate
        if any(gate.counts[fault] for fault in DISARMING):
            return DISARMED, f"{name} was stopped: {gate.told}"
    for name, part in fleet.cooperations.items():
        if part.stuck:
            return FAULT, f"{name} is stuck; in its way: {part.stuck}"
        if part.silent:
            return FAULT, f"{name} waits for {part.silent}"
    return OK, ""
