"""`txt1 doctor`: look for what is wrong with the line to the board, and say it in words one can act on."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
from itertools import pairwise
from math import ceil
from statistics import median
from typing import Final, NamedTuple

from txt1.cli.app import App
from txt1.cli.exit_codes import FAULT, OK
from txt1.cli.options import add_config, add_port, loaded, positive
from txt1.hal.registry import PORTS, port_of
from txt1.hal.serial import PID_SET_PERIOD, SEND_PERIOD, Port
from txt1.link import End, Link
from txt1.link.ports import access_problem, candidates, only_candidate
from txt1.link.receiver import Receiver
from txt1.protocol.decoder import Event, FrameFault, Reason
from txt1.protocol.frame import encode
from txt1.protocol.layout import Role
from txt1.protocol.messages import BatteryLevels, EncoderOdometry, PidResponse, PidSet, Velocity

LINK_RULE: Final = 2.5
"""s in which a board that hears the host has begun to answer: it judges the link once a second."""

ODOMETRY_RATE: Final = 20.0
"""Odometry messages a second that a board sends."""

RATE_SHARE: Final = 0.95
"""Share of them that should come."""

AGE_MAX: Final = 0.15
"""Age in s up to which odometry is fresh enough to drive by."""

ANSWER_MAX: Final = 0.3
"""Round trip of a PID set, s, that is still quick: 42 ms of it the bytes take at 57600 baud."""


class Findings(NamedTuple):
    """What was seen of the line.

    Attributes:
        duration: s of looking, from the first odometry on, or altogether when there was none.
        octets: bytes that came.
        odometry: odometry messages.
        batteries: battery messages.
        levels: the last of them: voltages of both packs, V.
        age_max: oldest that the odometry became before the next one came, s.
        faults: what was wrong with what came, by reason.
        asked: PID sets sent.
        answers: round trips of those that were answered, s.
        rejected: answers that said no.
        gone: why the link was lost meanwhile, if it was.

    """

    duration: float
    octets: int
    odometry: int
    batteries: int
    levels: tuple[float, float] | None
    age_max: float
    faults: dict[Reason, int]
    asked: int
    answers: tuple[float, ...]
    rejected: int
    gone: str | None


class _Examiner:
    """The end of the line that looks and listens."""

    def __init__(self) -> None:
        self.link: Link | None = None
        self.gone: str | None = None
        self.octets = 0
        self.receiver = Receiver(Role.HOST, self._take)
        self.odometry: list[float] = []
        self.batteries: list[tuple[float, tuple[float, float]]] = []
        self.faults: dict[Reason, int] = {}
        self.sent = 0.0
        self.answers: list[float] = []
        self.rejected = 0
        self._time = asyncio.get_running_loop().time

    def connected(self, link: Link) -> None:
        self.link = link

    def lost(self, reason: str) -> None:
        self.link, self.gone = None, reason

    def received(self, data: bytes) -> None:
        self.octets += len(data)
        self.receiver.feed(data)

    def _take(self, event: Event) -> None:
        match event:
            case EncoderOdometry():
                self.odometry.append(self._time())
            case BatteryLevels(one, two):
                self.batteries.append((self._time(), (one, two)))
            case PidResponse(accepted):
                self.answers.append(self._time() - self.sent)
                self.rejected += not accepted
            case FrameFault(reason):
                self.faults[reason] = self.faults.get(reason, 0) + 1


async def examine(port: Port, gains: PidSet, duration: float) -> Findings:
    """What the line at a port does for `duration` s while the host asks for standstill and sends its gains.

    Raises:
        HalError: the port cannot be opened.

    """
    loop = asyncio.get_running_loop()
    examiner = _Examiner()
    end: End = examiner
    await port.open(end)
    try:
        pid_set, velocity = encode(gains), encode(Velocity(0.0, 0.0))
        begun = loop.time()
        per_pid_set = round(PID_SET_PERIOD / SEND_PERIOD)
        asked = tick = 0
        while examiner.link is not None and loop.time() < _ends(begun, examiner, duration):
            examiner.link.write(velocity)
            if examiner.odometry and tick % per_pid_set == 0:
                examiner.link.write(pid_set)
                examiner.sent = loop.time()
                asked += 1
            tick += 1
            await asyncio.sleep(begun + tick * SEND_PERIOD - loop.time())
        ended = loop.time()
    finally:
        examiner.receiver.close()
        if examiner.link is not None:
            examiner.link.close()
        await port.close()
    arrivals = examiner.odometry
    since = arrivals[0] if arrivals else begun
    gaps = [later - earlier for earlier, later in pairwise([*arrivals, ended])]
    heard = [levels for time, levels in examiner.batteries if time >= since]
    return Findings(
        ended - since,
        examiner.octets,
        len(arrivals),
        len(heard),
        heard[-1] if heard else None,
        max(gaps, default=0.0),
        examiner.faults,
        asked,
        tuple(examiner.answers),
        examiner.rejected,
        examiner.gone,
    )


def _ends(begun: float, examiner: _Examiner, duration: float) -> float:
    """When to stop looking: a while after the first odometry, or when none has come for long enough."""
    return examiner.odometry[0] + duration if examiner.odometry else begun + LINK_RULE + duration


class Remark(NamedTuple):
    """A line of the doctor's: what was looked at, what was found, whether that is well."""

    subject: str
    text: str
    well: bool = True


