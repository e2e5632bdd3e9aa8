"""IR-SIM as a car: its wire at TCP port 10950, its laser, as an LD19, at 10960. It ends when the host hangs up."""

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import suppress
from math import cos, remainder, sin, tau

import irsim
import numpy as np

PERIOD = 0.05  # s of a step, as in world.yaml


def frame(command: int, data: bytes) -> bytes:
    body = bytes((command,)) + data
    total = sum(struct.unpack(f">{len(body) // 2}H", body[: len(body) // 2 * 2])) % 65536
    return b"\xfa\xfb" + bytes((len(data),)) + body + struct.pack(">H", total ^ body[-1] if len(body) % 2 else total)


def frames(stream: bytearray) -> Iterator[tuple[int, bytes]]:
    while (at := stream.find(b"\xfa\xfb")) >= 0 and len(stream) > at + 3 and len(stream) >= at + 6 + stream[at + 2]:
        command, data = stream[at + 3], bytes(stream[at + 4 : at + 4 + stream[at + 2]])
        if sound := stream.startswith(frame(command, data), at):
            yield command, data
        del stream[: at + 6 + len(data) if sound else at + 2]


def turn(ranges: list[float], ms: float) -> Iterator[bytes]:
    for k in range(0, 360, 12):  # degrees, clockwise from straight ahead, ten turns a second
        beams = (ranges[(180 - n) % 360] for n in range(k, k + 12))
        points = b"".join(struct.pack("<HB", round(1000 * r) if r < 3.99 else 0, 200) for r in beams)
        data = struct.pack("<BBHH", 0x54, 0x2C, 3600, 100 * k) + points
        data += struct.pack("<HH", 100 * (k + 11), round(ms + (k + 11) / 3.6) % 30000)
        check = 0
        for bit in (byte >> n & 1 for byte in data for n in range(7, -1, -1)):
            check = check << 1 & 0xFF ^ (0x4D if (check >> 7) ^ bit else 0)
        yield data + bytes((check,))


world = irsim.make("world.yaml", display=False)
eyes, eye = socket.create_server(("127.0.0.1", 10960)), None
eyes.setblocking(False)
wire = socket.create_server(("127.0.0.1", 10950)).accept()[0]
stream, v, omega, esc, before = bytearray(), 0.0, 0.0, True, (0.0, 0.0, 0.0)
heard = began = time.monotonic()
for tick in range(10**9):
    with suppress(BlockingIOError):
        if not (told := wire.recv(4096, socket.MSG_DONTWAIT)):
            break
        stream += told
    for command, data in frames(stream):
        if command == 0x67:
            heard, (v, omega) = time.monotonic(), (each / 1000.0 for each in struct.unpack(">2h", data))
        elif command == 0x6E and data[0] == 1:
            esc = bool(data[1])
        elif command == 0x70:
            wire.sendall(frame(0x70, b"\x3c"))
    moves = esc and time.monotonic() - heard < 1.0  # a board's link rule
    world.step([np.array([[v], [omega]]) * moves])
    x, y, theta = world.robot.state.ravel()[:3]
    speed = (cos(theta) * (x - before[0]) + sin(theta) * (y - before[1])) / PERIOD
    turning, before = remainder(theta - before[2], tau) / PERIOD, (x, y, theta)
    odometry = struct.pack(">5i", *(round(1000.0 * each) for each in (x, y, theta, speed, turning)))
    wire.sendall(frame(0x68, odometry) + (frame(0x6A, struct.pack(">2H", 12000, 0)) if tick % 20 == 0 else b""))
    with suppress(OSError):  # nobody looks, or nobody new
        if eye is not None and tick % 2 == 0:
            eye.sendall(b"".join(turn(world.get_lidar_scan()["ranges"], 1000.0 * PERIOD * tick)))
        eye = eyes.accept()[0]
    time.sleep(max(0.0, began + PERIOD * tick - time.monotonic()))
