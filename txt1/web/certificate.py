"""A certificate for the robot's own network, made at the first start."""

import socket
import ssl
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from txt1.errors import ConfigError
from txt1.kernel.clock import NS_PER_S, wall_ns

# days that it is valid: browsers accept no more
DAYS: Final = 397
CERTIFICATE: Final = "web-certificate.pem"
KEY: Final = "web-key.pem"


def own_certificate(folder: Path, host: str) -> tuple[Path, Path]:
    """Return certificate and key in a folder. They are made if there are none, or they end within a week."""
    certificate, key = folder / CERTIFICATE, folder / KEY
    now = datetime.fromtimestamp(wall_ns() / NS_PER_S, UTC)
    with suppress(OSError, ValueError):
        there = x509.load_pem_x509_certificate(certificate.read_bytes())
        if key.exists() and there.not_valid_after_utc > now + timedelta(days=7):
            return certificate, key
    private = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "txt1 robot")])
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName(_names(host)), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([x509.oid.ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(private, hashes.SHA256())
    )
    key.touch(mode=0o600)
    key.chmod(0o600)
    form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    key.write_bytes(private.private_bytes(*form))
    certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    return certificate, key


def tls(certificate: Path, key: Path | None) -> ssl.SSLContext:
    """Return a server's TLS context.

    Raises ConfigError: certificate or key cannot be read, or they do not belong together.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f"--web-cert {certificate}: cannot be used: {error}; give a PEM file and its key") from None
    return context


def fingerprint(certificate: Path) -> str:
    """Return the certificate's SHA-256 fingerprint, as browsers show it."""
    return x509.load_pem_x509_certificate(certificate.read_bytes()).fingerprint(hashes.SHA256()).hex(":").upper()


def addresses(host: str) -> list[str]:
    """Return the addresses at which other computers may find a server on `host`, the most likely first."""
    found = [] if host in ("0.0.0.0", "::") else [host]  # noqa: S104
    if not found:
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            # nothing is sent: it only asks for the route
            probe.connect(("192.0.2.1", 9))
            found.append(probe.getsockname()[0])
        found.append(socket.gethostname())
    return found


def _names(host: str) -> list[x509.GeneralName]:
    names: list[x509.GeneralName] = []
    for each in dict.fromkeys([*addresses(host), "localhost", "127.0.0.1"]):
        try:
            names.append(x509.IPAddress(ip_address(each)))
        except ValueError:
            names.append(x509.DNSName(each))
    return names
