"""Who may come in: tokens, cookies, hosts and origins."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.web.auth import SESSION, Auth, is_loopback, visitors_token

TOKEN = "t0ken-of-the-robot-long-enough"


def test_the_right_token_makes_a_cookie_that_lasts_twelve_hours() -> None:
    door = Auth(TOKEN, "https", 8443)
    signed = door.sign_in(TOKEN, 1e9)
    assert signed is not None and signed[0] == "operator"
    assert door.role(signed[1], 1e9 + SESSION - 1.0) == "operator"
    assert door.role(signed[1], 1e9 + SESSION + 1.0) is None
    assert door.role(signed[1], 1e9 - 10.0) is None, "from the future"
    assert TOKEN not in signed[1]


def test_visitors_have_a_token_of_their_own() -> None:
    door = Auth(TOKEN, "https", 8443)
    signed = door.sign_in(visitors_token(TOKEN), 1e9)
    assert signed is not None and signed[0] == "visitor"
    assert door.role(signed[1], 1e9) == "visitor"
    assert door.role(signed[1].replace("visitor", "operator"), 1e9) is None


def test_another_token_signs_everybody_out() -> None:
    signed = Auth(TOKEN, "https", 8443).sign_in(TOKEN, 1e9)
    assert signed is not None
    assert Auth(TOKEN + "x", "https", 8443).role(signed[1], 1e9) is None


@given(st.text(max_size=200))
def test_no_other_word_is_a_token_or_a_cookie(text: str) -> None:
    door = Auth(TOKEN, "https", 8443)
    assert door.role(text, 1e9) is None
    assert text in (TOKEN, visitors_token(TOKEN)) or door.sign_in(text, 1e9) is None


def test_an_address_has_five_wrong_tokens_and_then_one_in_five_seconds() -> None:
    door = Auth(TOKEN, "https", 8443)

    def tries(address: str, now: float) -> bool:
        may = door.may_try(address, now)
        if may:
            door.failed(address, now)
        return may

    assert [tries("10.0.0.9", 0.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert tries("10.0.0.8", 0.0)
    assert tries("10.0.0.9", 5.1) and not tries("10.0.0.9", 5.2)


@pytest.mark.parametrize(
    ("host", "known"),
    [("127.0.0.1:80", True), ("localhost:80", True), ("[::1]:80", True), ("evil.example:80", False), ("", False)],
)  # fmt: skip
def test_without_a_token_only_loopback_names_are_answered(host: str, known: bool) -> None:
    assert Auth(None, "http", 80).knows_host(host) is known
    assert Auth(TOKEN, "https", 80).knows_host(host), "with one a name is no secret"


@pytest.mark.parametrize(
    "origin", [None, "null", "http://127.0.0.1:81", "https://127.0.0.1:80", "http://evil.example", "http://127.0.0.1:80.evil.example"]
)  # fmt: skip
def test_other_origins_are_not_ours(origin: str | None) -> None:
    door = Auth(None, "http", 80)
    assert not door.knows_origin(origin, "127.0.0.1:80")
    assert door.knows_origin("http://127.0.0.1:80", "127.0.0.1:80")


def test_loopback_addresses() -> None:
    assert all(map(is_loopback, ("localhost", "127.0.0.1", "127.8.8.8", "::1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "10.0.0.1", "robot.local", "127.0.0.1.example")))
