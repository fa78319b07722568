"""Files and folders at a URL, by pyarrow for S3 and fsspec otherwise: one local copy for each version."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any, Final
from urllib.parse import urlsplit
from urllib.request import url2pathname

from cellwatt.errors import CellwattError, ConfigError, why
from cellwatt.host import blank
from cellwatt.outlets.historian.store import s3_options
from cellwatt.progress import stage

KEPT: Final = 30 * 86400.0
"""Time in s for which a copy is stored after its last use."""
_URL: Final = re.compile(r"[a-z][a-z0-9+.-]*(?:::|://)")
_TAGS: Final = (
    *("size", "ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created"),
    *("Last-Modified", "Content-MD5", "Digest", "modify", "modified", "last_write_time", "sha"),
)
"""Keys of fsspec's file information that distinguish versions of a file."""
_REFUSED: Final = ("ACCESS_DENIED", "INVALID_ACCESS_KEY_ID", "SIGNATURE_DOES_NOT_MATCH", "NO_CREDENTIALS", "FORBIDDEN")
_PIECE: Final = 8_000_000


class MissingError(CellwattError):
    """There is no file or folder at the URL."""


def is_url(text: str) -> bool:
    """True for a URL, false for a path."""
    return _URL.match(text) is not None


def copies() -> Path:
    """The folder of the copies: ``$XDG_CACHE_HOME/cellwatt``, or ``~/.cache/cellwatt``."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        return (given if given.is_absolute() else Path.home() / ".cache") / "cellwatt"
    except RuntimeError:
        raise CellwattError("this user has no home folder for copies of fetched files: set XDG_CACHE_HOME") from None


def fetch(url: str) -> Path:
    """Path of a copy of the present file or folder at a URL; for ``file://`` the path itself.

    Raises ``MissingError`` if there is none, ``ConfigError`` for a wrong URL or a missing package, otherwise
    ``CellwattError`` with the reason.
    """
    if url.startswith("file://"):
        return Path(url2pathname(urlsplit(url).path))
    with _reported(url):
        store, root = _file_system(url)
        files = _files(store, root)
    name = PurePosixPath(root).name
    if name in ("", ".."):
        raise CellwattError(f"{blank(url)} names no file and no folder")
    if not files:
        raise MissingError(f"{blank(url)} is a folder without files")
    if wrong := next((below for below in files if "\0" in below or ".." in PurePosixPath(below).parts), None):
        raise CellwattError(f"{blank(url)} has a file {wrong!r}, whose name leads out of the folder")
    there = copies()
    try:
        there.mkdir(0o700, parents=True, exist_ok=True)
        for old in there.iterdir():  # copies long unused, or of a killed process
            with suppress(FileNotFoundError):  # another process has removed or finished it
                if old.stat().st_mtime < time.time() - KEPT:
                    shutil.rmtree(old, ignore_errors=True)
        return _copy_of(url, store, files, there, name)
    except OSError as error:
        raise CellwattError(f"{blank(url)} cannot be stored in {there}: {why(error)}") from error


def _files(store: Any, root: str) -> dict[str, Mapping[str, Any]]:
    """File information of the store for a file (under ""), or for all files in a folder and below, by relative path."""
    about = store.info(root)
    if about["type"] != "directory":
        return {"": {**about, "name": root}}
    top = root.strip("/")
    found = sorted(store.find(root, detail=True).items())
    return {path.strip("/").removeprefix(top).lstrip("/"): {**about, "name": path} for path, about in found}


def _copy_of(url: str, store: Any, files: Mapping[str, Mapping[str, Any]], there: Path, name: str) -> Path:
    """Path of the copy of a file or folder in ``there``; made if there is none of this version. Raises ``OSError``."""
    version = json.dumps([url, [(below, [str(about.get(tag)) for tag in _TAGS]) for below, about in files.items()]])
    folder = there / hashlib.sha256(version.encode()).hexdigest()[:32]
    if folder.is_dir():
        os.utime(folder)
    else:
        _copy(url, store, files, folder, name)
    return folder / name


def _copy(url: str, store: Any, files: Mapping[str, Mapping[str, Any]], folder: Path, name: str) -> None:
    """Copy the files to ``folder / name``, all or none. Versions of a folder share the copies of their files."""
    part = Path(tempfile.mkdtemp(prefix=".part-", dir=folder.parent))
    try:
        total = sum(about.get("size") or 0 for about in files.values())
        with stage(f"fetching {blank(url)}", total, share=total) as progress:
            for below, about in files.items():
                target, size = part / name / below, about.get("size")
                target.parent.mkdir(parents=True, exist_ok=True)
                if below:
                    one = _copy_of(f"{url.rstrip('/')}/{below}", store, {"": about}, folder.parent, target.name)
                    try:
                        target.hardlink_to(one)
                    except OSError:  # a file system without links
                        shutil.copyfile(one, target)
                    continue
                with _reported(url), store.open(about["name"], "rb") as source, target.open("xb") as copy:
                    while piece := source.read(_PIECE):
                        copy.write(piece)
                        progress.advance(len(piece))
                    if size is not None and copy.tell() != size:
                        came = f"{copy.tell()} of {size} bytes received of {about['name']}"
                        raise CellwattError(f"{blank(url)}: {came}: try again")
        part.rename(folder)
    except OSError:
        if not folder.is_dir():  # else another process was first
            raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _reported(url: str) -> Iterator[None]:
    try:
        yield
    except CellwattError:
        raise
    except FileNotFoundError as error:
        raise MissingError(f"{blank(url)} does not exist") from error
    except ImportError as error:
        need = "pip install 'cellwatt[scale]'" if error.name == "fsspec" else str(error)
        raise ConfigError(f"{blank(url)} cannot be fetched: a package is missing: {need}") from error
    except Exception as error:  # a third-party file system may fail in any way
        refused = isinstance(error, PermissionError) or any(word in str(error) for word in _REFUSED)
        hint = "no access; are the credentials in the environment? " if refused else ""
        kind = ConfigError if isinstance(error, ValueError) else CellwattError
        raise kind(f"{blank(url)} cannot be fetched: {hint}{' '.join(str(error).split())[:300]}") from error


def _file_system(url: str) -> tuple[Any, str]:
    """An fsspec file system and the path in it; for S3 configured by the environment variables of Amazon's tools."""
    from fsspec.core import url_to_fs  # type: ignore[import-untyped]

    if not url.startswith("s3://"):
        found: tuple[Any, str] = url_to_fs(url)
        return found
    from fsspec.implementations.arrow import ArrowFSWrapper  # type: ignore[import-untyped]
    from pyarrow import fs

    parts = urlsplit(url, allow_fragments=False)
    if not parts.netloc or not parts.path.strip("/") or parts.query:
        raise ValueError("expected s3://bucket/key")

    def first(*names: str) -> str | None:
        return next((os.environ[name] for name in names if os.environ.get(name)), None)

    endpoint = first("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
    options = s3_options(endpoint, first("AWS_REGION", "AWS_DEFAULT_REGION"), None, first("AWS_CA_BUNDLE"))
    store = ArrowFSWrapper(fs.S3FileSystem(**options), skip_instance_cache=True)
    return store, f"{parts.netloc}/{parts.path.strip('/')}"
