"""Cells that are heard on the bus, by their liveliness tokens."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote

from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.zenoh.keys import PREFIX, CellKeys, escape
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.received import Health, read_health

if TYPE_CHECKING:
    import zenoh

_TIMEOUT: Final = 2.0  # s, for the answer of the other side
_PAUSE: Final = 0.2  # s
_MOST: Final = 12
"""Cells that an error names."""


def cells_heard(session: zenoh.Session, site: str | None = None) -> list[tuple[str, str]]:
    """Site and name of each cell that is up and that we may see, in order; of one site, or of all."""
    key = f"{PREFIX}/{'*' if site is None else escape(site)}/*"
    found = (str(reply.ok.key_expr).split("/") for reply in _tokens(session, key) if reply.ok is not None)
    return sorted({(unquote(chunks[1]), unquote(chunks[2])) for chunks in found})


def site_health(session: zenoh.Session, site: str) -> dict[str, Health | None]:
    """Health of each cell of a site that is heard, by name; ``None`` of those that do not answer us."""
    import zenoh

    found: dict[str, Health | None] = dict.fromkeys(name for _, name in cells_heard(session, site))
    question = f"{PREFIX}/{escape(site)}/*/@/status"
    # Each cell answers under its own key: no answer must be taken for another's.
    for reply in session.get(question, timeout=_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE):
        if reply.ok is not None:
            with contextlib.suppress(ProtocolError):  # it stays one that does not answer
                found[unquote(str(reply.ok.key_expr).split("/")[2])] = read_health(reply.ok)[1]
    return dict(sorted(found.items()))


def await_cell(
    link: LinkSettings, site: str, cell: str, patience: float, stopped: Callable[[], bool] = lambda: False
) -> None:
    """Return once a cell is on the bus; blocks.

    Raises ``OutletError`` after ``patience`` s, or once ``stopped()`` is true, with the reason: nobody answers at the
    endpoint, the session is refused there, or the cell is not heard; then with the cells that are.
    """
    keys = CellKeys(site, cell)
    end = time.monotonic() + patience
    with open_session(link, stopped, patience) as session:
        while not any(reply.ok is not None for reply in _tokens(session, keys.root)):
            if stopped() or time.monotonic() > end:
                raise OutletError(_absent(link, site, cell, cells_heard(session)))
            time.sleep(_PAUSE)


def _tokens(session: zenoh.Session, key: str) -> list[zenoh.Reply]:
    return list(session.liveliness().get(key, timeout=_TIMEOUT))


def _absent(link: LinkSettings, site: str, cell: str, heard: list[tuple[str, str]]) -> str:
    where = ", ".join(link.connect)
    if heard:
        names = ", ".join("/".join(name) for name in heard[:_MOST])
        return f"{where}: no cell is heard as {site}/{cell}; there is {names}{' …' if len(heard) > _MOST else ''}"
    return (
        f"{where}: no cell is heard as {site}/{cell}: is the daemon running, are site and cell right, "
        "and may you see it (cellwatt secure list)?"
    )
