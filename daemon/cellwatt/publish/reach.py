"""How a program beside the daemon reaches a cell that a settings file describes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import ValidationError

from cellwatt.errors import ConfigError
from cellwatt.publish.link import LinkSettings
from cellwatt.publish.sink import ZenohSettings

if TYPE_CHECKING:
    from cellwatt.config import CellConfig


def link_to(config: CellConfig, connect: str | None = None, hint: str = "") -> LinkSettings:
    """A client's link to the cell: at ``connect``, or where the cell listens or connects, with its credentials.

    Raises ``ConfigError``, with a ``hint`` of what else could be done, where the cell is not on the bus.
    """
    zenoh = config.sinks["zenoh"].settings if "zenoh" in config.sinks else None
    endpoints = (*zenoh.listen, *zenoh.connect) if isinstance(zenoh, ZenohSettings) else ()
    if not (connect or endpoints):
        raise ConfigError(f"{config.path}: the cell is not on the bus: zenoh has neither listen nor connect{hint}")
    endpoint = connect or endpoints[0].replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
    link = client_of(endpoint)
    if not isinstance(zenoh, ZenohSettings):
        return link
    return link.model_copy(update={key: getattr(zenoh, key) for key in ("tls", "user", "password", "namespace")})


def client_of(endpoint: str) -> LinkSettings:
    """A client's link to an endpoint. Raises ``ConfigError`` where it is none."""
    try:
        return LinkSettings(mode="client", connect=(endpoint,))
    except ValidationError as error:
        raise ConfigError("; ".join(e["msg"].removeprefix("Value error, ") for e in error.errors())) from None
