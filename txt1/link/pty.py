"""A pseudo-terminal: the virtual board's serial port, which hosts open like a device.

Beside the symbolic link is a lock file, PATH.lock, which the board holds as long as it runs. So no second board takes
its path, and a host sees whether the terminal still belongs to a board or to another program.
"""

import asyncio
import fcntl
import os
import select
import termios
import tty
from contextlib import suppress
from typing import Final

from txt1.errors import HalError
from txt1.link.base import BYTES_WAITING_MAX, End, Link, Listener

# s between two checks for a host on the pseudo-terminal
HOST_CHECK_PERIOD: Final = 0.05


class _PtyLink(Link):
    """The board's side of a pseudo-terminal: a link that is up with or without a host at the other end.

    This class opens the host's side for moments only, so the kernel reports whether a host has it open.
    """

    def __init__(self, path: str, end: End, master: int, slave: str, lock: int) -> None:
        super().__init__(path, end)
        self._lock = lock
        self._loop = asyncio.get_running_loop()
        self._master = master
        self._slave = slave
        self._poll = select.poll()
        # the kernel reports a hang-up unasked
        self._poll.register(master, 0)
        self._timer: asyncio.TimerHandle | None = None
        # whether a host has used the terminal since it was cleaned
        self._used = False
        end.connected(self)
        if self.up:
            self._look()

    def _send(self, data: bytes) -> None:
        # without a host the bytes would wait there, and the next host would take them for news
        if self._poll.poll(0):
            return
        try:
            sent = os.write(self._master, data)
        except BlockingIOError:
            sent = 0
        except OSError:
            # the host has left at this moment
            return
        self._used = True
        self.overflows += sent < len(data)

    def _let_go(self) -> None:
        if self._timer is None:
            self._loop.remove_reader(self._master)
        else:
            self._timer.cancel()
        with suppress(OSError):
            # otherwise the path belongs to another board by now
            if os.readlink(self.address) == self._slave:
                os.unlink(self.address)
                os.unlink(lock_file(self.address))
        os.close(self._lock)
        # closed last: until then no other pseudo-terminal can have its name
        os.close(self._master)

    def _look(self) -> None:
        """Read bytes from a host, if a host is or was there; else check again later."""
        self._timer = None
        self._loop.add_reader(self._master, self._readable)
        self._readable()

    def _readable(self) -> None:
        try:
            data = os.read(self._master, BYTES_WAITING_MAX)
        except BlockingIOError:
            self._used = True
        except OSError:
            self._hung_up()
        else:
            self._used = True
            self._end.received(data)

    def _hung_up(self) -> None:
        """Handle the host's leaving, after all its bytes are read: a reader would now wake the loop without end."""
        self._loop.remove_reader(self._master)
        # unread bytes and line settings of this host are not for the next
        if self._used:
            self._used = False
            _clean(self._slave)
        self._timer = self._loop.call_later(HOST_CHECK_PERIOD, self._look)


def listen_pty(path: str, end: End) -> Listener:
    """Make a pseudo-terminal and a symbolic link to it at `path`, which hosts open like a device.

    Hosts may come and go; `end` sees a single link, which is up until it is closed. Bytes that are written while no
    host has it open are lost, as on an unplugged line. Making and removing the symbolic link touches the file system
    from the loop. Raises HalError with a remedy: another file is at `path`, or the link cannot be made.
    """
    try:
        master, slave_fd = os.openpty()
    except OSError as error:
        raise HalError(f"the system has no pseudo-terminal left for {path}: {error.strerror}") from error
    slave = os.ttyname(slave_fd)
    # before a host opens it: an echo would send the board its own odometry
    tty.setraw(slave_fd)
    os.close(slave_fd)
    os.set_blocking(master, False)
    lock: int | None = None
    try:
        lock = _take(path, slave)
        _make_link(path, slave)
    except BaseException:
        if lock is not None:
            os.unlink(lock_file(path))
            os.close(lock)
        os.close(master)
        raise
    return _PtyLink(path, end, master, slave, lock)


def lock_file(path: str) -> str:
    """Return the lock file beside a symbolic link to a pseudo-terminal."""
    return f"{path}.lock"


def _take(path: str, slave: str) -> int:
    """Lock the path for this board; it is locked until the returned descriptor is closed."""
    try:
        lock = os.open(lock_file(path), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except FileNotFoundError as error:
        raise HalError(f"cannot make {path}: there is no such directory; make it or choose another path") from error
    except OSError as error:
        raise HalError(f"cannot make {path}: {error.strerror}; choose another path") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        raise HalError(f"{path} is another board's, which is running: end that board or choose another path") from None
    os.ftruncate(lock, 0)
    os.pwrite(lock, slave.encode(), 0)
    return lock


def is_left_behind(path: str) -> bool | None:
    """Return whether a link to a pseudo-terminal is left over from a board that is gone; None if it is unknown.

    It looks at files, so call it in a thread.
    """
    try:
        slave = os.readlink(path)
        if not slave.startswith("/dev/pts/"):
            return None
        lock = os.open(lock_file(path), os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        # a board holds the lock
        return os.read(lock, 100).decode(errors="replace") != slave
    else:
        return True
    finally:
        os.close(lock)


def _make_link(path: str, slave: str) -> None:
    """Make a symbolic link to the pseudo-terminal at `path`, in place of a link that a killed board has left."""
    try:
        if os.path.islink(path) and os.readlink(path).startswith("/dev/pts/"):
            os.unlink(path)
        os.symlink(slave, path)
    except FileExistsError as error:
        raise HalError(f"{path} exists and is no pseudo-terminal: remove it or choose another path") from error
    except OSError as error:
        raise HalError(f"cannot make {path}: {error.strerror}; choose another path") from error


def _clean(slave: str) -> None:
    """Discard unread bytes at the host's side, and set the side to raw."""
    # a host may have opened it exclusively
    with suppress(OSError, termios.error):
        slave_fd = os.open(slave, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            termios.tcflush(slave_fd, termios.TCIFLUSH)
            tty.setraw(slave_fd, termios.TCSANOW)
        finally:
            os.close(slave_fd)
