"""Answers from which a first settings file is written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass

from cellwatt.config.fields import fields_of
from cellwatt.config.loading import NAME
from cellwatt.driver import SourceSettings
from cellwatt.errors import ConfigError
from cellwatt.registry import driver as find_driver

LISTEN = "tcp/127.0.0.1:7447"
"""Where a cell is asked and watched from its own PC."""
RECORD = "recordings"
"""Folder of the record, beside the settings file."""

_PLAIN = re.compile(r"[A-Za-z/][A-Za-z0-9_./+-]*(?: [A-Za-z0-9_./+-]+)*|[0-9]+(?:\.[0-9]+){3}")
_WORDS = ("true", "false", "null")


@dataclass(frozen=True, slots=True)
class SourcePlan:
    """One device: the name of its source, its driver, and its settings as they are written in YAML."""

    name: str
    driver: str
    settings: Mapping[str, str]

    @property
    def model(self) -> type[SourceSettings]:
        """Settings class of the driver."""
        return find_driver(self.driver).Settings


@dataclass(frozen=True, slots=True)
class CellPlan:
    """A cell to be written. Without a ``record`` nothing is recorded."""

    site: str
    cell: str
    sources: tuple[SourcePlan, ...]
    robot: str | None = None
    record: str | None = RECORD
    listen: str = LISTEN


def parse_source(text: str) -> SourcePlan:
    """Read ``NAME=DRIVER:ADDRESS``. Raises ``ConfigError`` with the nearest driver where it is unknown."""
    name, equals, rest = text.partition("=")
    kind, _, address = rest.partition(":")
    if not equals or not kind:
        raise ConfigError(f"found {text!r} as a source, expected NAME=DRIVER:ADDRESS, like arm=ur:192.0.2.10")
    check_name(name)
    settings = find_driver(kind).Settings
    return SourcePlan(name, kind, address_settings(settings, address) if address else {})


def check_name(name: str) -> str:
    """Return the name of a source unchanged. Raises ``ConfigError`` if it cannot be one."""
    if not NAME.fullmatch(name):
        raise ConfigError(f"found {name!r} as a name, expected small letters, digits and '_', starting with a letter")
    return name


def address_settings(model: type[SourceSettings], address: str) -> dict[str, str]:
    """Settings that say where a device is: ``192.0.2.10``, ``192.0.2.10:30004`` or ``/dev/ttyUSB0``."""
    key = _address_key(model, address)
    host, colon, port = address.rpartition(":")
    alone = host.startswith("[") or ":" not in host
    if key == "host" and colon and alone and port.isdigit() and "port" in model.model_fields:
        return {key: in_yaml(host.strip("[]")), "port": port}
    return {key: in_yaml(address)}


def _address_key(model: type[SourceSettings], address: str) -> str:
    """The key for a path where there is one, else that for a host."""
    path = address.startswith("/")
    fitting = [key for key in model.reached_by if (key != "host") == path]
    return (fitting or list(model.reached_by))[0]


def questions(source: SourcePlan) -> list[str]:
    """Keys of a source that have no usual value and are not given yet, beside its address."""
    fields = fields_of(source.model)
    required = [key for key, field in fields.items() if field.is_required() and key not in source.model.reached_by]
    return [key for key in dict.fromkeys((*required, *source.model.asked)) if key not in source.settings]


def unreachable(source: SourcePlan) -> bool:
    """True if the settings do not say where the device is, and it has no usual place."""
    model, fields = source.model, fields_of(source.model)
    ways = [key for key in model.reached_by if key in fields]
    usual = any(fields[key].get_default() for key in ways if not fields[key].is_required())
    return bool(ways) and not usual and not any(key in source.settings for key in ways)


def in_yaml(value: str) -> str:
    """A text as it is written in YAML: in quotes where it would be read as something else."""
    if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    return json.dumps(value, ensure_ascii=False)
