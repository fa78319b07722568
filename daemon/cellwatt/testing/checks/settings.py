"""A mistake in a settings file is reported with line, column and key."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from cellwatt.config import load
from cellwatt.config.fields import fields_of
from cellwatt.config.places import position
from cellwatt.errors import ConfigError, Problem
from cellwatt.runtime.assemble import prepare
from cellwatt.testing.rig import NotConformingError, Rig, require

_HEAD = "site: test\ncell: test\nzenoh: off\nsources:\n  device:\n    driver: {name}\n"
_FIRST_LINE = _HEAD.count("\n") + 1
_INDENT = 4
_NONSENSE = "[{nonsense: [[]]}]"
"""A value that is invalid for every type of setting."""


async def settings_are_checked(rig: Rig, folder: Path) -> None:
    """Require that valid settings pass, and that unknown or missing keys and wrong values are reported in place."""
    name, model = rig.name, rig.driver.Settings
    undocumented = [key for key, field in fields_of(model).items() if not field.description]
    require(
        model.__doc__ and not undocumented, f"settings without a docstring: {', '.join(undocumented) or 'the class'}"
    )
    place = "/dev/ttyUSB0" if rig.transport == "pty" else "192.0.2.10:10000"
    right = rig.written(place)
    file = _File(folder / "cell.yaml", name)
    if mistakes := file.problems(right):
        raise NotConformingError(f"the settings of the rig itself are refused: {'; '.join(map(str, mistakes))}")
    told = file.problems(right | {"no_such_key": 1})
    _is_told(told, "no_such_key", _FIRST_LINE + len(right), _INDENT + 1, "an unknown key")
    for key, field in fields_of(model).items():
        if field.is_required():
            without = {k: v for k, v in right.items() if k != key}
            told = file.problems(without)
            require(any(repr(key) in str(p) for p in told), f"nobody says that {key!r} is missing: {_texts(told)}")
        if field.annotation is not Any:
            others = {k: v for k, v in right.items() if k != key}
            told = file.problems(others, f"{key}: {_NONSENSE}")
            _is_told(told, key, _FIRST_LINE + len(others), None, f"{key}: {_NONSENSE}")


class _File:
    """A settings file with one source."""

    def __init__(self, path: Path, driver: str) -> None:
        self._path = path
        self._driver = driver

    def problems(self, settings: Mapping[str, Any], last: str = "") -> tuple[Problem, ...]:
        """Problems of a file with these settings, one per line, and ``last`` as its last line."""
        lines = [
            yaml.safe_dump({k: v}, default_flow_style=True, width=10_000).strip()[1:-1] for k, v in settings.items()
        ]
        body = "".join(f"{' ' * _INDENT}{line}\n" for line in [*lines, *([last] if last else [])])
        self._path.write_text(_HEAD.format(name=self._driver) + body, encoding="utf-8")
        try:
            prepare(load(self._path))
        except ConfigError as error:
            return error.problems
        except Exception as error:
            raise NotConformingError(
                f"checking the settings raised {type(error).__name__}: {error}; raise ValueError in validators "
                f"and ConfigError in __init__; the file:\n{self._path.read_text(encoding='utf-8')}"
            ) from error
        return ()


def _is_told(told: tuple[Problem, ...], key: str, line: int, column: int | None, what: str) -> None:
    for problem in told:
        place = position(problem)
        if place.line == line and problem.path.startswith(f"sources.device.{key}") and column in (None, place.column):
            return
    where = f"line {line}" + (f", column {column}" if column else "")
    raise NotConformingError(
        f"{what} in a settings file must be told as sources.device.{key} at {where}; found: {_texts(told)} "
        "(derive the settings from SourceSettings, give each key its type, raise only ValueError in validators)"
    )


def _texts(told: tuple[Problem, ...]) -> str:
    return "; ".join(map(str, told)) or "no complaint"
