"""Packages that a driver needs and that are installed as an extra."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec

from cellwatt.errors import ConfigError


def require(source: str, what: str, packages: Mapping[str, str], how: str) -> None:
    """Raise ``ConfigError`` if a package of ``packages`` (module → package) is not installed.

    The message says that ``what`` of the source needs it and ``how`` to get it.
    """
    if missing := [package for module, package in packages.items() if not _is_present(module)]:
        raise ConfigError(f"source {source}: {what} needs {' and '.join(missing)}: {how}")


def _is_present(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # of the package that the module is in
        return False
    except ValueError:  # it is loaded, and was not found in a file
        return True
