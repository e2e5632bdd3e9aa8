"""`txt1 doctor`: finds faults of the line to the board, and prints each with its remedy."""

import argparse
import asyncio
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from statistics import median
from typing import Final

from txt1.cli import doctor_hal
from txt1.commands import FAULT, OK, add, positive, takes
from txt1.config import Config
from txt1.hal.languages import answering
from txt1.hal.registry import PORTS, create, is_on_a_line, is_simulated, port_of
from txt1.hal.serial import SEND_PERIOD
from txt1.kernel.realtime import REMEDY, grantable
from txt1.kit.app import App
from txt1.kit.findings import Finding, judged
from txt1.kit.options import CONFIGURATION, HALS, LINE, VEHICLE, loaded
from txt1.link.base import Link, Port
from txt1.link.ports import access_problem, candidates, only_candidate
from txt1.link.receiver import Receiver
from txt1.plugins import Registry
from txt1.protocol.decoder import Event, FrameFault, Reason
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import PID_SET_PERIOD, BatteryLevels, EncoderOdometry, PidResponse, PidSet, Velocity

# s within which a board that hears the host answers: it judges the link once a second
LINK_RULE: Final = 2.5
# odometry messages a second from a board
ODOMETRY_RATE: Final = 20.0
# number below which messages are missing
RATE_SHARE: Final = 0.95
# s of age up to which odometry is fresh enough for driving
ODOMETRY_AGE_MAX: Final = 0.15
# by HAL: (Config) -> findings on the computer
DOCTORS: Final = Registry("doctor", "txt1.doctors", {})
# s, a quick round trip of a PID set: 42 ms of it for the bytes at 57600 baud
ROUND_TRIP_MAX: Final = 0.3


class Observations:
    """The host's end of a line, and its observations."""

    def __init__(self) -> None:
        self._time = asyncio.get_running_loop().time
        self.begun = self.ended = self.sent = self._time()
        self.link: Link | None = None
        self.receiver = Receiver(Role.HOST, self._take)
        # reason for which the link was lost, if it was
        self.gone = ""
        # numbers of received bytes, PID sets sent, and answers that rejected them
        self.octets = self.asked = self.rejected = 0
        # arrival of each odometry message, s
        self.arrivals: list[float] = []
        # voltages of both packs, V, in each message
        self.levels: list[tuple[float, float]] = []
        self.faults: Counter[Reason] = Counter()
        # round trips of the answered PID sets, s
        self.answers: list[float] = []

    @property
    def duration(self) -> float:
        """Duration of the observation in s, from the first odometry message on; without odometry the whole time."""
        return self.ended - (self.arrivals[0] if self.arrivals else self.begun)

    @property
    def age_max(self) -> float:
        """Longest time between two odometry messages, s."""
        return max((later - earlier for earlier, later in pairwise([*self.arrivals, self.ended])), default=0.0)

    def connected(self, link: Link) -> None:
        """Take the link."""
        self.link = link

    def lost(self, reason: str) -> None:
        """Take the reason for its loss."""
        self.link, self.gone = None, reason

    def received(self, data: bytes) -> None:
        """Take bytes."""
        self.octets += len(data)
        self.receiver.feed(data)

    def _take(self, event: Event) -> None:
        match event:
            case EncoderOdometry():
                self.arrivals.append(self._time())
            case BatteryLevels(one, two):
                self.levels.append((one, two))
            case PidResponse(accepted):
                self.answers.append(self._time() - self.sent)
                self.rejected += not accepted
            case FrameFault(reason):
                self.faults[reason] += 1


async def examine(port: Port, gains: PidSet, duration: float) -> Observations:
    """Command standstill and send the gains for `duration` s after the first odometry; return the observations.

    Raises HalError: the port cannot be opened.
    """
    loop, found = asyncio.get_running_loop(), Observations()
    await port.open(found)
    try:
        pid_set, velocity = encode(gains), encode(Velocity(0.0, 0.0))
        found.begun = loop.time()
        tick = 0
        while found.link is not None and loop.time() < (
            found.arrivals[0] + duration if found.arrivals else found.begun + LINK_RULE + duration
        ):
            found.link.write(velocity)
            if found.arrivals and tick % round(PID_SET_PERIOD / SEND_PERIOD) == 0:
                found.link.write(pid_set)
                found.sent = loop.time()
                found.asked += 1
            tick += 1
            await asyncio.sleep(found.begun + tick * SEND_PERIOD - loop.time())
        found.ended = loop.time()
    finally:
        found.receiver.close()
        if found.link is not None:
            found.link.close()
        await port.close()
    return found


