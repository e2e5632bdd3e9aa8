"""Serial devices: opened raw and by one user alone, refused in words, and never waited for."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import sys
import termios
import threading
from pathlib import Path
from typing import Any

import pytest
from link_ends import FRAME, End, host_at, opened_pty, refusal, run_quietly
from serial import SerialException

from tests.patience import LIMIT, until
from txt1.errors import ConfigError, HalError, LinkLost
from txt1.link import device
from txt1.link.device import STANDARD_BAUDS, baud_warning, open_link


@pytest.mark.parametrize(("baud", "speed"), [(57600, termios.B57600), (115200, termios.B115200), (250_000, None)])
def test_a_device_is_opened_raw_with_8_data_bits_no_parity_and_one_stop_bit(
    baud: int, speed: int | None, transport: str
) -> None:
    async def main() -> None:
        with opened_pty() as (master, path):
            link = await open_link(path, End(), baud, transport=transport)
            _, oflag, cflag, lflag, ispeed, ospeed, _ = termios.tcgetattr(master)
            link.close()
        assert cflag & termios.CSIZE == termios.CS8
        assert not cflag & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
        assert not lflag & (termios.ECHO | termios.ICANON | termios.ISIG)
        assert not oflag & termios.OPOST
        assert speed is None or ispeed == ospeed == speed

    run_quietly(main())


def is_free(fd: int) -> bool:
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def test_an_unread_device_loses_writes_and_never_blocks(transport: str) -> None:
    async def main() -> None:
        with opened_pty() as (_, path):
            end = End()
            link = await open_link(path, end, transport=transport)
            for _ in range(40):
                for _ in range(50):
                    link.write(FRAME)
                await asyncio.sleep(0.001)  # the loop goes on
            assert link.overflows > 100
            link.close()
            with host_at(path) as other:
                if transport == "serialx":  # a thread closes it
                    await until(lambda: is_free(other))
                assert is_free(other), "at once"
            assert end.reasons == []

    run_quietly(main())


@pytest.mark.parametrize("noticed", ["on reading", "on writing"])
def test_a_device_unplugged_with_its_output_full_is_lost_without_noise(noticed: str, transport: str) -> None:
    async def main() -> None:
        with opened_pty() as (master, path):
            end = End()
            link = await open_link(path, end, transport=transport)
            for _ in range(20):  # what the loop stores, and what the kernel does
                for _ in range(100):
                    link.write(FRAME)
                await asyncio.sleep(0.001)
            assert link.overflows > 0
            if noticed == "on writing":
                link.transport.pause_reading()  # type: ignore[attr-defined]
            os.close(master)
            await until(lambda: end.reasons)
            assert end.reasons == [f"{path} is gone: the program behind it has ended or closed it"]
            with pytest.raises(LinkLost, match="is gone"):
                link.write(FRAME)

    run_quietly(main())


def test_an_adapter_pulled_out_is_called_unplugged() -> None:
    assert device.unplugged("/dev/ttyUSB0", SerialException(errno.EIO, "")) == "/dev/ttyUSB0 was unplugged"


def test_a_device_has_one_user(transport: str) -> None:
    async def main() -> None:
        with opened_pty() as (_, path):
            link = await open_link(path, End(), transport=transport)
            with pytest.raises(HalError, match=f"{path} is busy: another program has it open"):
                await open_link(path, End(), transport=transport)
            link.close()

    run_quietly(main())


def test_a_port_that_is_closed_keeps_the_line_up_at_which_boards_restart(transport: str) -> None:
    async def main() -> None:
        with opened_pty() as (master, path):
            link = await open_link(path, End(), transport=transport)
            assert not termios.tcgetattr(master)[2] & termios.HUPCL
            link.close()

    run_quietly(main())


def test_a_cancelled_opening_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    go, opened, really_open = threading.Event(), threading.Event(), device.open_port

    ports: list[Any] = []

    def slow(*given: Any) -> Any:
        go.wait(LIMIT)
        port, explain = really_open(*given)
        ports.append(port)
        opened.set()
        return port, explain

    monkeypatch.setattr(device, "open_port", slow)

    async def main() -> None:
        with opened_pty() as (_, path):
            end = End()
            opening = asyncio.create_task(open_link(path, end))
            await asyncio.sleep(0.01)
            opening.cancel()
            with pytest.raises(asyncio.CancelledError):
                await opening
            go.set()
            await until(opened.is_set)
            await until(lambda: not ports[0].is_open)
            assert end.links == []

    run_quietly(main())


def test_a_missing_device_is_named_with_the_ports_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "candidates", list)
    assert refusal("/dev/ttyUSB77") == (
        "/dev/ttyUSB77 does not exist: is the adapter plugged in? no serial port was found"
    )
    monkeypatch.setattr(device, "candidates", lambda: ["/dev/ttyUSB0 (FT232R)", "/dev/ttyS0"])
    assert refusal("/dev/ttyUSB77").endswith("plugged in? ports found: /dev/ttyUSB0 (FT232R), /dev/ttyS0")


@pytest.mark.parametrize("made", [False, True], ids=["no such path", "left by a killed board"])
def test_a_missing_virtual_board_is_named_with_the_command_that_starts_it(
    tmp_path: Path, made: bool, transport: str
) -> None:
    path = tmp_path / "txt1-board"
    if made:
        path.symlink_to("/dev/pts/99999")
    assert f"{path} does not exist: is `txt1 board --pty {path}` running?" in refusal(str(path), transport=transport)
    assert refusal("127.0.0.1:2947") == "127.0.0.1:2947 is no device; for TCP write socket://127.0.0.1:2947"


def test_what_is_no_serial_port_is_called_that(tmp_path: Path, transport: str) -> None:
    (tmp_path / "file").write_text("")
    for path in (str(tmp_path / "file"), str(tmp_path), "/dev/null"):
        assert refusal(path, transport=transport).startswith(f"{path} is no serial port")


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EACCES, "no permission to use PORT"),
        (errno.EBUSY, "PORT is busy: another program has it open"),
        (errno.EAGAIN, "PORT is busy: another program has it open"),
        (errno.ENXIO, "PORT has no hardware behind it"),
        (errno.EIO, "PORT has no hardware behind it"),
        (errno.EINVAL, "PORT is no serial port"),
    ],
)
def test_every_cause_has_its_own_words(monkeypatch: pytest.MonkeyPatch, number: int, said: str) -> None:
    def fail(*_: object, **__: object) -> None:
        raise SerialException(number, "could not open port")

    monkeypatch.setattr(device, "_Device", fail)
    with opened_pty() as (_, path):
        assert refusal(path).startswith(said.replace("PORT", path))


@pytest.mark.parametrize("baud", [-1, 0, 10**12])
def test_an_impossible_baud_rate_is_refused_by_name(baud: int, transport: str) -> None:
    with opened_pty() as (_, path):
        assert refusal(path, baud, transport) == f"{path} does not work at {baud} baud: the board's rate is 57600"


def test_unusual_baud_rates_get_one_line_of_warning() -> None:
    assert 57600 in STANDARD_BAUDS
    assert [baud_warning(baud) for baud in STANDARD_BAUDS] == [None] * len(STANDARD_BAUDS)
    warning = baud_warning(56700)  # the thesis's misprint
    assert warning is not None
    assert "56700 baud is unusual" in warning
    assert "nearest usual rate is 57600" in warning
    assert "\n" not in warning


def test_a_transport_that_is_missing_is_named_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serialx", None)

    async def main() -> None:
        with opened_pty() as (_, path), pytest.raises(ConfigError) as error:
            await open_link(path, End(), transport="serialx")
        assert str(error.value).startswith("serial.transport: serialx is not installed: ")
        assert str(error.value).endswith(" -m pip install serialx")

    run_quietly(main())


def test_a_cancelled_opening_by_serialx_leaves_nothing_open() -> None:
    pytest.importorskip("serialx", reason="serialx is not installed")

    async def main() -> None:
        with opened_pty() as (_, path), host_at(path) as other:
            end = End()
            opening = asyncio.create_task(open_link(path, end, transport="serialx"))
            await asyncio.sleep(0)
            opening.cancel()
            with pytest.raises(asyncio.CancelledError):
                await opening
            await until(lambda: is_free(other))
            assert end.links == []

    run_quietly(main())
