"""Reads and checks a settings file: one pass finds every error."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from stat import S_ISREG
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cellwatt.config.cell import VERSION, CellConfig, CellName, FrameSettings, OutletConfig, SourceConfig, StageConfig
from cellwatt.config.document import Document, read
from cellwatt.config.fields import anchored, fields_of
from cellwatt.config.marks import quoted
from cellwatt.config.places import MOST, KeyPath, first
from cellwatt.config.secret import secrets_in
from cellwatt.config.wording import explain, found, missing_key, nearest, unknown_key
from cellwatt.errors import ConfigError, Problem
from cellwatt.record.settings import RecordSettings, default_folder
from cellwatt.registry import available, driver, outlet, stage
from cellwatt.units import Units

NAME = re.compile(r"[a-z][a-z0-9_]*")
DEFAULT_OUTLET = "zenoh"
"""Outlet that is on by default; other outlets are on if their key is in the file."""

MOST_NAMES = 100
"""Largest number of sources of a cell, and of stages."""
_WORDED = 10 * MOST
"""Largest number of problems for which a message is composed, which takes time."""
_SECTIONS = ("sources", "frames", "stages", "record", "units")

M = TypeVar("M", bound=BaseModel)


def load(path: Path, environ: Mapping[str, str] | None = None) -> CellConfig:
    """Return the settings of one cell, checked without connecting to anything.

    ``environ`` provides ``${NAME}`` (default: the environment of the process). Raises ``ConfigError`` with the first
    ``MOST`` problems, in file order.
    """
    document = read(path, os.environ if environ is None else environ)
    version = document.value.get("version")
    if type(version) is int and version > VERSION:  # all other problems may follow from this one
        message = (
            f"settings of version {version}, this cellwatt reads version {VERSION}: "
            "install the version of cellwatt that they were written for, or a later one"
        )
        raise ConfigError([document.problem(("version",), message)])
    return load_document(document)


def load_document(document: Document) -> CellConfig:
    """Return the settings of a document, as ``load`` does; marks its secrets as hidden."""
    check = _Check(document, document.file.absolute().parent)
    config = _cell(check, document.file)
    if config is None or check.problems:
        problems = [replace(problem, message=document.blanked(problem.message)) for problem in check.problems]
        raise ConfigError(first(problems))
    return config


@dataclass(slots=True)
class _Check:
    """A document that is being checked, and the problems found so far."""

    document: Document
    folder: Path
    problems: list[Problem] = field(default_factory=list)
    reported: set[KeyPath] = field(default_factory=set)

    def __post_init__(self) -> None:
        for path, mistakes in self.document.mistakes.items():
            self.problems += mistakes
            self.reported.add(path)

    def complain(self, path: KeyPath, message: str, *, at_key: bool = False) -> None:
        """Add a problem, unless one is known at this key path."""
        if path not in self.reported and len(self.problems) < _WORDED:
            self.problems.append(self.document.problem(path, message, at_key=at_key))

    def mapping(self, path: KeyPath, value: Any) -> dict[Any, Any] | None:
        """Return the value as a mapping, empty for a key without a value; ``None`` after adding a problem."""
        if value is None or isinstance(value, dict):
            return value or {}
        self.complain(path, f"found {found(self.document, path)}, expected settings (key: value)")
        return None

    def settings(self, model: type[M], path: KeyPath, values: Mapping[Any, Any]) -> M | None:
        """Validate values with their settings class and hide their secrets; ``None`` after adding problems."""
        for secret in secrets_in(model, values, path):
            self.document.hide(secret)
        try:
            made = model.model_validate(anchored(model, dict(values), self.folder))
        except ValidationError as error:
            self.problems += explain(error, model, self.document, path, self.reported)
            return None
        except Exception as error:  # any exception from the validator of a foreign package
            self.complain(path, f"cannot be checked: {type(error).__name__}: {error}", at_key=True)
            return None
        for name, info in model.model_fields.items():
            key, number = (*path, info.alias or name), getattr(made, name)
            if isinstance(number, float) and not isfinite(number) and key in self.document.places:
                self.complain(key, f"found {found(self.document, key)}, expected a finite value")
        return made

    def part(
        self,
        find: Callable[[str], type[Any]],
        kind: Any,
        place: KeyPath,
        path: KeyPath,
        values: Mapping[Any, Any],
        hint: str = "",
    ) -> tuple[type[Any] | None, Any]:
        """Class and settings of a driver, stage or outlet, with its kind at ``place``; None after adding a problem."""
        if not isinstance(kind, str):
            self.complain(place, f"found {found(self.document, place)}, expected a name")
            return None, None
        try:
            made = find(kind)
        except ConfigError as error:
            self.complain(place, f"{error}{hint}")
            return None, None
        return made, self.settings(made.Settings, path, values)


def _cell(check: _Check, path: Path) -> CellConfig | None:
    document = check.document
    top: dict[Any, Any] = document.value
    ways_out = list(available("cellwatt.outlets"))
    keys = [*fields_of(CellName), *_SECTIONS, *ways_out]
    for key in top:
        if key in keys or len(check.problems) >= _WORDED:
            continue
        check.complain((key,), unknown_key(key, keys), at_key=True)
        check.reported.add((nearest(key, keys) or key,))
    name = check.settings(CellName, (), {k: top[k] for k in fields_of(CellName) if k in top})
    sources = dict(_sources(check, top))
    _same_device(check, sources)
    _same_line(check, sources)
    frames = _section(check, "frames", FrameSettings, top) if "frames" in top else FrameSettings()
    stages = dict(_stages(check, top, _robot(check, name)))
    record = _record(check, top, name) if "record" in top else None
    outlets = dict(_outlets(check, top, ways_out))
    units = _section(check, "units", Units, top) if "units" in top else Units()
    if name is None or frames is None or units is None:
        return None
    return CellConfig(
        path=path,
        text=document.public_text,
        site=name.site,
        cell=name.cell,
        robot=name.robot,
        latency=name.latency,
        sources=sources,
        frames=frames,
        stages=stages,
        record=record,
        outlets=outlets,
        units=units,
        environment=document.environment,
        secrets=document.secrets,
        record_place=document.place(("record", "folder")) if "record" in top else "",
    )


def _robot(check: _Check, name: CellName | None) -> Path | None:
    """File that describes the robot. Adds a problem for a path without readable ``robot.yaml``; a name is a label."""
    if name is None or name.robot is None:
        return None
    path = check.folder / name.robot
    described = path.suffix in (".yaml", ".yml")
    file = path if described else path / "robot.yaml"
    if (described or "/" in name.robot) and not os.access(file, os.R_OK):
        message = f"found {name.robot!r}, expected a robot.yaml or the folder that holds one: {file} cannot be read"
        check.complain(("robot",), message)
    return path if path.is_file() else file


def _record(check: _Check, top: Mapping[Any, Any], name: CellName | None) -> RecordSettings | None:
    values = check.mapping(("record",), top["record"])
    if values is None:
        return None
    if "folder" not in values:
        try:
            values = {**values, "folder": str(default_folder(name.cell if name is not None else ""))}
        except ConfigError as error:
            check.complain(("record",), str(error), at_key=True)
            return None
    return check.settings(RecordSettings, ("record",), values)


def _section(check: _Check, key: str, model: type[M], top: Mapping[Any, Any]) -> M | None:
    values = check.mapping((key,), top[key])
    return None if values is None else check.settings(model, (key,), values)


def _named(check: _Check, section: str, top: Mapping[Any, Any]) -> Iterator[tuple[str, dict[Any, Any]]]:
    """Entries of ``sources`` or ``stages`` whose name and mapping are valid."""
    entries = check.mapping((section,), top.get(section)) or {}
    if len(entries) > MOST_NAMES:
        check.complain((section,), f"found {len(entries):,} {section}, expected at most {MOST_NAMES}", at_key=True)
        return
    for name, value in entries.items():
        path = (section, name)
        if not isinstance(name, str) or not NAME.fullmatch(name):
            message = f"found {quoted(name)} as a name, expected small letters, digits and '_', starting with a letter"
            check.complain(path, message, at_key=True)
            continue
        values = check.mapping(path, value)
        if values is not None:
            yield name, dict(values)


def _sources(check: _Check, top: Mapping[Any, Any]) -> Iterator[tuple[str, SourceConfig]]:
    if "sources" not in top:
        if ("sources",) not in check.reported:
            check.complain((), missing_key("sources", "what is measured: name: {driver: …}"), at_key=True)
    elif not top["sources"]:
        check.complain(("sources",), "found no source, expected at least one (name: {driver: …})", at_key=True)
    for name, values in _named(check, "sources", top):
        path = ("sources", name)
        kind = values.pop("driver", None)
        if kind is None:
            if meant := nearest("driver", [key for key in values if isinstance(key, str)]):
                check.complain((*path, meant), unknown_key(meant, ["driver"]), at_key=True)
            else:
                known = f"one of: {', '.join(available('cellwatt.drivers'))}"
                check.complain(path, missing_key("driver", known), at_key=True)
            continue
        _, settings = check.part(driver, kind, (*path, "driver"), path, values)
        if settings is not None:
            yield name, SourceConfig(name, kind, settings, check.document.place(path))


def _stages(check: _Check, top: Mapping[Any, Any], robot: Path | None) -> Iterator[tuple[str, StageConfig]]:
    needs: dict[str, tuple[str, ...]] = {}
    kinds: set[str] = set()
    for name, values in _named(check, "stages", top):
        path = ("stages", name)
        own = values.pop("stage", None)
        kind = name if own is None else own
        place: KeyPath = path if own is None else (*path, "stage")
        known = own is not None or name in available("cellwatt.stages")
        hint = "" if known else f"; is {name!r} your own name? then add 'stage: KIND'"
        if isinstance(kind, str):
            kinds.add(kind)
        found_class, settings = check.part(stage, kind, place, path, values, hint)
        needs[name] = tuple(getattr(found_class, "needs", ()))
        if settings is not None:
            written = _written(settings.files(check.folder, robot))
            yield name, StageConfig(name, kind, settings, check.document.place(path), written)
    for name, wanted in needs.items():
        for kind in wanted:
            if kind not in kinds:
                message = f"needs a stage of the kind {kind!r}: add '{kind}: {{}}' to stages"
                check.complain(("stages", name), message, at_key=True)


def _written(files: Iterable[Path]) -> tuple[int, ...]:
    """Modification times, ns, of regular files; those that cannot be read here are reported when they are needed."""
    found: list[int] = []
    for file in files:
        with contextlib.suppress(OSError, ValueError):  # a text that is no path
            if S_ISREG((known := file.stat()).st_mode):
                found.append(known.st_mtime_ns)
    return tuple(found)


def _outlets(check: _Check, top: Mapping[Any, Any], names: list[str]) -> Iterator[tuple[str, OutletConfig]]:
    for name in names:
        value = top.get(name, {} if name == DEFAULT_OUTLET else "off")
        if str(value).lower() in ("off", "no", "false"):
            continue
        if (values := check.mapping((name,), value)) is not None:
            _, settings = check.part(outlet, name, (name,), (name,), values)
            if settings is not None:
                yield name, OutletConfig(name, settings)


def _same_device(check: _Check, sources: Mapping[str, SourceConfig]) -> None:
    first: dict[tuple[str, ...], str] = {}
    for name, source in sources.items():
        device = _device(source)
        other = first.setdefault(device, name) if device else name
        if other != name:
            where = " ".join(device[1:])
            check.complain(("sources", name), f"reads the same device as {other!r} ({where})", at_key=True)


def _same_line(check: _Check, sources: Mapping[str, SourceConfig]) -> None:
    """Add a problem for each source that opens a shared serial line in another way than the first source there."""
    first: dict[str, tuple[str, str]] = {}
    for name, source in sources.items():
        settings = source.settings
        keys = settings.reached_by if settings.line_parts else ()
        if line := next((path for key in keys if key != "host" and (path := getattr(settings, key))), None):
            way = ", ".join([line, *(f"{part} {getattr(settings, part)}" for part in settings.line_parts)])
            other, its = first.setdefault(os.path.realpath(line), (name, way))
            if way != its:
                message = f"opens its serial line as {way}; {other!r} opens the same line as {its}: write the same"
                check.complain(("sources", name), message, at_key=True)


def _device(source: SourceConfig) -> tuple[str, ...]:
    """Identity of a port that only one source may open: a serial port, or driver, host and port; () if there is none.

    A settings class may list fields in ``device_parts`` that distinguish devices at the same port.
    """
    settings = source.settings
    host, port = getattr(settings, "host", None), getattr(settings, "port", None)
    if host:
        parts = [f"{name} {getattr(settings, name)}" for name in settings.device_parts]
        return source.driver, str(host).lower(), *([f"port {port}"] if port else []), *parts
    for serial in (port, getattr(settings, "serial", None), getattr(settings, "device", None)):
        if isinstance(serial, str | Path) and str(serial):
            return "serial", os.path.realpath(serial)
    return ()
