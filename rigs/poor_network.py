"""A poor network between this computer and a namespace of its own: rate, loss and delay of real packets.

Two TUN devices, one in the namespace, and a thread between them that loses, delays and queues each packet. So TCP sees
what it sees behind a weak radio: it sends again, and its packets wait behind those of others. The kernel's netem does
the same, where it is there. It needs root and iproute2.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import select
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from time import monotonic
from typing import Final

HERE, THERE = "10.77.1.1", "10.77.1.2"
"""The addresses of the two sides."""
NAMESPACE: Final = "txt1-far"
# of Linux: names a TUN device, whose packets have no head
TUNSETIFF: Final = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
# packets that wait for their turn in each direction, as in netem
QUEUE: Final = 1000


def _tun(name: str) -> int:
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
    return device


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


@contextmanager
def poor_network(rate: float, loss: float, delay: float, seed: int = 1) -> Iterator[None]:
    """Connect both sides until the block is left: bits a second, share of lost packets, s; in each direction."""
    near, far = _tun("txt1-near"), _tun("txt1-far")
    over = threading.Event()
    between = threading.Thread(target=_between, args=(near, far, rate, loss, delay, Random(seed), over), daemon=True)
    _ip("netns", "add", NAMESPACE)
    try:
        _ip("link", "set", "txt1-far", "netns", NAMESPACE)
        for where, name, ours, theirs in (((), "txt1-near", HERE, THERE), (("-n", NAMESPACE), "txt1-far", THERE, HERE)):
            _ip(*where, "addr", "add", ours, "peer", theirs, "dev", name)
            _ip(*where, "link", "set", name, "up")
        between.start()
        yield
    finally:
        over.set()
        if between.is_alive():
            between.join()
        os.close(near)
        os.close(far)
        _ip("netns", "del", NAMESPACE)


def _between(near: int, far: int, rate: float, loss: float, delay: float, rng: Random, over: threading.Event) -> None:
    """Pass packets on: each waits for those before it, takes its time on the line, and arrives `delay` later."""
    other = {near: far, far: near}
    free = dict.fromkeys(other, 0.0)
    waiting: list[tuple[float, int, int, bytes]] = []
    count = 0
    while not over.is_set():
        pause = 0.1 if not waiting else min(0.1, max(0.0, waiting[0][0] - monotonic()))
        for source in select.select([near, far], [], [], pause)[0]:
            packet = os.read(source, 65536)
            present = monotonic()
            takes = 8.0 * len(packet) / rate
            queued = max(0.0, free[source] - present) / takes
            if rng.random() < loss or queued > QUEUE:
                continue
            free[source] = max(free[source], present) + takes
            count += 1
            heapq.heappush(waiting, (free[source] + delay, count, other[source], packet))
        while waiting and waiting[0][0] <= monotonic():
            _, _, sink, packet = heapq.heappop(waiting)
            os.write(sink, packet)