def remarks(findings: Findings, baud: int) -> Iterator[Remark]:
    """What the findings mean."""
    f = findings
    if f.gone is not None:
        yield Remark("link", f"lost: {f.gone}", False)
    if not f.octets:
        yield Remark(
            "bytes", "none came: is the board on? is this its port? are its transmit and receive lines crossed "
            "(null-modem cable)?", False,
        )  # fmt: skip
        return
    if not f.odometry:
        yield Remark(
            "odometry", f"none among {f.octets} bytes: the baud rate is not {baud}, this is another device, or the "
            "board does not hear this host (transmit line)", False,
        )  # fmt: skip
    else:
        rate = f.odometry / f.duration
        well = rate >= RATE_SHARE * ODOMETRY_RATE
        yield Remark(
            "odometry", f"{rate:.1f} a second of {ODOMETRY_RATE:.0f}"
            + ("" if well else ": frames are lost; look at the cable, its ground and its length"), well,
        )  # fmt: skip
        well = f.age_max <= AGE_MAX
        yield Remark(
            "age", f"odometry was at most {1e3 * f.age_max:.0f} ms old"
            + ("" if well else ": something holds it up; USB adapters have a latency timer, hubs add to it"), well,
        )  # fmt: skip
        yield _about_batteries(f)
        yield _about_answers(f)
    yield _about_faults(f)


def _about_batteries(f: Findings) -> Remark:
    if f.levels is None:
        return Remark("battery", "no levels came: a board sends them once a second", False)
    one, two = f.levels
    return Remark("battery", f"{f.batteries} times in {f.duration:.1f} s, {one:.2f} V and {two:.2f} V")


def _about_answers(f: Findings) -> Remark:
    if f.rejected:
        return Remark("PID set", f"rejected {f.rejected} times: check control.linear and control.angular", False)
    if not f.answers:
        return Remark("PID set", f"sent {f.asked} times, never answered: the board does not hear all of it", False)
    trip, share = median(f.answers), len(f.answers) / f.asked
    well = trip <= ANSWER_MAX and share >= 0.75
    text = f"answered {len(f.answers)} of {f.asked} times, after {1e3 * trip:.0f} ms"
    return Remark("PID set", text + ("" if well else ": long frames are lost or held up on the way"), well)


def _about_faults(f: Findings) -> Remark:
    if not f.faults:
        return Remark("faults", "none")
    counted = ", ".join(f"{count} x {reason.value}" for reason, count in f.faults.items())
    total = sum(f.faults.values())
    if set(f.faults) == {Reason.OLD_COMMAND}:
        return Remark("faults", f"{counted}: messages of older boards, harmless")
    well = total <= max(1, ceil(0.01 * (f.odometry + f.batteries)))
    return Remark("faults", counted + ("" if well else ": noise on the line, or not the right baud rate"), well)


def ports() -> Iterator[Remark]:
    """The serial ports of this computer, and whether one may open them."""
    found = candidates()
    if not found:
        yield Remark("ports", "none: plug in the USB-RS232 adapter; 'dmesg' tells whether the computer sees it", False)
    for port in found:
        problem = access_problem(port.device)
        text = f"{port.device} ({port.description}{', USB' if port.usb else ''})"
        yield Remark("port", text if problem is None else f"{text}: {problem}", problem is None)


# -- the command -----------------------------------------------------------------------------------------------


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the line and the time of listening to it."""
    add_config(parser)
    add_port(parser)
    parser.add_argument("--duration", type=positive, default=5.0, metavar="S", help="of listening; 5 by default")
    parser.set_defaults(main=main, hal="serial")


def main(arguments: argparse.Namespace) -> int:
    """Say in words what is wrong with the ports and the line to the board."""
    config = loaded(arguments).config
    found: list[bool] = []
    if config.serial.port is None:
        found = [_tell(remark) for remark in ports()]
        arguments.port = only_candidate()
        config = loaded(arguments).config
    port = port_of(config)
    print(f"talking to {port.address} at {config.serial.baud} baud; set-points are 0, so nothing moves")
    app = App("max" if config.serial.port in PORTS.ours else None)

    async def look() -> None:
        findings = await examine(port, config.loops().pid_set(), arguments.duration)
        found.extend(_tell(remark) for remark in remarks(findings, config.serial.baud))

    if app.run(look()) != OK:
        return app.code
    print("all is well" if all(found) else "see the lines marked with !")
    return OK if all(found) else FAULT


def _tell(remark: Remark) -> bool:
    """Print a remark and return whether what it says is well."""
    print(f"{' ' if remark.well else '!'} {remark.subject:<9} {remark.text}")
    return remark.well
