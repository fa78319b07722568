"""The store of a lake: a folder, or an S3 bucket. Files appear complete or not at all."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from cellwatt.errors import OutletError, why
from cellwatt.files import replace_bytes


class Store:
    """A lake in a folder, or, with ``options``, in an S3 bucket.

    In a folder, files are written under another name, synced to disk and renamed; in S3, a file is one object, which
    becomes visible when it is complete. All methods raise ``OutletError`` if the store cannot be reached.
    """

    def __init__(self, place: Path | str, options: Mapping[str, Any] | None = None) -> None:
        from pyarrow import fs

        self._root, self._remote = str(place).removeprefix("s3://").rstrip("/"), options is not None
        self._all_below = partial(fs.FileSelector, allow_not_found=True, recursive=True)
        self._fs = fs.LocalFileSystem()
        if options is not None:
            self._fs = fs.S3FileSystem(allow_delayed_open=True, background_writes=False, **options)

    def put(self, path: str, content: bytes) -> None:
        """Write a file, replacing an existing one; paths are relative to the lake."""
        target = f"{self._root}/{path}"
        with _as_outlet_error(target):
            if not self._remote:
                Path(target).parent.mkdir(parents=True, exist_ok=True)
                replace_bytes(Path(target), content)
                return
            with self._fs.open_output_stream(target) as out:
                out.write(content)

    def names(self, folder: str) -> list[str]:
        """Paths of the Parquet files below a folder, relative to it, sorted; none if the folder does not exist."""
        root = f"{self._root}/{folder}"
        with _as_outlet_error(root):
            found = self._fs.get_file_info(self._all_below(root))
        paths = (info.path for info in found if info.is_file and info.path.endswith(".parquet"))
        return sorted(path.removeprefix(f"{root}/") for path in paths)


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
def _as_outlet_error(path: object) -> Any:
    try:
        yield
    except OSError as error:
        raise OutletError(f"lake: {path}: {' '.join(why(error).split())[:300]}") from error
