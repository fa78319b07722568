"""Zenoh's ``access_control``: rules for publishing, asking and seeing. Pure.

Everything that is not allowed is denied. Zenoh checks both directions of each link: ``ingress`` is received from the
other end, ``egress`` is sent to it. A cell may only publish and answer questions under its own key; a viewer may only
subscribe and ask.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from cellwatt.outlets.zenoh.keys import PREFIX, CellKeys

Role = Literal["router", "cell", "viewer"]

_TELLS: Final = ("put", "declare_queryable", "reply", "liveliness_token")
"""Messages that a cell sends."""
_SEES: Final = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
"""Messages by which a viewer subscribes."""
_ASKS: Final = ("query",)


@dataclass(frozen=True, slots=True)
class Member:
    """A certificate holder that listens on ``hosts``. A viewer sees ``cells`` (empty: all) and may ask if ``asks``."""

    name: str
    role: Role
    hosts: tuple[str, ...] = ()
    cells: tuple[str, ...] = ()
    asks: bool = True


@dataclass(frozen=True, slots=True)
class _Grant:
    """Rules for links whose certificate has one of these names."""

    names: tuple[str, ...]
    rules: tuple[dict[str, Any], ...]


def for_router(site: str, cells: Sequence[Member], viewers: Sequence[Member]) -> dict[str, Any]:
    """Rules of a router between cells and viewers."""
    publishing = [_publishing(site, cell.name) for cell in cells]
    return _control([*publishing, *_seeing(site, [*map(_itself, cells), *viewers])])


def for_cell(site: str, cell: Member, viewers: Sequence[Member]) -> dict[str, Any]:
    """Rules of a cell to which viewers connect directly."""
    mine = [replace(v, cells=(cell.name,)) for v in viewers if not v.cells or cell.name in v.cells]
    return _control(_seeing(site, [_itself(cell), *mine]))


def _itself(cell: Member) -> Member:
    """The cell as its own viewer: ``cellwatt watch`` on the cell's PC uses the cell's certificate."""
    return replace(cell, cells=(cell.name,), asks=True)


def _publishing(site: str, cell: str) -> _Grant:
    keys = _keys(site, (cell,))
    tells = _rule(f"{cell} publishes", "ingress", _TELLS, keys)
    return _Grant((cell,), (tells, _rule(f"{cell} is asked", "egress", (*_SEES, *_ASKS), keys)))


def _seeing(site: str, viewers: Sequence[Member]) -> Iterator[_Grant]:
    """One grant for all viewers with the same rights."""
    for cells, asks in dict.fromkeys((v.cells, v.asks) for v in viewers):
        keys, whom = _keys(site, cells), ", ".join(cells) or "all cells"
        what = f"{'see and ask' if asks else 'see'} {whom}"
        says = _rule(what, "ingress", (*_SEES, *(_ASKS if asks else ())), keys)
        names = tuple(v.name for v in viewers if (v.cells, v.asks) == (cells, asks))
        yield _Grant(names, (says, _rule(f"{what}: what they are told", "egress", _TELLS, keys)))


def _control(grants: Iterable[_Grant]) -> dict[str, Any]:
    found = list(grants)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for grant in found for rule in grant.rules],
        # Each certificate name is a separate subject.
        "subjects": [
            {"id": name, "cert_common_names": [name]} for name in dict.fromkeys(n for g in found for n in g.names)
        ],
        "policies": [{"rules": [rule["id"] for rule in g.rules], "subjects": list(g.names)} for g in found],
    }


def _keys(site: str, cells: Sequence[str]) -> list[str]:
    """Key expressions for everything of these cells; ``**`` does not match the ``@`` of questions."""
    roots = [CellKeys(site, cell).root for cell in cells]
    if roots:
        return [key for root in roots for key in (f"{root}/**", f"{root}/@/**")]
    return [f"{PREFIX}/{site}/**", f"{PREFIX}/{site}/*/@/**"]


def _rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}
