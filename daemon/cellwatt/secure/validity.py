"""Warns of certificates in a settings file that are wrong or about to expire."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cellwatt.outlets.zenoh.link import LinkSettings, TlsSettings

SOON: Final = timedelta(days=30)
"""Rest of a certificate's time from which on it is told."""


def warnings(settings: LinkSettings) -> tuple[str, ...]:
    """One line per problem. Files that cannot be read are reported when the session is opened."""
    if settings.tls is None:
        return ()
    try:
        from cellwatt.secure import certificates  # noqa: F401
    except ImportError:
        return ("nobody looks when the certificates end: that needs pip install 'cellwatt[secure]'",)
    return tuple(_own(settings.tls, datetime.now(UTC)) + _authorities(settings.tls.root_ca, datetime.now(UTC)))


def _own(tls: TlsSettings, now: datetime) -> list[str]:
    from cellwatt.secure.certificates import belongs, read

    certificate, key = _bytes(tls.certificate), _bytes(tls.key)
    if certificate is None:
        return []
    try:
        first, *_ = read(certificate)
    except ValueError:
        return [f"tls.certificate: {tls.certificate} is no certificate"]
    found = _time(f"tls.certificate: {tls.certificate}", first.not_valid_before_utc, first.not_valid_after_utc, now)
    try:
        if key is not None and not belongs(first, key):
            found.append(f"tls.key: {tls.key} is not the key of {tls.certificate}")
    except (ValueError, TypeError):
        found.append(f"tls.key: {tls.key} is no private key that can be read without a password")
    if tls.key is not None and key is not None and tls.key.stat().st_mode & 0o007:
        found.append(f"tls.key: {tls.key} may be read by everybody on this PC: chmod 600")
    return found


def _authorities(path: Path, now: datetime) -> list[str]:
    """Warnings about authorities; one valid authority is enough, as there are two during a change."""
    from cellwatt.secure.certificates import read

    data = _bytes(path)
    if data is None:
        return []
    try:
        all_of_them = read(data)
    except ValueError:
        return [f"tls.root_ca: {path} is no certificate"]
    last = max(all_of_them, key=lambda c: c.not_valid_after_utc)
    return _time(f"tls.root_ca: {path}", last.not_valid_before_utc, last.not_valid_after_utc, now)


def _time(what: str, begin: datetime, end: datetime, now: datetime) -> list[str]:
    if end < now:
        return [f"{what} ended on {end:%Y-%m-%d}: nobody accepts it; cellwatt secure renew"]
    if begin > now:
        return [f"{what} begins only on {begin:%Y-%m-%d}: is this PC's clock right?"]
    if end < now + SOON:
        return [f"{what} ends on {end:%Y-%m-%d}, in {(end - now).days} days: cellwatt secure renew"]
    return []


def _bytes(path: Path | None) -> bytes | None:
    try:
        return None if path is None else path.read_bytes()
    except OSError:
        return None
