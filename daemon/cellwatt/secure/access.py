"""Who may publish, ask and see, as Zenoh's ``access_control``. Pure.

What is not allowed is denied. Zenoh looks at both directions of each link: ``ingress`` is what comes from the other
side, ``egress`` what goes to it. A cell may put messages and answer questions under its own key and nothing else; a
viewer may subscribe and ask, and put nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from cellwatt.publish.keys import PREFIX, CellKeys

_TELLS: Final = ("put", "declare_queryable", "reply", "liveliness_token")
"""What comes from a cell."""
_SEES: Final = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
"""How a viewer says what it wants to see."""
_ASKS: Final = ("query",)


@dataclass(frozen=True, slots=True)
class Viewer:
    """Who may see the cells named, or all of the site where none is named; ``asks``: and put questions to them."""

    name: str
    cells: tuple[str, ...] = ()
    asks: bool = True


def for_router(site: str, cells: Sequence[str], viewers: Sequence[Viewer]) -> dict[str, Any]:
    """Rules of a router between cells and viewers."""
    rules, policies = [], []
    for cell in cells:
        keys = _keys(site, (cell,))
        rules += [
            _rule(f"{cell} publishes", "ingress", _TELLS, keys),
            _rule(f"{cell} is asked", "egress", (*_SEES, *_ASKS), keys),
        ]
        policies.append(_policy(cell, f"{cell} publishes", f"{cell} is asked"))
    return _control(rules, policies, [*cells, *(v.name for v in viewers)], site, viewers)


def for_cell(site: str, cell: str, viewers: Sequence[Viewer]) -> dict[str, Any]:
    """Rules of a cell that viewers connect to themselves."""
    seeing = [v for v in viewers if not v.cells or cell in v.cells]
    return _control([], [], [v.name for v in seeing], site, [Viewer(v.name, (cell,), v.asks) for v in seeing])


def _control(
    rules: list[dict[str, Any]],
    policies: list[dict[str, Any]],
    names: Sequence[str],
    site: str,
    viewers: Sequence[Viewer],
) -> dict[str, Any]:
    for kind in dict.fromkeys((v.cells, v.asks) for v in viewers):
        cells, asks = kind
        whom = ", ".join(cells) or site
        messages = (*_SEES, *(_ASKS if asks else ()))
        sees, told = f"{'see and ask' if asks else 'see'} {whom}", f"are told by {whom}{'' if asks else ', live'}"
        keys = _keys(site, cells)
        rules = [*rules, _rule(sees, "ingress", messages, keys), _rule(told, "egress", _TELLS, keys)]
        mine = [v.name for v in viewers if (v.cells, v.asks) == kind]
        policies = [*policies, {"rules": [sees, told], "subjects": mine}]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        # Each name of a certificate is a subject of its own.
        "subjects": [{"id": name, "cert_common_names": [name]} for name in names],
        "policies": policies,
    }


def _keys(site: str, cells: Sequence[str]) -> list[str]:
    """Everything of these cells; ``**`` does not match the ``@`` of questions."""
    roots = [CellKeys(site, cell).root for cell in cells]
    if roots:
        return [key for root in roots for key in (f"{root}/**", f"{root}/@/**")]
    return [f"{PREFIX}/{site}/**", f"{PREFIX}/{site}/*/@/**"]


def _rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}


def _policy(subject: str, *rules: str) -> dict[str, Any]:
    return {"rules": list(rules), "subjects": [subject]}
