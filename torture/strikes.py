"""Faults that strike a robot on the desk: each a function that does it, and a plan of them for a seed.

A strike is a name, a time and a number between 0 and 1 of which it makes what it needs, so a plan is a list of plain
values that can be written down, repeated and cut short.
"""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, nan
from typing import Any, Final, NamedTuple

import numpy as np

from rigs.ros_ends import ROS_ENDS
from torture.hands import key_repeats, pad_freezes
from torture.struck_robot import Broken, Desk
from txt1.board.board import BoardEvent
from txt1.control.pid import Gains
from txt1.control.schedule import GainSet
from txt1.errors import CommandRefused, NotArmed, NotCapable
from txt1.hal.base import Button
from txt1.kernel.loop import clock_of
from txt1.protocol.messages import CombinedOdometry, PidSet, PowerControl, PwmCommand, PwmTest, Switch, Velocity
from txt1.sidecar import Request
from txt1.sim.parameters import LineFaults
from txt1.web.requests import REQUESTS

# the hardware underneath: the simulation, one of the two boards, and cars of other makes
KINDS: Final = ("sim", "ours", "original", "pi", "vesc", "waveshare", "pico")
HUGE: Final = (1e6, 1e300, 10**400, -1e9, 3.4e38)
NOT_FINITE: Final = (nan, inf, -inf)


class Strike(NamedTuple):
    """One fault: its name, when it strikes (s after the robot began to drive), and what it is made of, 0 to 1."""

    name: str
    time: float
    value: float


def pick(values: Sequence[Any], value: float) -> Any:
    """One of the values."""
    return values[int(value * len(values)) % len(values)]


def spread(value: float, low: float, high: float) -> float:
    """A number between two."""
    return low + value * (high - low)


Act = Callable[[Desk, float], None]
STRIKES: Final[dict[str, Act]] = {}


def strike(act: Act) -> Act:
    """Take a function in, by its name."""
    STRIKES[act.__name__.replace("_", " ")] = act
    return act


# -- commands ----------------------------------------------------------------------------------------------------------


@strike
def command_not_finite(desk: Desk, value: float) -> None:
    """NaN or infinite velocities, again and again for half a second."""
    bad = pick(NOT_FINITE, value)
    v, omega = pick(((bad, 0.0), (0.5, bad), (bad, bad)), 7 * value)
    desk.insist(0.5, lambda: desk.command("program", v, omega))


@strike
def command_huge(desk: Desk, value: float) -> None:
    """Velocities far beyond the limits."""
    v, omega = pick(HUGE, value), pick(HUGE, 3 * value)
    desk.insist(0.5, lambda: desk.command("program", v, omega))


@strike
def command_late(desk: Desk, value: float) -> None:
    """Commands that were given long ago, in place of fresh ones."""
    desk.drives_until_quiet(1.0)
    age = spread(value, 0.0, 3.0)
    desk.insist(1.0, lambda: desk.command("keys", 1.0, 0.5, desk.now - age))


@strike
def command_from_the_future(desk: Desk, value: float) -> None:
    """Commands that claim to be given later than now."""
    desk.drives_until_quiet(1.5)
    desk.command("web", 1.0, 0.0, desk.now + spread(value, 0.002, 10.0))
    desk.post(Velocity(1.0, 0.0), desk.now + spread(value, 0.2, 10.0))


@strike
def message_from_the_past(desk: Desk, value: float) -> None:
    """A Velocity message that waited somewhere, with its old time."""
    desk.post(Velocity(1.5, 0.0), desk.now - spread(value, 0.0, 5.0))


@strike
def messages_not_finite(desk: Desk, value: float) -> None:
    """Messages past the API: velocities, PWM, gains, odometry that are no numbers."""
    bad = pick(NOT_FINITE, value)
    for message in (
        Velocity(bad, 0.5),
        PwmTest(bad, 0, 0, 0, 0),
        PwmCommand(0, bad),
        PidSet((bad, 1.0, 1.0), ()),
        CombinedOdometry(0, 0, 0, bad, 0),
    ):
        desk.post(message, desk.now)


