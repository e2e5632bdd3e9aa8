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
from txt1.web.auth import ADDRESSES_MAX, Auth, token_in, visitors_token

TOKEN = "t0ken-of-the-robot-long-enough"


def test_the_right_token_makes_a_cookie_that_lasts_twelve_hours() -> None:
    door = Auth(TOKEN, "https", 8443)
    signed = door.sign_in(TOKEN, 1e9)
    assert signed is not None and signed[0] == "operator"
    ends = 1e9 + 12 * 3600
    assert [door.role(signed[1], now) for now in (1e9, ends - 1.0, ends)] == ["operator", "operator", None]
    assert door.role(signed[1], 1e9 - 1.0) == "operator", "the clock may be set back a little"
    assert door.role(signed[1], 1e9 - 1.5) is None, "from the future"
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


def test_a_cookie_s_time_is_in_the_digits_that_the_robot_writes() -> None:
    door = Auth(TOKEN, "https", 8443)
    signed = door.sign_in(TOKEN, 1e9)
    assert signed is not None
    role, time, proof = signed[1].split(".")
    other = "".join(chr(0x660 + int(digit)) for digit in time)
    assert float(other) == float(time)
    assert door.role(f"{role}.{other}.{proof}", 1e9) is None


def test_pages_of_two_robots_on_one_computer_have_two_cookies() -> None:
    assert Auth(TOKEN, "https", 8443).cookie != Auth(TOKEN, "https", 8444).cookie


def test_an_address_has_five_wrong_tokens_and_then_one_in_five_seconds() -> None:
    door = Auth(TOKEN, "https", 8443)
    assert [door.failed("10.0.0.9", 0.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert door.failed("10.0.0.8", 0.0)
    assert door.failed("10.0.0.9", 5.1) and not door.failed("10.0.0.9", 5.2)


def test_wrong_tokens_from_many_addresses_fill_no_memory() -> None:
    door = Auth(TOKEN, "https", 8443)
    while door.failed("10.0.0.9", 0.0):
        pass
    for k in range(ADDRESSES_MAX + 1):
        assert door.failed(f"10.1.{k // 256}.{k % 256}", 0.0)
    assert door.failed("10.0.0.9", 0.0), "the counts begin anew"


@pytest.mark.parametrize(
    "host", ["robot;script-src *", "robot/", "robot@evil.example", "robot\r\nX: y", "robot 'self'"]
)
@pytest.mark.parametrize("token", [TOKEN, None])
def test_a_host_that_could_not_stand_in_a_header_is_never_known(host: str, token: str | None) -> None:
    assert not Auth(token, "https", 8443).knows_host(host)


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
        *(
            ("a-word-that-nobody-guesses", 0o600 | more, "others may read it; chmod 600")
            for more in (0o040, 0o020, 0o010, 0o004, 0o002, 0o001)
        ),
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


def test_a_token_s_folder_that_is_missing_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere/token: No such file or directory; give a file that can be read"):
        token_in(tmp_path / "nowhere" / "token")


def test_a_token_is_complete_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    linked: list[str] = []
    link = Path.hardlink_to

    def watched(file: Path, made: str) -> None:
        linked.append(Path(made).read_text())
        link(file, made)

    monkeypatch.setattr(Path, "hardlink_to", watched)
    token = token_in(tmp_path / "token")
    assert linked == [f"{token}\n"]


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
