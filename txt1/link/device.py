"""Open a link by its address: a serial device over pyserial-asyncio or serialx, or a TCP connection.

pyserial-asyncio is the dependency. Its last release waits in reads, writes and closes, so three methods of its port and
three of its transport are replaced here; each says why. serialx (`txt1.link.serialx_link`) needs no such changes.
"""

import asyncio
import errno
import os
import stat
import termios
from collections.abc import Callable
from contextlib import suppress
from re import fullmatch
from typing import Any, Final

from serial import Serial, SerialException
from serial_asyncio import SerialTransport

from txt1.errors import ConfigError, HalError
from txt1.link.base import End, Link, StreamLink
from txt1.link.ports import Plug, access_problem, candidates, only_candidate, plug_of, port_with
from txt1.link.pty import is_left_behind
from txt1.link.serialx_link import open_serialx
from txt1.link.tcp import BOARD, open_socket

STANDARD_BAUDS: Final = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
# whatever a port that cannot be opened raises; SerialException is an OSError
OPENING: Final = (ValueError, OverflowError, OSError, termios.error)
# the port, and how to explain its loss
_Opened = tuple["_Device", Callable[[str, Exception | None], str]]


class _Device(Serial):
    """A serial port whose `read` and `write` never wait.

    They are called when the kernel says the device is ready. pyserial's own methods would wait again, in select(),
    which fails for descriptors above 1023. And its `write` spins as long as the device takes no bytes.
    """

    def read(self, size: int = 1, /) -> bytes:
        assert self.fd is not None
        try:
            data = os.read(self.fd, size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise SerialException(error.errno, str(error)) from error
        if not data:
            raise SerialException(errno.EIO, "nothing to read from a device that is ready: it is gone")
        return data

    def write(self, data: Any, /) -> int:
        assert self.fd is not None
        try:
            return os.write(self.fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise SerialException(error.errno, str(error)) from error


class _DeviceTransport(SerialTransport):  # type: ignore[misc]
    """pyserial-asyncio's transport, but it closes at once and without a report.

    The original `close` waits until everything is sent. Even the original `abort` calls tcdrain, which blocks the whole
    program as long as the device takes no bytes. And the original reports a write to an unplugged device as a bug of
    the program.
    """

    _closing: bool

    def _abort(self, exc: Exception | None) -> None:
        if self._closing:
            return
        self._closing = True
        self._remove_reader()
        self._remove_writer()
        # unplugged
        with suppress(termios.error, OSError):
            # the line that was held down is let up
            if not self._serial.dtr:
                self._serial.dtr = True
            # closing a UART would wait for it up to 30 s
            self._serial.reset_output_buffer()
        # closed now, so that the port can be opened again at once
        self._serial.close()
        self._loop.call_soon(self._protocol.connection_lost, exc)

    def _close(self, exc: Exception | None = None) -> None:
        self._abort(exc)

    def _fatal_error(self, exc: Exception, message: str = "") -> None:
        self._abort(exc)


async def open_link(
    address: str,
    end: End,
    baud: int = 57600,
    secret: bytes | None = None,
    behind: str = BOARD,
    transport: str = "pyserial-asyncio",
    dtr: bool = True,
    framing: str = "8N1",
) -> Link:
    """Open a link to a serial device (exclusive) or to `socket://host:port`; `end` is connected on return.

    A board on a network first gets proof of the secret, if there is one. `behind` is the command that serves such an
    address. `transport` is `serial.transport`. `dtr`: whether the line DTR is up meanwhile; serialx keeps it up.
    `framing`: data bits, parity and stop bits; serialx has 8N1. Raises HalError, which names the address, the cause and
    the remedy; ConfigError: the transport is not installed.
    """
    if "://" in address:
        return await open_socket(address, end, secret, behind)
    if transport == "serialx":
        try:
            return await open_serialx(address, end, baud, await asyncio.to_thread(_checked, address, baud))
        except OPENING as error:
            raise await asyncio.to_thread(_refusal, address, baud, behind, error) from error
    loop = asyncio.get_running_loop()
    opening = loop.run_in_executor(None, open_port, address, baud, behind, dtr, framing)
    try:
        device, explain = await asyncio.shield(opening)
    except asyncio.CancelledError:
        # the thread cannot be stopped; what it opens is closed unused
        opening.add_done_callback(_close_port)
        raise
    link = StreamLink(address, end, explain)
    over = _DeviceTransport(loop, link, device)
    try:
        # the transport has asked the loop to connect this end next
        await asyncio.sleep(0)
    except asyncio.CancelledError:
        link.shut()
        over.abort()
        raise
    return link


class DevicePort:
    """A serial device, or socket://host:port; None: the only plugged-in device.

    `baud` is the rate in bits a second, or a function that returns the rate for each opening.
    A USB device that was opened once is opened again under whatever name it has now, and no other device in its place.
    The first line of `secret_file` is the secret of a board on a network;
    `behind` is the command that serves such a port; `transport` is `serial.transport`.
    `dtr`: whether the line DTR is up while the port is open; it is up again when the port is closed.
    `framing`: data bits, parity and stop bits.
    """

    def __init__(
        self,
        address: str | None,
        baud: int | Callable[[], int],
        secret_file: str | None = None,
        behind: str = BOARD,
        transport: str = "pyserial-asyncio",
        dtr: bool = True,
        framing: str = "8N1",
    ) -> None:
        self.rate = 0
        """The rate at which it is open, or was opened last, bits a second; 0: it was not opened."""
        self._wanted = address
        self._transport = transport
        self._dtr, self._framing = dtr, framing
        self._behind = behind
        self._secret_file = secret_file
        self._baud = baud
        self._spent: tuple[int, int, int] | None = None
        # the USB device that was opened
        self._plug: Plug | None = None
        self.address = address or "the serial port"

    async def open(self, end: End) -> Link:
        """Open a link to the port."""
        if self._plug is not None:
            there = await asyncio.to_thread(port_with, self._plug)
            if there is None:
                raise HalError(f"{self._plug} is not there, which was {self.address}: is it plugged in?")
            self.address = there
        elif self._wanted is None:
            self.address = await asyncio.to_thread(only_candidate)
        # a killed board leaves its link to a pseudo-terminal behind, which may lead to another program's terminal by
        # now
        made = await asyncio.to_thread(_link_made, self.address)
        left = await asyncio.to_thread(is_left_behind, self.address)
        if left or (left is None and _passed_on(self._spent, made)):
            raise HalError(f"{self.address} was left behind by a board that is gone; waiting for a new board")
        secret = None if self._secret_file is None else await asyncio.to_thread(_secret_in, self._secret_file)
        plug = self._plug
        if plug is None and "://" not in self.address:
            plug = await asyncio.to_thread(plug_of, self.address)
        self.rate = self._baud if isinstance(self._baud, int) else self._baud()
        link = await open_link(
            self.address, end, self.rate, secret, self._behind, self._transport, self._dtr, self._framing
        )
        self._spent, self._plug = made, plug
        return link

    async def close(self) -> None:
        """Do nothing; the port holds no resources."""


def _secret_in(file: str) -> bytes:
    """Return the first line of a file."""
    try:
        with open(file, "rb") as lines:
            secret = lines.readline().strip()
    except OSError as error:
        raise ConfigError(f"serial.secret_file: {file}: {error.strerror}; write the board's secret there") from None
    if not secret:
        raise ConfigError(f"serial.secret_file: {file} is empty; write the board's secret there")
    return secret


def _link_made(address: str) -> tuple[int, int, int] | None:
    """Identify a link to a pseudo-terminal: its inode, the time it was made, and the time its target was made, in ns.

    The last is 0 if the target is gone. Returns None for anything but such a link.
    """
    try:
        if not os.readlink(address).startswith("/dev/pts/"):
            return None
        status = os.lstat(address)
    except OSError:
        return None
    made = 0
    with suppress(OSError):
        # unchanged by bytes that are sent or received
        made = os.stat(address).st_ctime_ns
    return status.st_ino, status.st_mtime_ns, made


def _passed_on(before: tuple[int, int, int] | None, now: tuple[int, int, int] | None) -> bool:
    """Return whether the link is the same, but its pseudo-terminal is gone or another, perhaps another program's."""
    return before is not None and now is not None and before[:2] == now[:2] and (not now[2] or now[2] != before[2])


def baud_warning(baud: int) -> str | None:
    """Return a warning if many adapters do not support this baud rate; None for a rate of STANDARD_BAUDS."""
    if baud in STANDARD_BAUDS:
        return None
    near = min(STANDARD_BAUDS, key=lambda standard: abs(standard - baud))
    return f"{baud} baud is unusual (the nearest usual rate is {near}, the board's 57600): the adapter may not know it"


def open_port(address: str, baud: int, behind: str = BOARD, dtr: bool = True, framing: str = "8N1") -> _Opened:
    """Open a port; return it, and the function that explains its loss.

    Opening may block: a modem waits for carrier, a USB stack may be slow.
    """
    try:
        explain = _checked(address, baud)
        bits, parity, stop = int(framing[0]), framing[1], int(framing[2])
        device = _Device(None, baud, bits, parity, stop, exclusive=True, timeout=0, write_timeout=0)
        device.dtr, device.port = dtr, address
        device.open()
        _keep_up(device)
        return device, explain
    except OPENING as error:
        raise _refusal(address, baud, behind, error) from error


def _checked(address: str, baud: int) -> Callable[[str, Exception | None], str]:
    """Return the function that explains the loss of the port.

    Raises ValueError: there is no such baud rate; HalError: the address is a file or directory; OSError.
    """
    if not 0 < baud < 2**31:
        # the kernel would take 0 as "hang up", and has 32 bits for the number
        raise ValueError
    if not stat.S_ISCHR(os.stat(address).st_mode):
        raise HalError(f"{address} is no serial port but a file or directory: {_found()}")
    if os.path.realpath(address).startswith("/dev/pts/"):
        return lambda address, _: f"{address} is gone: the program behind it has ended or closed it"
    return unplugged


def _refusal(address: str, baud: int, behind: str, error: Exception) -> HalError:
    """Return the error for a port that cannot be opened, for people."""
    if isinstance(error, ValueError | OverflowError):
        usual = "the board's rate is 57600" if behind == BOARD else "check the rate"
        return HalError(f"{address} does not work at {baud} baud: {usual}")
    # termios.error is no OSError: the device went away meanwhile
    cause = error if isinstance(error, OSError) else OSError(*error.args)
    return HalError(_why_not_open(address, cause, behind))


def _keep_up(device: Any) -> None:
    """Let the line DTR stay up when the port is closed: many boards restart when it rises as the port opens again."""
    attributes = termios.tcgetattr(device)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(device, termios.TCSANOW, attributes)


def _close_port(opening: asyncio.Future[_Opened]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result()[0].close()


def _why_not_open(address: str, error: OSError, behind: str) -> str:
    """Return why a device cannot be opened, and the remedy, for people."""
    match error.errno:
        case errno.ENOENT | errno.ENOTDIR | errno.ELOOP:
            if address.startswith("/dev/") and not address.startswith("/dev/pts/"):
                return f"{address} does not exist: is the adapter plugged in? {_found()}"
            if fullmatch(r"[\w.-]+:\d+", address):
                return f"{address} is no device; for TCP write socket://{address}"
            return f"{address} does not exist: is `{behind} --pty {address}` running? {_found()}"
        case errno.EACCES | errno.EPERM:
            return access_problem(address) or f"no permission to use {address}: {error.strerror}"
        case errno.EBUSY | errno.EAGAIN:
            return f"{address} is busy: another program has it open; close that program first"
        case errno.ENXIO | errno.ENODEV | errno.EIO:
            return f"{address} has no hardware behind it: {_found()}"
    return f"{address} is no serial port: {_found()}"


def _found() -> str:
    """Return the available ports, as the end of a sentence."""
    ports = candidates()
    return f"ports found: {', '.join(map(str, ports))}" if ports else "no serial port was found"


def unplugged(address: str, _: Exception | None) -> str:
    """Return the message for an adapter that was pulled out."""
    return f"{address} was unplugged"
