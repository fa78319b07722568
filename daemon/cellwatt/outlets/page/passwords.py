"""Passwords as settings hold them: scrypt hashes as text, ``scrypt$n$r$p$salt$hash``. Pure but for random numbers."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets
from dataclasses import dataclass
from typing import Final

N, R, P = 2**14, 8, 5
"""Cost of a new hash: 16 MiB and a quarter of a second of one core."""
LONGEST: Final = 1024
"""Characters of a password."""
_LEAST_COST: Final = 2**14 * 8
_MOST_MEMORY: Final = 64 * 2**20
_MOST_REPEATS: Final = 16
_SALT, _HASH = 16, 32
_SHORTEST_SALT: Final = 8


@dataclass(frozen=True, slots=True)
class Hash:
    """A password's hash with the cost and salt it was made with."""

    n: int
    r: int
    p: int
    salt: bytes
    value: bytes

    def __str__(self) -> str:
        salt, value = (base64.b64encode(part).decode() for part in (self.salt, self.value))
        return f"scrypt${self.n}${self.r}${self.p}${salt}${value}"

    def fits(self, password: str) -> bool:
        """True if this is the hash of a password; takes its cost, and as long for a wrong one."""
        found = _scrypt(password, self.salt, self.n, self.r, self.p)
        return hmac.compare_digest(found, self.value) and len(password) <= LONGEST


def hash_of(password: str, n: int = N, r: int = R, p: int = P) -> Hash:
    """The hash of a password with a new salt. Raises ``ValueError`` if it is empty or too long."""
    if not 0 < len(password) <= LONGEST:
        raise ValueError(f"a password has 1 to {LONGEST} characters")
    salt = secrets.token_bytes(_SALT)
    return Hash(n, r, p, salt, _scrypt(password, salt, n, r, p))


def parse(text: str) -> Hash:
    """Read a hash. Raises ``ValueError`` for anything else, and for a cost that is too low or takes too much memory."""
    kind, *parts = text.split("$")
    try:
        n, r, p = (int(part) for part in parts[:3])
        salt, value = (base64.b64decode(part, validate=True) for part in parts[3:])
    except (ValueError, binascii.Error):
        kind, n, r, p, salt, value = "", 1, 1, 1, b"", b""
    if kind != "scrypt" or len(value) != _HASH or len(salt) < _SHORTEST_SALT:
        raise ValueError("expected the hash of a password, as 'cellwatt view --hash-password' prints it")
    if n < 2 or n & (n - 1) or n * r < _LEAST_COST or 128 * n * r > _MOST_MEMORY or not 0 < p <= _MOST_REPEATS:
        raise ValueError("the cost of this hash is out of range: make a new one with 'cellwatt view --hash-password'")
    return Hash(n, r, p, salt, value)


def _scrypt(password: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    known = password[:LONGEST].encode("utf-8", "surrogatepass")
    return hashlib.scrypt(known, salt=salt, n=n, r=r, p=p, maxmem=2 * _MOST_MEMORY, dklen=_HASH)
