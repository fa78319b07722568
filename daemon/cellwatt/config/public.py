"""Settings in a form safe to publish: secrets are hidden, values from the environment appear as ``${NAME}``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from cellwatt.config.cell import CellConfig
from cellwatt.config.places import KeyPath
from cellwatt.host import without

_SHORTEST_SECRET = 8
"""Shortest length, characters, of a value from the environment that is also hidden inside other texts."""


def public_config(config: CellConfig) -> dict[str, Any]:
    """The active settings with all defaults, in base units, ready for JSON, with secrets hidden."""
    tree: dict[str, Any] = {
        "site": config.site,
        "cell": config.cell,
        "robot": config.robot,
        "sources": {n: {"driver": s.driver, **_plain(s.settings)} for n, s in config.sources.items()},
        "frames": _plain(config.frames),
        "stages": {n: {"stage": s.kind, **_plain(s.settings)} for n, s in config.stages.items()},
        "record": None if config.record is None else _plain(config.record),
        "units": _plain(config.units),
        **{n: _plain(s.settings) for n, s in config.outlets.items()},
    }
    for path, shown in config.environment.items():
        _blank(tree, path, shown)
    long = {value: shown for value, shown in config.secrets.items() if len(value) >= _SHORTEST_SECRET}
    blanked: dict[str, Any] = _hide(tree, long)
    return blanked


def _plain(settings: BaseModel) -> dict[str, Any]:
    return settings.model_dump(mode="json", by_alias=True)


def _blank(tree: Any, path: KeyPath, shown: str) -> None:
    """Put ``shown`` at ``path``, or at its longest prefix that exists after validation."""
    key: Any = str(path[0]) if isinstance(tree, dict) else path[0]
    there = key in tree if isinstance(tree, dict) else isinstance(key, int) and key < len(tree)
    if there and len(path) > 1 and isinstance(tree[key], dict | list):
        _blank(tree[key], path[1:], shown)
    elif there or isinstance(tree, dict):
        tree[key] = shown
    else:
        tree[:] = [shown]


def _hide(tree: Any, secrets: Mapping[str, str]) -> Any:
    if isinstance(tree, dict):
        return {_hide(key, secrets): _hide(value, secrets) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_hide(value, secrets) for value in tree]
    return without(tree, secrets) if isinstance(tree, str) else tree