@strike
def flood(desk: Desk, value: float) -> None:
    """More messages at once than there is room for."""
    for k in range(1500):
        desk.post(Velocity(pick((0.0, 0.5, nan), value + 0.34 * k), 0.0), desk.now)


def _everything(desk: Desk, value: float) -> None:
    """Each message that there is, hundreds of times at once; none of those that may move anything is sound."""
    for k in range(300):
        bad = pick((*NOT_FINITE, *HUGE), value + 0.13 * k)
        for message in (
            Velocity(0.0, 0.0),
            Velocity(nan, bad),
            PwmTest(0, 0, 0, 0, 0),
            PwmCommand(k % 7, bad),
            PidSet((bad, bad, bad), ((bad, 0.0, 0.0, 0.0),)),
            CombinedOdometry(0, 0, 0, nan, bad),
            PowerControl(Switch.ATX, False),
        ):
            desk.post(message, desk.now)


@strike
def flood_of_each(desk: Desk, value: float) -> None:
    """Every message that there is, hundreds of times at once."""
    _everything(desk, value)


@strike
def stop_in_a_flood(desk: Desk, value: float) -> None:
    """The operator's stop in the middle of a flood of everything, which goes on."""
    _everything(desk, value)
    desk.stop(spread(value, 0.5, 2.0))
    desk.insist(0.1, lambda: _everything(desk, value))


@strike
def whole_envelope(desk: Desk, value: float) -> None:
    """From corner to corner of what may be asked for, ten times a second, and just above nothing."""
    rng = np.random.default_rng(int(1e9 * value))
    speeds = desk.v_max * np.array((-1.0, -1.0, -0.5, 0.0, 1e-9, 0.05, 0.5, 1.0, 1.0))
    turns = desk.omega_max * np.array((-1.0, -0.3, 0.0, 1e-9, 0.3, 1.0))

    def corner() -> None:
        desk.v, desk.omega = float(rng.choice(speeds)), float(rng.choice(turns))

    for k in range(int(spread(value, 10, 40))):
        desk.later(0.1 * k, corner)


JUNK: Final = (nan, inf, -1e308, 10**400, "boom", "", None, True, [], [[]], {}, {"v": 1.0})
ASKED: Final = (
    "drive", "combined", "servos", "press", "tell", "subscribe", "call", "begin", "cancel", "missing", "release",
    "fleet", "learned", "refused", "nothing", "parent", "request", "disarm",
)  # fmt: skip
FIELDS: Final = (
    "v", "omega", "age", "x", "y", "theta", "switch", "on", "values", "id", "name", "fields", "who", "heard",
)  # fmt: skip


@strike
def hostile_peers(desk: Desk, value: float) -> None:
    """A node of ROS, a peer of the fleet and a pad's bridge ask for everything there is, wrongly, and then for a stop.

    A stop is obeyed at once, whoever made it up and whatever came before it.
    """
    rng = np.random.default_rng(int(1e9 * value))
    end = desk.end(pick((*ROS_ENDS, "fleet", "gamepad"), value))
    for _ in range(60):
        fields = {name: JUNK[rng.integers(len(JUNK))] for name in FIELDS if rng.random() < 0.4}
        end.request(Request(ASKED[rng.integers(len(ASKED))], fields, float(rng.choice((0.0, 0.1, 10.0, -5.0)))))
        end.telemetry()
    for stop in ({}, {"who": "console1", "stop": f"{rng.integers(2**62):032x}"}, {"why": [1]}):
        end.request(Request("stop", stop if end is desk.end("fleet") else {}, 0.0))
        if desk.robot.armed:
            raise Broken(f"a stop {stop} was not obeyed")
    desk.stop(spread(value, 0.3, 1.5))
    end.let_go()


PAGE_FIELDS: Final = (
    "n", "t", "v", "omega", "ping", "points", "speed", "linear", "angular", "on", "name", "topics", "to", "stop",
)  # fmt: skip


