"""Tell the service manager how the robot is: the protocol of systemd's sd_notify(3), and its watchdog's food.

systemd gives a service of Type=notify the address of a datagram socket in NOTIFY_SOCKET, and with WatchdogSec the time
in WATCHDOG_USEC after which it takes a silent service for hung, kills it and starts it again. Without them nothing here
does anything.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from txt1.kernel.ticks import Ticks
from txt1.runtime import Runtime
from txt1.sidecar import SERVE_PRIORITY
from txt1.tasks import controller

# within the watchdog's time: some may come late
FEEDINGS: Final = 4


def tell(*lines: str) -> None:
    """Send lines such as ``READY=1``; a manager that has gone or does not listen is no fault."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address[:1] in ("/", "@"):
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.setblocking(False)
            manager.sendto("\n".join(lines).encode(), address.replace("@", "\0", 1) if address[0] == "@" else address)


def watchdog() -> float | None:
    """Return after how many s without food the watchdog bites this process; None where there is none."""
    duration, process = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", "")
    if not duration.isdecimal() or (process and process != str(os.getpid())):
        return None
    return int(duration) * 1e-6 or None


@contextmanager
def served(runtime: Runtime) -> Iterator[None]:
    """Report a running robot as ready, its state with every change, and its end; feed the watchdog meanwhile.

    The watchdog is fed for cycles of the controller: while there are none it goes hungry.
    """
    if "NOTIFY_SOCKET" not in os.environ:
        yield
        return
    limit = watchdog()
    # at whole multiples of the controller's period, behind it, so that it does not come in its way
    period = controller.CONTROL_PERIOD * max(
        1, int((1.0 if limit is None else limit / FEEDINGS) / controller.CONTROL_PERIOD)
    )
    status = ""
    fed = 0

    async def feed(ticks: Ticks) -> None:
        nonlocal status, fed
        async for _ in ticks:
            lines = []
            cycles = runtime.statistics()["controller"].cycles
            if limit is not None and cycles > fed:
                fed = cycles
                lines = ["WATCHDOG=1"]
            if status != (status := status_of(runtime)):
                lines.append(f"STATUS={status}")
            if lines:
                tell(*lines)

    runtime.add_task("watchdog", SERVE_PRIORITY, period, feed)
    tell("READY=1")
    try:
        yield
    finally:
        tell("STOPPING=1")


def status_of(runtime: Runtime) -> str:
    """Return one line on the robot for ``systemctl status``."""
    gate = runtime.gate
    return "armed" if gate.armed else f"disarmed: {gate.reason}"
