"""Distinguishes logs from tables and recordings of cellwatt, and reads them."""

from __future__ import annotations

from pathlib import Path

from cellwatt.errors import RecordingError
from cellwatt.logs import bag, lerobot
from cellwatt.logs.choice import chosen
from cellwatt.logs.log import Log
from cellwatt.record.foreign import ForeignError
from cellwatt.record.survey import in_folder, survey


def is_log(path: Path) -> bool:
    """True for a ROS 2 bag, an MCAP file that cellwatt did not write, and a LeRobot data set or a file of one."""
    place, _ = chosen(path)
    if lerobot.root_of(place) is not None or bag.is_bag(place):
        return True
    if place.is_dir():
        files = in_folder(place)
        return bool(files) and all(_is_foreign(file) for file in files)
    return place.name.endswith(".mcap") and _is_foreign(place)


def read_log(path: Path) -> Log:
    """Read a log; of several topics or episodes, the choice follows ``#`` after the path.

    Raises ``RecordingError`` if the log holds no joints, or several topics or episodes without a choice, and
    ``ConfigError`` if the package that reads it is missing.
    """
    place, choice = chosen(path)
    root = lerobot.root_of(place)
    return bag.read(place, choice) if root is None else lerobot.read(root, place, choice)


def _is_foreign(path: Path) -> bool:
    try:
        survey(path, chunks=False)
    except RecordingError as error:
        return isinstance(error, ForeignError)
    return False
