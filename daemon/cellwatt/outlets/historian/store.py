"""The places of a lake: a folder, or a bucket of S3. A file is there whole, or not at all."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from cellwatt.errors import OutletError, why
from cellwatt.files import replace_bytes


class FolderStore:
    """A lake in a folder: files are written under another name, brought to disk, and renamed.

    All methods raise ``OutletError`` where the place cannot be reached.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def put(self, path: str, content: bytes) -> None:
        """Write a file, in place of one that is there."""
        target = self._folder / path
        with _told(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            replace_bytes(target, content)

    def names(self, folder: str) -> list[str]:
        """Names of the files in a folder and those below, relative to it, sorted; none where it is not there."""
        root = self._folder / folder
        with _told(root):
            return sorted(str(path.relative_to(root)) for path in root.rglob("*.parquet") if path.is_file())


class BucketStore:
    """A lake in S3: a file is one object, which others see when it is whole."""

    def __init__(self, place: str, options: Mapping[str, Any]) -> None:
        from pyarrow import fs

        self._place = place.removeprefix("s3://").rstrip("/")
        self._fs = fs.S3FileSystem(allow_delayed_open=True, background_writes=False, **options)
        self._fs_module = fs

    def put(self, path: str, content: bytes) -> None:
        """See ``FolderStore.put``."""
        with _told(path), self._fs.open_output_stream(self._at(path)) as out:
            out.write(content)

    def names(self, folder: str) -> list[str]:
        """See ``FolderStore.names``."""
        root = self._at(folder)
        with _told(folder):
            found = self._fs.get_file_info(self._fs_module.FileSelector(root, allow_not_found=True, recursive=True))
        kept = (info.path for info in found if info.is_file and info.path.endswith(".parquet"))
        return sorted(path.removeprefix(f"{root}/") for path in kept)

    def _at(self, path: str) -> str:
        return f"{self._place}/{path}"


Store = FolderStore | BucketStore
"""Files by their paths within the lake."""


def s3_options(
    endpoint: str | None, region: str | None, keys: tuple[str, str] | None, ca: str | None
) -> dict[str, Any]:
    """Options of ``pyarrow.fs.S3FileSystem``."""
    options: dict[str, Any] = {}
    if endpoint is not None:
        parts = urlsplit(endpoint)
        options |= {"endpoint_override": f"{parts.netloc}{parts.path}", "scheme": parts.scheme}
    if region is not None or endpoint is not None:
        options["region"] = region or "us-east-1"
    if keys is not None:
        options |= {"access_key": keys[0], "secret_key": keys[1]}
    return options | ({} if ca is None else {"tls_ca_file_path": ca})


@contextlib.contextmanager
def _told(path: object) -> Any:
    try:
        yield
    except OSError as error:
        raise OutletError(f"lake: {path}: {' '.join(why(error).split())[:300]}") from error
