"""Links from a program beside the daemon to a cell described by a settings file."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

from pydantic import ValidationError

from cellwatt.errors import ConfigError, OutletError, ProtocolError
from cellwatt.outlets.zenoh.keys import PREFIX, CellKeys, escape
from cellwatt.outlets.zenoh.link import LinkSettings, TlsSettings, open_session
from cellwatt.outlets.zenoh.outlet import ZenohSettings
from cellwatt.outlets.zenoh.received import read_health

if TYPE_CHECKING:
    import zenoh

    from cellwatt.config import CellConfig


PATIENCE: Final = 5.0  # s, for a link to a cell and for its answer
_INSTEAD: Final = "; set zenoh: {listen: [tcp/127.0.0.1:7447]}, or ask the outlet metrics"


def link_to(
    config: CellConfig, connect: str | None = None, hint: str = "", tls: TlsSettings | None = None
) -> LinkSettings:
    """A client's link to the cell, at ``connect``, or at the cell's listen endpoint or routers, with its credentials.

    ``tls`` replaces the cell's own certificates. Raises ``ConfigError``, with ``hint`` appended, if the cell is not on
    the bus.
    """
    zenoh = config.outlets["zenoh"].settings if "zenoh" in config.outlets else None
    endpoints = (zenoh.listen[:1] or zenoh.connect) if isinstance(zenoh, ZenohSettings) else ()
    if not (connect or endpoints):
        lacking = "zenoh is off" if zenoh is None else "zenoh has neither listen nor connect"
        raise ConfigError(f"{config.path}: the cell is not on the bus: {lacking}{hint}")
    local = tuple(e.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:") for e in endpoints)
    chosen = (connect,) if connect else local
    if not isinstance(zenoh, ZenohSettings):
        return client_of(chosen, tls)
    tls = tls or zenoh.tls
    if tls is not None and not connect and local != endpoints:
        # A certificate names the PC, not the loopback address used here.
        tls = tls.model_copy(update={"verify_name": False})
    return client_of(chosen, tls, user=zenoh.user, password=zenoh.password)


def client_of(endpoints: tuple[str, ...], tls: TlsSettings | None = None, **more: Any) -> LinkSettings:
    """A client's link to one of the endpoints. Raises ``ConfigError`` if one is invalid or lacks certificates."""
    try:
        return LinkSettings(mode="client", connect=endpoints, tls=tls, **more)
    except ValidationError as error:
        raise ConfigError("; ".join(e["msg"].removeprefix("Value error, ") for e in error.errors())) from None


def ask_cell(config: CellConfig, question: str) -> dict[str, Any]:
    """The running daemon's answer to ``@/question`` (``status``, ``config``, ``schema`` …), parsed from JSON.

    Raises ``OutletError`` if no answer arrives within some seconds, or it cannot be parsed.
    """
    import zenoh

    keys = CellKeys(config.site, config.cell)
    try:
        with open_session(link_to(config, hint=_INSTEAD), patience=PATIENCE) as session:
            replies = list(session.get(keys.question(question), timeout=PATIENCE))
        sample = next((reply.ok for reply in replies if reply.ok is not None), None)
        if sample is None:
            refused = [reply.err.payload.to_string() for reply in replies if reply.err is not None]
            raise OutletError(f"the cell {keys.root} does not answer: {', '.join(refused) or 'is its daemon running?'}")
        answer: dict[str, Any] = json.loads(sample.payload.to_bytes())
    except (zenoh.ZError, ValueError) as error:
        raise OutletError(f"the cell {keys.root} gave an invalid answer: {error}") from error
    return answer


_TIMEOUT: Final = 2.0  # s, for an answer
_PAUSE: Final = 0.2  # s
_MOST: Final = 12
"""Most cells named in an error."""


def cells_heard(session: zenoh.Session, site: str | None = None) -> list[tuple[str, str]]:
    """Site and name of each running cell that this session may see, sorted; of one site or of all."""
    key = f"{PREFIX}/{'*' if site is None else escape(site)}/*"
    found = (str(reply.ok.key_expr).split("/") for reply in _tokens(session, key) if reply.ok is not None)
    return sorted({(unquote(chunks[1]), unquote(chunks[2])) for chunks in found})


def site_health(session: zenoh.Session, site: str) -> dict[str, Mapping[str, Any]]:
    """Health of each running cell of a site, by name; empty for cells that do not answer."""
    import zenoh

    found: dict[str, Mapping[str, Any]] = {name: {} for _, name in cells_heard(session, site)}
    question = f"{PREFIX}/{escape(site)}/*/@/status"
    # Each cell answers under its own key: no answer may replace that of another cell.
    for reply in session.get(question, timeout=_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE):
        if reply.ok is not None:
            with contextlib.suppress(ProtocolError):  # the cell counts as not answering
                found[unquote(str(reply.ok.key_expr).split("/")[2])] = read_health(reply.ok)[1].status
    return dict(sorted(found.items()))


def await_cell(link: LinkSettings, site: str, cell: str, patience: float) -> None:
    """Return once a cell is on the bus; blocks.

    Raises ``OutletError`` after ``patience`` s with the reason: no answer from the endpoint, the session is refused
    there, or the cell is not on the bus; then the error names the cells that are.
    """
    keys = CellKeys(site, cell)
    end = time.monotonic() + patience
    with open_session(link, patience=patience) as session:
        while not any(reply.ok is not None for reply in _tokens(session, keys.root)):
            if time.monotonic() > end:
                raise OutletError(_absent(link, site, cell, cells_heard(session)))
            time.sleep(_PAUSE)


def _tokens(session: zenoh.Session, key: str) -> list[zenoh.Reply]:
    return list(session.liveliness().get(key, timeout=_TIMEOUT))


def _absent(link: LinkSettings, site: str, cell: str, heard: list[tuple[str, str]]) -> str:
    where = ", ".join(link.connect)
    if heard:
        names = ", ".join("/".join(name) for name in heard[:_MOST])
        return f"{where}: no cell {site}/{cell} is on the bus; it has {names}{' …' if len(heard) > _MOST else ''}"
    return (
        f"{where}: no cell {site}/{cell} is on the bus: is the daemon running, are site and cell right, "
        "and may you see it (cellwatt secure list)?"
    )
