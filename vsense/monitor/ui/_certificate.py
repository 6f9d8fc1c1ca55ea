"""HTTPS for the page: a certificate that was given, or one that is made here and kept.

A page that other machines may open is protected by tokens, and whoever hears a token has it. The
made certificate is kept between starts: a browser that was told to accept it once warns again only
where somebody else answers, and the fingerprint that is printed is the same every time.
"""

from __future__ import annotations

import datetime
import hashlib
import ipaddress
import os
import socket
import ssl
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from vsense.base import errors
from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.base.files import check_private, open_bytes
from vsense.monitor.ui.access import PRIVATE_MODE, WebAddress, is_loopback, own_address

VALID_DAYS = 3650
"""Of a made certificate: nobody renews it, and what counts is its fingerprint."""

ALTERNATIVES = "or give one with --web-cert FILE, or send the tokens unencrypted with --insecure"


@dataclass(frozen=True, slots=True)
class PageTls:
    """How the page is encrypted.

    Attributes:
        context: for the server's side of connections.
        fingerprint: of a certificate that was made here, "" of a given one.
    """

    context: ssl.SSLContext
    fingerprint: str = ""


def tls_of(web: WebAddress) -> PageTls | None:
    """Gives what the page is encrypted with; None for plain HTTP: on this machine, or --insecure.

    Raises:
        UsageError: a certificate has to be made, and the library for that is missing.
        VsenseError: the certificate or its key cannot be used or kept.
    """
    if web.certificate is not None:
        return PageTls(_context(web.certificate, web.key))
    if web.insecure or is_loopback(web.host):
        return None
    try:
        errors.require("a page that other machines may open needs", "cryptography")
    except UsageError as error:
        raise UsageError(f"{error}; {ALTERNATIVES}") from None
    path = kept_path()
    with failing_as(VsenseError, f"{path}: cannot keep the page's certificate; {ALTERNATIVES}"):
        if not os.path.exists(path):
            _make(path)
    return PageTls(_context(path, None), fingerprint_of(path))


def kept_path() -> Path:
    """Where the made certificate is kept, with its key."""
    base = os.environ.get("XDG_STATE_HOME")
    return (Path(base) if base else Path.home() / ".local" / "state") / "vsense" / "page.pem"


def fingerprint_of(path: Path) -> str:
    """The SHA-256 fingerprint of the certificate in a file, as browsers show it."""
    text = path.read_text()
    begin = text.index("-----BEGIN CERTIFICATE")
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(text[begin:])).digest().hex(":").upper()


def _context(certificate: Path, key: Path | None) -> ssl.SSLContext:
    """Reads a certificate, and its key from a file of its own or the same."""
    secret = key or certificate
    # OpenSSL would wait for a pipe's other end for ever, and read a device to its end.
    with failing_as(VsenseError, f"{certificate}: cannot read the certificate"):
        open_bytes(certificate).close()
    with failing_as(VsenseError, f"{secret}: cannot read the page's key"), open_bytes(secret) as it:
        check_private(it, secret, "the page's key", PRIVATE_MODE)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_alpn_protocols(["http/1.1"])
    try:
        # A key with a password is none that a server can start with.
        context.load_cert_chain(certificate, key, password=lambda: b"")
    except ssl.SSLError as error:
        what = f"{certificate} and {key} are" if key else f"{certificate} is"
        reason = (error.reason or str(error)).replace("_", " ").lower()
        raise VsenseError(
            f"{what} no certificate with its key, without a password, in PEM: {reason}"
        ) from None
    except OSError as error:
        raise VsenseError(f"{certificate}: cannot read the certificate: {error.strerror}") from None
    return context


def _make(path: Path) -> None:
    """Makes a certificate with its key and keeps it; another process may have been quicker."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    # mkstemp's mode is 0600.
    descriptor, name = tempfile.mkstemp(dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(_generate())
        with suppress(FileExistsError):
            os.link(name, path)
    finally:
        os.unlink(name)


def _generate() -> bytes:
    """A new key, and a certificate that it signs itself, as PEM."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    host = socket.gethostname()[:60] or "vsense"
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, host)])
    names: list[x509.GeneralName] = [
        x509.DNSName(n) for n in dict.fromkeys((host, "localhost")) if n.isascii()
    ]
    addresses = dict.fromkeys(("127.0.0.1", "::1", own_address()))
    names += [x509.IPAddress(ipaddress.ip_address(a)) for a in addresses if _is_address(a)]
    now = datetime.datetime.now(datetime.timezone.utc)
    day = datetime.timedelta(days=1)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - day)  # clocks differ
        .not_valid_after(now + VALID_DAYS * day)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(key, hashes.SHA256())
    )
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    return secret + certificate.public_bytes(serialization.Encoding.PEM)


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True
