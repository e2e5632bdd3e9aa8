"""Ports for tests: none is given to two of them, though they run at the same time."""

from __future__ import annotations

import atexit
import socket
from contextlib import suppress
from random import SystemRandom
from typing import Final

# below the ports that the kernel gives to whoever asks for any
PORTS: Final = range(12_000, 32_000)


def free_port() -> int:
    """Return a TCP port of the loopback that stays this process's until it ends.

    A port that is only found free may be another program's a moment later. This one is outside the range from which the
    kernel chooses, and a UDP socket of the same number keeps it from other tests.
    """
    while True:
        port = SystemRandom().choice(PORTS)
        keeps = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with suppress(OSError), socket.socket() as probe:
            keeps.bind(("127.0.0.1", port))
            probe.bind(("127.0.0.1", port))
            atexit.register(keeps.close)
            return port
        keeps.close()
