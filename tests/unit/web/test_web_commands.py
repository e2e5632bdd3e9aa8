"""What a page's request does, which page may make it, and who is told."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from itertools import count
from math import inf, nan
from pathlib import Path
from typing import Any, Final

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from tests.patience import LIMIT  # noqa: E402
from tests.unit.web.test_web_requests import Robot, Socket  # noqa: E402
from txt1.web import pages, requests  # noqa: E402
from txt1.web.auth import Role  # noqa: E402
from txt1.web.budgets import Budgets  # noqa: E402
from txt1.web.pages import FAST, PAGE_RATE, Page, Pages  # noqa: E402
from txt1.web.requests import CHOSEN_MAX, POINTS_MAX, take  # noqa: E402
from txt1.web.wheel import COMMAND_AGE_MAX, PageClock  # noqa: E402

NOW: Final = 100.0
STANDS: Final[list[tuple[str, dict[str, object]]]] = [("release", {}), ("halt", {})]
WAY: Final = [[1.0, 2.0], [3.0, 4.0]]
COMMANDS: Final[dict[str, tuple[dict[str, Any], list[tuple[str, dict[str, Any]]]]]] = {
    "drive": ({"v": 0.4, "omega": 0.1}, [("drive", {"v": 0.4, "omega": 0.1, "age": 0.0, "held": True})]),
    "go": ({"points": WAY, "speed": 0.3}, [("go", {"points": WAY, "speed": 0.3})]),
    "here": ({"points": WAY}, [("here", {"points": WAY})]),
    "hold": ({}, [("hold", {"age": 0.0})]),
    "arm": ({}, [("arm", {})]),
    "take": ({}, STANDS),
    "release": ({}, STANDS),
    "give": ({}, STANDS),
}
"""Requests that only the page with the wheel may make: their fields, and what the robot is asked for."""
TIMED: Final = ("drive", "go", "here", "hold", "arm")
"""The requests that may come too late."""
DRIVES: Final = "page 1 drives; it may give up the wheel, or be idle for 10 s"
REFUSED: Final = dict.fromkeys(("go", "here", "arm", "take"), DRIVES)
"""What another page is told."""


class Desk:
    """Pages with the clock of their server, which stands still, and a robot that writes down what it is asked for."""

    def __init__(self, folder: Path, *fleet: str) -> None:
        self.robot = Robot()
        self.pages = Pages(self.robot, folder, 0.5, {}, list(fleet), invites=False)
        self.budgets = Budgets()
        self._numbers = count(1)

    def join(self, role: Role = "operator") -> Page:
        account, socket = self.budgets.account("127.0.0.1"), Socket()
        if role == "stop channel":
            return self.pages.join_stop_channel("127.0.0.1", socket, account)  # type: ignore[arg-type]
        page = self.pages.join(role, "127.0.0.1", socket, account)  # type: ignore[arg-type]
        page.clock.answered(NOW, NOW, NOW)
        return page

    def ask(self, page: Page, do: str, **fields: object) -> list[tuple[str, dict[str, object]]]:
        """What the robot is asked for because of a page's request."""
        self.robot.asked.clear()
        for each in (page, *self.pages.connected.values()):
            each.outbox.clear()
        take(self.pages, page, json.dumps({"do": do, "n": next(self._numbers), "t": NOW, **fields}))
        return self.robot.asked


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Desk:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    monkeypatch.setattr(pages, "STATUS_PERIOD", 0.0)
    return Desk(tmp_path)


def told(page: Page, key: str = "told") -> list[Any]:
    """Of the messages to a page since the last request."""
    return [message[key] for message in map(json.loads, page.outbox) if key in message]


def wheel(page: Page) -> list[int]:
    """The numbers of the driving pages in the status that a page has got since the last request."""
    return [status["wheel"] for status in told(page, "page")]


async def listed(page: Page) -> None:
    """Wait until a page is told which recordings there are."""
    async with asyncio.timeout(LIMIT):
        while not told(page, "files"):
            await asyncio.sleep(0.001)


# -- the wheel ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("do", COMMANDS)
async def test_the_robot_obeys_the_page_with_the_wheel_and_no_other_page(do: str, desk: Desk) -> None:
    driving, other = desk.join(), desk.join()
    assert driving.car.wheel.take(driving.number, True, NOW)
    fields, asked = COMMANDS[do]
    assert desk.ask(other, do, **fields) == []
    assert driving.car.wheel.holder == driving.number
    assert told(other) == ([REFUSED[do]] if do in REFUSED else [])
    assert other.counts["refused"] == (do in REFUSED or do == "drive")
    assert desk.ask(driving, do, **fields) == asked
    assert driving.car.wheel.holder == (0 if do == "give" else driving.number)
    assert told(driving) == [] and driving.counts.total() == 0


