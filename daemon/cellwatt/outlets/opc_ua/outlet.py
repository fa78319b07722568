"""Serves a cell over OPC UA, from a separate process."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar, Final, Self

from pydantic import Field, FilePath, SecretStr
from pydantic import model_validator as model_check

from cellwatt.door.settings import Listening
from cellwatt.outlets.apart.outlet import ApartOutlet
from cellwatt.outlets.selection import Selection
from cellwatt.quantity import Hertz
from cellwatt.results import Alarm, Energy, Event, Result


class OpcUaOutletSettings(Listening, Selection):
    """The cell as an OPC UA server."""

    secured, login = "a certificate", "users or trusted certificates"

    listen: str = "127.0.0.1:4840"
    """Address and port; port 0 selects a free port."""
    path: str = Field("/cellwatt", pattern=r"^/[A-Za-z0-9/_.-]*$")
    """Path of the endpoint's URL."""
    rate: Hertz = 10.0
    """Rows per second, at most the frames' rate. A row has means over its span; states and counters, last values."""
    certificate: Path | None = None
    """The server's certificate (PEM). With it, all messages are signed or encrypted (Basic256Sha256)."""
    trusted: tuple[FilePath, ...] = ()
    """Certificates (PEM) of the clients that may connect; default: any client."""
    users: Mapping[str, SecretStr] = {}
    """Passwords by user, best as ``${…}``. Without users, any client may read and none may acknowledge."""
    open: bool = False
    """Allow a network address without a certificate, or without users and trusted certificates."""

    @model_check(mode="after")
    def _trusting(self) -> Self:
        if self.trusted and self.certificate is None:
            raise ValueError("trusted certificates are of use only with a certificate and key of the server's own")
        return self

    @property
    def asks(self) -> bool:
        """See ``Listening.asks``."""
        return bool(self.users or self.trusted)


if find_spec("asyncua") is None:  # only the serving process imports it; a missing one is reported at once
    raise ModuleNotFoundError("No module named 'asyncua'", name="asyncua")

ACKNOWLEDGED: Final = "acknowledged"
"""Kind of the event of an acknowledgement."""


class OpcUaOutlet(ApartOutlet[OpcUaOutletSettings]):
    """Serves a cell's values, energies, health and alarms to OPC UA clients, from a separate process."""

    Settings: ClassVar[type[OpcUaOutletSettings]] = OpcUaOutletSettings
    title = "The cell as an OPC UA server"
    module = "cellwatt.outlets.opc_ua.serving"
    what = "the OPC UA server"
    memory = 512 << 20
    forgets = Energy

    def takes(self, item: Result | Event) -> bool:
        """True for items with a node in the server: alarms, acknowledgements and energies."""
        return isinstance(item, Alarm | Energy) or (isinstance(item, Event) and item.kind == ACKNOWLEDGED)
