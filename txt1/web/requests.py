"""The requests of a page: a table that says who may make each, what it costs, and what it does.

How it works
------------

`REQUESTS`, at the end, has a row for each request. A request without a row is refused, and so is a row's request by a
page of another role. `take` carries out a page's message; it is the only place that asks whether a page may. It goes
through the row in this order, and the first "no" ends it:

1. the page's account pays the cost (`budgets`); a stop is obeyed whatever is left;
2. the page has a role that may;
3. `read` finds the fields sound (ValueError, TypeError or KeyError: the message is counted as malformed);
4. a command is young: its age follows from its time stamp (`PageClock`);
5. the page has the wheel, or gets it (`PageWheel.take`), if the request needs it.

Then `do` acts, and asks nothing about roles or the wheel. A change of hands passes through zero: the robot halts, and
the page that has driven or wanted to drive meanwhile has to let go before it moves the robot.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from enum import Enum
from itertools import chain
from math import inf, isfinite
from typing import Any, Final, NamedTuple

from txt1.web.auth import Role
from txt1.web.budgets import FRAME_COST
from txt1.web.pages import Page, Pages, now
from txt1.web.player import RECORDING_NAME, PagePlayer
from txt1.web.wheel import COMMAND_AGE_MAX

# units: a request that acts once, and one that reads or writes files; all others cost no more than their frame
ACTION: Final = 5.0
FILES: Final = 20.0
# length of a page's stop
STOP_MAX: Final = 1000
# number of topics that a page may plot
CHOSEN_MAX: Final = 20
# of a route
POINTS_MAX: Final = 100
# the smallest limit of visitors' speed, m/s
LIMIT_MIN: Final = 0.1

# recordings that are shown at once, to visitors and to all: each takes memory
PLAYERS_MAX: Final[Mapping[Role, int]] = {"visitor": 2, "operator": 4}

EVERYBODY: Final[frozenset[Role]] = frozenset({"operator", "visitor"})
OPERATOR: Final[frozenset[Role]] = frozenset({"operator"})
# whoever may stop: also a connection that may do nothing else
ALL: Final[frozenset[Role]] = EVERYBODY | {"stop channel"}
REFUSALS: Final[Mapping[Role, str]] = {
    "visitor": "visitors may look, drive and stop; this is the operator's",
    "stop channel": "this connection is for stops alone",
}

Message = dict[str, Any]


class WheelUse(Enum):
    """What a request has to do with the wheel."""

    UNUSED = "unused"
    """It needs no wheel."""
    HELD = "held"
    """Only the page that has the wheel makes it."""
    TAKEN = "taken"
    """The page gets the wheel first, if it may; a page that shows a recording does not."""


class PageRequest(NamedTuple):
    """A request of a page: who may make it, what it costs, and what it does."""

    who: frozenset[Role]
    wheel: WheelUse
    cost: float
    """What the page pays, in the units of `budgets`."""
    read: Callable[[Message], Any]
    """Returns the fields; raises ValueError, TypeError or KeyError for fields without sense."""
    do: Callable[[Pages, Page, Any, float], None]
    """Acts; gets the fields and the command's age in s."""
    again: str | None = None
    """For a command that may come too late: how to give it again; "" for one that the page repeats anyway."""


def take(pages: Pages, page: Page, text: str) -> None:
    """Carry out a page's message. Beyond the page's budget only stops are carried out.

    A malformed message is counted.
    """
    present = now()
    if not page.account.spend(present, FRAME_COST):
        page.counts["dropped"] += 1
        if not _is_stop(text):
            return
    try:
        message = json.loads(text)
        request = REQUESTS[message["do"]]
        if request.cost > FRAME_COST and not page.account.spend(present, request.cost - FRAME_COST):
            page.counts["dropped"] += 1
            return
        _carry_out(pages, page, request, message, present)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        page.counts["malformed"] += 1
    except Exception as error:
        # a mistake in the program costs only this message
        page.counts["malformed"] += 1
        page.tell(told=f"that failed: {type(error).__name__}: {error}")


