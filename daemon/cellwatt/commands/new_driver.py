"""``cellwatt new-driver``: writes a package to start a driver from."""

from __future__ import annotations

import keyword
import os
import re
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

import click

from cellwatt.errors import CellwattError, why
from cellwatt.registry import available

_SKELETON = files("cellwatt") / "testing" / "skeleton"
_MODULES = ("__init__.py", "driver.py", "emulator.py", "wire.py")
_TEMPLATES = {
    "pyproject.toml": "pyproject.toml",
    "README.md": "README.md",
    "test_conformance.py": "tests/test_conformance.py",
    "test_wire.py": "tests/test_wire.py",
}
"""Template, and where it goes in the new folder."""


@click.command(short_help="Write a package for a driver of your own.")
@click.argument("name")
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    help="Where to put the folder NAME (default: here).",
)
def command(name: str, folder: Path) -> None:
    """Write a package for a new driver NAME that works as it is: against its own emulator, with its tests."""
    _check(name)
    target = folder / name
    if os.path.lexists(target):
        raise click.UsageError(f"{target} is there already: choose another name or --folder")
    try:
        for path, text in package(name).items():
            file = target / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CellwattError(f"{target} cannot be written: {why(error)}") from error
    click.echo(f"{target} is written. Next:\n")
    click.echo(f"  cd {target}\n  pip install -e '.[test]'\n  pytest\n  cellwatt drivers {name}")


def package(name: str) -> dict[str, str]:
    """The files of a new driver's package, by path below its folder."""
    camel = "".join(part.capitalize() for part in name.split("_"))
    found = {f"{name}/{module}": _renamed(_read(module), name, camel) for module in _MODULES}
    for template, path in _TEMPLATES.items():
        text = Template(_read(f"{template}.template"))
        found[path] = text.substitute(name=name, Name=camel, dashed=name.replace("_", "-"))
    return found


def _check(name: str) -> None:
    """Raise ``UsageError`` if the name cannot be that of a driver and of a package."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*[a-z0-9]", name) or keyword.iskeyword(name):
        raise click.UsageError(f"found {name!r} as a name, expected small letters, digits and '_', like my_meter")
    if name in available("cellwatt.drivers"):
        raise click.UsageError(f"there is a driver named {name!r} already: cellwatt drivers {name}")
    if find_spec(name) is not None:
        raise click.UsageError(f"there is a Python package named {name!r} already: choose another name")


def _read(name: str) -> str:
    return (_SKELETON / name).read_text(encoding="utf-8")


def _renamed(text: str, name: str, camel: str) -> str:
    text = text.replace("cellwatt.testing.skeleton", name)
    return (
        text.replace("Skeleton: a meter", f"{name}: a meter").replace("Skeleton meter", name).replace("Skeleton", camel)
    )
