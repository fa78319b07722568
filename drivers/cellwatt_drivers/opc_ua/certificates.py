"""Certificates and keys as files, PEM or DER."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import SecretStr

from cellwatt.errors import DeviceError
from cellwatt.files import read_bytes


def certificate_of(path: Path) -> Any:
    """The certificate of a file. Raises ``DeviceError``."""
    from cryptography import x509

    with _usable(path):
        content = read_bytes(path)
        return x509.load_pem_x509_certificate(content) if _is_pem(content) else x509.load_der_x509_certificate(content)


def key_of(path: Path, password: SecretStr | None) -> Any:
    """The private key of a file. Raises ``DeviceError``."""
    from cryptography.hazmat.primitives import serialization

    secret = password.get_secret_value().encode() if password else None
    with _usable(path):
        content = read_bytes(path)
        pem, der = serialization.load_pem_private_key, serialization.load_der_private_key
        return (pem if _is_pem(content) else der)(content, password=secret)


def application_uri(path: Path, certificate: Any) -> str:
    """Application URI of the certificate in this file, which a server compares. Raises ``DeviceError``."""
    from cryptography import x509

    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        return str(names.get_values_for_type(x509.UniformResourceIdentifier)[0])
    except (x509.ExtensionNotFound, IndexError) as error:
        raise DeviceError(f"{path} names no application URI (subjectAltName URI), as OPC UA asks") from error


def _is_pem(content: bytes) -> bool:
    return content.lstrip().startswith(b"-----")


@contextmanager
def _usable(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, TypeError) as error:
        raise DeviceError(f"{path} cannot be used: {error}") from error