@pytest.mark.parametrize("do", ["drive", "arm", "take"])
async def test_who_gets_the_free_wheel_by_a_request_is_told_to_all_pages(do: str, desk: Desk) -> None:
    page, other = desk.join(), desk.join()
    fields, asked = COMMANDS[do]
    assert desk.ask(page, do, **fields) == asked
    assert wheel(page) == wheel(other) == [page.number]


@pytest.mark.parametrize("do", ["go", "here"])
async def test_a_way_and_a_place_take_the_free_wheel(do: str, desk: Desk) -> None:
    page = desk.join()
    fields, asked = COMMANDS[do]
    assert desk.ask(page, do, **fields) == asked
    assert page.car.wheel.holder == page.number


@pytest.mark.parametrize("do", ["hold", "release", "give"])
async def test_the_other_requests_leave_the_free_wheel_alone(do: str, desk: Desk) -> None:
    page = desk.join()
    assert desk.ask(page, do) == []
    assert page.car.wheel.holder == 0


async def test_a_page_that_goes_on_driving_troubles_no_page_with_news_and_the_end_is_told(desk: Desk) -> None:
    page, other = desk.join(), desk.join()
    desk.ask(page, "drive", v=0.1, omega=0.0)
    desk.ask(page, "drive", v=0.2, omega=0.0)
    assert wheel(other) == []
    desk.ask(other, "take")
    assert (wheel(page), wheel(other)) == ([], [page.number]), "who was refused sees who drives"
    desk.ask(page, "give")
    assert wheel(page) == wheel(other) == [0]


@pytest.mark.parametrize("do", [do for do in COMMANDS if do not in ("release", "give")])
async def test_a_page_that_shows_a_recording_moves_nothing(do: str, desk: Desk) -> None:
    page = desk.join()
    page.player = Player()  # type: ignore[assignment]
    assert desk.ask(page, do, **COMMANDS[do][0]) == []
    assert page.car.wheel.holder == 0


# -- too late ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("do", TIMED)
@pytest.mark.parametrize("late", [COMMAND_AGE_MAX + 0.01, -0.01, inf, nan])
async def test_a_request_that_is_late_or_of_the_future_is_counted_and_does_nothing(
    do: str, late: float, desk: Desk
) -> None:
    page = desk.join()
    page.car.wheel.take(page.number, True, NOW)
    assert desk.ask(page, do, **COMMANDS[do][0], t=NOW - late) == []
    assert page.counts == {"late": 1}
    again = {"arm": "hold again", "go": "press again", "here": "press again"}
    assert told(page) == ([f"that came too late: {again[do]}"] if do in again else [])


@pytest.mark.parametrize("do", TIMED)
async def test_a_request_that_was_sent_before_a_release_or_comes_twice_does_nothing(do: str, desk: Desk) -> None:
    page = desk.join()
    page.car.wheel.take(page.number, True, NOW)
    fields, asked = COMMANDS[do]
    assert desk.ask(page, do, **fields, n=50) == asked
    assert desk.ask(page, do, **fields, n=50) == []
    assert desk.ask(page, "release", n=60) == STANDS
    assert desk.ask(page, do, **fields, n=55) == []
    assert page.counts == {"late": 2}


async def test_a_command_is_late_after_a_quarter_of_a_second(desk: Desk) -> None:
    page = desk.join()
    assert [name for name, _ in desk.ask(page, "drive", v=0.4, omega=0.0, t=NOW - 0.25)] == ["drive"]
    assert desk.ask(page, "drive", v=0.4, omega=0.0, t=NOW - 0.2501) == []


@pytest.mark.parametrize(
    ("sent", "trip"),
    [(NOW, 0.0), (NOW - 0.5, 0.5), (NOW - 59.9, 59.9), (NOW - 60.0, None), (NOW + 0.1, None), (-50.0, None)],
)
async def test_the_clock_of_a_page_is_measured_by_answers_within_a_minute(
    sent: float, trip: float | None, desk: Desk
) -> None:
    page = desk.join()
    page.clock = PageClock()
    desk.ask(page, "pong", ping=sent, t=7.0)
    assert page.round_trip == (None if trip is None else pytest.approx(trip))
    assert page.clock.age(7.0, NOW) == (inf if trip is None else pytest.approx(trip))


