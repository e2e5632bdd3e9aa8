"""What runs in the process beside the loop in these tests."""

from __future__ import annotations

import os
import threading
import time

from txt1.sidecar import Connection


def echo(connection: Connection, **options: object) -> None:
    """Answers telemetry with a request that holds it."""
    connection.request("began", **options)
    for telemetry in connection:
        connection.request("echo", telemetry=telemetry)
        if telemetry.get("end"):
            return


def late(connection: Connection) -> None:
    """Is ready only when the robot has sent something; it has a thread before that."""
    threading.Thread(target=threading.Event().wait, daemon=True).start()
    connection.newest()
    connection.request("began")
    connection.newest()


def drive(connection: Connection) -> None:
    """Commands 20 times a second as long as it lives."""
    for _ in iter(lambda: connection.receive(0.05), 0):
        connection.request("drive", v=0.5, omega=0.0)


def ask(connection: Connection, topics: list[str] | None = None, asked: list[list[object]] | None = None) -> None:
    """Asks for what it is told to, and then drives and reports what it sees."""
    for name, fields in asked or []:
        connection.request(name, **fields)  # type: ignore[arg-type]
    connection.request("subscribe", topics=topics, rate=20.0)
    for telemetry in connection:
        connection.request("drive", v=0.5, omega=0.0)
        connection.request("seen", line=telemetry)


def drive_then_hang(connection: Connection) -> None:
    for _ in range(20):
        connection.request("drive", v=0.5, omega=0.0)
        time.sleep(0.05)
    time.sleep(3600.0)


def hang(connection: Connection) -> None:
    connection.request("drive", v=0.5, omega=0.0)
    time.sleep(3600.0)


def flood(connection: Connection, rate: float = 1e5) -> None:
    """Writes `rate` messages a second, hundreds at a time."""
    began, sent, piece = time.monotonic(), 0, 200
    while True:
        line = b'{"time": %d, "request": "drive", "v": 0.5, "omega": 0.0}\n' % time.monotonic_ns()
        os.write(connection.fileno(), line * piece)
        sent += piece
        time.sleep(max(0.0, began + sent / rate - time.monotonic()))


def flood_with_a_stop(connection: Connection) -> None:
    """Floods, and asks for the emergency stop once, in the midst of it."""
    line = b'{"time": %d, "request": "drive", "v": 0.5, "omega": 0.0}\n' % time.monotonic_ns()
    connection.request("began")
    os.write(connection.fileno(), line * 100 + line.replace(b"drive", b"stop") + line * 100)
    flood(connection)


def flood_with_the_word(connection: Connection) -> None:
    """Floods, and in the midst of it says the word of the emergency stop without asking for it."""
    line = b'{"time": %d, "request": "drive", "v": 0.5, "omega": 0.0}\n' % time.monotonic_ns()
    word = b'{"time": 1, "stop": "stop", "request": "tell", "text": "stop"}\n[["stop"]]\n"stop"\n{"stop" "stop"\n'
    connection.request("began")
    os.write(connection.fileno(), line * 100 + word + line * 100)
    flood(connection)


def flood_with_a_call(connection: Connection) -> None:
    """Floods, and calls for the emergency stop as the nodes of ROS do, in the midst of it."""
    line = b'{"time": %d, "request": "drive", "v": 0.5, "omega": 0.0}\n' % time.monotonic_ns()
    call = b'{"time": 1, "received": 0, "request": "call", "id": 7, "name": "stop", "fields": {}}\n'
    connection.request("began")
    os.write(connection.fileno(), line * 100 + 3 * call + line * 100)
    flood(connection)


def stop_at_no_time(connection: Connection) -> None:
    os.write(connection.fileno(), b'{"time": "yesterday", "received": 1e99, "request": "stop"}\n')
    for _ in connection:
        pass


def beat_then_fail(connection: Connection) -> None:
    """Is at work for a moment, and fails then."""
    connection.request("began")
    connection.receive(0.05)
    raise SystemExit(3)


def endless(connection: Connection) -> None:
    while True:
        os.write(connection.fileno(), b"x" * 10_000)


def leak(connection: Connection, total: int = 1 << 30, rate: int = 100 << 20) -> None:
    """Takes `rate` bytes of memory a second, and keeps them, up to `total`."""
    kept: list[bytes] = []
    for _ in iter(lambda: connection.receive(0.05), 0):
        connection.request("drive", v=0.5, omega=0.0)
        if len(kept) * (rate // 20) < total:
            kept.append(b"x" * (rate // 20))
            connection.request("leaked", bytes=len(kept) * (rate // 20))


def fail(connection: Connection) -> None:
    connection.request("began")
    raise SystemExit(3)


def garbage(connection: Connection) -> None:
    now = time.monotonic_ns()
    for line in (
        b"nonsense",
        b"[]",
        b"{}",
        b'{"time": "yesterday"}',
        b'{"time": %d, "request": "future"}' % (now + 10**12),
        b'{"time": %d, "received": 99}' % now,
        b"[" * 5000,
        b"\xff\xfe",
    ):
        os.write(connection.fileno(), line + b"\n")
    connection.request("proper")
    for _ in connection:
        pass
