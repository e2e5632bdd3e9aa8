"""Who may make which request of the page: each request, by each role, in each state of the wheel.

The table `MAY` is the promise. A request without a row here fails the test.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from tests.unit.web.test_web_commands import NOW, STANDS, WAY, Desk, listed, told, wheel  # noqa: E402
from txt1.web import pages, requests  # noqa: E402
from txt1.web.auth import Role  # noqa: E402
from txt1.web.pages import Page  # noqa: E402
from txt1.web.requests import REQUESTS  # noqa: E402
from txt1.web.wheel import IDLE  # noqa: E402

STATES: Final = ("free", "own", "operator's", "idle operator's", "visitor's", "idle visitor's")
"""Of the wheel: whose it is before the request."""
MAY: Final[dict[str, tuple[str, str, str]]] = {
    # request: what an operator, a visitor and a stop channel get in each state
    #    yes, -: nothing is done, TAKE: the robot halts, the wheel changes hands, and the request is carried out
    "stop": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "yes yes yes yes yes yes"),
    "disarm": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
    "drive": ("yes yes - TAKE TAKE TAKE", "yes yes - - - TAKE", "- - - - - -"),
    "go": ("yes yes - TAKE TAKE TAKE", "yes yes - - - TAKE", "- - - - - -"),
    "take": ("yes yes - TAKE TAKE TAKE", "yes yes - - - TAKE", "- - - - - -"),
    "hold": ("- yes - - - -", "- yes - - - -", "- - - - - -"),
    "release": ("- yes - - - -", "- yes - - - -", "- - - - - -"),
    "give": ("- yes - - - -", "- yes - - - -", "- - - - - -"),
    "arm": ("yes yes - TAKE TAKE TAKE", "- - - - - -", "- - - - - -"),
    "here": ("yes yes - TAKE TAKE TAKE", "- - - - - -", "- - - - - -"),
    "gains": ("yes yes yes yes yes yes", "- - - - - -", "- - - - - -"),
    "limit": ("yes yes yes yes yes yes", "- - - - - -", "- - - - - -"),
    "record": ("yes yes yes yes yes yes", "- - - - - -", "- - - - - -"),
    "pong": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
    "robot": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
    "choose": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
    "files": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
    "replay": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
    "wind": ("yes yes yes yes yes yes", "yes yes yes yes yes yes", "- - - - - -"),
}
FIELDS: Final[dict[str, dict[str, Any]]] = {
    "drive": {"v": 0.4, "omega": 0.1},
    "go": {"points": WAY, "speed": 0.3},
    "here": {"points": WAY},
    "gains": {"linear": [1.0, 2.0, 3.0], "angular": [[1.5, 1.0, 2.0, 3.0]]},
    "limit": {"speed": 1.5},
    "record": {"on": True},
    "pong": {"ping": NOW - 0.5},
    "robot": {"name": ""},
    "choose": {"topics": ["/scan"]},
    "wind": {"to": 1.0},
}
OTHERS: Final[dict[str, Callable[[Page], object]]] = {
    "limit": lambda page: [status["visitors"] for status in told(page, "page")] == [1.5],
    "pong": lambda page: page.round_trip == 0.5,
    "robot": lambda page: wheel(page),
    "choose": lambda page: page.chosen == {"/scan"},
    "files": lambda page: told(page, "files"),
    "replay": lambda page: page.replays == 1,
    # without a recording there is nothing to wind, which is no refusal
    "wind": lambda page: not page.counts["refused"],
}
"""Whether a request was carried out that asks nothing of the robot by its own name."""


def cells() -> list[tuple[str, Role, str, str]]:
    """Each request, role and state of the wheel, and what is promised."""
    found: list[tuple[str, Role, str, str]] = []
    roles: tuple[Role, Role, Role] = ("operator", "visitor", "stop channel")
    for do in REQUESTS:
        for role, promised in zip(roles, MAY[do], strict=True):
            found += [(do, role, *each) for each in zip(STATES, promised.split(), strict=True)]
    return found


def test_each_request_has_a_row() -> None:
    assert set(MAY) == set(REQUESTS)


@pytest.mark.parametrize(("do", "role", "state", "promised"), cells())
async def test_a_request_does_what_its_role_may_in_each_state_of_the_wheel(
    do: str, role: Role, state: str, promised: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    monkeypatch.setattr(pages, "STATUS_PERIOD", 0.0)
    desk = Desk(tmp_path)
    page, operator, visitor = desk.join(role), desk.join(), desk.join("visitor")
    holder = {"own": page, "free": None}.get(state, operator if "operator" in state else visitor)
    car_wheel = page.car.wheel
    if holder is not None:
        car_wheel.take(holder.number, holder.role == "operator", NOW - IDLE if "idle" in state else NOW)
    before = car_wheel.holder

    asked = desk.ask(page, do, **FIELDS.get(do, {}))

    if do == "files" and promised != "-":
        await listed(page)
    names = [name for name, _ in asked]
    if do in ("stop", "disarm", "drive", "go", "here", "arm", "hold", "gains", "record"):
        done = do in names
    elif do in ("release", "give", "take"):
        done = asked == STANDS or asked == STANDS * 2
    else:
        done = bool(OTHERS[do](page))
    assert done == (promised != "-")
    assert page.counts["malformed"] == page.counts["late"] == 0
    if promised == "-":
        assert asked == [] and car_wheel.holder == before
        if role == "stop channel":
            assert told(page) == ["this connection is for stops alone"]
        elif role == "visitor" and do in ("arm", "here", "gains", "limit", "record"):
            assert "operator's" in told(page)[0]
    elif promised == "TAKE":
        assert names[:2] == ["release", "halt"] and car_wheel.holder == page.number
        if do == "drive":
            assert asked[-1] == ("drive", {"v": 0.0, "omega": 0.0, "age": 0.0, "held": True}), "it has to let go first"
    else:
        takes = before == 0 and do in ("drive", "go", "take", "arm", "here")
        gives = state == "own" and do in ("give", "replay")
        assert car_wheel.holder == (page.number if takes else 0 if gives else before)


async def test_a_change_of_hands_passes_through_zero_and_both_let_go_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the end of a press counts as letting go: a stick that is held in its middle commands zeros, too."""
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    operator, visitor = desk.join(), desk.join("visitor")

    def drives(page: Page) -> bool:
        return ("drive", {"v": 0.4, "omega": 0.0, "age": 0.0, "held": True}) in desk.ask(
            page, "drive", v=0.4, omega=0.0
        )

    assert drives(visitor)
    assert not drives(operator) and not drives(operator), "the same press goes on"
    assert told(operator) == []
    desk.ask(operator, "drive", v=0.0, omega=0.0)
    assert not drives(operator), "the same press goes on"
    desk.ask(operator, "release")
    assert drives(operator) and not drives(visitor)
    desk.ask(operator, "give")
    assert not drives(visitor), "its press is older than the free wheel"
    desk.ask(visitor, "release")
    assert drives(visitor)
    desk.ask(operator, "take")
    assert drives(operator), "the button was pressed, and then the stick"


