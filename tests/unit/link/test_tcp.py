"""Links over TCP: one host at a time, peers that vanish, and addresses nobody answers at."""

from __future__ import annotations

import asyncio
import socket
from contextlib import closing

import pytest
from link_ends import EVERY_BYTE, FRAME, End, refusal, run_quietly

from tests.patience import until
from txt1.errors import HalError, LinkLost
from txt1.kernel.loop import run
from txt1.link import tcp
from txt1.link.device import open_link
from txt1.link.impairments import paced
from txt1.link.tcp import listen_tcp


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_a_board_listens_where_it_is_told_and_says_how_to_reach_it(host: str) -> None:
    async def main() -> None:
        board, end = End(), End()
        try:
            listener = await listen_tcp(host, 0, board)
        except HalError:
            pytest.skip("this computer does not have this address")
        assert listener.address.startswith("socket://[::1]:" if ":" in listener.address[9:14] else "socket://127.")
        link = await open_link(listener.address, end)
        link.write(FRAME)
        await until(lambda: board.pieces)
        assert board.link.address.startswith("socket://")
        link.close()
        await until(lambda: board.reasons)
        assert board.reasons[0].startswith(board.link.address)
        listener.close()

    run_quietly(main())


def test_a_second_host_is_turned_away_while_the_first_talks() -> None:
    async def main() -> None:
        board, first, second = End(), End(), End()
        with closing(await listen_tcp("127.0.0.1", 0, board)) as listener:
            link = await open_link(listener.address, first)
            await open_link(listener.address, second)
            await until(lambda: second.reasons)
            link.write(FRAME)
            await until(lambda: board.pieces)
            assert first.reasons == board.reasons == []
            assert len(board.links) == 1
            link.close()
            await until(lambda: board.reasons)
            third = End()
            link = await open_link(listener.address, third)
            board.link.write(FRAME)
            await until(lambda: third.pieces)
            assert len(board.links) == 2
            link.close()

    run_quietly(main())


def test_a_silent_host_gives_way_to_a_new_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "HOST_SILENCE", 0.0)

    async def main() -> None:
        board, first, second = End(), End(), End()
        with closing(await listen_tcp("127.0.0.1", 0, board)) as listener:
            await open_link(listener.address, first)
            link = await open_link(listener.address, second)
            await until(lambda: first.reasons and len(board.links) == 2)
            assert "silent, and another host took its place" in board.reasons[0]
            link.write(FRAME)
            await until(lambda: board.pieces)
            board.link.write(FRAME)
            await until(lambda: second.pieces)
            assert first.pieces == []
            assert second.reasons == []
            with pytest.raises(LinkLost, match="another host"):
                board.links[0].write(FRAME)
            link.close()

    run_quietly(main())


def test_closing_the_listener_lets_go_of_the_host_too() -> None:
    async def main() -> None:
        board, host = End(), End()
        listener = await listen_tcp("127.0.0.1", 0, paced(board, 57600))
        await open_link(listener.address, host)
        board.link.write(FRAME)
        listener.close()
        with pytest.raises(LinkLost):
            board.link.write(FRAME)
        await until(lambda: host.reasons)
        with pytest.raises(HalError, match="refuses the connection"):
            await open_link(listener.address, End())
        assert board.reasons == []

    run_quietly(main())


def test_a_peer_that_does_not_read_costs_writes_and_never_time() -> None:
    async def main() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.setblocking(False)
            link = await open_link(f"socket://127.0.0.1:{server.getsockname()[1]}", End())
            peer, _ = await asyncio.get_running_loop().sock_accept(server)
            for _ in range(40):
                for _ in range(500):
                    link.write(EVERY_BYTE)
                await asyncio.sleep(0.001)
            assert link.overflows > 1000
            link.close()
            await asyncio.sleep(0)
            peer.close()

    run_quietly(main())


def test_a_peer_that_breaks_off_is_told_from_one_that_closes() -> None:
    assert tcp.broken_off("socket://a:1", None) == "socket://a:1 was closed by the other side"
    assert tcp.broken_off("socket://a:1", ConnectionResetError()) == "socket://a:1 was broken off by the other side"
    assert tcp.broken_off("socket://a:1", TimeoutError()) == "socket://a:1 no longer answers"


def test_a_tcp_peer_that_vanishes_is_noticed_after_three_seconds() -> None:
    async def main() -> None:
        with closing(await listen_tcp("127.0.0.1", 0, End())) as listener:
            link = await open_link(listener.address, End())
            sock = link.transport.get_extra_info("socket")  # type: ignore[attr-defined]
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 3000
            # also if this side only listens
            assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            for name, value in tcp.KEEP_ALIVE.items():
                assert sock.getsockopt(socket.IPPROTO_TCP, getattr(socket, name)) == value
            link.close()

    run_quietly(main())


@pytest.mark.parametrize(
    "address",
    [
        "socket://",
        "socket://127.0.0.1",
        "socket://:5000",
        "socket://127.0.0.1:port",
        "socket://127.0.0.1:70000",
        "socket://127.0.0.1:0",
        "socket://[::1:5000",
        "socket://me@127.0.0.1:5000",
        "socket://127.0.0.1:5000/board",
        "socket://127.0.0.1:5000?logging=debug",
        "tcp://127.0.0.1:5000",
        "rfc2217://127.0.0.1:5000",
    ],
)
def test_a_malformed_address_is_refused_with_an_example(address: str) -> None:
    said = refusal(address)
    assert said.startswith(f"{address} is no address")
    assert "socket://127.0.0.1:5000" in said


def test_a_port_without_a_listener_is_reported_as_refusing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    said = refusal(f"socket://127.0.0.1:{port}")
    assert said == (
        f"socket://127.0.0.1:{port} refuses the connection: is `txt1 board --tcp 127.0.0.1:{port}` running there?"
    )


def test_an_unknown_computer_and_a_silent_one_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    async def unknown(host: str, port: int) -> socket.socket:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    async def silent(host: str, port: int) -> socket.socket:
        await asyncio.sleep(3600.0)
        raise AssertionError

    monkeypatch.setattr(tcp, "_connected_socket", unknown)
    assert refusal("socket://robto:5000") == (
        "socket://robto:5000: no computer is known by the name 'robto': check the spelling"
    )
    monkeypatch.setattr(tcp, "_connected_socket", silent)
    monkeypatch.setattr(tcp, "ANSWER", 0.01)
    assert refusal("socket://10.0.0.9:5000").startswith("socket://10.0.0.9:5000 does not answer")


@pytest.mark.parametrize(
    ("host", "port", "said"),
    [
        ("127.0.0.1", 70000, "a port is a number from 0 to 65535"),
        ("127.0.0.1", -1, "a port is a number from 0 to 65535"),
        ("192.0.2.1", 5000, "this computer does not have this address"),
    ],
)
def test_what_cannot_be_listened_on_is_refused_with_the_reason(host: str, port: int, said: str) -> None:
    async def main() -> None:
        with pytest.raises(HalError, match=f"cannot listen on {host}:{port}: {said}"):
            await listen_tcp(host, port, End())

    run(main())


def test_a_port_in_use_is_refused_with_a_remedy() -> None:
    async def main() -> None:
        with closing(await listen_tcp("127.0.0.1", 0, End())) as listener:
            port = int(listener.address.rpartition(":")[2])
            with pytest.raises(HalError, match=f"127.0.0.1:{port}: it is in use, perhaps by another board; choose"):
                await listen_tcp("127.0.0.1", port, End())

    run_quietly(main())