@strike
def visitors(desk: Desk, value: float) -> None:
    """Two visitors of the web page do everything, with sense and without, beyond their budgets, and one stops.

    None of it arms the robot, loads gains, or sets its pose, and the stop is obeyed.
    """
    rng, web = np.random.default_rng(int(1e9 * value)), desk.web
    pages = [web.join("visitor"), web.join("visitor")]
    armed, table = desk.robot.armed, desk.robot.runtime.state.gains
    names = sorted(set(REQUESTS) - {"stop", "disarm", "files"})

    def ask() -> None:
        for page in pages:
            for _ in range(int(rng.integers(12))):
                fields = {name: JUNK[rng.integers(len(JUNK))] for name in PAGE_FIELDS if rng.random() < 0.15}
                web.ask(page, **{"do": names[rng.integers(len(names))], "v": 9.0, "omega": 0.3, **fields})
            web.ask(page, do="drive", v=9.0, omega=0.3)

    def end() -> None:
        for _ in range(300):
            web.ask(pages[0], do="wind")
        web.ask(pages[0], do="stop")
        if desk.robot.armed:
            raise Broken("a visitor's stop was not obeyed")
        web.ask(pages[0], do="arm")
        web.ask(pages[1], do="arm")
        if desk.robot.armed:
            raise Broken("a visitor has armed the robot")
        for page in pages:
            web.leave(page)
        desk.stop(spread(value, 0.3, 1.5))

    ask()
    if desk.robot.armed > armed or desk.robot.runtime.state.gains is not table:
        raise Broken("a visitor has armed the robot, or loaded gains")
    lasts = spread(7 * value % 1.0, 0.1, 1.5)
    desk.insist(lasts, ask)
    desk.later(lasts + 0.1, end)


@strike
def reversal(desk: Desk, value: float) -> None:
    """Full speed back."""
    desk.v, desk.omega = -desk.v, spread(value, -1.0, 1.0)


@strike
def other_source(desk: Desk, value: float) -> None:
    """Somebody of another priority drives for a while, and lets go, or does not."""
    name = pick(("keys", "gamepad", "web", "ros"), value)
    v = spread(5 * value % 1.0, -1.5, 1.5)
    desk.insist(spread(value, 0.1, 2.0), lambda: desk.command(name, v, 0.3))


@strike
def silence(desk: Desk, value: float) -> None:
    """Whoever drives falls silent."""
    desk.drives_until_quiet(spread(value, 0.2, 3.0))


@strike
def rest(desk: Desk, value: float) -> None:
    """Zeros for a while."""
    v, desk.v = desk.v, 0.0
    desk.later(spread(value, 0.2, 2.0), lambda: setattr(desk, "v", v))


# -- hands ---------------------------------------------------------------------------------------------------------


@strike
def key_up_lost(desk: Desk, value: float) -> None:
    """The release of a terminal's key is lost, and the computer repeats the key for seconds."""
    desk.spawn(key_repeats(desk, pick("ws", 9 * value), spread(value, 1.0, 8.0), spread(5 * value % 1.0, 0.1, 1.5)))


@strike
def pad_out_of_reach(desk: Desk, value: float) -> None:
    """A gamepad keeps its last state, its dead-man down."""
    desk.spawn(pad_freezes(desk, np.random.default_rng(int(1e9 * value)), False))


@strike
def pad_that_returns(desk: Desk, value: float) -> None:
    """The same, and the pad comes back as another one."""
    desk.spawn(pad_freezes(desk, np.random.default_rng(int(1e9 * value)), True))


# -- the operator ------------------------------------------------------------------------------------------------------


@strike
def emergency_stop(desk: Desk, value: float) -> None:
    """Stop; armed again after a while."""
    desk.stop(spread(value, 0.3, 3.0))


@strike
def disarm(desk: Desk, value: float) -> None:
    """Disarm; armed again after a while."""
    desk.disarm(spread(value, 0.1, 2.0))


@strike
def arm_while_armed(desk: Desk, value: float) -> None:
    """Arm once more in the middle of it, twice at the same instant."""
    desk.arm()
    desk.arm()


@strike
def stop_and_arm_at_once(desk: Desk, value: float) -> None:
    """Both in the same instant: what was given before must not count."""
    desk.stop(0.0)
    desk.arm()