# -- what may be driven ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("v", "omega", "asked"),
    [
        (0.0, 0.0, ["request", "drive"]),
        (0.5, 0.0, ["drive"]),
        (0.0, 0.1, ["drive"]),
        (1.0, 0.0, ["drive"]),
        (0.0, 1.0, ["drive"]),
    ],
)
async def test_a_page_that_holds_its_stick_still_keeps_the_robot_standing(
    v: float, omega: float, asked: list[str], desk: Desk
) -> None:
    assert [name for name, _ in desk.ask(desk.join(), "drive", v=v, omega=omega)] == asked


ROUTE: Final = [[0.1 * k, 0.0] for k in range(POINTS_MAX + 1)]
SENSELESS: Final[list[tuple[str, dict[str, Any]]]] = [
    *(("drive", {"v": v, "omega": omega}) for v, omega in ((inf, 0.0), (0.0, -inf), (nan, 0.1), (0.1, nan))),
    ("go", {"points": []}),
    ("go", {"points": ROUTE}),
    ("go", {"points": [[0.0, inf]]}),
    ("go", {"points": [[nan, 0.0]]}),
    ("go", {"points": [[1.0]]}),
    *(("go", {"points": WAY, "speed": speed}) for speed in (0.0, -0.1, inf, nan)),
    ("here", {"points": []}),
    ("here", {"points": [*WAY, [5.0, 6.0]]}),
    ("here", {"points": [[0.0, nan]]}),
    ("choose", {"topics": "/odom"}),
    ("choose", {"topics": [1]}),
    ("choose", {"topics": ["/odom"] * (CHOSEN_MAX + 1)}),
    ("robot", {"name": "nobody"}),
    ("gains", {"linear": [1.0, 2.0, 3.0]}),
]


@pytest.mark.parametrize(("do", "fields"), SENSELESS)
async def test_a_request_without_sense_is_counted_and_does_nothing(do: str, fields: dict[str, Any], desk: Desk) -> None:
    page = desk.join()
    before = page.chosen, page.car
    assert desk.ask(page, do, **fields) == []
    assert page.counts == {"malformed": 1} and not page.outbox
    assert page.car.wheel.holder == 0 and (page.chosen, page.car) == before


async def test_the_longest_way_and_a_single_place_are_driven(desk: Desk) -> None:
    page = desk.join()
    assert desk.ask(page, "go", points=ROUTE[:-1]) == [("go", {"points": ROUTE[:-1], "speed": 0.5})]
    assert desk.ask(page, "go", points=WAY[:1], speed=1.5) == [("go", {"points": WAY[:1], "speed": 1.5})]
    assert desk.ask(page, "here", points=WAY[:1]) == [("here", {"points": WAY[:1]})]


async def test_a_visitor_s_way_is_driven_no_faster_than_visitors_may(desk: Desk) -> None:
    visitor = desk.join("visitor")
    for wanted, speed in ((2.0, 0.5), (0.3, 0.3)):
        assert desk.ask(visitor, "go", points=WAY, speed=wanted) == [("go", {"points": WAY, "speed": speed})]


# -- who may do it -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.1, 1.5])
async def test_the_operator_sets_the_visitors_speed_and_all_are_told(speed: float, desk: Desk) -> None:
    operator, visitor = desk.join(), desk.join("visitor")
    desk.ask(operator, "limit", speed=speed)
    assert desk.pages.limit == speed
    assert [status["limit"] for status in told(visitor, "page")] == [speed]


@pytest.mark.parametrize("speed", [0.09, -1.0, inf, nan])
async def test_a_speed_that_is_none_does_not_become_the_visitors_limit(speed: float, desk: Desk) -> None:
    page = desk.join()
    desk.ask(page, "limit", speed=speed)
    assert desk.pages.limit == 0.5
    assert told(page) == [f"visitors' speed: {speed:g} m/s; give 0.1 or more. It stays 0.5 m/s"]


async def test_a_visitor_who_drives_when_the_limit_falls_begins_again_below_it(desk: Desk) -> None:
    operator, visitor = desk.join(), desk.join("visitor")
    desk.ask(visitor, "go", points=WAY)
    assert desk.ask(operator, "limit", speed=0.6) == []
    assert desk.ask(operator, "limit", speed=0.3) == STANDS
    assert desk.ask(visitor, "go", points=WAY) == [("go", {"points": WAY, "speed": 0.3})]


async def test_every_page_may_disarm_and_stop_however_late(desk: Desk) -> None:
    page = desk.join("visitor")
    assert desk.ask(page, "disarm", n=0, t=0.0) == [("disarm", {"reason": "disarmed by web page 1"})]
    assert desk.ask(page, "stop", n=0, t=0.0) == [("stop", {})]


