"""Ports are listed with the likely ones first, and whoever cannot use one is told what to do."""

from __future__ import annotations

import grp
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from txt1.errors import HalError
from txt1.link.ports import SerialPort, access_problem, candidates, only_candidate


def connected(monkeypatch: pytest.MonkeyPatch, *ports: tuple[str, str, int | None]) -> None:
    """Let these be the computer's ports: device, description, USB vendor."""
    found = [SimpleNamespace(device=device, description=description, vid=vid) for device, description, vid in ports]
    monkeypatch.setattr(list_ports, "comports", lambda: found)


def test_usb_ports_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    connected(
        monkeypatch, ("/dev/ttyS1", "n/a", None), ("/dev/ttyUSB1", "FT232R", 0x403), ("/dev/ttyACM0", "u-blox", 0x1546)
    )
    assert candidates() == [
        SerialPort("/dev/ttyACM0", "u-blox", True),
        SerialPort("/dev/ttyUSB1", "FT232R", True),
        SerialPort("/dev/ttyS1", "n/a", False),
    ]


def test_the_only_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    connected(monkeypatch, ("/dev/ttyUSB0", "FT232R", 0x403))
    assert only_candidate() == "/dev/ttyUSB0"


def test_without_a_port_the_adapter_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    connected(monkeypatch)
    with pytest.raises(HalError) as error:
        only_candidate()
    assert str(error.value) == "no serial port found: plug in the USB-RS232 adapter, or name one with --port"


def test_among_several_ports_none_is_guessed(monkeypatch: pytest.MonkeyPatch) -> None:
    connected(monkeypatch, ("/dev/ttyACM0", "u-blox GPS", 0x1546), ("/dev/ttyS0", "n/a", None))
    with pytest.raises(HalError) as error:
        only_candidate()
    assert str(error.value) == ("2 serial ports found, name one with --port: /dev/ttyACM0 (u-blox GPS), /dev/ttyS0")


def test_this_computer_s_own_ports_can_be_listed() -> None:
    assert all(port.device.startswith("/dev/") for port in candidates())


@pytest.fixture
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A port this user may not use: of the group dialout, which may."""
    path = tmp_path / "ttyUSB0"
    path.touch()
    path.chmod(0o660)
    status = os.stat(path)
    dialout = os.stat_result((status.st_mode, *status[1:5], 20, *status[6:]))
    real = os.stat
    monkeypatch.setattr(os, "stat", lambda name, **kwargs: dialout if name == str(path) else real(name, **kwargs))
    monkeypatch.setattr(os, "access", lambda name, mode: False)
    monkeypatch.setattr(grp, "getgrgid", lambda gid: SimpleNamespace(gr_name={20: "dialout", 0: "root"}[gid]))
    return path


def test_a_port_one_may_use_has_no_problem(tmp_path: Path) -> None:
    path = tmp_path / "ttyUSB0"
    path.touch()
    assert access_problem(str(path)) is None


def test_a_missing_port_is_called_missing() -> None:
    assert access_problem("/dev/ttyUSB77") == "/dev/ttyUSB77 does not exist: is the adapter plugged in?"


def test_a_path_through_a_file_cannot_be_looked_at(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert access_problem(f"{tmp_path}/file/ttyUSB0") == f"{tmp_path}/file/ttyUSB0 cannot be looked at: Not a directory"


def test_who_is_not_in_the_port_s_group_is_told_how_to_join_it(device: Path) -> None:
    assert access_problem(str(device)) == (
        f"no permission to use {device}: it belongs to the group dialout: "
        "sudo usermod -aG dialout $USER, then log out and in again"
    )


@pytest.mark.parametrize("why", ["the group may not write", "the group is root"])
def test_where_joining_a_group_would_not_help_a_udev_rule_does(
    device: Path, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    status = os.stat(str(device))
    mode, group = (0o100600, 20) if why == "the group may not write" else (0o100660, 0)
    changed = os.stat_result((mode, *status[1:5], group, *status[6:]))
    monkeypatch.setattr(os, "stat", lambda name, **kwargs: changed)
    problem = access_problem(str(device))
    assert problem is not None
    assert 'KERNEL=="ttyUSB0", SUBSYSTEM=="tty", GROUP="dialout", MODE="0660"' in problem
    assert "/etc/udev/rules.d/50-txt1.rules" in problem
    assert "usermod" not in problem


def test_a_group_without_a_name_is_told_by_its_number(device: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(gid: int) -> None:
        raise KeyError(gid)

    monkeypatch.setattr(grp, "getgrgid", unknown)
    assert "sudo usermod -aG 20 $USER" in str(access_problem(str(device)))
