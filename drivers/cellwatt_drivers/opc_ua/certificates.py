"""Certificates and keys as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellwatt.errors import DeviceError
from cellwatt.files import read_bytes


@dataclass(frozen=True, slots=True)
class Credentials:
    """Files of a certificate and its key, this PC's or a user's, and of the server's where that is pinned."""

    certificate: Path
    key: Path
    key_password: str | None = None
    server_certificate: Path | None = None


@dataclass(frozen=True, slots=True)
class Contents:
    """Certificates and key as DER, and what the server compares: the application's URI."""

    certificate: bytes
    key: bytes
    server: bytes | None
    uri: str
    thumbprint: str


def contents(credentials: Credentials) -> Contents:
    """Read the files. Raises ``DeviceError`` with the file that is at fault."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization

    path = credentials.certificate
    try:
        certificate = _certificate(path)
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = names.get_values_for_type(x509.UniformResourceIdentifier)
        path = credentials.key
        key = _key(credentials)
        path = credentials.server_certificate or path
        pinned = credentials.server_certificate and _certificate(credentials.server_certificate)
    except (OSError, ValueError, TypeError, x509.ExtensionNotFound) as error:
        raise DeviceError(f"{path} cannot be used: {error}") from error
    if not uris:
        raise DeviceError(f"{credentials.certificate} names no application URI (subjectAltName URI), as OPC UA asks")
    der = serialization.Encoding.DER
    return Contents(
        certificate.public_bytes(der),
        key.private_bytes(der, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
        pinned.public_bytes(der) if pinned else None,
        uris[0],
        certificate.fingerprint(hashes.SHA1()).hex(),
    )


def user_of(credentials: Credentials) -> tuple[Any, Any]:
    """A user's certificate and private key, read. Raises ``DeviceError`` with the file that is at fault."""
    path = credentials.certificate
    try:
        certificate = _certificate(path)
        path = credentials.key
        return certificate, _key(credentials)
    except (OSError, ValueError, TypeError) as error:
        raise DeviceError(f"{path} cannot be used: {error}") from error


def _key(credentials: Credentials) -> Any:
    from cryptography.hazmat.primitives import serialization

    secret = credentials.key_password.encode() if credentials.key_password else None
    content = read_bytes(credentials.key)
    pem = content.lstrip().startswith(b"-----")
    load = serialization.load_pem_private_key if pem else serialization.load_der_private_key
    return load(content, password=secret)


def _certificate(path: Path) -> Any:
    from cryptography import x509

    content = read_bytes(path)
    pem = content.lstrip().startswith(b"-----")
    return x509.load_pem_x509_certificate(content) if pem else x509.load_der_x509_certificate(content)
