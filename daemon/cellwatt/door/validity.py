"""Warns of certificates that are wrong or about to expire."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

SOON: Final = timedelta(days=30)
"""Rest of a certificate's time from which on it is told."""


def warnings(certificate: Path | None, key: Path | None, authority: Path | None = None) -> tuple[str, ...]:
    """One line per problem, after the setting of a file. Those that cannot be read are told where they are opened."""
    if certificate is None and authority is None:
        return ()
    try:
        from cellwatt.door import certificates  # noqa: F401
    except ImportError:
        return ("nobody looks when the certificates end: that needs pip install 'cellwatt[secure]'",)
    now = datetime.now(UTC)
    own = [] if certificate is None else _own(certificate, key, now)
    return tuple(own + _authorities(authority, now))


def _own(file: Path, key_file: Path | None, now: datetime) -> list[str]:
    from cellwatt.door.certificates import belongs, read

    certificate, key = _bytes(file), _bytes(key_file)
    if certificate is None:
        return []
    try:
        first, *_ = read(certificate)
    except ValueError:
        return [f"certificate: {file} is no certificate"]
    found = _time(f"certificate: {file}", first.not_valid_before_utc, first.not_valid_after_utc, now)
    try:
        if key is not None and not belongs(first, key):
            found.append(f"key: {key_file} is not the key of {file}")
    except (ValueError, TypeError):
        found.append(f"key: {key_file} is no private key that can be read without a password")
    if key_file is not None and key is not None and key_file.stat().st_mode & 0o007:
        found.append(f"key: {key_file} may be read by everybody on this PC: chmod 600")
    return found


def _authorities(path: Path | None, now: datetime) -> list[str]:
    """Warnings about authorities; one valid authority is enough, as there are two during a change."""
    from cellwatt.door.certificates import read

    data = _bytes(path)
    if data is None:
        return []
    try:
        all_of_them = read(data)
    except ValueError:
        return [f"root_ca: {path} is no certificate"]
    last = max(all_of_them, key=lambda c: c.not_valid_after_utc)
    return _time(f"root_ca: {path}", last.not_valid_before_utc, last.not_valid_after_utc, now)


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