def _carry_out(pages: Pages, page: Page, request: PageRequest, message: Message, present: float) -> None:
    if page.role not in request.who:
        page.counts["refused"] += 1
        page.tell(told=REFUSALS[page.role])
        return
    fields = request.read(message)
    age = 0.0
    if request.again is not None:
        age = page.clock.age(float(message["t"]), present)
        if not (page.sequence.accepts(message["n"]) and 0.0 <= age <= COMMAND_AGE_MAX):
            page.counts["late"] += 1
            if request.again:
                page.tell(told=f"that came too late: {request.again}")
            return
    if request.wheel is WheelUse.HELD and page.car.wheel.holder != page.number:
        return
    if request.wheel is WheelUse.TAKEN:
        # a hand that holds something gives the command again and again
        holds = request.again == ""
        why = _grasp(pages, page, present, holds)
        if why:
            page.counts["refused"] += 1
            page.overruled = page.overruled or holds
            if not holds:
                page.tell(told=why)
                pages.status(page)
            return
    request.do(pages, page, fields, age)


def _grasp(pages: Pages, page: Page, present: float, holds: bool) -> str:
    """Give a page the wheel; return why it does not get it, "" if it has it."""
    if page.player is not None:
        return "this page shows a recording; go back to the robot first"
    wheel = page.car.wheel
    before, operator = wheel.holder, page.role == "operator"
    if not wheel.take(page.number, operator, present):
        return wheel.why(operator)
    if before == page.number:
        return ""
    if before:
        # passes through zero; both pages have to let go of what they hold
        pages.halt(page)
        page.overruled = page.overruled or holds
        pages.connected[before].overruled = True
        if holds:
            page.tell(told="you have the wheel now: let go, then drive")
    pages.status_of_all()
    return ""


def _is_stop(text: str) -> bool:
    """Return whether a message is a stop. A stop is short, so that a flood of long messages is not parsed."""
    if len(text) > STOP_MAX or '"stop"' not in text:
        return False
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(message, dict) and message.get("do") == "stop"


# -- fields ------------------------------------------------------------------------------------------------------------


def _nothing(message: Message) -> None:
    """For a request without fields."""


def _times(message: Message) -> tuple[float, float]:
    return float(message["ping"]), float(message["t"])


def _number_of_stop(message: Message) -> object:
    return message.get("stop")


def _velocity(message: Message) -> tuple[float, float]:
    v, omega = float(message["v"]), float(message["omega"])
    if not (isfinite(v) and isfinite(omega)):
        raise ValueError("not finite")
    return v, omega


def _points(message: Message, most: int) -> list[list[float]]:
    points = [[float(x), float(y)] for x, y in message["points"]]
    if not (0 < len(points) <= most and all(map(isfinite, chain(*points)))):
        raise ValueError("points")
    return points


def _way(message: Message) -> tuple[list[list[float]], float]:
    speed = float(message.get("speed", 0.5))
    if not 0.0 < speed < inf:
        raise ValueError("speed")
    return _points(message, POINTS_MAX), speed


def _place(message: Message) -> list[list[float]]:
    return _points(message, 2)


def _sequence(message: Message) -> object:
    return message.get("n")


def _table(message: Message) -> tuple[object, object]:
    return message["linear"], message["angular"]


def _speed(message: Message) -> float:
    return float(message["speed"])


def _on(message: Message) -> bool:
    return bool(message["on"])


def _name(message: Message) -> object:
    return message["name"]


def _topics(message: Message) -> list[str]:
    topics = message["topics"]
    if not (isinstance(topics, list) and len(topics) <= CHOSEN_MAX and all(isinstance(t, str) for t in topics)):
        raise ValueError("topics")
    return topics


def _recording(message: Message) -> str | None:
    """Return the name of a recording, None for none; a wrong name is found when it is shown."""
    name = message.get("name")
    return None if name is None else str(name)


def _position(message: Message) -> tuple[object, object]:
    return message.get("to"), message.get("speed")


# -- what each does ----------------------------------------------------------------------------------------------------


def _pong(pages: Pages, page: Page, times: tuple[float, float], age: float) -> None:
    sent, theirs = times
    present = now()
    if 0.0 <= present - sent < 60.0:
        page.clock.answered(sent, theirs, present)
        page.round_trip = present - sent


