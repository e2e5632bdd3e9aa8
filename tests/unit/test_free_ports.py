"""Ports for tests."""

import socket

import pytest

from rigs.ports import PORTS, free_port


def test_a_port_is_free_and_given_to_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigs.ports.PORTS", range(PORTS.start, PORTS.start + 40))
    given = [free_port() for _ in range(25)]
    assert len(set(given)) == 25
    for port in given:
        with socket.create_server(("127.0.0.1", port)):
            pass
