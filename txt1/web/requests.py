"""The requests of a page, by name: a function each, and their table at the end.

The age of a command follows from its time stamp (`PageClock`); late commands are counted. A stop needs neither the
wheel nor budget.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from itertools import chain
from math import inf, isfinite
from typing import Any, Final

from txt1.web.pages import Page, Pages, now
from txt1.web.player import RECORDING_NAME, PagePlayer, recordings
from txt1.web.wheel import AGE_MAX

# number of dropped messages after which a page is disconnected
FLOOD: Final = 5000
# length of a page's stop
STOP_MAX: Final = 1000
# number of topics that a page may plot
CHOSEN_MAX: Final = 20
# of a route
POINTS_MAX: Final = 100

Message = dict[str, Any]


def take(pages: Pages, page: Page, text: str) -> bool:
    """Carry out a page's message; return whether it was within the page's budget.

    A malformed message is counted. Beyond the budget only a page's stops are carried out.
    """
    present = now()
    enough = page.budget.spend(present)
    if not enough:
        page.counts["dropped"] += 1
        if page.counts["dropped"] == FLOOD:
            pages.dismiss(page, "too many messages")
        if not _is_stop(text):
            return False
    try:
        message = json.loads(text)
        REQUESTS[message["do"]](pages, page, message, present)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        page.counts["malformed"] += 1
    except Exception as error:
        # a mistake in the program costs only this message
        page.counts["malformed"] += 1
        page.tell(told=f"that failed: {type(error).__name__}: {error}")
    return enough


def _is_stop(text: str) -> bool:
    """Return whether a message is a stop. A stop is short, so that a flood of long messages is not parsed."""
    if len(text) > STOP_MAX or '"stop"' not in text:
        return False
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(message, dict) and message.get("do") == "stop"


def _fresh(page: Page, message: Message, present: float) -> float | None:
    """Return the age of a command in s; None if it is late, which is counted."""
    age = page.clock.age(float(message["t"]), present)
    if page.sequence.accepts(message["n"]) and 0.0 <= age <= AGE_MAX:
        return age
    page.counts["late"] += 1
    return None


def _pong(pages: Pages, page: Page, message: Message, present: float) -> None:
    sent = float(message["ping"])
    if 0.0 <= present - sent < 60.0:
        page.clock.answered(sent, float(message["t"]), present)
        page.round_trip = present - sent


def _stop(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Stop all robots of a fleet, whichever the page shows; confirm it, or the page repeats it when it connects."""
    pages.ask(None, "stop")
    if not pages.ended.is_set():
        page.tell(stop=message.get("stop"))


