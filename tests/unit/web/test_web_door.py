"""Who may come in: tokens, cookies, hosts and origins."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.commands import is_loopback
from txt1.errors import ConfigError
from txt1.web.auth import SESSION, Auth, token_in, visitors_token

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


def test_a_cookie_with_another_letter_anywhere_is_a_stranger_s() -> None:
    door = Auth(TOKEN, "https", 8443)
    signed = door.sign_in(TOKEN, 1e9)
    assert signed is not None
    cookie = signed[1]
    for at, letter in enumerate(cookie):
        other = "1" if letter != "1" else "2"
        assert door.role(cookie[:at] + other + cookie[at + 1 :], 1e9) is None, at
    assert door.role(cookie, 1e9) == "operator"


@given(st.text(max_size=200))
def test_no_other_word_is_a_token_or_a_cookie(text: str) -> None:
    door = Auth(TOKEN, "https", 8443)
    assert door.role(text, 1e9) is None
    assert text in (TOKEN, visitors_token(TOKEN)) or door.sign_in(text, 1e9) is None


def test_an_address_has_five_wrong_tokens_and_then_one_in_five_seconds() -> None:
    door = Auth(TOKEN, "https", 8443)
    assert [door.failed("10.0.0.9", 0.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert door.failed("10.0.0.8", 0.0)
    assert door.failed("10.0.0.9", 5.1) and not door.failed("10.0.0.9", 5.2)


@pytest.mark.parametrize(
    ("host", "known"),
    [("127.0.0.1:80", True), ("localhost:80", True), ("[::1]:80", True), ("evil.example:80", False), ("", False)],
)
def test_without_a_token_only_loopback_names_are_answered(host: str, known: bool) -> None:
    assert Auth(None, "http", 80).knows_host(host) is known
    assert Auth(TOKEN, "https", 80).knows_host(host), "with one a name is no secret"


@pytest.mark.parametrize(
    "origin",
    [
        None,
        "null",
        "http://127.0.0.1:81",
        "https://127.0.0.1:80",
        "http://evil.example",
        "http://127.0.0.1:80.evil.example",
    ],
)
def test_other_origins_are_not_ours(origin: str | None) -> None:
    door = Auth(None, "http", 80)
    assert not door.knows_origin(origin, "127.0.0.1:80")
    assert door.knows_origin("http://127.0.0.1:80", "127.0.0.1:80")


def test_loopback_addresses() -> None:
    assert all(map(is_loopback, ("localhost", "127.0.0.1", "127.8.8.8", "::1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "10.0.0.1", "robot.local", "127.0.0.1.example")))


# -- the file ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "mode", "problem"),
    [
        ("a-word-that-nobody-guesses", 0o644, "others may read it; chmod 600"),
        ("short", 0o600, "a word of at least 16 characters"),
        ("", 0o600, "a word of at least 16 characters"),
        ("two words that nobody guesses", 0o600, "a word of at least 16 characters"),
        ("ein-Wort-das-niemand-errät", 0o600, "a word of at least 16 characters"),
        *((f"a-word-that{mark}nobody-guesses", 0o600, "a digit or one of . _ ~ -") for mark in "+%&#/"),
    ],
)
def test_a_malformed_or_guessable_token_is_refused(content: str, mode: int, problem: str, tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(content, encoding="utf-8")
    file.chmod(mode)
    with pytest.raises(ConfigError, match=re.escape(problem)):
        token_in(file)


@pytest.mark.parametrize("name", ["/dev/null", "."])
def test_a_token_is_kept_in_a_regular_file(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"--web-token {tmp_path / name}: not a regular file") as refused:
        token_in(tmp_path / name)
    assert "chmod" not in str(refused.value)


def test_who_make_a_token_at_once_have_the_same(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        for place in range(50):
            file = tmp_path / str(place)
            assert len(set(pool.map(token_in, [file] * 8))) == 1
    assert {path.name for path in tmp_path.iterdir()} == {str(place) for place in range(50)}


def test_a_token_that_somebody_makes_meanwhile_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "token"
    file.write_text(TOKEN)
    file.chmod(0o600)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "exists", lambda _: False)
        assert token_in(file) == TOKEN
    assert list(tmp_path.iterdir()) == [file]
