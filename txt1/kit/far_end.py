"""Options for the far end of a line that another program opens: a pseudo-terminal, or a TCP port."""

import argparse
from typing import Final

from txt1.commands import host_and_port, takes
from txt1.link.base import End, Listener
from txt1.link.pty import listen_pty
from txt1.link.tcp import listen_tcp

FAR_END: Final = {
    "--pty": takes("PATH", "a pseudo-terminal with a link to it at PATH"),
    "--tcp": takes("[HOST:]PORT", "a TCP port; HOST is 127.0.0.1", host_and_port),
}


async def listen(arguments: argparse.Namespace, end: End) -> Listener:
    """Open the far end from `FAR_END`; raises LinkError if that fails."""
    if arguments.pty is not None:
        return listen_pty(arguments.pty, end)
    host, port = arguments.tcp
    return await listen_tcp(host, port, end)
