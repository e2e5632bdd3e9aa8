"""`txt1 doctor` says in words what is wrong with a line."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pytest import approx

from txt1.board.board import VirtualPort
from txt1.cli import execute
from txt1.cli.doctor import Finding, Observations, examine, findings
from txt1.config import load
from txt1.config.schema import ControlConfig
from txt1.errors import HalError
from txt1.link import ports
from txt1.link.base import End, Link, connect
from txt1.link.ports import SerialPort
from txt1.protocol.decoder import Reason

Capture = pytest.CaptureFixture[str]
GAINS = ControlConfig().pid_set()


async def found(*settings: str) -> Observations:
    return await examine(VirtualPort(load(None, settings).config), GAINS, 5.0)


def said(observed: Observations) -> dict[str, Finding]:
    return {finding.subject: finding for finding in findings(observed, 57600)}


async def test_a_board_on_a_clean_line_is_well() -> None:
    observed = await found()
    assert len(observed.arrivals) / observed.duration == approx(20.0, rel=0.02)
    assert observed.age_max == approx(0.05, abs=0.01)
    assert len(observed.answers) == observed.asked == 5
    assert observed.answers[0] == approx(0.045, abs=0.005)
    assert observed.faults == {}
    assert all(finding.well for finding in said(observed).values())


async def test_lost_frames_are_put_down_to_the_cable() -> None:
    finding = said(await found("board.fault.drop=0.2"))
    assert not finding["odometry"].well
    assert "cable" in finding["odometry"].text


async def test_flipped_bits_are_counted_and_put_down_to_noise() -> None:
    observed = await found("board.fault.flip=0.002", "seed=2")
    assert observed.faults[Reason.BAD_CHECKSUM] > 10
    assert not said(observed)["faults"].well
    assert "noise" in said(observed)["faults"].text


async def test_a_line_that_holds_up_its_bytes_is_told_from_one_that_loses_them() -> None:
    finding = said(await found("board.fault.stall=0.3", "board.fault.stall_every=1.0"))
    assert not finding["age"].well
    assert "ms old" in finding["age"].text


class DeafPort:
    """A port with somebody at the other end who says what he likes."""

    address = "deaf"

    def __init__(self, noise: bytes) -> None:
        self._noise = noise

    async def open(self, end: End) -> Link:
        port = self

        class Other:
            link: Link | None = None

            def connected(self, link: Link) -> None:
                self.link = link

            def received(self, data: bytes) -> None:
                if self.link is not None and port._noise:
                    self.link.write(port._noise)

            def lost(self, reason: str) -> None:
                self.link = None

        return connect(end, Other())[0]

    async def close(self) -> None:
        pass


async def test_silence_asks_for_power_port_and_crossed_lines() -> None:
    observed = await examine(DeafPort(b""), GAINS, 5.0)
    (finding,) = said(observed).values()
    assert not finding.well
    assert "null-modem" in finding.text and "on?" in finding.text


async def test_bytes_that_are_no_frames_point_at_the_baud_rate() -> None:
    observed = await examine(DeafPort(b"\xfa\x00\x80\xf8\x78"), GAINS, 5.0)
    assert not said(observed)["odometry"].well
    assert "baud rate is not 57600" in said(observed)["odometry"].text


async def test_a_board_that_rejects_the_gains_is_quoted(reject_gains: Callable[[], None]) -> None:
    reject_gains()
    finding = said(await found())["PID set"]
    assert not finding.well
    assert "rejected 5 times" in finding.text


def test_the_command_ends_with_0_when_all_is_well_and_with_1_when_not(capsys: Capture) -> None:
    assert execute(["doctor", "--port", "virtual"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].startswith("talking to virtual at 57600 baud")
    assert out.splitlines()[-1] == "all is well"
    assert out.splitlines()[-2].startswith("  real time ")
    assert execute(["doctor", "--port", "virtual", "--set", "board.fault.drop=0.5"]) == 1
    out = capsys.readouterr().out
    assert any(line.startswith("! odometry") for line in out.splitlines())
    assert "nothing moves" in out


def test_without_a_port_the_ports_are_listed_with_what_keeps_one_from_opening_them(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    two = [SerialPort("/dev/ttyUSB0", "FT232R", True), SerialPort("/dev/ttyUSB1", "CP2102", True)]
    monkeypatch.setattr(ports, "candidates", lambda: two)
    monkeypatch.setattr("txt1.cli.doctor.candidates", lambda: two)
    monkeypatch.setattr("txt1.cli.doctor.access_problem", lambda device: None if device.endswith("0") else "not yours")
    assert execute(["doctor"]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "  port      /dev/ttyUSB0 (FT232R, USB)",
        "! port      /dev/ttyUSB1 (CP2102, USB): not yours",
    ]
    assert "/dev/ttyUSB0" in err and "/dev/ttyUSB1" in err and "--port" in err


def test_a_port_that_is_not_there_is_named(capsys: Capture) -> None:
    assert execute(["doctor", "--port", "/dev/ttyUSB77"]) == 1
    assert "/dev/ttyUSB77" in capsys.readouterr().err


async def test_a_port_that_cannot_be_opened_is_an_error_and_not_a_finding() -> None:
    class NoPort(DeafPort):
        async def open(self, end: End) -> Link:
            raise HalError("busy")

    with pytest.raises(HalError, match="busy"):
        await examine(NoPort(b""), GAINS, 1.0)


async def test_a_line_that_is_lost_meanwhile_is_not_well() -> None:
    observed = await found("board.fault.cut=4.0")
    assert not said(observed)["link"].well
    assert "closed" in said(observed)["link"].text