@strike
def buttons(desk: Desk, value: float) -> None:
    """Any button of the joystick, on the robot."""
    desk.robot.press(pick((Button.LEFT, Button.RIGHT, Button.UP, Button.DOWN), value))


@strike
def manual_mode(desk: Desk, value: float) -> None:
    """The centre button, PWM by hand, and back."""
    desk.robot.press(Button.CENTRE)
    motor = spread(value, -30000, 30000)

    def by_hand() -> None:
        desk.pwm_test(int(motor), int(-motor), int(motor))

    desk.insist(spread(value, 0.3, 1.2), by_hand)
    desk.later(1.3, lambda: desk.robot.press(Button.CENTRE))


@strike
def servos(desk: Desk, value: float) -> None:
    """The free servos, anywhere, and with what is no count."""
    with suppress(NotArmed, CommandRefused, NotCapable):
        desk.robot.servos(int(spread(value, -40000, 40000)), pick((0, nan, 10**400, 24000), 3 * value))


@strike
def gains(desk: Desk, value: float) -> None:
    """Gains that are zero, wild, negative or none; the right ones come back after a second."""
    k = pick((0.0, 1e5, -11.0, 500.0, nan), value)
    table = tuple((x, k, k, 0.0) for x in pick(((0.5, 0.4), (0.5,), ()), 3 * value))
    desk.post(PidSet((k, k, 0.0), table), desk.now)
    desk.later(1.0, desk.load_gains)


@strike
def bad_gains_by_the_program(desk: Desk, value: float) -> None:
    """Gains that do not fit the wire, through the API."""

    async def load() -> None:
        with suppress(CommandRefused):
            await desk.robot.load_gains(Gains(pick((1e8, nan, 10**400), value), 0.0, 0.0), [GainSet(1.0, Gains())], 0.5)

    desk.spawn(load())
    desk.later(1.0, desk.load_gains)


@strike
def esc_off(desk: Desk, value: float) -> None:
    """The ESC off in the middle of it, and on again."""
    desk.switch(Switch.ESC, False)
    desk.later(spread(value, 0.2, 2.0), lambda: desk.switch(Switch.ESC, True))


@strike
def atx_off(desk: Desk, value: float) -> None:
    """The ATX supply, which has to be refused while armed."""
    desk.switch(Switch.ATX, False)
    desk.later(0.5, lambda: desk.switch(Switch.ATX, True))


@strike
def combined_odometry(desk: Desk, value: float) -> None:
    """Combined odometry that is frozen, biased, huge or no number."""
    factor, offset = pick(((0.0, 0.0), (1.1, 0.0), (1.0, 0.4), (1.0, 1e30), (1.0, nan), (-1.0, 0.0)), value)

    def offer() -> None:
        odometry = desk.robot.odometry
        with suppress(CommandRefused):
            desk.robot.combined_odometry(0.0, 0.0, 0.0, factor * odometry.v + offset, odometry.omega)

    desk.insist(spread(7 * value % 1.0, 0.5, 3.0), offer)


# -- time --------------------------------------------------------------------------------------------------------------


@strike
def stall(desk: Desk, value: float) -> None:
    """A step that takes long: everybody's clock goes on meanwhile."""
    clock: Any = clock_of(asyncio.get_running_loop())
    clock.spend(spread(value, 0.005, 0.4))


@strike
def clock_jump(desk: Desk, value: float) -> None:
    """The process was stopped for seconds."""
    clock: Any = clock_of(asyncio.get_running_loop())
    clock.spend(spread(value, 0.5, 5.0))


@strike
def slow_steps(desk: Desk, value: float) -> None:
    """Every step takes long for a while: an overloaded computer."""
    clock: Any = clock_of(asyncio.get_running_loop())
    desk.insist(1.0, lambda: clock.spend(spread(value, 0.005, 0.03)))


# -- sensors and batteries ---------------------------------------------------------------------------------------------


@strike
def encoder_dead(desk: Desk, value: float) -> None:
    """One encoder's counter, or both, stand still for a while."""
    right, left = pick(((True, False), (False, True), (True, True)), value)
    vehicle = desk.vehicle
    vehicle.faults = replace(vehicle.faults, right_encoder=right, left_encoder=left)
    desk.later(2.0, lambda: desk.mend(right_encoder=False, left_encoder=False))


