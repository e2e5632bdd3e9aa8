"""`--web`: where the page is, and the files that keep it safe."""

from __future__ import annotations

import argparse
import json
import socket
from pathlib import Path

import pytest

from txt1.cli.run import add_arguments
from txt1.errors import ConfigError
from txt1.web.options import WebPage, web_page


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "txt1"


def start(*words: str) -> WebPage | None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return web_page(parser.parse_args([*words, "--headless"]))


def test_nothing_is_served_unless_asked_for() -> None:
    assert start() is None


def test_on_loopback_there_is_neither_token_nor_tls(capsys: pytest.CaptureFixture[str], state: Path) -> None:
    page = start("--web", "0")
    assert page is not None and page.host == "127.0.0.1" and page.port > 0
    assert page.token is page.certificate is page.key is None
    assert page.places == (f"http://127.0.0.1:{page.port}/",)
    assert capsys.readouterr().err == "", "nothing is said before it answers"
    assert not state.exists()


def test_beyond_it_both_are_made_for_their_owner_and_the_token_is_not_printed(
    capsys: pytest.CaptureFixture[str], state: Path
) -> None:
    page = start("--web", "0.0.0.0:0")
    assert page is not None and page.token is not None and page.key is not None
    told = capsys.readouterr().err
    token = page.token.read_text().strip()
    assert "https://" in told and "SHA-256" in told and token not in told
    assert page.token.parent == state and state.stat().st_mode & 0o077 == 0
    assert page.token.stat().st_mode & 0o077 == page.key.stat().st_mode & 0o077 == 0
    assert token not in json.dumps(page.bridge()), "the server's options stand in the list of processes"
    lines = told.splitlines()
    code = [line for line in lines if "█" in line]
    assert page.places[0] in lines[lines.index(code[0]) - 1], "the address stands just above the code"
    assert 1 + len(code) + 2 <= 24, "with the line on Enter, and the cursor's, it fits a window of 24 rows"
    again = start("--web", "0.0.0.0:0")
    assert again is not None and again.token is not None and again.token.read_text().strip() == token


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--web-token", "x"), "there is no page; add --web"),
        (("--web", "0", "--speed", "max"), "no person could watch"),
        (("--web", "no.such.host.invalid:0"), "cannot listen there"),
        (("--web", "0", "--web-cert", __file__), "cannot be used"),
    ],
)
def test_mistakes_are_told_before_the_robot_is_brought_up(words: tuple[str, ...], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        start(*words)


def test_a_port_that_is_taken_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"--web 127.0.0.1:{port}: cannot listen there"):
            start("--web", str(port))


def test_other_robots_are_named_with_their_addresses() -> None:
    page = start("--web", "0", "--web-robot", "txt02=https://txt02.local:8080")
    assert page is not None and page.robots == {"txt02": "https://txt02.local:8080"}
