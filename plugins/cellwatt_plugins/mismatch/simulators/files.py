"""A simulator's XML file with what it includes, to be changed and written to another folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from cellwatt.errors import ConfigError
from cellwatt.files import read_text, write_file
from cellwatt_plugins.mismatch.simulators.markup import Element, Markup

DIRECTORIES = ("meshdir", "texturedir", "assetdir")
ASSETS = {"mesh": "meshdir", "texture": "texturedir", "hfield": "assetdir", "skin": "assetdir"}
MOST = 200
"""Files that one includes, and those include in turn."""


@dataclass(frozen=True)
class One:
    """One file of a simulator."""

    path: Path
    original: str
    markup: Markup


class Files:
    """A file and all that it includes; the first is the main one. Raises ``ConfigError``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.every: list[One] = []
        self._read(path)

    def _read(self, path: Path) -> None:
        try:
            text = read_text(path)
            one = One(path, text, Markup(text))
        except (OSError, UnicodeDecodeError, expat.ExpatError) as error:
            raise ConfigError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from error
        self.every.append(one)
        if len(self.every) > MOST:
            raise ConfigError(f"{self.path}: includes more than {MOST} files: does one include itself?")
        for include in one.markup.root.iter("include"):
            self._read(self._place(include.attributes.get("file", "")))

    def _place(self, name: str) -> Path:
        """Path of a file as MuJoCo resolves it: from the main file's folder."""
        return self.path.parent / name

    def all(self, tag: str) -> Iterator[tuple[One, Element]]:
        """All elements of a tag with the file that they are in."""
        for one in self.every:
            for element in one.markup.root.iter(tag):
                yield one, element

    def write(self, folder: Path) -> list[Path]:
        """Writes what changed as ``name.mended.xml``, the main file first; the rest is named where it is."""
        self._relocate(folder)
        changed = {self.path: self._new(folder, self.path)}
        while True:
            # Who includes a file that is written anew is written anew as well.
            more = {one.path: self._new(folder, one.path) for one in self.every if one.markup.text() != one.original}
            if more.keys() <= changed.keys():
                break
            changed |= more
            for one, include in self.all("include"):
                place = self._place(include.attributes.get("file", ""))
                if place in changed:
                    one.markup.set(include, file=changed[place].name)
        for one in self.every:
            if one.path in changed:
                write_file(changed[one.path], one.markup.text())
        return list(changed.values())

    def _new(self, folder: Path, path: Path) -> Path:
        return folder / f"{path.stem}.mended{path.suffix}"

    def _relocate(self, folder: Path) -> None:
        """Names of files and folders as seen from ``folder``."""
        here = self.path.parent.resolve()
        if folder.resolve() == here:
            return
        for one, include in self.all("include"):
            one.markup.set(include, file=_seen(self._place(include.attributes.get("file", "")), folder))
        if self.path.suffix.lower() == ".urdf":
            for one, mesh in self.all("mesh"):
                name = mesh.attributes.get("filename", "")
                if name and "://" not in name and not Path(name).is_absolute():
                    one.markup.set(mesh, filename=_seen(here / name, folder))
            return
        self._relocate_assets(here, folder)

    def _relocate_assets(self, here: Path, folder: Path) -> None:
        named = set()
        for one, compiler in self.all("compiler"):
            for kind in DIRECTORIES:
                if kind in compiler.attributes:
                    named.add(kind)
                    one.markup.set(compiler, **{kind: _seen(here / compiler.attributes[kind], folder)})
        if "assetdir" in named:
            return
        used = {kind for tag, kind in ASSETS.items() for _, e in self.all(tag) if "file" in e.attributes}
        missing = ({"meshdir", "texturedir"} if "assetdir" in used else used) - named
        if missing:
            main = self.every[0].markup
            main.add(main.root, "<compiler " + " ".join(f'{k}="{_seen(here, folder)}"' for k in sorted(missing)) + "/>")


def _seen(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
