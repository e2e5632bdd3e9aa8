"""Admission to the web page: the token in its file, cookies, the address that a request names, the page it comes from.

A page signs in once, with the token, and gets a cookie: a time and its HMAC under the token. So the server keeps no
list of sessions, a restart ends no session, and a new token ends all sessions.
"""

import re
import secrets
import stat
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from hmac import compare_digest, digest
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Final, Literal
from urllib.parse import urlsplit

from txt1.commands import is_loopback
from txt1.errors import ConfigError
from txt1.web.budgets import Budget

Role = Literal["operator", "visitor", "stop channel"]
"""Of a connection. A stop channel is a page's further connection, which may do nothing but stop."""

# s for which a page stays signed in
SESSION: Final = 12 * 3600
# characters of a token; a shorter token could be guessed
TOKEN_MIN: Final = 16
# characters that an address contains unchanged
TOKEN: Final = re.compile(rf"[A-Za-z0-9._~-]{{{TOKEN_MIN},}}")
# wrong tokens a second from one address, and at once
TRIES: Final = (0.2, 5.0)
# addresses whose attempts are counted
ADDRESSES_MAX: Final = 1000


def token_in(file: Path) -> str:
    """Return the token in a file. If there is no file, make it with a new token, readable by its owner only.

    Raises ConfigError: it is no regular file, others may read it, its token is malformed, or it cannot be read or made.
    """
    try:
        if not file.exists():
            _make(file)
        mode = file.stat().st_mode
        if not stat.S_ISREG(mode):
            raise ConfigError(f"--web-token {file}: not a regular file; name one, or one that is to be made")
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise ConfigError(f"--web-token {file}: others may read it; chmod 600 {file}")
        token = file.read_text(encoding="latin-1").strip()
    except OSError as error:
        raise ConfigError(f"--web-token {file}: {error.strerror}; give a file that can be read or made") from None
    if not TOKEN.fullmatch(token):
        raise ConfigError(
            f"--web-token {file}: its token has to be a word of at least {TOKEN_MIN} characters, each a letter from A "
            "to Z or a to z, a digit or one of . _ ~ -; delete the file, and a good one is made"
        )
    return token


def _make(file: Path) -> None:
    """Write a file with a new token in a single step; a file that has appeared meanwhile stays."""
    # temporary files have mode 0600
    with NamedTemporaryFile("w", encoding="ascii", dir=file.parent, prefix=".token-") as made:
        made.write(secrets.token_urlsafe(32) + "\n")
        made.flush()
        with suppress(FileExistsError):
            file.hardlink_to(made.name)


def visitors_token(token: str) -> str:
    """Return the token for visitors, derived from the operator's: a visitor cannot compute the operator's token
    from it.
    """
    return digest(token.encode(), b"txt1 visitor", "sha256").hex()[:32]


class Auth:
    """Admits pages.

    Without a token, for loopback addresses only, it admits every page that asks for a loopback address.
    """

    def __init__(self, token: str | None, scheme: Literal["http", "https"], port: int) -> None:
        self._tokens: Mapping[Role, str] = {}
        self.visitors_token = None if token is None else visitors_token(token)
        if token is not None and self.visitors_token is not None:
            self._tokens = {"operator": token, "visitor": self.visitors_token}
        self._scheme = scheme
        self._tries: dict[str, Budget] = {}
        self.cookie: Final = f"txt1-{port}"

    def knows_host(self, host: str) -> bool:
        """Return whether a request's Host may be this server's: without a token only a loopback address,
        whatever a DNS says.
        """
        if re.search(r"[^\w.:\[\]-]", host):
            return False
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            # half a bracket
            return False
        return bool(self._tokens) or is_loopback(name)

    def knows_origin(self, origin: str | None, host: str) -> bool:
        """Return whether a request comes from this server's page."""
        return origin == f"{self._scheme}://{host}"

    def sign_in(self, token: str, now: float) -> tuple[Role, str] | None:
        """Return the role and the cookie's value for a token; None for a wrong token."""
        for role, right in self._tokens.items():
            if compare_digest(token.encode(), right.encode()):
                return role, self._signed(role, now)
        return None

    def failed(self, address: str, now: float) -> bool:
        """Count a wrong token; return whether its address is still below the limit.

        Only wrong tokens are limited. Otherwise another user of the operator's address could keep the operator out. The
        limit does not prevent guessing; the token's length does.
        """
        if len(self._tries) > ADDRESSES_MAX:
            self._tries.clear()
        return self._tries.setdefault(address, Budget(*TRIES)).spend(now)

    def role(self, cookie: str | None, now: float) -> Role | None:
        """Return the role of a cookie's value; None for an invalid value."""
        if not self._tokens:
            return "operator"
        parts = (cookie or "").split(".")
        if len(parts) != 3 or not parts[1].isascii() or not parts[1].isdecimal() or len(parts[1]) > 12:
            return None
        for role in self._tokens:
            since = float(parts[1])
            if role == parts[0] and since <= now + 1.0 and now - since < SESSION:
                return role if compare_digest(self._signed(role, since), cookie or "") else None
        return None

    def _signed(self, role: Role, since: float) -> str:
        text = f"{role}.{int(since)}"
        return f"{text}.{sha256(digest(self._tokens[role].encode(), text.encode(), 'sha256')).hexdigest()}"