# -- what a page shows -------------------------------------------------------------------------------------------------


async def test_a_page_that_chooses_another_robot_lets_the_present_one_stand(desk: Desk, tmp_path: Path) -> None:
    desk = Desk(tmp_path, "a", "b")
    page = desk.join()
    here, there = desk.pages.cars.values()
    desk.ask(page, "drive", v=0.4, omega=0.0)
    desk.ask(page, "choose", topics=["/scan"])
    here.full, there.full = "all of a", "all of b"
    assert desk.ask(page, "robot", name="a") == []
    assert (here.wheel.holder, page.chosen) == (page.number, frozenset({"/scan"})), "it is shown already"
    assert [status["robot"] for status in told(page, "page")] == ["a"]
    asked = desk.ask(page, "robot", name="b")
    assert asked[:2] == [("release", {"robot": "a"}), ("halt", {"robot": "a"})]
    topics = sorted(FAST)
    assert ("subscribe", {"topics": topics, "rate": PAGE_RATE, "seldom": None, "robot": "b"}) in asked[2:]
    assert (here.wheel.holder, page.car, page.chosen, page.newest) == (0, there, frozenset(), "all of b")
    assert [status["robot"] for status in told(page, "page")][-1] == "b"
    assert [fields["robot"] for _, fields in desk.ask(page, "drive", v=0.4, omega=0.0)] == ["b"]


async def test_a_page_plots_up_to_twenty_topics_of_a_hundred_letters(desk: Desk) -> None:
    page = desk.join()
    topics = [f"/{k:02}{150 * 'x'}" for k in range(CHOSEN_MAX)]
    asked = desk.ask(page, "choose", topics=topics)
    chosen = {topic[:100] for topic in topics}
    assert page.chosen == chosen and len(chosen) == 20
    assert asked == [("subscribe", {"topics": sorted(chosen.union(FAST)), "rate": PAGE_RATE, "seldom": None})]


async def test_a_page_is_told_which_recordings_there_are(desk: Desk, tmp_path: Path) -> None:
    for name in ("run.mcap", "token", ".hidden.mcap"):
        (tmp_path / name).write_text("x")
    page = desk.join()
    desk.ask(page, "files")
    await listed(page)
    assert [[each["name"] for each in files] for files in told(page, "files")] == [["run.mcap"]]