def _stop(pages: Pages, page: Page, number: object, age: float) -> None:
    """Stop all robots of a fleet, whichever the page shows; confirm it, or the page repeats it when it connects."""
    pages.stop(page, number)


def _drive(pages: Pages, page: Page, velocity: tuple[float, float], age: float) -> None:
    """Drive at v in m/s and omega in rad/s; with zeros the page holds the wheel and the robot stands."""
    v, omega = velocity
    page.car.wheel.drove(now())
    if page.overruled:
        v = omega = 0.0
    limit = pages.limit_of(page)
    if limit is not None and abs(v) > limit:
        v, omega = v * limit / abs(v), omega * limit / abs(v)
    if v == 0.0 and omega == 0.0:
        pages.ask(page, "request")
    pages.ask(page, "drive", v=v, omega=omega, age=age, held=True)


def _release(pages: Pages, page: Page, number: object, age: float) -> None:
    """Release the stick: the robot stops, and the page keeps the wheel. A late release counts, too."""
    page.sequence.accepts(number)
    page.overruled = False
    if page.car.wheel.holder == page.number:
        pages.halt(page)


def _take(pages: Pages, page: Page, nothing: None, age: float) -> None:
    """Take the wheel, and let the robot stand. It is a press, so the page need not let go."""
    page.overruled = False
    pages.halt(page)


def _give(pages: Pages, page: Page, nothing: None, age: float) -> None:
    if page.car.wheel.holder == page.number:
        pages.halt(page)
        page.car.wheel.give(page.number)
        pages.status_of_all()


def _arm(pages: Pages, page: Page, nothing: None, age: float) -> None:
    pages.ask(page, "arm")


def _disarm(pages: Pages, page: Page, nothing: None, age: float) -> None:
    pages.ask(page, "disarm", reason=f"disarmed by web page {page.number}")


def _go(pages: Pages, page: Page, way: tuple[list[list[float]], float], age: float) -> None:
    """Drive along points, m, as long as the page repeats `hold`."""
    points, wanted = way
    page.car.wheel.drove(now())
    pages.ask(page, "go", points=points, speed=min(wanted, pages.limit_of(page) or wanted))


def _here(pages: Pages, page: Page, points: list[list[float]], age: float) -> None:
    """Set the robot's place on its map, and a place that it faces, m."""
    page.car.wheel.drove(now())
    pages.ask(page, "here", points=points)


def _hold(pages: Pages, page: Page, nothing: None, age: float) -> None:
    page.car.wheel.drove(now())
    pages.ask(page, "hold", age=age)


def _gains(pages: Pages, page: Page, table: tuple[object, object], age: float) -> None:
    linear, angular = table
    pages.ask(page, "gains", linear=linear, angular=angular)


def _limit(pages: Pages, page: Page, limit: float, age: float) -> None:
    """Limit the speed of visitors, m/s; a visitor who drives faster than that has to begin again."""
    if not LIMIT_MIN <= limit < inf:
        page.tell(told=f"visitors' speed: {limit:g} m/s; give {LIMIT_MIN:g} or more. It stays {pages.limit:g} m/s")
        return
    for each in pages.connected.values():
        if limit < pages.limit and each.role == "visitor" and each.car.wheel.holder == each.number:
            pages.halt(each)
    pages.limit = limit
    pages.status_of_all()


def _record(pages: Pages, page: Page, on: bool, age: float) -> None:
    pages.ask(page, "record", on=on)


def _robot(pages: Pages, page: Page, name: object, age: float) -> None:
    """Show another robot of the fleet, and release the present robot."""
    car = pages.cars[name]  # type: ignore[index]
    if car is not page.car:
        _give(pages, page, None, age)
        page.car, page.chosen = car, frozenset()
        pages.subscribe()
        page.show(car.full)
    pages.status(page)


def _choose(pages: Pages, page: Page, topics: list[str], age: float) -> None:
    page.chosen = frozenset(t[:100] for t in topics)
    pages.subscribe()


def _files(pages: Pages, page: Page, nothing: None, age: float) -> None:
    pages.list_recordings(page)


