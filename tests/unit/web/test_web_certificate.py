"""The certificate that is made at the first start."""

from __future__ import annotations

import ssl
from pathlib import Path

import pytest

from txt1.errors import ConfigError
from txt1.web.certificate import addresses, fingerprint, own_certificate, tls


def test_it_is_made_once_for_its_owner_s_eyes_and_a_browser_trusts_it(tmp_path: Path) -> None:
    certificate, key = own_certificate(tmp_path, "0.0.0.0")
    before = fingerprint(certificate)
    assert own_certificate(tmp_path, "0.0.0.0") == (certificate, key)
    assert fingerprint(certificate) == before
    assert key.stat().st_mode & 0o077 == 0
    server = tls(certificate, key)
    client = ssl.create_default_context(cafile=str(certificate))
    here, there = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = server.wrap_bio(here, there, server_side=True)
    theirs = client.wrap_bio(there, here, server_hostname="127.0.0.1")
    for _ in range(6):
        for end in (theirs, ours):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
    assert theirs.getpeercert() and theirs.version() in ("TLSv1.2", "TLSv1.3")


def test_files_that_are_none_are_refused_in_a_line(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.pem"
    wrong.write_text("no certificate")
    with pytest.raises(ConfigError, match="--web-cert"):
        tls(wrong, None)


def test_an_address_of_its_own_is_named_as_it_is() -> None:
    assert addresses("10.1.2.3") == ["10.1.2.3"]
    assert addresses("0.0.0.0")
