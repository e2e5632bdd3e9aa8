"""Options of the web page: its token, its certificate, and the address and QR code for the terminal."""

from __future__ import annotations

import argparse
import os
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from txt1.additions import Options
from txt1.commands import existing, host_and_port, is_loopback, named_url, need, path, positive, say, takes, view_of
from txt1.errors import ConfigError, MissingExtra

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.kernel.loop import Speed

# default place of the token
FILE: Final = "web-token"
# default address: this computer alone
HERE: Final = ("127.0.0.1", 8080)
MODULES: Final = ("aiohttp", "cryptography", "segno")


WEB: Final = {
    "--web": takes(
        "[HOST:]PORT",
        "serve the web page, to watch and drive from; 127.0.0.1:8080, and other than loopback addresses "
        "with a token and TLS only",
        host_and_port,
        nargs="?",
        const=HERE,
    ),
    "--web-token": takes("FILE", "file with the token that pages must send, made if there is none", path),
    "--web-cert": takes("FILE", "your certificate (PEM), in place of one made at the first start", existing),
    "--web-key": takes("FILE", "private key of --web-cert, if it is not in the same file", existing),
    "--web-speed": takes("V", "largest speed of visitors at first, m/s", positive, default=0.5),
    "--web-folder": takes("FOLDER", "folder of the page's recordings", path, default=Path("out/recordings")),
    "--web-robot": takes(
        "NAME=URL", "another robot's page, to choose there; may be repeated", named_url, action="append", default=[]
    ),
}


class WebPage(NamedTuple):
    """The page's address, and the files that protect it."""

    host: str
    port: int
    token: Path | None
    certificate: Path | None
    key: Path | None
    folder: Path
    speed: float
    robots: dict[str, str]
    places: tuple[str, ...] = ()
    """Its addresses, the most likely first."""

    def bridge(self) -> tuple[str, dict[str, object]]:
        """Return the bridge's name and options. Of files it has only the names, because process lists are public."""
        options = {name: str(value) if isinstance(value, Path) else value for name, value in self._asdict().items()}
        del options["places"]
        return "web", options

    def camera_bridge(self, port: int, cameras: list[str]) -> tuple[str, dict[str, object]]:
        """Return the name and options of the bridge that serves pictures at a port."""
        files = {name: str(value) for name in ("token", "certificate", "key") if (value := getattr(self, name))}
        return "web_camera", {"host": self.host, "port": port, "page": self.port, "cameras": cameras, **files}


def web_page(arguments: argparse.Namespace) -> WebPage | None:
    """Return the requested page, or None. Make its files, and print its address; raises ConfigError."""
    if arguments.web is None:
        if arguments.web_token or arguments.web_cert or arguments.web_key:
            raise ConfigError("--web-token, --web-cert, --web-key: there is no page; add --web")
        return None
    if arguments.speed == "max":
        raise ConfigError("--web: at full speed (--speed max) no person could watch; leave one of them out")
    if arguments.web_folder.exists() and not arguments.web_folder.is_dir():
        raise ConfigError(f"--web-folder {arguments.web_folder}: a file, no folder; name one, or a new one")
    need("--web", "web", *MODULES)
    from txt1.web.auth import token_in
    from txt1.web.certificate import addresses, fingerprint, own_certificate, tls

    host, port = arguments.web
    token, certificate, key = arguments.web_token, arguments.web_cert, arguments.web_key
    inside = is_loopback(host)
    port = _free(host, port)
    if not inside:
        folder = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "txt1"
        token = token or folder / FILE
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if certificate is None:
                certificate, key = own_certificate(folder, host)
        except OSError as error:
            remedy = "give --web-token and --web-cert files of your own, or set XDG_STATE_HOME"
            raise ConfigError(f"{folder}: cannot be made or written: {error.strerror}; {remedy}") from None
    if certificate is not None:
        # refused before the robot is started
        tls(certificate, key)
    scheme = "http" if certificate is None else "https"
    word = "" if token is None else token_in(token)
    hosts = [host] if inside else addresses(host)
    named = [f"[{each}]" if ":" in each else each for each in hosts]
    places = tuple(f"{scheme}://{each}:{port}/" for each in named)
    # the code comes last but for a line: at 80 x 24 it stays on the screen as a whole, with the address above it
    if certificate is not None and arguments.web_cert is None:
        say(f"a browser will ask whether to trust the certificate with SHA-256 {fingerprint(certificate)}")
    if token is not None:
        say(f"the page's token is in {token}; a phone that reads this code needs not type it")
        say(f"the page will be at {'  '.join(places)}")
        import segno

        segno.make(f"{places[0]}#token={word}", error="l").terminal(out=sys.stderr, compact=True)
    if token is not None and view_of(arguments) == "screens" and sys.stdin.isatty() and sys.stderr.isatty():
        # without a newline, so that the newline of Enter moves nothing out of the window
        sys.stderr.write("txt1: Enter starts the page and the screens; key p shows this code again ")
        sys.stderr.flush()
        sys.stdin.readline()
    robots = dict(arguments.web_robot)
    return WebPage(host, port, token, certificate, key, arguments.web_folder, arguments.web_speed, robots, places)


def _free(host: str, port: int) -> int:
    """Return the port, any free port for 0; raises ConfigError if the address is not available."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            return int(probe.getsockname()[1])
    except (OSError, UnicodeError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ConfigError(f"--web {host}:{port}: cannot listen there: {why}; choose another address") from None


def free_or_any(host: str, port: int) -> int:
    """Return the port if it is free, else any free port."""
    try:
        return _free(host, port)
    except ConfigError:
        return _free(host, 0)


class PageAsked(NamedTuple):
    """The page beside a robot."""

    page: WebPage
    speed: Speed
    """Speed of the robot's time, for recordings that the page begins."""
    printed: bool = False
    """Whether its address is printed when it answers: there are no screens and no log that show it."""


def asked(arguments: argparse.Namespace, config: Config) -> PageAsked | None:
    """Return the requested page, None for none; raises as `web_page`.

    A practice has a page of its own accord, where a person may look at it and its libraries are there.
    """
    if arguments.practice and arguments.web is None and arguments.speed != "max" and view_of(arguments) != "nothing":
        try:
            need("the page", "web", *MODULES)
            arguments.web = HERE[0], free_or_any(*HERE)
        except MissingExtra as error:
            say(f"there is no page beside it: {error}")
    page = web_page(arguments)
    return None if page is None else PageAsked(page, arguments.speed, view_of(arguments) == "nothing")


OPTIONS: Final = Options("web page", WEB, asked)
