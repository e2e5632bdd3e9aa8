"""A pseudo-terminal: the virtual board's serial port, which hosts open like a device."""

import asyncio
import os
import select
import termios
import tty
from contextlib import suppress
from typing import Final

from txt1.errors import HalError
from txt1.link.base import BACKLOG, End, Link, Listener

LOOK_EVERY: Final = 0.05  # s between two looks whether a host has opened the pseudo-terminal


class _PtyLink(Link):
    """The board's side of a pseudo-terminal: a line that is up whether or not a host listens at its other end.

    The host's side is opened here for moments only: as long as nobody else has it open, the kernel says so.
    """

    def __init__(self, path: str, end: End, master: int, slave: str) -> None:
        super().__init__(path, end)
        self._loop = asyncio.get_running_loop()
        self._master = master
        self._slave = slave
        self._poll = select.poll()
        self._poll.register(master, 0)  # a hang-up is reported unasked
        self._timer: asyncio.TimerHandle | None = None
        self._used = False  # by a host, since it was cleaned
        end.connected(self)
        if self.up:
            self._look()

    def _send(self, data: bytes) -> None:
        if self._poll.poll(0):  # nobody is there: it would lie there until the next host takes it for news
            return
        try:
            sent = os.write(self._master, data)
        except BlockingIOError:
            sent = 0
        except OSError:  # the host has left this very moment
            return
        self._used = True
        self.overflows += sent < len(data)

    def _let_go(self) -> None:
        if self._timer is None:
            self._loop.remove_reader(self._master)
        else:
            self._timer.cancel()
        with suppress(OSError):
            if os.readlink(self.address) == self._slave:  # else it is another's by now
                os.unlink(self.address)
        os.close(self._master)  # last, for until then no other pseudo-terminal can have its name

    def _look(self) -> None:
        """Read what a host has sent, if one is or was there; else look again later."""
        self._timer = None
        self._loop.add_reader(self._master, self._readable)
        self._readable()

    def _readable(self) -> None:
        try:
            data = os.read(self._master, BACKLOG)
        except BlockingIOError:
            self._used = True
        except OSError:
            self._hung_up()
        else:
            self._used = True
            self._end.received(data)

    def _hung_up(self) -> None:
        """No host is there, and all that the last one sent is read. A reader would wake the loop without end now."""
        self._loop.remove_reader(self._master)
        if self._used:  # what the host did not read, and how it set the line, are not for the next one
            self._used = False
            _clean(self._slave)
        self._timer = self._loop.call_later(LOOK_EVERY, self._look)


def listen_pty(path: str, end: End) -> Listener:
    """A pseudo-terminal that hosts open at `path`, which becomes a symbolic link to it.

    All hosts, one after the other, are one link to `end`: it is up until it is closed, and what is written while no
    host has it open is lost, as on a line nobody listens to. Making and removing the symbolic link touches the file
    system from the loop. A HalError when there is something else at `path`, or it cannot be made, says what to do.
    """
    try:
        master, slave_fd = os.openpty()
    except OSError as error:
        raise HalError(f"the system has no pseudo-terminal left for {path}: {error.strerror}") from error
    slave = os.ttyname(slave_fd)
    tty.setraw(slave_fd)  # before anybody opens it: an echo would send the board its own odometry
    os.close(slave_fd)
    os.set_blocking(master, False)
    try:
        _make_link(path, slave)
    except BaseException:
        os.close(master)
        raise
    return _PtyLink(path, end, master, slave)


def _make_link(path: str, slave: str) -> None:
    """Put a symbolic link to the pseudo-terminal at `path`, in place of one that a killed board has left."""
    try:
        if os.path.islink(path) and os.readlink(path).startswith("/dev/pts/"):
            os.unlink(path)
        os.symlink(slave, path)
    except FileExistsError as error:
        raise HalError(f"{path} exists and is no pseudo-terminal: remove it or choose another path") from error
    except FileNotFoundError as error:
        raise HalError(f"cannot make {path}: there is no such directory; make it or choose another path") from error
    except OSError as error:
        raise HalError(f"cannot make {path}: {error.strerror}; choose another path") from error


def _clean(slave: str) -> None:
    """Throw away what waits to be read at the host's side, and set it to raw."""
    with suppress(OSError, termios.error):  # a host may have reserved it for itself
        slave_fd = os.open(slave, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            termios.tcflush(slave_fd, termios.TCIFLUSH)
            tty.setraw(slave_fd, termios.TCSANOW)
        finally:
            os.close(slave_fd)
