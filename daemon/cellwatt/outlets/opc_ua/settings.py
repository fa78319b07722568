"""Settings of the cell as an OPC UA server."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import Field, FilePath, SecretStr
from pydantic import model_validator as model_check

from cellwatt.door.settings import Listening
from cellwatt.outlets.selection import Selection
from cellwatt.quantity import Hertz


class OpcUaOutletSettings(Listening, Selection):
    """The cell as an OPC UA server."""

    listen: str = "127.0.0.1:4840"
    """Address and port; port 0 is any that is free."""
    path: str = Field("/cellwatt", pattern=r"^/[A-Za-z0-9/_.-]*$")
    """Path of the endpoint's URL."""
    rate: Hertz = 10.0
    """Rows a second, at most the frames' rate: a row has the means of its span, and the last of what is no measure."""
    certificate: Path | None = None
    """The server's certificate (PEM): with it, messages are signed or encrypted (Basic256Sha256) and never plain."""
    trusted: tuple[FilePath, ...] = ()
    """Certificates (PEM) of the clients that may come in; where none is named, any may."""
    users: Mapping[str, SecretStr] = {}
    """Passwords by user, best as ``${…}``; where there are none, whoever comes may read, and nobody acknowledge."""
    open: bool = False
    """Allow a network address without certificate, or without users and trusted certificates."""

    @model_check(mode="after")
    def _trusting(self) -> Self:
        if self.trusted and self.certificate is None:
            raise ValueError("trusted certificates are of use only with a certificate and key of the server's own")
        return self

    @property
    def opening(self) -> str:
        """See ``Listening.opening``."""
        lacks = ["a certificate"] if self.certificate is None else []
        lacks += [] if self.users or self.trusted else ["users or trusted certificates"]
        if self.local or not lacks:
            return ""
        return f"open to the network without {' and '.join(lacks)}: whoever reaches it sees the cell"

    def told(self) -> dict[str, Any]:
        """What the process that serves needs, with passwords, JSON-ready, for it and nobody else."""
        users = {name: password.get_secret_value() for name, password in self.users.items()}
        own = self.model_dump(mode="json", include={"path", "certificate", "key", "trusted"})
        return {**own, "host": self.host, "port": self.port, "users": users}

    @property
    def advice(self) -> str:
        """See ``Listening.advice``."""
        return "use 127.0.0.1, or give certificate, key, and users or trusted, or set open: true"
