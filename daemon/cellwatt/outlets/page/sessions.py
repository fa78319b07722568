"""Logins of browsers, stored across restarts in a file that only its owner may read; hashes of passwords."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import logging
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from cellwatt.files import read_bytes, replace_bytes

log = logging.getLogger(__name__)

FILE: Final = "page-logins.json"
"""Name of the file beside the recordings."""
LASTS: Final = 30 * 86400.0
"""Lifetime, s, of a login after its last use."""
MOST: Final = 1000
"""Largest number of logins; the one that expires first is removed."""
_NOTED: Final = 3600.0
"""Interval, s, at which the use of a login is stored."""
_LARGEST: Final = 1_000_000


@dataclass(slots=True)
class Login:
    """One browser's login; ``proof`` changes with the user's password."""

    name: str
    proof: str
    ends: float


@dataclass(slots=True)
class _Saved:
    """Content of the file: the secret of this page (hex), and logins by the digest of their token."""

    secret: str
    logins: dict[str, Login]


_STORED: Final = TypeAdapter(_Saved)


class Sessions:
    """Logins by the SHA-256 of the browser's token; ``file`` ``None``: in memory only.

    ``proof_of`` returns a digest for a user's current password, ``None`` for an unknown user: a login with another
    digest is invalid. ``clock`` is UTC, s. Only ``save`` and ``load`` block.
    """

    def __init__(
        self,
        file: Path | None,
        proof_of: Callable[[str], str | None],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._file = file
        self._proof_of = proof_of
        self._clock = clock
        self._logins: dict[str, Login] = {}
        self._secret = secrets.token_bytes(32)
        self.changed = False
        """True if there are changes to save."""

    def begin(self, name: str) -> str:
        """Log a user in; return the token for the browser."""
        token = new_token()
        self._logins[_key(token)] = Login(name, self._proof_of(name) or "", self._clock() + LASTS)
        while len(self._logins) > MOST:
            del self._logins[min(self._logins, key=lambda key: self._logins[key].ends)]
        self.changed = True
        return token

    def name_of(self, token: str) -> str | None:
        """The user logged in with a token; ``None`` if the token is unknown or has expired."""
        login = self._logins.get(_key(token))
        if login is None:
            return None
        now = self._clock()
        if login.ends < now or login.proof != self._proof_of(login.name):
            self.end(token)
            return None
        if login.ends < now + LASTS - _NOTED:
            login.ends, self.changed = now + LASTS, True
        return login.name

    def end(self, token: str) -> None:
        """Log out."""
        if self._logins.pop(_key(token), None) is not None:
            self.changed = True

    def csrf(self, token: str) -> str:
        """CSRF token that a browser with this token must send with each changing request."""
        return hmac.new(self._secret, token.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()

    def load(self) -> None:
        """Load saved logins; blocks. A file that is damaged, or that other users may read, is ignored."""
        if self._file is None:
            return
        try:
            saved = _STORED.validate_json(read_bytes(self._file, _LARGEST))
            if self._file.stat().st_mode & 0o077:
                raise ValueError("other users may read it, so its logins are void")
            self._secret, self._logins = bytes.fromhex(saved.secret), saved.logins
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            reason = "it is damaged" if isinstance(error, ValidationError) else error
            log.warning("%s: %s; everybody has to log in again", self._file, reason)

    def save(self) -> None:
        """Save the logins, if changed; blocks. A failure is logged; the next change tries again."""
        if self._file is None or not self.changed:
            return
        self.changed = False
        now = self._clock()
        logins = {key: login for key, login in list(self._logins.items()) if login.ends > now}
        try:
            replace_bytes(self._file, _STORED.dump_json(_Saved(self._secret.hex(), logins)), 0o600)
        except OSError as error:
            log.warning("%s cannot be written, logins end with this process: %s", self._file, error.strerror)


def new_token() -> str:
    """A random token."""
    return secrets.token_urlsafe(32)


def _key(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


N, R, P = 2**14, 8, 5
"""Cost of a new hash: 16 MiB and 0.25 s of one core."""
LONGEST: Final = 1024
"""Longest password, characters."""
_LEAST_COST: Final = 2**14 * 8
_MOST_MEMORY: Final = 64 * 2**20
_MOST_REPEATS: Final = 16
_SALT, _HASH = 16, 32
_SHORTEST_SALT: Final = 8


@dataclass(frozen=True, slots=True)
class Hash:
    """Hash of a password, with its cost parameters and salt."""

    n: int
    r: int
    p: int
    salt: bytes
    value: bytes

    def __str__(self) -> str:
        salt, value = (base64.b64encode(part).decode() for part in (self.salt, self.value))
        return f"scrypt${self.n}${self.r}${self.p}${salt}${value}"

    def fits(self, password: str) -> bool:
        """True if this is the hash of ``password``; takes equally long for a wrong password."""
        found = _scrypt(password, self.salt, self.n, self.r, self.p)
        return hmac.compare_digest(found, self.value) and len(password) <= LONGEST


def hash_of(password: str, n: int = N, r: int = R, p: int = P) -> Hash:
    """The hash of a password with a new salt. Raises ``ValueError`` if it is empty or too long."""
    if not 0 < len(password) <= LONGEST:
        raise ValueError(f"a password has 1 to {LONGEST} characters")
    salt = secrets.token_bytes(_SALT)
    return Hash(n, r, p, salt, _scrypt(password, salt, n, r, p))


def parse(text: str) -> Hash:
    """Parse a hash. Raises ``ValueError`` if it is malformed, its cost too low or its memory too large."""
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
