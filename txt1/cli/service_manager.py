"""Reports the robot's state to the service manager (systemd's sd_notify(3)), and feeds its watchdog.

For a service of Type=notify, systemd puts the address of a datagram socket into NOTIFY_SOCKET. With WatchdogSec it puts
a time into WATCHDOG_USEC. A service that is silent for this time counts as hung; systemd kills it and starts it again.
Without these variables the functions do nothing.
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

# messages within the watchdog's time: some may come late
FEEDINGS: Final = 4


def tell(*lines: str) -> None:
    """Send lines such as ``READY=1``; a missing or deaf manager is no fault."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address[:1] in ("/", "@"):
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.setblocking(False)
            manager.sendto("\n".join(lines).encode(), address.replace("@", "\0", 1) if address[0] == "@" else address)


def watchdog() -> float | None:
    """Return the time in s after which the watchdog ends this silent process; None without a watchdog."""
    duration, process = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", "")
    if not duration.isdecimal() or (process and process != str(os.getpid())):
        return None
    return int(duration) * 1e-6 or None


@contextmanager
def served(runtime: Runtime) -> Iterator[None]:
    """Report a running robot as ready, its state with every change, and its end; feed the watchdog meanwhile.

    Cycles of the controller feed the watchdog. Without cycles it gets nothing.
    """
    if "NOTIFY_SOCKET" not in os.environ:
        yield
        return
    limit = watchdog()
    # at whole multiples of the controller's period, after the controller, so that it does not delay it
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
    return "armed" if gate.armed else f"disarmed: {gate.told}"
