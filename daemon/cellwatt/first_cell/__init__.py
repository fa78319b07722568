"""Writes a first settings file: the given settings, and every other key commented out with its default."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel

from cellwatt.channel import Stream
from cellwatt.config import FrameSettings
from cellwatt.config.cell import CellName
from cellwatt.config.document import read
from cellwatt.config.installed import Installed, installed
from cellwatt.config.loading import NAME, load_document
from cellwatt.config.reference import Field, in_yaml, reference
from cellwatt.config.wording import first_sentence
from cellwatt.driver import SourceSettings
from cellwatt.errors import CellwattError, ConfigError, why
from cellwatt.files import replace_text
from cellwatt.record.settings import RecordSettings
from cellwatt.registry import driver as find_driver
from cellwatt.runtime.assemble import Prepared, prepare
from cellwatt.units import Units

LISTEN = "tcp/127.0.0.1:7447"
"""Endpoint at which programs on the same PC reach the cell."""
RECORD = "recordings"
"""Folder of the recordings, beside the settings file."""

_COMMENT = 40
"""Column at which comments begin, unless the setting before them is longer."""
_WIDTH = 120
_HIDDEN = "*"


@dataclass(frozen=True, slots=True)
class SourcePlan:
    """One device: the name of its source, its driver, and its settings as YAML text."""

    name: str
    driver: str
    settings: Mapping[str, str]


def parse_source(text: str) -> SourcePlan:
    """Parse ``NAME=DRIVER:ADDRESS``. Raises ``ConfigError``; for an unknown driver it names the most similar one."""
    name, equals, rest = text.partition("=")
    kind, _, address = rest.partition(":")
    if not equals or not kind:
        raise ConfigError(f"found {text!r} as a source, expected NAME=DRIVER:ADDRESS, like arm=ur:192.0.2.10")
    if not NAME.fullmatch(name):
        raise ConfigError(f"found {name!r} as a name, expected small letters, digits and '_', starting with a letter")
    settings = find_driver(kind).Settings
    return SourcePlan(name, kind, address_settings(settings, address) if address else {})


def address_settings(model: type[SourceSettings], address: str) -> dict[str, str]:
    """Settings for the address of a device: ``192.0.2.10``, ``[2001:db8::1]:30004`` or ``/dev/ttyUSB0``."""
    is_path = address.startswith("/")
    key = next((key for key in model.reached_by if (key != "host") == is_path), model.reached_by[0])
    host, colon, port = address.rpartition(":")
    alone = host.startswith("[") or ":" not in host
    if key == "host" and colon and alone and port.isdigit() and "port" in model.model_fields:
        return {key: in_yaml(host.strip("[]")), "port": port}
    return {key: in_yaml(address.strip("[]") if key == "host" else address)}


def write_cell(
    path: Path,
    site: str,
    cell: str,
    sources: Sequence[SourcePlan],
    robot: str | None = None,
    record: str = RECORD,
) -> None:
    """Validate the settings of a cell, then write the file atomically.

    Raises ``ConfigError`` if the settings are invalid, ``CellwattError`` if the file cannot be written.
    """
    named = {"version": str(CellName.model_fields["version"].default), "site": in_yaml(site), "cell": in_yaml(cell)}
    named |= {"robot": in_yaml(robot)} if robot else {}
    recorded = {"folder": in_yaml(record)}
    try:
        arms = arms_of(_checked(path, cell_text(named, sources, recorded, ())).streams)
        text = cell_text(named, sources, recorded, arms)
        _checked(path, text)
    except ConfigError as error:  # line numbers are useless: the file does not exist yet
        texts = [f"{p.path}: {p.message}" if p.path else p.message for p in error.problems]
        more = any(str(p.path).startswith("sources.") for p in error.problems)
        advice = "; give it as --set NAME.KEY=VALUE" if more else ""
        raise ConfigError(f"{path} is not written: {'; '.join(texts)}{advice}") from error
    try:
        replace_text(path, text)
    except OSError as error:
        raise CellwattError(f"{path} cannot be written: {why(error)}") from error


def _checked(path: Path, text: str) -> Prepared:
    return prepare(load_document(read(path, os.environ, text=text)))


def arms_of(streams: Mapping[str, tuple[Stream, ...]]) -> tuple[str, ...]:
    """Names of the sources that measure joint positions."""
    return tuple(n for n, found in streams.items() if any("joint_1.position" in stream.names for stream in found))


def cell_text(
    named: Mapping[str, str], sources: Sequence[SourcePlan], record: Mapping[str, str], arms: tuple[str, ...]
) -> str:
    """Text of the settings file; ``arms`` are the sources whose motion is segmented into tasks."""
    lines = [
        "# Settings of a cell. A key behind '# ' is off and shows its default: take the '# ' away to change it.",
        "# All keys: docs/settings.md, or cellwatt drivers NAME. After a change: cellwatt check FILE",
        *_keys(CellName, named),
        "",
        "sources:",
        *(line for source in sources for line in _source(source)),
        "",
        *_section("frames", FrameSettings, {}, "The time grid onto which all channels are brought"),
        "",
        *_stages(arms),
        "",
        *_section("record", RecordSettings, record, "Every raw sample is written there first"),
        "",
        *_outlets(),
        *_section("units", Units, {}, "Units in which values are shown and exported"),
    ]
    return "\n".join(lines) + "\n"


def _source(source: SourcePlan) -> Iterator[str]:
    part = next(p for p in installed("driver") if p.name == source.driver)
    yield f"  {source.name}:"
    yield from _line("    ", f"driver: {source.driver}", part.title)
    yield from _keys(find_driver(source.driver).Settings, source.settings, "    ")


def _section(name: str, model: type[BaseModel], values: Mapping[str, str], about: str) -> Iterator[str]:
    """A section with the given values; commented out as a whole if there are none."""
    yield from _line("" if values else "# ", f"{name}:", about)
    yield from _keys(model, values, "  " if values else "#   ")


def _keys(model: type[BaseModel], values: Mapping[str, str], indent: str = "") -> Iterator[str]:
    """Keys of a settings class: those with values, then the others, commented out unless ``indent`` does so."""
    fields = {f.key: f for f in reference(model) if "." not in f.key and "[]" not in f.key}
    for key, value in values.items():
        yield from _line(indent, f"{key}: {value}", first_sentence(fields[key].description) if key in fields else "")
    off = "" if "#" in indent else "# "
    for key, field in fields.items():
        if key not in values and (shown := _default(field)) is not None:
            yield from _line(indent, f"{off}{key}: {shown}".rstrip(), first_sentence(field.description))


def _default(field: Field) -> str | None:
    """The default as YAML; ``""`` if the user must choose a value, ``None`` for nested settings."""
    if field.type == "settings" or field.default.startswith("{"):
        return None
    if field.type.startswith("NAME: "):
        return "" if field.required else "{}"
    return "" if field.default.startswith(_HIDDEN) else field.default


def _stages(arms: tuple[str, ...]) -> Iterator[str]:
    yield from _line("", "stages:" if arms else "# stages:", "What is learned from the frames")
    parts = {part.name: part for part in installed("stage") if part.found is not None}
    if arms and "segment" in parts:
        only = "{}" if len(arms) == 1 else f"{{arm: {arms[0]}}}"
        yield from _line("  ", f"segment: {only}", parts.pop("segment").title)
    for part in parts.values():
        indent, off = ("  ", "# ") if arms else ("#   ", "")
        yield from _line(indent, f"{off}{part.name}: {_required(part)}", part.title)


def _required(part: Installed) -> str:
    fields = [] if part.settings is None else reference(part.settings)
    keys = [f"{f.key}: {'FILE' if 'path' in f.type else '…'}" for f in fields if f.required and "." not in f.key]
    return f"{{{', '.join(keys)}}}"


def _outlets() -> Iterator[str]:
    for part in installed("outlet"):
        if part.settings is not None:
            values = {"listen": f"[{LISTEN}]"} if part.name == "zenoh" else {}
            yield from _section(part.name, part.settings, values, part.title)
            yield ""


def _line(indent: str, text: str, about: str) -> Iterator[str]:
    """A line with its comment after it, or above it if both are too long for one line."""
    line = f"{indent}{text}"
    behind = f"{line.ljust(_COMMENT)}  # {about}"
    if not about:
        yield line
    elif len(behind) <= _WIDTH:
        yield behind
    else:
        yield f"{indent}# {about}:"
        yield line
