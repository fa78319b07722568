"""A settings file for a bundle: as it is in force, or, where it is wrong, its mistakes and its outline."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from cellwatt.address import HIDDEN
from cellwatt.config import CellConfig, load, public_config
from cellwatt.config.document import Document, read
from cellwatt.errors import ConfigError
from cellwatt.record.room import Room, room
from cellwatt.runtime.assemble import prepare

_SUSPECT: Final = ("pass", "pw", "secret", "token", "key", "credential")
"""Parts of keys below which a wrong file may hold secrets that no settings class has declared."""
_PLAIN: Final = ("version", "site", "cell", "driver", "stage")


@dataclass(slots=True)
class Findings:
    """A settings file examined: ``config`` if it is right, ``secrets`` with what to show for each."""

    config: CellConfig | None
    shown: dict[str, Any]
    check: list[str]
    secrets: dict[str, str] = field(default_factory=dict)


def examine(file: Path) -> Findings:
    """Read and check a settings file, right or wrong."""
    try:
        config = load(file)
    except ConfigError as error:
        return _wrong(file, [str(problem) for problem in error.problems])
    disk = room(config.record) if config.record is not None else Room()
    warnings = [*config.warnings, *disk.warnings]
    told = [*_unprepared(config), *([disk.refusal] if disk.refusal else []), *(f"warning: {text}" for text in warnings)]
    return Findings(config, public_config(config), told, dict(config.secrets))


def _unprepared(config: CellConfig) -> list[str]:
    try:
        prepare(config)
    except ConfigError as error:
        return [str(problem) for problem in error.problems]
    return [f"{config.path}: configuration is valid"]


def _wrong(file: Path, problems: list[str]) -> Findings:
    try:
        document = read(file, os.environ)
    except ConfigError:
        return Findings(None, {}, problems)
    secrets = dict(document.secrets)
    for path, place in document.places.items():
        if place.written and any(word in str(key).lower() for key in path for word in _SUSPECT):
            secrets[place.written] = HIDDEN
    return Findings(None, {"outline": _outline(document)}, problems, secrets)


def _outline(document: Document) -> Any:
    return _masked(document.value, "")


def _masked(value: Any, key: str) -> Any:
    """Keys and lengths alone: in a wrong file nobody knows which values are secrets."""
    if isinstance(value, Mapping):
        return {str(k): _masked(v, str(k)) for k, v in value.items()}
    if isinstance(value, list):
        return [_masked(v, "") for v in value]
    return value if value is None or key in _PLAIN else HIDDEN
