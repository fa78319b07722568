"""Makes and reads certificates of a P-256 authority. Pure except for random numbers.

A certificate with hosts may serve and connect, one without hosts may only connect (extended key usage, which Zenoh's
TLS enforces at both ends). So a viewer's certificate cannot be used to impersonate a router.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from cellwatt.errors import ConfigError

AUTHORITY_DAYS: Final = 3650
MEMBER_DAYS: Final = 398
_BEFORE: Final = timedelta(days=1)
"""A certificate is valid from this long before its issue, because clocks in a plant differ."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A certificate and its private key, PEM."""

    certificate: bytes
    key: bytes


def new_authority(site: str, now: datetime, days: float = AUTHORITY_DAYS) -> Pair:
    """Make the certificate authority of a site, valid for ``days``."""
    key = ec.generate_private_key(ec.SECP256R1())
    serial = x509.random_serial_number()
    # Two authorities of a site have different names, so that their certificates can be distinguished.
    name = _name(f"cellwatt {site} {now:%Y-%m-%d} {serial & 0xFFFF:04x}")
    usage = {"digital_signature": False, "content_commitment": False, "key_encipherment": False}
    usage |= {"data_encipherment": False, "key_agreement": False, "encipher_only": False, "decipher_only": False}
    certificate = (
        _builder(name, key.public_key(), serial, now, now + timedelta(days=days))
        .issuer_name(name)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(x509.KeyUsage(key_cert_sign=True, crl_sign=True, **usage), critical=True)
        .sign(key, hashes.SHA256())
    )
    return Pair(certificate.public_bytes(Encoding.PEM), _pem(key))


def issue(authority: Pair, name: str, hosts: Sequence[str], now: datetime, days: float = MEMBER_DAYS) -> Pair:
    """Issue a certificate with the common name ``name``; it expires at the latest with its authority.

    With ``hosts``, names or addresses, its holder may listen there. Raises ``ConfigError`` for an invalid host.
    """
    signer = x509.load_pem_x509_certificate(authority.certificate)
    signing = load_pem_private_key(authority.key, None)
    assert isinstance(signing, ec.EllipticCurvePrivateKey)
    key = ec.generate_private_key(ec.SECP256R1())
    end = min(now + timedelta(days=days), signer.not_valid_after_utc)
    usages = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])]
    builder = (
        _builder(_name(name), key.public_key(), x509.random_serial_number(), now, end)
        .issuer_name(signer.subject)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signing.public_key()), critical=False)
    )
    if hosts:
        builder = builder.add_extension(x509.SubjectAlternativeName([_host(h) for h in hosts]), critical=False)
    return Pair(builder.sign(signing, hashes.SHA256()).public_bytes(Encoding.PEM), _pem(key))


def read(pem: bytes) -> list[x509.Certificate]:
    """Parse the certificates in a PEM text. Raises ``ValueError`` if there is none."""
    return x509.load_pem_x509_certificates(pem)


def belongs(certificate: x509.Certificate, key: bytes) -> bool:
    """True if a PEM private key belongs to a certificate. Raises ``ValueError`` or ``TypeError`` if it is not a key."""
    form = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return load_pem_private_key(key, None).public_key().public_bytes(*form) == certificate.public_key().public_bytes(
        *form
    )


def _builder(
    name: x509.Name, key: ec.EllipticCurvePublicKey, serial: int, now: datetime, end: datetime
) -> x509.CertificateBuilder:
    begin = min(now - _BEFORE, end - _BEFORE)
    return (
        x509.CertificateBuilder()
        .subject_name(name)
        .public_key(key)
        .serial_number(serial)
        .not_valid_before(begin)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise ConfigError(f"{host!r} is neither a host name nor an address: {error}") from None


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