def _replay(pages: Pages, page: Page, name: str | None, age: float) -> None:
    """Show a recording in place of the robot; without a name show the robot again."""
    page.replays += 1
    if page.player is not None:
        page.player.stop()
        page.player = None
    if name is not None and not RECORDING_NAME.fullmatch(name):
        raise ValueError("name")
    _give(pages, page, None, age)
    if name is None:
        page.show(page.car.full)
    else:
        pages.later(_play(pages, page, name, page.replays))
    pages.status(page)


async def _play(pages: Pages, page: Page, name: str, asked: int) -> None:
    """Play a recording, unless the page has gone meanwhile, or asked for something else."""

    def wanted() -> bool:
        return page.number in pages.connected and page.replays == asked

    try:
        # one at a time, because it takes memory
        async with pages.loading:
            if not wanted():
                return
            if not _has_room(pages, page.role):
                page.tell(told="too many pages show recordings; wait until one is shown no more")
                return
            player = await asyncio.to_thread(PagePlayer.open, pages.folder / name)
        if wanted():
            page.player = player
            pages.status(page)
            await player.play(page.show, now)
    except Exception as error:
        # for any damage of the file
        page.tell(told=f"{name} cannot be shown: {error}")


def _has_room(pages: Pages, role: Role) -> bool:
    """Return whether one recording more may be shown: of visitors' to a visitor, and of all."""
    return all(pages.players(each) < most for each, most in PLAYERS_MAX.items() if each in (role, "operator"))


def _wind(pages: Pages, page: Page, where: tuple[object, object], age: float) -> None:
    """Move within the recording, or set its speed; 0 pauses."""
    if page.player is not None:
        page.player.wind(*where)
        pages.status(page)


REQUESTS: Final[Mapping[str, PageRequest]] = {
    # everybody stops, whatever else there is
    "stop": PageRequest(ALL, WheelUse.UNUSED, FRAME_COST, _number_of_stop, _stop),
    "disarm": PageRequest(EVERYBODY, WheelUse.UNUSED, ACTION, _nothing, _disarm),
    # whoever has the wheel, or gets it
    "drive": PageRequest(EVERYBODY, WheelUse.TAKEN, FRAME_COST, _velocity, _drive, again=""),
    "go": PageRequest(EVERYBODY, WheelUse.TAKEN, ACTION, _way, _go, again="press again"),
    "take": PageRequest(EVERYBODY, WheelUse.TAKEN, ACTION, _nothing, _take),
    "hold": PageRequest(EVERYBODY, WheelUse.HELD, FRAME_COST, _nothing, _hold, again=""),
    "release": PageRequest(EVERYBODY, WheelUse.UNUSED, FRAME_COST, _sequence, _release),
    "give": PageRequest(EVERYBODY, WheelUse.HELD, ACTION, _nothing, _give),
    "arm": PageRequest(OPERATOR, WheelUse.TAKEN, ACTION, _nothing, _arm, again="hold again"),
    "here": PageRequest(OPERATOR, WheelUse.TAKEN, ACTION, _place, _here, again="press again"),
    # what changes the robot
    "gains": PageRequest(OPERATOR, WheelUse.UNUSED, ACTION, _table, _gains),
    "limit": PageRequest(OPERATOR, WheelUse.UNUSED, ACTION, _speed, _limit),
    "record": PageRequest(OPERATOR, WheelUse.UNUSED, FILES, _on, _record),
    # what a page shows
    "pong": PageRequest(EVERYBODY, WheelUse.UNUSED, FRAME_COST, _times, _pong),
    "robot": PageRequest(EVERYBODY, WheelUse.UNUSED, ACTION, _name, _robot),
    "choose": PageRequest(EVERYBODY, WheelUse.UNUSED, ACTION, _topics, _choose),
    "files": PageRequest(EVERYBODY, WheelUse.UNUSED, FILES, _nothing, _files),
    "replay": PageRequest(EVERYBODY, WheelUse.UNUSED, FILES, _recording, _replay),
    "wind": PageRequest(EVERYBODY, WheelUse.UNUSED, FRAME_COST, _position, _wind),
}
