"""Packages that a driver needs and that an extra installs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec

from cellwatt.errors import ConfigError


def require(source: str, what: str, packages: Mapping[str, str], how: str) -> None:
    """Raise ``ConfigError`` if a package of ``packages`` (module → package) is not installed.

    The message names the source and ``what`` needs the package, and ends with ``how`` to install it.
    """
    if missing := [package for module, package in packages.items() if not _is_present(module)]:
        raise ConfigError(f"source {source}: {what} needs {' and '.join(missing)}: {how}")


def _is_present(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # the module's parent package is missing
        return False
    except ValueError:  # the module is loaded, but has no spec
        return True
