"""What strangers send that is no request: a short answer, and no traceback on the operator's terminal."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from tests.patience import LIMIT  # noqa: E402
from tests.unit.web.test_web_server import HOST, Clock, clock, port, serving  # noqa: E402, F401
from txt1.web.troubles import TOLD_CHARACTERS, Troubles, counting  # noqa: E402

AT: Final = b"Host: 127.0.0.1\r\n"
FORM: Final = b"Content-Type: application/x-www-form-urlencoded\r\n"
POST: Final = b"POST /sign-in HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\n"
STRANGE: Final = (
    b"GET\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(100) + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.0\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + AT + AT + b"\r\n",
    b"GET / HTTP/1.0\r\n" + AT + AT + b"\r\n",
    b"GET / HTTP/9.9\r\n" + AT + b"\r\n",
    b"GET http://[ HTTP/1.1\r\n" + AT + b"\r\n",
    b"GET / HTTP/1.1\r\nHost: [\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: ]:1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: \r\n\r\n",
    b"GET /\xff\xfe HTTP/1.1\r\n" + AT + b"\r\n",
    b"GET /" + b"a" * 9000 + b" HTTP/1.1\r\n" + AT + b"\r\n",
    b"GET / HTTP/1.1\r\n" + AT + b"Content-Length: x\r\n\r\n",
    b"CONNECT / HTTP/1.1\r\n" + AT + b"\r\n",
    b"OPTIONS * HTTP/1.1\r\n" + AT + b"\r\n",
    b"GET / HTTP/1.1\r\n" + AT + b"Expect: bogus\r\n\r\n",
    POST + FORM.replace(b"\r\n", b"; charset=bogus\r\n") + b"Content-Length: 7\r\n\r\ntoken=x",
    POST + b"Content-Type: multipart/form-data\r\nContent-Length: 7\r\n\r\ntoken=x",
    POST + FORM + b"Content-Encoding: gzip\r\nContent-Length: 7\r\n\r\ntoken=x",
    POST + FORM + b"Content-Encoding: br\r\nContent-Length: 7\r\n\r\ntoken=x",
    POST + b"Content-Type: \xff\xff\r\nContent-Length: 7\r\n\r\ntoken=x",
    POST + FORM + b"Content-Length: 12\r\n\r\ntoken=%ed%a0",
    POST + FORM + b"Content-Length: 35\r\n\r\n" + b"&".join(b"a=%d" % k for k in range(9)),
    POST + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n\r\n",
    POST + b"Transfer-Encoding: chunked\r\n\r\n5\r\ntoken\r\nG\r\n\r\n",
    POST + b"Content-Length: 20000\r\n\r\n" + b"x" * 20000,
)


async def test_a_stranger_gets_short_answers_and_writes_nothing_on_the_terminal(
    clock: Clock,  # noqa: F811
    port: int,  # noqa: F811
    capfd: pytest.CaptureFixture[str],
) -> None:
    async with serving(clock, port) as served:
        for strange in STRANGE:
            reader, writer = await served.connect()
            writer.write(strange.replace(b"%d", b"%d" % port) if b"%d" in strange else strange)
            async with asyncio.timeout(LIMIT):
                head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith((b"HTTP/1.0 4", b"HTTP/1.1 4")), (strange[:80], head)
            writer.close()
            # so that no budget is exceeded
            clock.now += 5.0
        told = [fields["text"] for name, fields in served.robot.asked if name == "tell"]
        assert [str(text).partition(";")[0] for text in told] == [
            f"requests that the page's server could not answer: {count}" for count in (1, 10)
        ]
        assert (await served.answer("/")).startswith(b"HTTP/1.1 200")
    said = capfd.readouterr()
    assert said.err == said.out == ""


def test_of_many_troubles_the_first_the_tenth_and_so_on_are_told() -> None:
    told: list[str] = []
    troubles = Troubles(told.append)
    for k in range(1234):
        troubles.note(f"number {k}\n\x1b[31m{'x' * 1000}")
    assert [text.partition(" ?[31mx")[0].rpartition(" ")[2] for text in told] == ["0", "9", "99", "999"]
    assert troubles.count == 1234
    assert all(text.isprintable() and len(text) < TOLD_CHARACTERS + 80 for text in told)


def logs(text: str, error: Exception | None = None) -> None:
    logging.getLogger("aiohttp.server").warning(text, exc_info=error)


def reports(text: str, error: Exception | None = None) -> None:
    context = {"message": text} if error is None else {"message": text, "exception": error}
    asyncio.get_running_loop().call_exception_handler(context)


@pytest.mark.parametrize("tell", [logs, reports])
@pytest.mark.parametrize("error", [None, ZeroDivisionError("of theirs")])
async def test_a_trouble_is_told_by_its_error_or_in_the_words_of_a_library(
    tell: Callable[[str, Exception | None], None], error: Exception | None
) -> None:
    told: list[str] = []
    with counting(told.append):
        tell("a mistake", error)
    last = "a mistake" if error is None else "ZeroDivisionError: of theirs"
    assert told == [f"requests that the page's server could not answer: 1; the last: {last}"]


async def test_what_libraries_log_and_callbacks_raise_is_counted_until_the_server_ends(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "aiohttp")
    loggers = [logging.getLogger(name) for name in ("aiohttp", "asyncio")]
    before = [list(each.handlers) for each in loggers]
    with counting(lambda text: None) as troubles:
        logs("a mistake", ZeroDivisionError("of theirs"))
        logging.getLogger("asyncio").warning("socket.send() raised exception.")
        reports("lost", ValueError("of ours"))
        reports("without")
        logging.getLogger("aiohttp.access").info("a page was fetched")
    assert troubles.count == 4, "what is no trouble does not count"
    assert capfd.readouterr().err == "" and caplog.records == []
    assert all(each.propagate for each in loggers) and [each.handlers for each in loggers] == before