def findings(f: Observations, baud: int) -> Iterator[Finding]:
    """Yield findings on the observations: each is in order, or a fault with its likely cause."""
    if f.gone:
        yield Finding("link", f"lost: {f.gone}", False)
    if not f.octets:
        cause = "is the board on? is this its port? are its transmit and receive lines crossed (null-modem cable)?"
        yield Finding("bytes", f"none came: {cause}", False)
        return
    if f.arrivals:
        rate = len(f.arrivals) / f.duration
        yield judged(
            "odometry",
            f"{rate:.1f} a second of {ODOMETRY_RATE:.0f}",
            rate >= RATE_SHARE * ODOMETRY_RATE,
            "frames are lost; look at the cable, its ground and its length",
        )
        yield judged(
            "age",
            f"odometry was at most {1e3 * f.age_max:.0f} ms old",
            f.age_max <= ODOMETRY_AGE_MAX,
            "something holds it up; USB adapters have a latency timer, hubs add to it",
        )
        if f.levels:
            one, two = f.levels[-1]
            yield Finding("battery", f"{len(f.levels)} times in {f.duration:.1f} s, {one:.2f} V and {two:.2f} V")
        else:
            yield Finding("battery", "no levels came: a board sends them once a second", False)
        if f.rejected:
            yield Finding("PID set", f"rejected {f.rejected} times: check control.linear and control.angular", False)
        elif not f.answers:
            yield Finding("PID set", f"sent {f.asked} times, never answered: the board does not hear all of it", False)
        else:
            trip, share = median(f.answers), len(f.answers) / f.asked
            yield judged(
                "PID set",
                f"answered {len(f.answers)} of {f.asked} times, after {1e3 * trip:.0f} ms",
                trip <= ROUND_TRIP_MAX and share >= 0.75,
                "long frames are lost or held up on the way",
            )
    else:
        yield Finding(
            "odometry",
            f"none among {f.octets} bytes: the baud rate is not {baud}, this is another device, or the "
            "board does not hear this host (transmit line)",
            False,
        )
    counted = ", ".join(f"{count} x {reason.value}" for reason, count in f.faults.items())
    if set(f.faults) == {Reason.OLD_COMMAND}:
        yield Finding("faults", f"{counted}: messages of older boards, harmless")
    else:
        well = f.faults.total() <= max(1, 0.01 * (len(f.arrivals) + len(f.levels)))
        yield judged("faults", counted or "none", well, "noise on the line, or not the right baud rate")


def ports() -> Iterator[Finding]:
    """Yield a remark on each serial port of this computer: whether this user may open it."""
    found = candidates()
    if not found:
        yield Finding("ports", "none: plug in the USB-RS232 adapter; 'dmesg' tells whether the computer sees it", False)
    for port in found:
        problem = access_problem(port.device)
        text = f"{port.device} ({port.description}{', USB' if port.usb else ''})"
        yield judged("port", text, problem is None, problem or "")


def real_time() -> Finding:
    """Return the rights that `txt1 run --realtime` would get, and how to get all of them; no fault either way."""
    granted = grantable()
    return Finding("real time", f"{granted}{f'; {REMEDY}' if granted.missing else ''}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the line and the duration."""
    add(
        parser,
        CONFIGURATION
        | LINE
        | VEHICLE
        | {
            "--hal": takes("NAME", f"hardware layer to examine: {HALS}, ...; serial by default"),
            "--duration": takes("S", "of listening; 5 by default", positive, default=5.0),
        },
    )
    parser.set_defaults(hal="serial")


def main(arguments: argparse.Namespace) -> int:
    """Print the faults of the ports and of the line to the board, or of another hardware layer."""
    config = loaded(arguments).config
    found: list[bool] = []
    if config.hal == "serial":
        if config.serial.port is None:
            found = [remark.show() for remark in ports()]
            arguments.port = only_candidate()
            config = loaded(arguments).config
        port = port_of(config)
        print(f"talking to {port.address} at {config.serial.baud} baud; set-points are 0, so nothing moves")
        at_once = config.serial.port in PORTS.ours
        looking = _at_line(port, config, arguments.duration)
    else:
        brought = DOCTORS.make("hal", config.hal, config) if config.hal in DOCTORS.ours else ()
        before = [*(ports() if is_on_a_line(config.hal) else ()), *doctor_hal.computer(), *brought]
        found = [remark.show() for remark in before]
        print(f"opening the HAL '{config.hal}' for {arguments.duration:g} s; its outputs are neutral, so nothing moves")
        at_once = is_simulated(config)
        looking = doctor_hal.examined(create(config), arguments.duration)

    async def look() -> None:
        found.extend(remark.show() for remark in await looking)

    app = App("max" if at_once else None)
    if app.run(look()) != OK:
        return app.code
    real_time().show()
    print("all is well" if all(found) else "see the lines marked with !")
    return OK if all(found) else FAULT


async def _at_line(port: Port, config: Config, duration: float) -> list[Finding]:
    """Return the findings on a board; without a board, the device that answered when each kind was asked."""
    observed = await examine(port, config.loops().pid_set(), duration)
    found = list(findings(observed, config.serial.baud))
    if not observed.arrivals:
        others = await answering(lambda language: port_of(config, language.baud))
        found += [
            Finding(
                "device",
                f"{language.device} answers at {language.baud} baud: txt1 run --hal {name} --port {port.address}; "
                f"txt1 doctor --hal {name} --port {port.address} looks at it",
                well=False,
            )
            for name, language in others
            if name != "serial"
        ]
    return found
