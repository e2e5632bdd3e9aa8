"""The key of a fleet, in a file: it decides whose messages are heard, and where.

A fleet is a name and a key. HMAC-SHA256 makes from both:

* the **space**, the first part of all its Zenoh keys: fleets with another name or key are never heard by accident;
* the **signature** before each message, over the message and its Zenoh key: without the key nobody can send a message
  or
  redirect one to another robot. (Zenoh itself checks only the opening of a link);
* beyond loopback, the **password** with which links are opened.

On loopback the key is the user's own, made when it is first needed. So the terminals of one user find each other
without a password, and two users on one computer stay apart. A key is a file that only its owner may read. A symlink is
not followed, as another user may have put it there.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from hmac import compare_digest, digest
from pathlib import Path
from secrets import token_hex
from tempfile import NamedTemporaryFile
from typing import Final

from txt1.errors import ConfigError
from txt1.fleet.messages import is_name

# the name of a fleet by default
FLEET_NAME: Final = "txt1"
# letters of a signature: 128 bits in hexadecimal
SIGNATURE: Final = 32
# letters of a password
KEY_MIN: Final = 16
# bytes of the longest file that may be a key
KEY_MAX: Final = 4096
MADE: Final = ("space", "signature", "password")


class FleetKey:
    """A fleet's name and secret, and everything derived from them; raises ConfigError: the name is not valid."""

    def __init__(self, secret: str, fleet: str = FLEET_NAME) -> None:
        if not is_name(fleet):
            raise ConfigError(f"--fleet-name: '{fleet}': a fleet's name has small letters, digits and _, 64 at most")
        self.fleet = fleet
        made = {what: digest(secret.encode(), f"txt1 {what} of {fleet}".encode(), "sha256") for what in MADE}
        self._signing = made["signature"]
        self.space = f"txt1/{fleet}/{made['space'].hex()[:SIGNATURE]}"
        """The first part of all Zenoh keys of the fleet."""
        self.password = made["password"].hex()
        """The password of links beyond loopback."""

    def signature(self, where: str, text: bytes) -> str:
        """Return the signature of a message on a Zenoh key, given without the space."""
        return digest(self._signing, where.encode() + b"\0" + text, "sha256").hex()[:SIGNATURE]

    def signed(self, where: str, text: bytes) -> bytes:
        """Return a message with its signature."""
        return self.signature(where, text).encode() + text

    def opened(self, where: str, payload: bytes) -> bytes | None:
        """Return the message in a payload; None: it is not signed with this key for this place."""
        given, text = payload[:SIGNATURE], payload[SIGNATURE:]
        return text if compare_digest(given, self.signature(where, text).encode()) else None

    @contextmanager
    def dictionary(self) -> Iterator[str]:
        """A file of users and passwords, which Zenoh reads once when it opens; the file exists within the block only.

        It is a new file with a random name and mode 0600, so a symlink cannot be in its place.
        """
        with NamedTemporaryFile("w", prefix="txt1-fleet-", encoding="utf-8") as file:
            file.write(f"{self.fleet}:{self.password}\n")
            file.flush()
            yield file.name


def fleet_key(interface: str, path: Path | None, fleet: str = FLEET_NAME) -> FleetKey:
    """Return the key of a fleet on an interface (empty: loopback), from the file at `path` or the user's own.

    Raises ConfigError: no file is named beyond loopback, or others may use the file.
    """
    if path is None and interface:
        own = f"copy your own ({_users_path()}) to each robot" if _users_path().exists() else "make one"
        raise ConfigError(f"--fleet {interface}: beyond loopback all share a key; add --fleet-key FILE ({own})")
    if path is None:
        path, whose = users_key(), "your fleet's key"
    else:
        whose = "--fleet-key"
    secret = _read(path, f"{whose} {path}")
    if len(secret) < KEY_MIN:
        raise ConfigError(f"{whose} {path}: it is too short; put a password of {KEY_MIN} characters or more into it")
    return FleetKey(secret, fleet)


def users_key() -> Path:
    """Return the file with the user's own key, and make it if it is missing; raises ConfigError."""
    path = _users_path()
    if path.exists() or path.is_symlink():
        return path
    draft = path.with_name(f".{path.name}-{token_hex(8)}")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        try:
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                print(token_hex(32), file=file)
            # two terminals may start in the same instant: the link of the first stays, and its file is complete
            path.hardlink_to(draft)
        except FileExistsError:
            pass
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        remedy = "name another with --fleet-key FILE, or set XDG_CONFIG_HOME"
        raise ConfigError(f"your fleet's key {path}: cannot make it: {error.strerror}; {remedy}") from None
    return path


def _users_path() -> Path:
    try:
        home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    except RuntimeError:
        raise ConfigError("your fleet's key: you have no home to keep it in; add --fleet-key FILE") from None
    return Path(home, "txt1", "fleet-key")


def _open(path: str, flags: int) -> int:
    # and do not wait for the other end of a pipe
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK)


def _read(path: Path, named: str) -> str:
    """Return the text of a file that only its owner may read; raises ConfigError, which begins with `named`."""
    try:
        with open(path, "rb", opener=_open) as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise ConfigError(f"{named}: it is no file; put a password into one")
            if os.geteuid() not in (0, about.st_uid):
                raise ConfigError(f"{named}: it belongs to another user; make a copy of your own: install -m 600")
            if about.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
                raise ConfigError(f"{named}: others may use it; make it yours alone: chmod 600 {path}")
            return file.read(KEY_MAX).decode("utf-8").strip()
    except UnicodeDecodeError:
        raise ConfigError(f"{named}: it is no text; put a password into it") from None
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise ConfigError(f"{named}: it is a symlink, which others may turn; name the file itself") from None
        raise ConfigError(f"{named}: cannot read it: {error.strerror}; put a password into it") from None
