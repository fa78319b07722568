"""Copies of what lies at URLs: one folder for each version of each URL, which is there whole or not at all.

``FOLDER/VERSION/NAME`` is the copy, ``FOLDER/VERSION/.origin`` says of what.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit
from urllib.request import url2pathname

from cellwatt.errors import CellwattError, why
from cellwatt.fetch.remote import File, Remote
from cellwatt.host import blank
from cellwatt.progress import Stage, stage

KEPT: Final = 30 * 86400.0
"""s that a copy is kept after its last use."""
_PIECE: Final = 8_000_000
_ORIGIN: Final = ".origin"
_PART: Final = ".part-"


def folder() -> Path:
    """The folder of the copies: ``$XDG_CACHE_HOME/cellwatt``, or ``~/.cache/cellwatt``."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        return (given if given.is_absolute() else Path.home() / ".cache") / "cellwatt"
    except RuntimeError:
        raise CellwattError("there is no home for copies of what is fetched: set XDG_CACHE_HOME") from None


def fetch(url: str) -> Path:
    """Path of a copy of the file or folder at a URL, as it is now; a ``file://`` is its own copy.

    Raises ``MissingError`` where there is none, else ``CellwattError`` with the reason.
    """
    if url.startswith("file://"):
        return Path(url2pathname(urlsplit(url).path))
    remote = Remote(url)
    files = remote.files()
    return _copy(remote, files, _version(url, files))


def _version(url: str, files: Sequence[File]) -> str:
    whole = json.dumps([url, [(file.name, file.size, file.tag) for file in files]])
    return hashlib.sha256(whole.encode()).hexdigest()[:32]


def _kept(version: str) -> Path | None:
    place = folder() / version
    try:
        name = json.loads((place / _ORIGIN).read_text("utf-8"))["name"]
        os.utime(place)
    except OSError:
        return None
    return place / str(name)


def _copy(remote: Remote, files: Sequence[File], version: str) -> Path:
    kept = _kept(version)
    if kept is not None:
        return kept
    name = remote.name
    try:
        folder().mkdir(0o700, parents=True, exist_ok=True)
        _forget()
        part = Path(tempfile.mkdtemp(prefix=_PART, dir=folder()))
        try:
            with stage(f"fetching {blank(remote.url)}", sum(file.size for file in files)) as told:
                for file in files:
                    _take(remote, file, part / name / file.name if file.name else part / name, told)
            (part / _ORIGIN).write_text(json.dumps({"url": remote.url, "name": name}), "utf-8")
            _put(part, folder() / version)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise CellwattError(f"{blank(remote.url)} cannot be kept in {folder()}: {why(error)}") from error
    return folder() / version / name


def _take(remote: Remote, file: File, target: Path, told: Stage) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    size = 0
    with remote.open(file) as source, target.open("xb") as copy:
        while piece := source.read(_PIECE):
            copy.write(piece)
            size += len(piece)
            told.advance(len(piece))
    if size != file.size:
        raise CellwattError(f"{blank(remote.url)}: {size} bytes of {file.size} came of {file.path}: try again")


def _put(part: Path, place: Path) -> None:
    """Rename, unless another process was first."""
    try:
        part.rename(place)
    except OSError:
        if not (place / _ORIGIN).is_file():
            raise


def _forget() -> None:
    """Remove copies that nobody has used for long, and what a process left that was killed."""
    oldest = time.time() - KEPT
    for place in folder().iterdir():
        if place.stat().st_mtime < oldest:
            shutil.rmtree(place, ignore_errors=True)
