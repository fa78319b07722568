"""Ed25519 keys (RFC 8032): signs with a private key, verifies with public keys. Needs the extra ``secure``.

A signature covers a list of parts; the first names the kind of content, so that no signature is valid for another kind.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cellwatt.errors import ConfigError, why

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

SIGNATURE: Final = 64
"""Bytes of a signature."""
_BLOCK: Final = re.compile(rb"-----BEGIN (PUBLIC KEY|CERTIFICATE)-----.*?-----END \1-----", re.DOTALL)


class Signer:
    """Signs with a cell's private key. Raises ``ConfigError`` if the file contains none."""

    def __init__(self, path: Path) -> None:
        self._key = _private(path)

    def sign(self, *parts: bytes | str) -> bytes:
        """Sign these parts together; return 64 bytes."""
        return self._key.sign(_joined(parts))


class Verifier:
    """Verifies with the public keys of a cell, or certificates with them: PEM, one or several in a file.

    Raises ``ConfigError`` if the file contains none.
    """

    def __init__(self, path: Path) -> None:
        self._keys = _public(path)

    def holds(self, signature: bytes, *parts: bytes | str) -> bool:
        """True if one of the keys signed these parts together."""
        from cryptography.exceptions import InvalidSignature

        signed = _joined(parts)
        for key in self._keys:
            try:
                key.verify(signature, signed)
            except InvalidSignature:
                continue
            return True
        return False


def unusable(path: Path | None) -> tuple[str, ...]:
    """Reason why the key in this file cannot sign, in one line; empty if it can, or if ``path`` is ``None``."""
    try:
        if path is not None:
            Signer(path)
    except ConfigError as error:
        return (f"sign: {error}",)
    return ()


def new_key() -> tuple[bytes, bytes]:
    """Make a private key and its public key, PEM."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat

    key = Ed25519PrivateKey.generate()
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return private, key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


def _joined(parts: tuple[bytes | str, ...]) -> bytes:
    """Concatenate the parts with their lengths, so that different lists of parts give different bytes."""
    plain = [part.encode("utf-8", "surrogatepass") if isinstance(part, str) else part for part in parts]
    return b"".join(len(part).to_bytes(8, "little") + part for part in plain)


def _private(path: Path) -> Ed25519PrivateKey:
    data = _text(path)
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        key = load_pem_private_key(data, None)
    except (ValueError, TypeError):
        raise ConfigError(f"{path} holds no private key that can be read without a password") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigError(f"{path} holds a key of another kind; expected Ed25519, as cellwatt secure makes it")
    return key


def _public(path: Path) -> list[Ed25519PublicKey]:
    data = _text(path)
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    keys = []
    for found in _BLOCK.finditer(data):
        try:
            key = (
                load_pem_public_key(found[0])
                if found[1] == b"PUBLIC KEY"
                else x509.load_pem_x509_certificate(found[0]).public_key()
            )
        except ValueError:
            continue
        keys += [key] if isinstance(key, Ed25519PublicKey) else []
    if not keys:
        raise ConfigError(f"{path} holds no public key or certificate of Ed25519, as cellwatt secure makes it")
    return keys


def _text(path: Path) -> bytes:
    """Read the key file. Raises ``ConfigError``, also if the extra is not installed."""
    try:
        import cryptography  # noqa: F401
    except ImportError as error:
        raise ConfigError("signatures need the extra 'secure': pip install 'cellwatt[secure]'") from error
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {why(error)}") from None
