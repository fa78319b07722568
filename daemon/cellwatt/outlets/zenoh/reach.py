"""Links from a program beside the daemon to a cell described by a settings file."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from cellwatt.errors import ConfigError, OutletError
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, TlsSettings, open_session
from cellwatt.outlets.zenoh.outlet import ZenohSettings

if TYPE_CHECKING:
    from cellwatt.config import CellConfig

PATIENCE: Final = 5.0  # s, for a link to a cell and for its answer


def link_to(
    config: CellConfig, connect: str | None = None, hint: str = "", tls: TlsSettings | None = None
) -> LinkSettings:
    """A client's link to the cell, at ``connect`` or at the cell's own endpoints, with its credentials.

    ``tls`` replaces the cell's own certificates. Raises ``ConfigError``, with a ``hint`` of what else to do, if the
    cell is not on the bus.
    """
    zenoh = config.outlets["zenoh"].settings if "zenoh" in config.outlets else None
    endpoints = (*zenoh.listen, *zenoh.connect) if isinstance(zenoh, ZenohSettings) else ()
    if not (connect or endpoints):
        raise ConfigError(f"{config.path}: the cell is not on the bus: zenoh has neither listen nor connect{hint}")
    if not isinstance(zenoh, ZenohSettings):
        return client_of(connect or endpoints[0], tls)
    endpoint = connect or endpoints[0].replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
    tls = tls or zenoh.tls
    if tls is not None and endpoint not in (connect, endpoints[0]):
        # A certificate names the PC, not the loopback address by which we reach it without leaving it.
        tls = tls.model_copy(update={"verify_name": False})
    return client_of(endpoint, tls, user=zenoh.user, password=zenoh.password, namespace=zenoh.namespace)


def client_of(endpoint: str, tls: TlsSettings | None = None, **more: Any) -> LinkSettings:
    """A client's link to an endpoint. Raises ``ConfigError`` if it is not one, or certificates are missing."""
    try:
        return LinkSettings(mode="client", connect=(endpoint,), tls=tls, **more)
    except ValidationError as error:
        raise ConfigError("; ".join(e["msg"].removeprefix("Value error, ") for e in error.errors())) from None


def ask_cell(config: CellConfig, question: str) -> dict[str, Any]:
    """The running daemon's answer to ``@/question`` (``status``, ``config``, ``schema`` …), from JSON.

    Raises ``OutletError`` if nobody answers within some seconds, or not with an answer.
    """
    import zenoh

    keys = CellKeys(config.site, config.cell)
    session = open_session(link_to(config), lambda: False, patience=PATIENCE)
    try:
        replies = list(session.get(keys.question(question), timeout=PATIENCE))
        told = next((reply.ok for reply in replies if reply.ok is not None), None)
        if told is None:
            refused = [reply.err.payload.to_string() for reply in replies if reply.err is not None]
            raise OutletError(f"the cell {keys.root} does not answer: {', '.join(refused) or 'is its daemon running?'}")
        answer: dict[str, Any] = json.loads(told.payload.to_bytes())
    except (zenoh.ZError, ValueError) as error:
        raise OutletError(f"the cell {keys.root} gave no answer that can be read: {error}") from error
    finally:
        session.close()  # type: ignore[no-untyped-call]
    return answer
