"""Settings of a door: address, certificate, access."""

from __future__ import annotations

import re
import ssl
from pathlib import Path
from typing import ClassVar, Final

from pydantic import field_validator
from pydantic import model_validator as model_check

from cellwatt.door import validity
from cellwatt.errors import OutletError
from cellwatt.files import unreadable
from cellwatt.host import LAST_PORT, check_host, stays_here
from cellwatt.outlet import OutletSettings, both_or_neither, refusal
from cellwatt.section import Certified

_LISTEN: Final = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\[\]:]+):(\d{1,5})")


class Listening(OutletSettings, Certified):
    """Settings of an outlet that listens: on this PC only, or with certificate and login, unless ``open`` is set."""

    secured: ClassVar[str] = "TLS"
    """What the certificate provides, for messages."""
    login: ClassVar[str] = "users"
    """How users are admitted, for messages."""

    listen: str
    """Address and port."""
    certificate: Path | None = None
    """Certificate (PEM) for https, followed by the intermediate authorities, if there are any."""
    key: Path | None = None
    """Private key of ``certificate``."""
    open: bool = False
    """Allow access from the network without certificate or login."""

    @field_validator("listen")
    @classmethod
    def _address(cls, listen: str) -> str:
        found = _LISTEN.fullmatch(listen)
        if found is None or int(found[2]) > LAST_PORT:
            expected = cls.model_fields["listen"].default
            raise ValueError(f"{listen!r} is not an address; expected host:port, like {expected}")
        check_host(found[1].strip("[]"))
        return listen

    @model_check(mode="after")
    def _closed(self) -> Listening:
        both_or_neither(certificate=self.certificate, key=self.key)
        if not self.open and (text := self.opening):
            advice = f"use 127.0.0.1, or give certificate, key and {self.login}, or set open: true"
            raise refusal(self, (("listen",), self.listen, f"{text}; {advice}"))
        return self

    @property
    def host(self) -> str:
        """Host name or address to listen on."""
        return self.listen.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """Port to listen on; 0 for a free one."""
        return int(self.listen.rpartition(":")[2])

    @property
    def local(self) -> bool:
        """True if only this PC can connect."""
        return stays_here(self.host)

    @property
    def asks(self) -> bool:
        """True if every client must log in."""
        return False

    @property
    def opening(self) -> str:
        """How outsiders get access, as text; empty if they cannot."""
        lacks = [*([self.secured] if self.certificate is None else []), *([] if self.asks else [self.login])]
        if self.local or not lacks:
            return ""
        harm = "passwords and data are sent unencrypted" if self.asks else "anyone who reaches it sees the cell"
        return f"open to the network without {' and '.join(lacks)}: {harm}"

    def warnings(self) -> tuple[str, ...]:
        """Access left open on purpose, and keys and certificates that are missing or expire soon."""
        ways = (f"listen: {self.listen}: {self.opening} (open: true)",) if self.opening else ()
        files = unreadable({"certificate": self.certificate, "key": self.key})
        return (*ways, *files, *validity.warnings(self.certificate, self.key))


def tls_context(settings: Listening) -> ssl.SSLContext | None:
    """TLS context for serving; ``None`` without a certificate. Reads files. Raises ``OutletError``."""
    if settings.certificate is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(settings.certificate, settings.key, password=lambda: b"")
    except (OSError, ValueError) as error:
        text = f"certificate: {settings.certificate} with key {settings.key} cannot be used: {error}"
        raise OutletError(text) from None
    return context