async def test_many_who_ask_for_the_recordings_at_once_are_answered_by_one_look(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[Path] = []
    monkeypatch.setattr(pages, "recordings", lambda folder: looks.append(folder) or [])
    some = [desk.join() for _ in range(5)]
    for _ in range(3):
        for page in some:
            take(desk.pages, page, '{"do": "files"}')
    for page in some:
        await listed(page)
    assert len(looks) == 1


async def test_all_pages_are_told_of_many_changes_at_once_and_of_the_last(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One page that takes the wheel and gives it up again and again does not make the server write to all others."""
    monkeypatch.setattr(pages, "STATUS_PERIOD", 0.05)
    page, other = desk.join(), desk.join()
    other.outbox.clear()
    for _ in range(6):
        for do in ("take", "give"):
            take(desk.pages, page, json.dumps({"do": do}))
    take(desk.pages, page, json.dumps({"do": "take"}))
    async with asyncio.timeout(LIMIT):
        while wheel(other)[-1:] != [page.number]:
            await asyncio.sleep(0.01)
    assert len(wheel(other)) <= 2


class Player:
    """Of a recording: writes down what is done with it."""

    def __init__(self) -> None:
        self.done: list[object] = []

    def status(self) -> str:
        return "a recording"

    def wind(self, to: object, speed: object) -> None:
        self.done.append((to, speed))

    def stop(self) -> None:
        self.done.append("stop")

    async def play(self, show: Callable[[str], None], now: Callable[[], float]) -> None:
        self.done.append("play")
        show("from the recording")


class Recordings:
    """In place of `PagePlayer`: reads recordings, and something may happen meanwhile."""

    def __init__(self) -> None:
        self.opened: list[tuple[Path, Player]] = []
        self.meanwhile: Callable[[], object] = lambda: None

    def open(self, path: Path) -> Player:
        self.opened.append((path, Player()))
        self.meanwhile()
        return self.opened[-1][1]

    async def read(self) -> None:
        """Wait until all recordings that were asked for are read, and played."""
        await asyncio.gather(*(task for task in asyncio.all_tasks() if task is not asyncio.current_task()))


@pytest.fixture
def shelf(monkeypatch: pytest.MonkeyPatch) -> Recordings:
    shelf = Recordings()
    monkeypatch.setattr(requests, "PagePlayer", shelf)
    return shelf


async def test_a_page_that_plays_a_recording_lets_the_robot_stand_and_comes_back_to_it(
    desk: Desk, shelf: Recordings, tmp_path: Path
) -> None:
    page = desk.join()
    page.car.wheel.take(page.number, True, NOW)
    assert desk.ask(page, "replay", name="run.mcap") == STANDS
    assert page.car.wheel.holder == 0 and told(page, "page")
    page.outbox.clear()
    await shelf.read()
    [(path, player)] = shelf.opened
    assert path == tmp_path / "run.mcap" and page.player is player  # type: ignore[comparison-overlap]
    assert page.newest == "from the recording"
    assert [status["replay"] for status in told(page, "page")] == ["a recording"]
    desk.ask(page, "wind", to=3.0, speed=2.0)
    assert player.done == ["play", (3.0, 2.0)] and told(page, "page")
    page.car.full = "all of the robot"
    desk.ask(page, "replay")
    assert player.done[2:] == ["stop"] and page.player is None
    assert page.newest == "all of the robot"
    assert [status["replay"] for status in told(page, "page")] == [None]
    desk.ask(page, "wind", to=3.0)
    assert not page.outbox and page.counts.total() == 0


@pytest.mark.parametrize("name", ["../token", "run", "", ".mcap", "a/b.mcap", 5, ["run.mcap"], "run.mcap\n"])
async def test_only_a_recording_s_name_is_opened(name: object, desk: Desk, shelf: Recordings) -> None:
    page = desk.join()
    page.car.wheel.take(page.number, True, NOW)
    assert desk.ask(page, "replay", name=name) == []
    await shelf.read()
    assert shelf.opened == [] and page.player is None and page.counts == {"malformed": 1}


async def test_a_damaged_recording_is_told(desk: Desk, shelf: Recordings) -> None:
    page = desk.join()
    shelf.meanwhile = lambda: 1 // 0
    desk.ask(page, "replay", name="run.mcap")
    await shelf.read()
    assert told(page) == ["run.mcap cannot be shown: integer division or modulo by zero"] and page.player is None


@pytest.mark.parametrize("meanwhile", ["leaves", "robot", "nonsense"])
async def test_a_recording_is_not_played_to_a_page_that_wants_it_no_more(
    meanwhile: str, desk: Desk, shelf: Recordings
) -> None:
    page = desk.join()
    shelf.meanwhile = {
        "leaves": lambda: desk.pages.leave(page),
        "robot": lambda: desk.ask(page, "replay"),
        "nonsense": lambda: desk.ask(page, "replay", name="../token"),
    }[meanwhile]
    desk.ask(page, "replay", name="run.mcap")
    await shelf.read()
    [(_, player)] = shelf.opened
    assert page.player is None and player.done == []


async def test_of_recordings_that_are_asked_for_at_once_only_the_last_is_read(desk: Desk, shelf: Recordings) -> None:
    page = desk.join()
    for k in range(5):
        desk.ask(page, "replay", name=f"{k}.mcap")
    await shelf.read()
    [(path, player)] = shelf.opened
    assert path.name == "4.mcap" and page.player is player  # type: ignore[comparison-overlap]


@pytest.mark.parametrize(
    ("asking", "shown"),
    [
        ("visitor visitor visitor", "yes yes no"),
        ("operator operator operator operator operator", "yes yes yes yes no"),
        ("operator operator operator operator visitor", "yes yes yes yes no"),
        ("operator operator operator visitor visitor", "yes yes yes yes no"),
        ("visitor visitor operator operator operator", "yes yes yes yes no"),
    ],
)
async def test_visitors_show_two_recordings_at_once_and_all_pages_together_four(
    asking: str, shown: str, desk: Desk, shelf: Recordings
) -> None:
    there = [desk.join(role) for role in asking.split()]  # type: ignore[arg-type]
    for page in there:
        take(desk.pages, page, '{"do": "replay", "name": "run.mcap"}')
    await shelf.read()
    assert [["no", "yes"][page.player is not None] for page in there] == shown.split()
    assert len(shelf.opened) == shown.count("yes"), "what is not shown takes no memory"
    *_, first, last = there
    assert told(last) == ["too many pages show recordings; wait until one is shown no more"] and not told(first)
    desk.ask(first, "replay")
    desk.ask(last, "replay", name="run.mcap")
    await shelf.read()
    assert last.player is not None and not told(last)