def _drive(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Drive at v in m/s and omega in rad/s; with zeros the page holds the wheel and the robot stands."""
    v, omega = float(message["v"]), float(message["omega"])
    if not (isfinite(v) and isfinite(omega)):
        raise ValueError("not finite")
    age = _fresh(page, message, present)
    if age is None or page.player is not None:
        return
    before = page.car.wheel.holder
    if not page.car.wheel.drive(page.number, present):
        page.counts["refused"] += 1
        return
    if before != page.number:
        pages.status()
    limit = pages.limit_of(page)
    if limit is not None and abs(v) > limit:
        v, omega = v * limit / abs(v), omega * limit / abs(v)
    if v == 0.0 and omega == 0.0:
        pages.ask(page, "request")
    pages.ask(page, "drive", v=v, omega=omega, age=age)


def _release(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Release the stick: the robot stops, and the page keeps the wheel. A late release counts, too."""
    page.sequence.accepts(message.get("n"))
    if page.car.wheel.holder == page.number:
        pages.ask(page, "release")
        pages.ask(page, "halt")


def _take(pages: Pages, page: Page, message: Message, present: float) -> None:
    if page.player is None and page.car.wheel.take(page.number, present):
        # the request of the page before
        pages.ask(page, "release")
        pages.ask(page, "halt")
    else:
        page.tell(told=f"page {page.car.wheel.holder} drives; it may give the wheel away, or be idle for 10 s")
    pages.status()


def _give(pages: Pages, page: Page, message: Message, present: float) -> None:
    if page.car.wheel.holder == page.number:
        pages.ask(page, "release")
        pages.ask(page, "halt")
        page.car.wheel.give(page.number)
        pages.status()


def _arm(pages: Pages, page: Page, message: Message, present: float) -> None:
    if _fresh(page, message, present) is None:
        page.tell(told="that came too late: hold again")
    elif page.player is None and page.car.wheel.take(page.number, present):
        pages.ask(page, "arm")
        pages.status()
    else:
        page.tell(told=f"page {page.car.wheel.holder} drives: only it arms the robot")


def _disarm(pages: Pages, page: Page, message: Message, present: float) -> None:
    pages.ask(page, "disarm", reason=f"disarmed by web page {page.number}")


def _go(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Drive along points, m, as long as the page repeats `hold`."""
    points = [[float(x), float(y)] for x, y in message["points"]]
    wanted = float(message.get("speed", 0.5))
    if not (0 < len(points) <= POINTS_MAX and all(map(isfinite, (wanted, *chain(*points)))) and wanted > 0.0):
        raise ValueError("points or speed")
    if _fresh(page, message, present) is None:
        page.tell(told="that came too late: press again")
    elif page.player is None:
        if not page.car.wheel.drive(page.number, present):
            page.tell(told=f"page {page.car.wheel.holder} drives")
            return
        speed = min(wanted, pages.limit_of(page) or wanted)
        pages.ask(page, "go", points=points, speed=speed)


def _here(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Set the robot's place on its map, and a place that it faces, m; only the driving page may do so."""
    points = [[float(x), float(y)] for x, y in message["points"]]
    if not (0 < len(points) <= 2 and all(map(isfinite, chain(*points)))):
        raise ValueError("points")
    if _fresh(page, message, present) is None:
        page.tell(told="that came too late: press again")
    elif page.player is None:
        if page.car.wheel.drive(page.number, present):
            pages.ask(page, "here", points=points)
        else:
            page.tell(told=f"page {page.car.wheel.holder} drives: it says where the robot is")


def _hold(pages: Pages, page: Page, message: Message, present: float) -> None:
    age = _fresh(page, message, present)
    if age is not None and page.car.wheel.holder == page.number and page.car.wheel.drive(page.number, present):
        pages.ask(page, "hold", age=age)


def _gains(pages: Pages, page: Page, message: Message, present: float) -> None:
    if _operates(page):
        pages.ask(page, "gains", linear=message["linear"], angular=message["angular"])


def _limit(pages: Pages, page: Page, message: Message, present: float) -> None:
    limit = float(message["speed"])
    if _operates(page) and 0.1 <= limit < inf:
        pages.limit = limit
        pages.status()


def _record(pages: Pages, page: Page, message: Message, present: float) -> None:
    if _operates(page):
        pages.ask(page, "record", on=bool(message["on"]))


def _operates(page: Page) -> bool:
    if page.role != "operator":
        page.tell(told="visitors may look and drive; this is the operator's")
    return page.role == "operator"


def _robot(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Show another robot of the fleet, and release the present robot."""
    car = pages.cars[message["name"]]
    if car is not page.car:
        _give(pages, page, message, present)
        page.car, page.chosen = car, frozenset()
        pages.subscribe()
        page.show(car.full)
    pages.status(page)


def _choose(pages: Pages, page: Page, message: Message, present: float) -> None:
    topics = message["topics"]
    if not (isinstance(topics, list) and len(topics) <= CHOSEN_MAX and all(isinstance(t, str) for t in topics)):
        raise ValueError("topics")
    page.chosen = frozenset(t[:100] for t in topics)
    pages.subscribe()


def _files(pages: Pages, page: Page, message: Message, present: float) -> None:
    page.tell(files=recordings(pages.folder))


def _replay(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Show a recording in place of the robot; without a name show the robot again."""
    name = message.get("name")
    page.replays += 1
    if page.player is not None:
        page.player.stop()
        page.player = None
    if name is not None and not RECORDING_NAME.fullmatch(str(name)):
        raise ValueError("name")
    _give(pages, page, message, present)
    if name is not None:
        pages.later(_play(pages, page, str(name), page.replays))
    else:
        page.show(page.car.full)
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
            player = await asyncio.to_thread(PagePlayer.open, pages.folder / name)
        if wanted():
            page.player = player
            pages.status(page)
            await player.play(page.show, now)
    except Exception as error:
        # for any damage of the file
        page.tell(told=f"{name} cannot be shown: {error}")


def _wind(pages: Pages, page: Page, message: Message, present: float) -> None:
    """Move within the recording, or set its speed; 0 pauses."""
    if page.player is not None:
        page.player.wind(message.get("to"), message.get("speed"))
        pages.status(page)


REQUESTS: Final[Mapping[str, Callable[[Pages, Page, Message, float], None]]] = {
    "pong": _pong,
    "stop": _stop,
    "drive": _drive,
    "release": _release,
    "take": _take,
    "give": _give,
    "arm": _arm,
    "disarm": _disarm,
    "go": _go,
    "here": _here,
    "hold": _hold,
    "gains": _gains,
    "limit": _limit,
    "record": _record,
    "robot": _robot,
    "choose": _choose,
    "files": _files,
    "replay": _replay,
    "wind": _wind,
}