@strike
def encoders_go(desk: Desk, value: float) -> None:
    """Encoders lose their power, both or one, and are back after a while, or flicker as a loose connector does."""
    sides = pick((("right", "left"), ("right",), ("left",)), value)
    dead = {f"{side}_encoder": True for side in sides}
    back = dict.fromkeys(dead, False)
    flickers = int(spread(7 * value % 1.0, 1, 6))
    for k in range(flickers):
        lasts = spread(11 * value * (k + 1) % 1.0, 0.03, 3.0 / flickers)
        desk.later(0.7 * k, lambda: desk.mend(**dead))
        desk.later(0.7 * k + min(lasts, 0.6), lambda: desk.mend(**back))


@strike
def encoder_reversed(desk: Desk, value: float) -> None:
    """An encoder counts backwards."""
    right, left = pick(((-1, 1), (1, -1), (-1, -1)), value)
    desk.falsify(spread(value, 0.2, 1.0), lambda ticks: (right * ticks[0], left * ticks[1]))


@strike
def encoder_jump(desk: Desk, value: float) -> None:
    """A counter is suddenly far away, and is back."""
    by = int(spread(value, -100000, 100000))
    desk.falsify(spread(7 * value % 1.0, 0.02, 0.2), lambda ticks: (ticks[0] + by, ticks[1]))


@strike
def battery_bad(desk: Desk, value: float) -> None:
    """Voltages that are low, none, no number, infinite."""
    counted = desk.kind in ("vesc", "waveshare", "pico")  # what counts steps of a converter tells no such number
    volts = pick((8.7, 0.0, 9.2, nan, inf, -5.0)[: 3 if counted else 6], value)
    vehicle = desk.vehicle
    vehicle.faults = replace(vehicle.faults, voltage=volts)
    desk.later(spread(value, 1.0, 7.0), lambda: desk.mend(voltage=None))


@strike
def lifted(desk: Desk, value: float) -> None:
    """Somebody puts it down elsewhere."""
    with suppress(NotCapable):
        desk.robot.place(spread(value, -3.0, 3.0), 0.0, spread(value, -3.0, 3.0))


# -- the line, and what is behind it -----------------------------------------------------------------------------------

ON_A_LINE: Final = {
    "line loses frames": lambda value: LineFaults(drop=spread(value, 0.05, 0.6)),
    "line flips bits": lambda value: LineFaults(flip=spread(value, 0.0005, 0.02)),
    "line repeats": lambda value: LineFaults(duplicate=spread(value, 0.1, 1.0)),
    "line splits": lambda value: LineFaults(split=True),
    "line delays": lambda value: LineFaults(delay=spread(value, 0.01, 0.4), jitter=0.05),
    "line jitters": lambda value: LineFaults(jitter=spread(value, 0.02, 0.3)),
    "line stalls": lambda value: LineFaults(stall=spread(value, 0.1, 1.0), stall_every=0.5),
    "line does it all": lambda value: LineFaults(drop=0.1, flip=0.001, duplicate=0.1, split=True, jitter=0.03),
}


def _on_the_line(make: Callable[[float], LineFaults]) -> Act:
    def act(desk: Desk, value: float) -> None:
        desk.spoil_line(make(value), spread(3 * value % 1.0, 0.5, 4.0))

    return act


for _name, _make in ON_A_LINE.items():
    STRIKES[_name] = _on_the_line(_make)


@strike
def line_dead(desk: Desk, value: float) -> None:
    """Nothing arrives any more, both ways or one: a host or a board that died looks like this from the other end."""
    ways = pick(((True, True), (True, False), (False, True)), value)
    desk.spoil_line(LineFaults(drop=1.0), spread(7 * value % 1.0, 0.3, 4.0), ways)


@strike
def line_gap(desk: Desk, value: float) -> None:
    """Nothing arrives at the board for a while, and it is heard all the time."""
    desk.spoil_line(LineFaults(drop=1.0), spread(value, 0.2, 5.0), (True, False))


