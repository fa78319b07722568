"""Access to an OPC UA server: users with passwords, and clients with trusted certificates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from hmac import compare_digest
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.crypto.uacrypto import der_from_x509, load_certificate
from asyncua.server.user_managers import UserManager
from cryptography import x509


class Users(UserManager):  # type: ignore[misc]
    """Admits users with their passwords, or anyone if there are no users; nobody may change nodes."""

    def __init__(self, users: Mapping[str, str]) -> None:
        self._users = users

    def get_user(
        self, iserver: Any, username: str | None = None, password: str | bytes | None = None, certificate: Any = None
    ) -> User | None:
        """Return the user, or ``None`` if access is denied."""
        if not self._users:
            return User(role=UserRole.User)
        known = self._users.get(username or "")
        given = password if isinstance(password, bytes) else (password or "").encode()
        if known is None or not compare_digest(known.encode(), given):
            return None
        return User(role=UserRole.User, name=username)


async def trust_only(server: Server, files: Iterable[Path]) -> None:
    """Make a server refuse clients with other certificates than those in PEM files."""
    wanted = {der_from_x509(await load_certificate(file, "pem")) for file in files}

    async def check(certificate: x509.Certificate, _: ua.ApplicationDescription) -> None:
        if der_from_x509(certificate) not in wanted:
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)

    server.iserver.certificate_validator = check
