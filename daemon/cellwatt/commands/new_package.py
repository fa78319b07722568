"""``cellwatt new-driver`` and ``new-outlet``: write a package to start from."""

from __future__ import annotations

import keyword
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

import click

from cellwatt.files import write_file
from cellwatt.registry import available


@dataclass(frozen=True, slots=True)
class Kit:
    """A kind of package: the ``skeleton`` that it is made of, its modules, and where each of its templates goes."""

    kind: str
    skeleton: str
    modules: tuple[str, ...]
    templates: Mapping[str, str]
    example: str


_COMMON = {
    "pyproject.toml": "pyproject.toml",
    "README.md": "README.md",
    "test_conformance.py": "tests/test_conformance.py",
}
DRIVER = Kit(
    "driver",
    "skeleton",
    ("__init__.py", "driver.py", "emulator.py", "wire.py"),
    {**_COMMON, "test_wire.py": "tests/test_wire.py"},
    "my_meter",
)
OUTLET = Kit("outlet", "outlet_skeleton", ("__init__.py", "outlet.py"), _COMMON, "my_outlet")
_name = click.argument("name")
_folder = click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    help="Where to put the folder NAME (default: here).",
)


@click.command(short_help="Write a package for a driver of your own.")
@_name
@_folder
def driver(name: str, folder: Path) -> None:
    """Write a package for a new driver NAME that works as it is: against its own emulator, with its tests."""
    _write(DRIVER, name, folder)


@click.command(short_help="Write a package for an outlet of your own.")
@_name
@_folder
def outlet(name: str, folder: Path) -> None:
    """Write a package for a new outlet NAME that works as it is: a webhook, with the tests of any outlet."""
    _write(OUTLET, name, folder)


def _write(kit: Kit, name: str, folder: Path) -> None:
    _check(kit, name)
    target = folder / name
    if os.path.lexists(target):
        raise click.UsageError(f"{target} is there already: choose another name or --folder")
    for path, text in package(name, kit).items():
        write_file(target / path, text)
    click.echo(f"{target} is written. Next:\n")
    click.echo(f"  cd {target}\n  pip install -e '.[test]'\n  pytest\n  cellwatt drivers {name}")


def package(name: str, kit: Kit = DRIVER) -> dict[str, str]:
    """The files of a new package, by path below its folder."""
    camel = "".join(part.capitalize() for part in name.split("_"))
    found = {f"{name}/{module}": _renamed(_read(kit, module), kit, name, camel) for module in kit.modules}
    for template, path in kit.templates.items():
        text = Template(_read(kit, f"{template}.template"))
        found[path] = text.substitute(name=name, Name=camel, dashed=name.replace("_", "-"))
    return found


def _check(kit: Kit, name: str) -> None:
    """Raise ``UsageError`` if the name cannot be that of such a package."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*[a-z0-9]", name) or keyword.iskeyword(name):
        raise click.UsageError(f"found {name!r} as a name, expected small letters, digits and '_', like {kit.example}")
    if name in available(f"cellwatt.{kit.kind}s"):
        article = "an" if kit.kind == "outlet" else "a"
        raise click.UsageError(f"there is {article} {kit.kind} named {name!r} already: cellwatt drivers {name}")
    if find_spec(name) is not None:
        raise click.UsageError(f"there is a Python package named {name!r} already: choose another name")


def _read(kit: Kit, name: str) -> str:
    return (files("cellwatt") / "testing" / kit.skeleton / name).read_text(encoding="utf-8")


def _renamed(text: str, kit: Kit, name: str, camel: str) -> str:
    for before, after in (
        (f"cellwatt.testing.{kit.skeleton}", name),
        ("Skeleton: ", f"{name}: "),
        ("Skeleton meter", name),
        ("Skeleton webhook", name),
        ("Skeleton", camel),
    ):
        text = text.replace(before, after)
    return text