@strike
def unplugged(desk: Desk, value: float) -> None:
    """The line is gone, and can be opened again."""
    link = getattr(desk.device, "link", None)
    if link is not None:
        link.close()


@strike
def board_restart(desk: Desk, value: float) -> None:
    """The board is without power for a moment."""
    off = spread(value, 0.05, 1.5)
    if desk.kind == "original":
        assert desk.board is not None
        desk.board.happen(BoardEvent("restart", off))
    else:
        desk.spawn(desk.device.restart(off))
    desk.later(3.0, desk.load_gains)


@strike
def board_centre_button(desk: Desk, value: float) -> None:
    """Somebody presses the button on the board, and again later."""
    desk.press_centre()
    desk.later(spread(value, 0.5, 3.0), desk.press_centre)


@strike
def board_esc_off(desk: Desk, value: float) -> None:
    """The board's ESC switch, by somebody else."""
    if desk.board is not None:
        desk.board.happen(BoardEvent("esc", 0.0))
        desk.later(spread(value, 0.5, 3.0), lambda: desk.switch(Switch.ESC, True))


@strike
def board_stop(desk: Desk, value: float) -> None:
    """The operator of the board stops it, and lets it go."""
    board = desk.board
    if board is not None and desk.kind == "ours":
        board.stop()

        def again() -> None:
            with suppress(NotArmed):
                board.arm()

        desk.later(spread(value, 0.2, 2.0), again)


@strike
def power_off_in_motion(desk: Desk, value: float) -> None:
    """Somebody else's message to the board, to switch off the supply of its encoders while it drives: refused."""
    if desk.board is not None:
        desk.board.runtime.post(PowerControl(Switch.ATX, False), desk.board.now)


@strike
def controller_fault(desk: Desk, value: float) -> None:
    """The motor controller reports a fault, and drives no more until it is over."""
    desk.device.fault = int(spread(value, 1, 27))
    desk.later(spread(value, 0.1, 3.0), lambda: setattr(desk.device, "fault", 0))


@strike
def guard_hangs(desk: Desk, value: float) -> None:
    """The kernel holds the guard in the bus: nothing new is put out, and nothing feeds the watchdog."""
    desk.device.hangs = True
    desk.later(spread(value, 0.03, 3.0), lambda: setattr(desk.device, "hangs", False))


@strike
def bus_dead(desk: Desk, value: float) -> None:
    """A wire of the servo board's bus is off for a while, or for an instant."""
    desk.device.bus.dead = True
    desk.later(spread(value * value, 0.03, 3.0), lambda: setattr(desk.device.bus, "dead", False))


ANY_LINE: Final = frozenset({*ON_A_LINE, "line dead", "line gap", "unplugged"})
BOARDS: Final = frozenset({"board centre button", "board esc off"})
ONLY_OF: Final = {
    "sim": frozenset({"lifted", "manual mode"}),
    "ours": ANY_LINE | BOARDS | {"board stop", "power off in motion"},
    "original": ANY_LINE | BOARDS | {"board restart"},
    "pi": frozenset({"guard hangs", "bus dead"}),
    "vesc": ANY_LINE | {"controller fault"},
    "waveshare": ANY_LINE,
    "pico": ANY_LINE | {"board restart", "board centre button"},
}
"""Faults that not every kind of hardware can have, by the kinds that can."""
SOME: Final = frozenset.union(*ONLY_OF.values())


def names(kind: str) -> list[str]:
    """The faults that there are for this kind of hardware."""
    return [name for name in STRIKES if name not in SOME or name in ONLY_OF[kind]]


def plan(kind: str, seed: int, duration: float) -> list[Strike]:
    """The faults of a run: 3 to 12 of them, anywhere in it, of which some at the same instant."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    there = names(kind)
    strikes = []
    time = 0.0
    for _ in range(int(rng.integers(3, 13))):
        if rng.random() > 0.15:
            time = float(np.round(rng.uniform(0.5, duration - 1.0), 3))
        strikes.append(Strike(there[int(rng.integers(len(there)))], time, float(rng.random())))
    return sorted(strikes, key=lambda each: each.time)
