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


class Plug(NamedTuple):
    """What a USB device says of itself, and where it is plugged in."""

    vendor: int
    product: int
    # empty: it has none
    serial_number: str
    # the socket on the computer, such as 1-1.4
    socket: str

    def __str__(self) -> str:
        """Return the name of the device, for people."""
        name = f"USB device {self.vendor:04x}:{self.product:04x}"
        if self.serial_number:
            return f"{name} with serial number {self.serial_number}"
        return f"{name} at socket {self.socket}"


def plug_of(device: str) -> Plug | None:
    """Return what the device at a path says of itself; None unless it is a USB device."""
    path = os.path.realpath(device)
    return next((plug for at, plug in _plugs() if os.path.realpath(at) == path), None)


def port_with(plug: Plug) -> str | None:
    """Return the path at which a USB device is now; None: it is not plugged in.

    A device is known by its serial number. Without one, or where several have the same, it is known by its socket.
    """
    alike = [(at, other) for at, other in _plugs() if other[:3] == plug[:3]]
    if plug.serial_number and len(alike) == 1:
        return alike[0][0]
    return next((at for at, other in alike if other.socket == plug.socket), None)


def _plugs() -> list[tuple[str, Plug]]:
    return [
        (port.device, Plug(port.vid, port.pid or 0, port.serial_number or "", port.location or ""))
        for port in list_ports.comports()
        if port.vid is not None
    ]


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
