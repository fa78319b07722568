"""Settings of the cell as an OPC UA server."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from pydantic import ConfigDict, Field, FilePath, SecretStr, field_validator
from pydantic import model_validator as model_check

from cellwatt.host import check_host
from cellwatt.publish.exposure import stays_here
from cellwatt.quantity import Hertz
from cellwatt.sink import SinkSettings
from cellwatt.sinks.selection import Selection


class OpcUaSinkSettings(SinkSettings, Selection):
    """The cell as an OPC UA server."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, hide_input_in_errors=True)

    listen: str = "127.0.0.1:4840"
    """Address and port; port 0 is any that is free."""
    path: str = Field("/cellwatt", pattern=r"^/[A-Za-z0-9/_.-]*$")
    """Path of the endpoint's URL."""
    rate: Hertz = 10.0
    """Rows a second, at most the frames' rate: a row has the means of its span, and the last of what is no measure."""
    certificate: FilePath | None = None
    """The server's certificate (PEM): with it, messages are signed or encrypted (Basic256Sha256) and never plain."""
    key: FilePath | None = None
    """Private key (PEM) of ``certificate``."""
    trusted: tuple[FilePath, ...] = ()
    """Certificates (PEM) of the clients that may come in; where none is named, any may."""
    users: Mapping[str, SecretStr] = {}
    """Passwords by user, best as ``${…}``; where there are none, whoever comes may read, and nobody acknowledge."""
    open: bool = False
    """Allow a network address without certificate, or without users and trusted certificates."""

    @field_validator("listen")
    @classmethod
    def _is_address(cls, listen: str) -> str:
        host, colon, port = listen.rpartition(":")
        if not colon or not port.isdecimal() or int(port) > 65535:
            raise ValueError("expected an address and a port, like 127.0.0.1:4840")
        check_host(host.strip("[]"))
        return listen

    @model_check(mode="after")
    def _closed(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key are needed together")
        if self.trusted and self.certificate is None:
            raise ValueError("trusted certificates are of use only with a certificate and key of the server's own")
        if not self.open and (text := self.opening):
            raise ValueError(
                f"listen: {text}; use 127.0.0.1, or give certificate, key, and users or trusted, or set open: true"
            )
        return self

    @property
    def host(self) -> str:
        """Host name or address to listen at."""
        return self.listen.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """Port to listen at."""
        return int(self.listen.rpartition(":")[2])

    @property
    def opening(self) -> str:
        """How strangers get in, in words; empty if they do not."""
        lacks = ["a certificate"] if self.certificate is None else []
        lacks += [] if self.users or self.trusted else ["users or trusted certificates"]
        if stays_here(self.host) or not lacks:
            return ""
        return f"open to the network without {' and '.join(lacks)}: whoever reaches it sees the cell"

    def told(self) -> dict[str, Any]:
        """What the process that serves needs, with passwords, JSON-ready, for it and nobody else."""
        users = {name: password.get_secret_value() for name, password in self.users.items()}
        own = self.model_dump(mode="json", include={"path", "certificate", "key", "trusted"})
        return {**own, "host": self.host, "port": self.port, "users": users}

    def warnings(self) -> tuple[str, ...]:
        """Access left open on purpose."""
        return (f"listen: {self.listen}: {self.opening} (open: true)",) if self.opening else ()
