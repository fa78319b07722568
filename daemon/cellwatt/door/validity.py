"""Warns of certificates that are invalid or about to expire."""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

SOON: Final = timedelta(days=30)
"""Remaining validity from which on a certificate is reported."""


def warnings(certificate: Path | None, key: Path | None, authority: Path | None = None) -> tuple[str, ...]:
    """One line per problem, prefixed with the setting. Unreadable files are reported where they are opened."""
    if certificate is None and authority is None:
        return ()
    try:
        from cellwatt.door import certificates
    except ImportError:
        return ("the expiry of certificates is not checked: pip install 'cellwatt[secure]'",)
    found: list[str] = []
    now = datetime.now(UTC)
    # One valid authority is enough: during a change the file has two.
    for what, file, most in (("certificate", certificate, 1), ("root_ca", authority, None)):
        if (data := _bytes(file)) is None:
            continue
        try:
            last = max(certificates.read(data)[:most], key=lambda c: c.not_valid_after_utc)
        except ValueError:
            found.append(f"{what}: {file} is not a certificate")
            continue
        found += _time(f"{what}: {file}", last.not_valid_before_utc, last.not_valid_after_utc, now)
        if what == "certificate" and key is not None and (secret := _bytes(key)) is not None:
            try:
                if not certificates.belongs(last, secret):
                    found.append(f"key: {key} is not the key of {file}")
            except (ValueError, TypeError):
                found.append(f"key: {key} is not a private key that is readable without a password")
            with contextlib.suppress(OSError):  # removed meanwhile
                if key.stat().st_mode & 0o007:
                    found.append(f"key: {key} is readable by every user of this PC: chmod 600")
    return tuple(found)


def _time(what: str, begin: datetime, end: datetime, now: datetime) -> list[str]:
    if end < now:
        return [f"{what} ended on {end:%Y-%m-%d}: no peer accepts it; run cellwatt secure renew"]
    if begin > now:
        return [f"{what} begins only on {begin:%Y-%m-%d}: is this PC's clock right?"]
    if end < now + SOON:
        return [f"{what} ends on {end:%Y-%m-%d}, in {(end - now).days} days: run cellwatt secure renew"]
    return []


def _bytes(path: Path | None) -> bytes | None:
    try:
        return None if path is None else path.read_bytes()
    except OSError:
        return None