async def test_a_visitor_who_keeps_the_wheel_with_zeros_keeps_it_from_no_operator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    operator, visitor = desk.join(), desk.join("visitor")
    desk.ask(visitor, "drive", v=0.0, omega=0.0)
    assert desk.ask(operator, "take") == [*STANDS, *STANDS]
    assert desk.ask(visitor, "drive", v=0.0, omega=0.0) == []
    assert wheel(operator) == [] and visitor.car.wheel.holder == operator.number
    assert desk.ask(visitor, "take") == []
    assert told(visitor) == [f"page {operator.number} is an operator's, and has the wheel until it gives it up"]


def drives(desk: Desk, page: Page, **given: Any) -> bool:
    """Whether a page's held stick moves the robot."""
    asked = desk.ask(page, "drive", v=0.4, omega=0.0, **given)
    return ("drive", {"v": 0.4, "omega": 0.0, "age": 0.0, "held": True}) in asked


async def test_a_hold_that_was_refused_drives_only_after_it_was_let_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    operator, visitor = desk.join(), desk.join("visitor")
    assert drives(desk, operator) and not drives(desk, visitor)
    assert visitor.counts["refused"] == 1
    assert told(visitor) == [], "a hold asks 20 times a second"
    desk.ask(operator, "give")
    assert not drives(desk, visitor), "the press is older than the free wheel"
    desk.ask(visitor, "take")
    assert drives(desk, visitor), "the button was pressed"


async def test_a_hold_that_was_overruled_meanwhile_drives_only_after_it_was_let_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    operator, visitor = desk.join(), desk.join("visitor")
    assert drives(desk, visitor)
    # the visitor's messages are on their way
    desk.ask(operator, "take")
    desk.ask(operator, "give")
    assert not drives(desk, visitor)
    desk.ask(visitor, "release")
    assert drives(desk, visitor)


async def test_who_takes_over_with_a_hold_is_told_to_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    operator, visitor = desk.join(), desk.join("visitor")
    assert drives(desk, visitor)
    assert "you have the wheel now: let go, then drive" not in operator.outbox
    assert not drives(desk, operator)
    assert any("you have the wheel now: let go, then drive" in each for each in operator.outbox)
    desk.ask(operator, "give")
    desk.ask(visitor, "release")
    assert drives(desk, visitor)
    operator.outbox.clear()
    desk.ask(operator, "take")
    assert not any("let go, then drive" in each for each in operator.outbox), "a button is not held"


@pytest.mark.parametrize("do", ["drive", "go", "hold", "here"])
async def test_who_drives_keeps_the_wheel_from_an_equal(
    do: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    present = NOW
    monkeypatch.setattr(requests, "now", lambda: present)
    desk = Desk(tmp_path)
    driver, other = desk.join(), desk.join()
    desk.ask(driver, "take")
    for _ in range(5):
        present += 0.6 * IDLE
        driver.clock.answered(present, present, present)
        desk.ask(driver, do, t=present, **FIELDS.get(do, {}))
        assert driver.car.wheel.holder == driver.number
    present += 0.6 * IDLE
    desk.ask(other, "take")
    assert driver.car.wheel.holder == driver.number
    present += 0.6 * IDLE
    desk.ask(other, "take")
    assert driver.car.wheel.holder == other.number, "it was idle"


async def test_what_a_role_may_not_do_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    visitor = desk.join("visitor")
    for count in (1, 2):
        desk.ask(visitor, "arm")
        assert visitor.counts["refused"] == count


async def test_a_lower_limit_halts_a_visitor_and_an_equal_one_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "now", lambda: NOW)
    desk = Desk(tmp_path)
    operator, visitor = desk.join(), desk.join("visitor")
    desk.ask(operator, "limit", speed=1.0)
    assert drives(desk, visitor)
    assert desk.ask(operator, "limit", speed=1.0) == []
    assert desk.ask(operator, "limit", speed=0.9) != []
