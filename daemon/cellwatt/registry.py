"""Finds drivers, stages, outlets, commands and public names by entry point, here and in any other package."""

from __future__ import annotations

import difflib
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from cellwatt.driver import Driver
from cellwatt.errors import CellwattError, ConfigError
from cellwatt.outlet import Outlet
from cellwatt.stage import Stage


@cache
def available(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, sorted. Raises ``CellwattError`` if two packages claim one name."""
    found: dict[str, EntryPoint] = {}
    for point in sorted(entry_points(group=group), key=lambda p: p.name):
        other = found.get(point.name)
        if other is not None and other.value != point.value:
            raise CellwattError(f"{group}: {point.name!r} is claimed by both {other.value} and {point.value}")
        found[point.name] = point
    return found


def load(group: str, name: str) -> Any:
    """Load the object behind an entry point.

    Raises ``ConfigError``: with the nearest name if the name is unknown, with the reason if the import fails, and with
    the extra to install if the entry point names one (``explain = "package.module:explain [explain]"``).
    """
    points = available(group)
    what = group.rsplit(".", 1)[1].removesuffix("s")
    if name not in points:
        near = difflib.get_close_matches(name, points, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"no {what} named {name!r}{hint} (there are: {', '.join(points)})")
    try:
        return points[name].load()
    except ConfigError:
        raise
    except Exception as error:  # a third-party package may fail in any way
        point, called = points[name], f"cellwatt.{name}" if what == "api" else f"{what} {name!r}"
        if isinstance(error, ModuleNotFoundError) and point.extras and point.dist:
            extra = f"{point.dist.name}[{point.extras[0]}]"
            raise ConfigError(f"{called} needs the package {error.name}: pip install '{extra}'") from error
        reason = " ".join(str(error).split())
        raise ConfigError(f"{called} cannot be loaded: {type(error).__name__}: {reason}") from error


def driver(name: str) -> type[Driver[Any]]:
    """Load a driver class by name. Raises ``ConfigError`` as ``load``."""
    found: type[Driver[Any]] = load("cellwatt.drivers", name)
    return found


def stage(name: str) -> type[Stage[Any]]:
    """Load a stage class by name. Raises ``ConfigError`` as ``load``."""
    found: type[Stage[Any]] = load("cellwatt.stages", name)
    return found


def outlet(name: str) -> type[Outlet[Any]]:
    """Load an outlet class by name. Raises ``ConfigError`` as ``load``."""
    found: type[Outlet[Any]] = load("cellwatt.outlets", name)
    return found
