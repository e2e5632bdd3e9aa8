"""The key of a fleet: which files may hold one, and what is made of it."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.errors import ConfigError
from txt1.fleet import key as module
from txt1.fleet.key import KEY_MIN, SIGNATURE, FleetKey, fleet_key, users_key

PASSWORD = "long enough for a password"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.touch(mode=0o600)
    path.write_text(f"{PASSWORD}\n")
    return path


def test_a_user_s_own_key_is_made_once_and_is_nobody_else_s(fleet_s_key: Path) -> None:
    old = os.umask(0)
    try:
        path = users_key()
    finally:
        os.umask(old)
    about = path.lstat()
    assert path == fleet_s_key / "txt1" / "fleet-key"
    assert stat.S_IMODE(about.st_mode) == 0o600 and stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert [each.name for each in path.parent.iterdir()] == ["fleet-key"], "no draft is left"
    told = path.read_text()
    assert len(told.strip()) == 64 and users_key() == path and path.read_text() == told
    assert fleet_key("", None).space == fleet_key("", None).space


def test_of_two_terminals_that_begin_at_once_both_have_the_key_of_the_first(
    fleet_s_key: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(length: int) -> str:
        if length == 32:  # between our look and our link
            (fleet_s_key / "txt1" / "fleet-key").write_text("the key of the first terminal")
        return "f" * length

    monkeypatch.setattr(module, "token_hex", other)
    assert users_key().read_text() == "the key of the first terminal"
    assert len(list((fleet_s_key / "txt1").iterdir())) == 1


def test_a_key_that_cannot_be_kept_is_refused_with_the_remedy(fleet_s_key: Path) -> None:
    (fleet_s_key / "txt1").write_text("a file where the folder should be")
    with pytest.raises(ConfigError, match=r"cannot make it: .*; name another with --fleet-key FILE"):
        users_key()


def test_a_key_is_made_where_none_is_and_one_that_is_there_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "none" / "yet"))
    path = users_key()
    path.unlink()
    told = users_key().read_text()

    def no(length: int) -> str:
        raise AssertionError(f"a new key of {length} bytes")

    monkeypatch.setattr(module, "token_hex", no)
    assert users_key().read_text() == told
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    (tmp_path / ".config").symlink_to(path.parents[1])
    assert users_key() == tmp_path / ".config" / "txt1" / "fleet-key"


def test_without_a_home_a_key_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    with pytest.raises(ConfigError, match="you have no home to keep it in; add --fleet-key FILE"):
        fleet_key("", None)


@pytest.mark.parametrize("mode", [0o604, 0o640, 0o620, 0o602, 0o610, 0o666, 0o644])
def test_a_key_that_others_may_use_is_refused_with_the_remedy(file: Path, mode: int) -> None:
    file.chmod(mode)
    with pytest.raises(ConfigError) as refused:
        fleet_key("", file)
    assert str(refused.value) == (f"--fleet-key {file}: others may use it; make it yours alone: chmod 600 {file}")
    file.chmod(0o400)
    assert fleet_key("", file).space


def test_a_symlink_a_pipe_and_a_folder_are_no_key(file: Path, tmp_path: Path, fleet_s_key: Path) -> None:
    link, pipe = tmp_path / "link", tmp_path / "pipe"
    link.symlink_to(file)
    os.mkfifo(pipe, 0o600)
    with pytest.raises(ConfigError, match="it is a symlink, which others may turn; name the file itself"):
        fleet_key("", link)
    for other in (pipe, tmp_path):
        with pytest.raises(ConfigError, match=r"it is no file|Is a directory"):
            fleet_key("", other)
    (fleet_s_key / "txt1").mkdir()
    (fleet_s_key / "txt1" / "fleet-key").symlink_to(file)
    with pytest.raises(ConfigError, match=r"your fleet's key .*: it is a symlink"):
        fleet_key("", None)


def test_another_user_s_key_is_refused(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    owner = file.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(ConfigError, match="it belongs to another user; make a copy of your own"):
        fleet_key("", file)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert fleet_key("", file).space, "root may use anybody's"


@pytest.mark.parametrize(("content", "why"), [(b"short", "16 characters"), (b"\xff" * 20, "it is no text")])
def test_a_file_that_holds_no_password_is_refused(file: Path, content: bytes, why: str) -> None:
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=why):
        fleet_key("", file)
    with pytest.raises(ConfigError, match="cannot read it: No such file"):
        fleet_key("", file.with_name("none"))
    file.write_text("x" * KEY_MIN)
    assert fleet_key("", file).space


def test_beyond_loopback_a_key_is_asked_for(file: Path) -> None:
    why = "--fleet eth0: beyond loopback all share a key; add --fleet-key FILE"
    with pytest.raises(ConfigError, match=rf"{why} \(make one\)"):
        fleet_key("eth0", None)
    users_key()
    with pytest.raises(ConfigError, match=rf"{why} \(copy your own \({users_key()}\) to each robot\)"):
        fleet_key("eth0", None)
    assert fleet_key("eth0", file).password != PASSWORD


@pytest.mark.parametrize("name", ["", "TXT", "a/b", "*", "a b", "x" * 65])
def test_a_name_of_a_fleet_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="--fleet-name: "):
        FleetKey(PASSWORD, name)


def test_other_names_and_other_keys_have_nothing_in_common() -> None:
    keys = [FleetKey(PASSWORD), FleetKey(PASSWORD, "txt2"), FleetKey(f"{PASSWORD}x"), FleetKey(PASSWORD, "txt")]
    assert len({key.space for key in keys}) == len({key.password for key in keys}) == len(keys)
    message = keys[0].signed("stop/a", b"{}")
    assert keys[0].opened("stop/a", message) == b"{}"
    assert not any(key.opened("stop/a", message) for key in keys[1:])


@given(st.binary(max_size=80), st.integers(0, 200), st.integers(1, 255))
def test_a_message_that_was_changed_moved_or_cut_is_not_signed(text: bytes, at: int, by: int) -> None:
    key = FleetKey(PASSWORD)
    message = bytearray(key.signed("drive/net01", text))
    assert key.opened("drive/net01", bytes(message)) == text
    assert key.opened("drive/net02", bytes(message)) is None
    assert key.opened("drive/net01", bytes(message[:-1])) is None
    assert key.opened("drive/net01", text) is None or len(text) < SIGNATURE
    message[at % len(message)] ^= by
    assert key.opened("drive/net01", bytes(message)) is None
