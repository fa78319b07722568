"""``cellwatt new-driver`` and ``new-outlet``: write a working package as a starting point."""

from __future__ import annotations

import keyword
import os
import re
import shlex
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

import click

from cellwatt.commands import FOLDER
from cellwatt.files import write_file
from cellwatt.registry import available


@dataclass(frozen=True, slots=True)
class Kit:
    """A kind of package: its template folder ``skeleton``, and an example of a package name."""

    kind: str
    skeleton: str
    example: str


DRIVER = Kit("driver", "skeleton", "my_meter")
OUTLET = Kit("outlet", "outlet_skeleton", "my_outlet")
_name = click.argument("name")
_folder = click.option("--folder", type=FOLDER, default=Path(), help="Parent of the new folder NAME (default: here).")


@click.command(short_help="Write a package for your own driver.")
@_name
@_folder
def driver(name: str, folder: Path) -> None:
    """Write a package for a new driver NAME. It works at once: it has an emulator of its device, and tests."""
    _write(DRIVER, name, folder)


@click.command(short_help="Write a package for your own outlet.")
@_name
@_folder
def outlet(name: str, folder: Path) -> None:
    """Write a package for a new outlet NAME. It works at once: it is a webhook, with the tests of an outlet."""
    _write(OUTLET, name, folder)


def _write(kit: Kit, name: str, folder: Path) -> None:
    _check(kit, name)
    target = folder / name
    if os.path.lexists(target):
        raise click.UsageError(f"{target} already exists: choose another name or --folder")
    for path, text in package(name, kit).items():
        write_file(target / path, text)
    click.echo(f"{target} is written. Next:\n")
    click.echo(f"  cd {shlex.quote(str(target))}\n  pip install -e '.[test]'\n  pytest\n  cellwatt drivers {name}")


def package(name: str, kit: Kit = DRIVER) -> dict[str, str]:
    """Text of each file of a new package, by path relative to its folder."""
    camel = "".join(part.capitalize() for part in name.split("_"))
    found = {}
    for file in (files("cellwatt") / "testing" / kit.skeleton).iterdir():
        if file.name.endswith(".template"):
            target = file.name.removesuffix(".template")
            text = Template(file.read_text(encoding="utf-8"))
            path = f"tests/{target}" if target.startswith("test_") else target
            found[path] = text.substitute(name=name, Name=camel, dashed=name.replace("_", "-"))
        elif file.name.endswith(".py"):
            found[f"{name}/{file.name}"] = _renamed(file.read_text(encoding="utf-8"), kit, name, camel)
    return found


def _check(kit: Kit, name: str) -> None:
    """Raise ``UsageError`` if a package of this kind cannot have this name."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*[a-z0-9]", name) or keyword.iskeyword(name):
        raise click.UsageError(f"found {name!r} as a name, expected small letters, digits and '_', like {kit.example}")
    if name in available(f"cellwatt.{kit.kind}s"):
        article = "an" if kit.kind == "outlet" else "a"
        raise click.UsageError(f"there is {article} {kit.kind} named {name!r} already: cellwatt drivers {name}")
    if find_spec(name) is not None:
        raise click.UsageError(f"there is a Python package named {name!r} already: choose another name")


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
