"""The process that brings the record into a lake: ``python -m cellwatt.outlets.historian.worker``, told on stdin.

It is a process of its own since Parquet and S3 block, and take memory that the daemon then has back.
"""

from __future__ import annotations

import fcntl
import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from cellwatt.errors import CellwattError, OutletError
from cellwatt.outlets.historian.exporting import Export
from cellwatt.outlets.historian.settings import LakeSettings
from cellwatt.outlets.historian.store import BucketStore, FolderStore, Store, s3_options

LOCK: Final = "historian-lake.lock"
"""File in the folder of the record that is locked while a lake is written."""


def store_of(settings: LakeSettings, folder: Path) -> Store:
    """The place of a lake; a folder that is not absolute begins at ``folder``."""
    if not settings.remote:
        return FolderStore(folder / settings.folder)
    keys = None
    if settings.access_key is not None and settings.secret_key is not None:
        keys = settings.access_key.get_secret_value(), settings.secret_key.get_secret_value()
    ca = None if settings.ca is None else str(folder / settings.ca)
    return BucketStore(settings.folder, s3_options(settings.endpoint, settings.region, keys, ca))


def work(told: dict[str, Any]) -> None:
    """Export once, by what the outlet tells. Raises ``OutletError``, also where another process is at it."""
    settings, record = LakeSettings.model_validate(told["settings"]), Path(told["record"])
    store = store_of(settings, Path(told["folder"]))
    with _alone(record / LOCK):
        for done in Export(record, told["site"], told["cell"], settings, store).run():
            print(json.dumps(asdict(done)), file=sys.stderr, flush=True)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    try:
        file = path.open("ab")
    except OSError as error:  # the folder was removed, or may no longer be written
        raise OutletError(f"lake: {path} cannot be opened: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutletError("lake: another process still writes it") from None
        yield


def main() -> int:
    """Export; return the exit code."""
    logging.disable(logging.WARNING)  # a file that is still being written is no news here
    try:
        work(json.load(sys.stdin))
    except CellwattError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
