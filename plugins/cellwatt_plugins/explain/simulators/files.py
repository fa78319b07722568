"""A simulator's XML file and the files it includes, to be changed and written to another folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from cellwatt.errors import ConfigError
from cellwatt.files import read_text, write_file
from cellwatt_plugins.explain.simulators.markup import Element, Markup

DIRECTORIES = ("meshdir", "texturedir", "assetdir")
ASSETS = {"mesh": "meshdir", "texture": "texturedir", "hfield": "assetdir", "skin": "assetdir"}
MOST = 200
"""Largest number of files that a file includes, directly and indirectly, with the file itself."""


class Files:
    """A main file and all files that it includes, the main file first. Raises ``ConfigError``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.every: list[Markup] = []
        self._read(path)

    @property
    def root(self) -> Element:
        """Root of the main file."""
        return self.every[0].root

    def _read(self, path: Path) -> None:
        try:
            one = Markup(read_text(path), path)
        except (OSError, UnicodeDecodeError, expat.ExpatError) as error:
            raise ConfigError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from error
        self.every.append(one)
        if len(self.every) > MOST:
            raise ConfigError(f"{self.path}: includes more than {MOST} files: does one include itself?")
        for include in one.root.iter("include"):
            self._read(self._named(include))

    def _named(self, element: Element) -> Path:
        """Path of the file that an element names, as MuJoCo resolves it: from the main file's folder."""
        return self.path.parent / element.attributes.get("file", "")

    def all(self, *tags: str) -> Iterator[Element]:
        """All elements of some tags."""
        return (element for one in self.every for tag in tags for element in one.root.iter(tag))

    def write(self, folder: Path) -> list[Path]:
        """Write the changed files as ``name.mended.xml``; return their paths, the main file first.

        Unchanged files are not copied: the changed ones refer to them where they are.
        """
        self._relocate(folder)
        changed = {self.path: self._new(folder, self.path)}
        while True:
            # A file that includes a rewritten file is rewritten, too.
            more = {one.path: self._new(folder, one.path) for one in self.every if one.changed}
            if more.keys() <= changed.keys():
                break
            changed |= more
            for include in self.all("include"):
                if (place := self._named(include)) in changed:
                    include.set(file=changed[place].name)
        for one in self.every:
            if one.path in changed:
                write_file(changed[one.path], one.text())
        return list(changed.values())

    def _new(self, folder: Path, path: Path) -> Path:
        """Path of a rewritten file; an included file whose name is not unique is prefixed with its folders."""
        twins = path != self.path and any(one.path.name == path.name and one.path != path for one in self.every)
        name = f"{path.stem}.mended{path.suffix}"
        below = os.path.relpath(path.parent, self.path.parent).replace(os.sep, "_")
        return folder / (f"{below}_{name}" if twins and below != "." else name)

    def _relocate(self, folder: Path) -> None:
        """Change the names of files and folders to paths relative to ``folder``."""
        here = self.path.parent.resolve()
        if folder.resolve() == here:
            return
        for element in self.all("include", "model"):
            element.set(file=_seen(self._named(element), folder))
        stated = {kind for compiler in self.all("compiler") for kind in compiler.attributes}
        if self.path.suffix.lower() == ".urdf" and not stated & {"meshdir", "assetdir"}:
            for mesh in self.all("mesh"):
                name = mesh.attributes.get("filename", "")
                if name and "://" not in name and not Path(name).is_absolute():
                    mesh.set(filename=_seen(here / name, folder))
            return
        self._relocate_assets(here, folder)

    def _relocate_assets(self, here: Path, folder: Path) -> None:
        named = set()
        for compiler in self.all("compiler"):
            for kind in DIRECTORIES:
                if kind in compiler.attributes:
                    named.add(kind)
                    compiler.set(**{kind: _seen(here / compiler.attributes[kind], folder)})
        if "assetdir" in named:
            return
        used = {kind for tag, kind in ASSETS.items() for e in self.all(tag) if "file" in e.attributes}
        missing = ({"meshdir", "texturedir"} if "assetdir" in used else used) - named
        if missing:
            folders = " ".join(f'{kind}="{_seen(here, folder)}"' for kind in sorted(missing))
            self.root.added.append(f"<compiler {folders}/>")


def _seen(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
