"""The computer's serial ports, and whether this user may use them.

The functions ask the file system: not for the loop.
"""

import grp
import os
import stat
from typing import NamedTuple

from serial.tools import list_ports

from txt1.errors import HalError


class SerialPort(NamedTuple):
    """A serial port that the operating system knows."""

    # its path, such as /dev/ttyUSB0
    device: str
    # description by maker or driver
    description: str
    usb: bool

    def __str__(self) -> str:
        """Path and description, for people."""
        return f"{self.device} ({self.description})" if self.description not in ("", "n/a") else self.device


def candidates() -> list[SerialPort]:
    """Return the ports found, USB ports first: the computer of a robot has few others."""
    found = [SerialPort(port.device, port.description or "", port.vid is not None) for port in list_ports.comports()]
    return sorted(found, key=lambda port: (not port.usb, port.device))


def only_candidate() -> str:
    """Return the path of the only port.

    Raises HalError for no port or several: the others of a robot are its GPS and its laser scanner.
    """
    ports = candidates()
    if not ports:
        raise HalError("no serial port found: plug in the USB-RS232 adapter, or name one with --port")
    if len(ports) > 1:
        raise HalError(f"{len(ports)} serial ports found, name one with --port: {', '.join(map(str, ports))}")
    return ports[0].device


def access_problem(device: str) -> str | None:
    """Return why this user cannot read and write the port, with the remedy; None if access is possible."""
    try:
        status = os.stat(device)
    except FileNotFoundError:
        return f"{device} does not exist: is the adapter plugged in?"
    except OSError as error:
        return f"{device} cannot be looked at: {error.strerror}"
    if os.access(device, os.R_OK | os.W_OK):
        return None
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    # if the port's group may use it, joining the group (dialout, or uucp) is the remedy; the group root is no such
    # group
    if status.st_gid and status.st_mode & (stat.S_IRGRP | stat.S_IWGRP) == stat.S_IRGRP | stat.S_IWGRP:
        remedy = f"it belongs to the group {group}: sudo usermod -aG {group} $USER, then log out and in again"
    else:
        rule = f'KERNEL=="{os.path.basename(device)}", SUBSYSTEM=="tty", GROUP="dialout", MODE="0660"'
        remedy = f"add the udev rule {rule} in /etc/udev/rules.d/50-txt1.rules, then plug it in again"
    return f"no permission to use {device}: {remedy}"
