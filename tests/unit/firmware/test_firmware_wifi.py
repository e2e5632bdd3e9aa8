"""The firmware's line over Wi-Fi, on a loopback socket: only a host that knows the secret is heard."""

from __future__ import annotations

import hmac
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from txt1pico import store, wifi
from txt1pico.core import Core

from rigs.ports import free_port
from tests.patience import LIMIT, S
from txt1.protocol.layout import encode
from txt1.protocol.messages import Velocity

SECRET = b"a long secret"


@pytest.fixture
def line() -> Iterator[wifi.Wireless]:
    """A line that listens on a free port of this computer."""
    line = wifi.Wireless(SECRET, "127.0.0.1", free_port())
    yield line
    line.close()


@pytest.fixture
def call(line: wifi.Wireless) -> Iterator[Callable[[], Host]]:
    """Has a new host call the line."""
    with ExitStack() as hosts:

        def call() -> Host:
            host = Host(line, Core())
            hosts.enter_context(host.socket)
            return host

        yield call


class Host:
    """A host that has called."""

    def __init__(self, line: wifi.Wireless, core: Core) -> None:
        self.line, self.core = line, core
        self.socket = socket.create_connection(("127.0.0.1", line.port), timeout=LIMIT)
        self.poll()
        self.challenge = self.socket.recv(100).split()[1]

    def poll(self, times: int = 3, elapsed: int = 20) -> None:
        for _ in range(times):
            self.line.poll(self.core, elapsed)

    def prove(self, secret: bytes) -> None:
        self.send(hmac.digest(secret, self.challenge, "sha256").hex().encode() + b"\n")

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)
        self.poll()


def test_its_hmac_is_pythons() -> None:
    for secret in (b"short", b"x" * 64, b"y" * 100):
        assert wifi.hmac(secret, b"message") == hmac.digest(secret, b"message", "sha256").hex().encode()


def test_a_host_that_knows_the_secret_is_heard_and_answered(line: wifi.Wireless, call: Callable[[], Host]) -> None:
    host = call()
    host.prove(SECRET)
    assert line.trusted
    host.send(encode(Velocity(0.5, 0.0)))
    assert host.core.received == 1
    line.send(b"hello")
    assert host.socket.recv(10) == b"hello"


def test_frames_before_a_wrong_proof_and_behind_it_count_for_nothing(
    line: wifi.Wireless, call: Callable[[], Host]
) -> None:
    host = call()
    host.send(encode(Velocity(0.5, 0.0)))
    host.prove(b"a wrong secret")
    host.poll()
    assert not line.trusted and line.refused == 1 and host.core.received == 0
    assert host.socket.recv(10) == b"", "hung up"


def test_every_host_gets_a_challenge_of_its_own(line: wifi.Wireless, call: Callable[[], Host]) -> None:
    first = call()
    line.drop()
    assert call().challenge != first.challenge


def test_a_silent_host_is_dropped_after_a_second_and_another_may_come(
    line: wifi.Wireless, call: Callable[[], Host]
) -> None:
    host = call()
    host.prove(SECRET)
    host.poll(times=60)
    assert not line.trusted
    call().prove(SECRET)
    assert line.trusted


def test_a_second_host_waits_until_the_first_is_gone(line: wifi.Wireless, call: Callable[[], Host]) -> None:
    call().prove(SECRET)
    with socket.create_connection(("127.0.0.1", line.port), timeout=0.1 * S) as second:
        line.poll(Core(), 20)
        with pytest.raises(TimeoutError):
            second.recv(10)


def test_wifi_is_off_unless_the_settings_name_a_network_and_a_secret() -> None:
    assert store.check({})["wifi"] is None
    with pytest.raises(store.SettingsError, match="wifi: it takes ssid, password, and a secret"):
        store.check({"wifi": {"ssid": "lab", "password": "x", "secret": "short"}})
