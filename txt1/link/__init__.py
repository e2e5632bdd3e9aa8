"""Byte links: a serial device, a TCP connection, a pseudo-terminal or a pair in memory, all with the same two faces.

A `Link` is written to; its `End` is told what happens. `open_link` leads a host to a board, `listen_pty` and
`listen_tcp` lead hosts to the virtual board, `connect` joins two ends in memory. `paced` and `faulty` put a baud rate
and a bad line between an end and any of these, and they can be nested:
`listen_pty(path, paced(faulty(board, faults, seed), 57600))`.
"""

from txt1.link.address import STANDARD_BAUDS, baud_warning, open_link
from txt1.link.base import BACKLOG, End, Link, Listener
from txt1.link.impairments import faulty, paced
from txt1.link.memory import connect
from txt1.link.pty import listen_pty
from txt1.link.tcp import SILENT, listen_tcp

__all__ = [
    "BACKLOG",
    "SILENT",
    "STANDARD_BAUDS",
    "End",
    "Link",
    "Listener",
    "baud_warning",
    "connect",
    "faulty",
    "listen_pty",
    "listen_tcp",
    "open_link",
    "paced",
]
