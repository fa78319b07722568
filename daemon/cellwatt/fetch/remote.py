"""What lies at a URL: S3 by pyarrow, all else by fsspec."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import IO, Any
from urllib.parse import urlsplit

from cellwatt.errors import CellwattError, ConfigError
from cellwatt.host import blank
from cellwatt.outlets.historian.store import s3_options

_URL = re.compile(r"[a-z][a-z0-9+.-]*(?:::|://)")
_TAGS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created")
"""Keys of fsspec's file systems for what tells two versions of a file apart, the best first."""
_REFUSED = ("ACCESS_DENIED", "INVALID_ACCESS_KEY_ID", "SIGNATURE_DOES_NOT_MATCH", "NO_CREDENTIALS", "FORBIDDEN")


class MissingError(CellwattError):
    """Nothing is at the URL."""


@dataclass(frozen=True, slots=True)
class File:
    """A file at a URL: its ``path`` there, ``name`` below the URL ("" where it is the URL's own), ``size`` in bytes."""

    path: str
    name: str
    size: int
    tag: str


def is_url(text: str) -> bool:
    """Tell a URL from a path."""
    return _URL.match(text) is not None


class Remote:
    """The file or folder at a URL. Raises ``MissingError``, ``ConfigError``, or ``CellwattError`` with the reason."""

    def __init__(self, url: str) -> None:
        self.url = url
        with self._told():
            self._fs, self._root = _file_system(url)

    @property
    def name(self) -> str:
        """Last part of the URL's path."""
        name = PurePosixPath(self._root).name
        if name in ("", ".."):
            raise CellwattError(f"{blank(self.url)} names no file and no folder")
        return name

    def files(self) -> list[File]:
        """The file, or all of the folder and those below, sorted."""
        with self._told():
            about = self._fs.info(self._root)
            if about["type"] != "directory":
                return [_file(about, self._root, "")]
            found: Mapping[str, Any] = self._fs.find(self._root, detail=True)
        below = [_file(about, path, _below(path, self._root)) for path, about in sorted(found.items())]
        if not below:
            raise MissingError(f"{blank(self.url)} is a folder without files")
        if wrong := next((file.name for file in below if not _is_safe(file.name)), None):
            raise CellwattError(f"{blank(self.url)} has a file {wrong!r}, whose name leads out of the folder")
        return below

    @contextmanager
    def open(self, file: File) -> Iterator[IO[bytes]]:
        """Read a file from its beginning."""
        with self._told(), self._fs.open(file.path, "rb") as source:
            yield source

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except FileNotFoundError as error:
            raise MissingError(f"{blank(self.url)} is not there") from error
        except ImportError as error:
            need = "pip install 'cellwatt[scale]'" if error.name == "fsspec" else str(error)
            raise ConfigError(f"{blank(self.url)} cannot be fetched: a package is missing: {need}") from error
        except ValueError as error:
            raise ConfigError(f"{blank(self.url)} cannot be fetched: {_plain(error)}") from error
        except CellwattError:
            raise
        except Exception as error:  # a file system of others may fail in any way
            refused = isinstance(error, PermissionError) or any(word in str(error) for word in _REFUSED)
            hint = "no access; are the credentials in the environment? " if refused else ""
            raise CellwattError(f"{blank(self.url)} cannot be fetched: {hint}{_plain(error)}") from error


def _file_system(url: str) -> tuple[Any, str]:
    from fsspec.core import url_to_fs  # type: ignore[import-untyped]

    if not url.startswith("s3://"):
        found: tuple[Any, str] = url_to_fs(url)
        return found
    from fsspec.implementations.arrow import ArrowFSWrapper  # type: ignore[import-untyped]
    from pyarrow import fs

    parts = urlsplit(url, allow_fragments=False)
    if not parts.netloc or not parts.path.strip("/") or parts.query:
        raise ValueError("expected s3://bucket/key")
    store = fs.S3FileSystem(**_s3_settings(os.environ))
    return ArrowFSWrapper(store, skip_instance_cache=True), f"{parts.netloc}/{parts.path.strip('/')}"


def _s3_settings(environment: Mapping[str, str]) -> dict[str, Any]:
    """Options from the variables of Amazon's own tools; pyarrow reads the keys itself."""

    def first(*names: str) -> str | None:
        return next((environment[name] for name in names if environment.get(name)), None)

    endpoint = first("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
    return s3_options(endpoint, first("AWS_REGION", "AWS_DEFAULT_REGION"), None, first("AWS_CA_BUNDLE"))


def _file(about: Mapping[str, Any], path: str, name: str) -> File:
    tag = next((about[key] for key in _TAGS if about.get(key)), "")
    return File(path, name, int(about["size"] or 0), str(tag))


def _below(path: str, root: str) -> str:
    return path.strip("/").removeprefix(root.strip("/")).lstrip("/")


def _is_safe(name: str) -> bool:
    return bool(name) and "\0" not in name and ".." not in PurePosixPath(name).parts


def _plain(error: Exception) -> str:
    return " ".join(str(error).split())[:300]
