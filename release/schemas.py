"""JSON Schema of every JSON message, made from the code that reads and writes them.

``python release/schemas.py docs/schemas`` writes them as files.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Final

from cellwatt.outlets.zenoh.messages import TYPES, adapter

_MARK: Final = {
    "type": "object",
    "description": "Where the message stands: it is number sequence of its topic since session, UTC ns.",
    "properties": {"session": {"type": "integer"}, "sequence": {"type": "integer"}},
    "required": ["session", "sequence"],
}
_HEALTH: Final = {
    "mark": _MARK,
    "session": {"type": "integer", "description": "Start of the daemon, UTC ns; the numbering of raw streams."},
    "time": {"type": "integer", "description": "When this was said, UTC ns."},
    "positions": {
        "type": "object",
        "description": "By topic [session, next]: all numbers below next were published. A consumer that has fewer"
        " missed some.",
        "additionalProperties": {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2},
    },
    "status": {"type": "object", "description": "State and figures of every part of the cell."},
}


def schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema of every JSON message, by the kind of topic."""
    found = {kind: _schema(kind) for kind in TYPES}
    found["health"] = _titled("health", "Once a second, and as the answer to @/status.", _HEALTH, list(_HEALTH))
    return found


def _schema(kind: str) -> dict[str, Any]:
    found = adapter(kind).json_schema(mode="serialization")
    properties = {"mark": _MARK, **{name: _tidy(about) for name, about in found["properties"].items()}}
    return _titled(kind, found["description"], properties, list(properties))


def _titled(kind: str, description: str, properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"cellwatt {kind}",
        "description": " ".join(description.replace("``", "").split()),
        "type": "object",
        "properties": properties,
        "required": required,
    }


def _tidy(about: Any) -> Any:
    """The same schema without titles and defaults, and with ``null`` allowed for every float."""
    if isinstance(about, list):
        return [_tidy(a) for a in about]
    if not isinstance(about, dict):
        return about
    changed = {k: _tidy(v) for k, v in about.items() if k not in ("default", "title")}
    return changed | {"type": ["number", "null"]} if about.get("type") == "number" else changed


def write(folder: Path) -> None:
    """Write each schema to ``<kind>.json`` in a folder, which is made when missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, schema in schemas().items():
        (folder / f"{kind}.json").write_text(json.dumps(schema, indent=2, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
