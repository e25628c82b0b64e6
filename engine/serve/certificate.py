"""A certificate of our own for ``--lan``: browsers warn about it once, and the connection is encrypted."""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import FormatError
from ..core.files import atomic_write, read_bytes, write_file

if TYPE_CHECKING:
    from cryptography.x509 import GeneralName

_DAYS = 825
"""The longest time for which all browsers accept such a certificate."""
_RENEW_DAYS = 30
_MAX_BYTES = 1 << 16


def certificate_files(folder: Path, hosts: Sequence[str]) -> tuple[Path, Path]:
    """Return the files of certificate and private key for `hosts`; new ones when they expire or the hosts changed.

    Raises
    ------
    DiskError
        When they cannot be written.
    """
    from cryptography import x509

    certificate, key = folder / "certificate.pem", folder / "private_key.pem"
    if certificate.exists() and key.exists():
        # A damaged certificate is replaced as an old one is.
        with contextlib.suppress(ValueError, FormatError, x509.ExtensionNotFound):
            known = x509.load_pem_x509_certificate(read_bytes(certificate, max_bytes=_MAX_BYTES, advice="Delete it."))
            names = known.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            left = known.not_valid_after_utc - datetime.datetime.now(datetime.UTC)
            if {str(name.value) for name in names} == set(hosts) and left.days > _RENEW_DAYS:
                return certificate, key
    _write(certificate, key, hosts)
    return certificate, key


def _write(certificate: Path, key: Path, hosts: Sequence[str]) -> None:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    private = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Gaussian Heritage")])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=_DAYS))
        .add_extension(x509.SubjectAlternativeName([_general_name(host) for host in hosts]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(private, hashes.SHA256())
    )
    with atomic_write(key, private=True) as stream:
        stream.write(
            private.private_bytes(
                serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
            )
        )
    write_file(certificate, made.public_bytes(serialization.Encoding.PEM))


def _general_name(host: str) -> GeneralName:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
