"""Every exception that cellwatt raises on purpose.

    CellwattError                 root; its text is one line for the person at the cell
    ├── ConfigError               the settings file, or a file it names, is wrong (carries every problem found)
    ├── RecordingError            a recording cannot be read or written
    │   └── RepairingError        the recording is being repaired: try again later
    ├── ModelError                a model or reference file is refused
    ├── OutletError                 an outlet cannot be opened
    └── SourceError               a device; the daemon retries with back-off
        ├── ConnectError          no device answers, or the port is gone    (also a ConnectionError)
        ├── ProtocolError         bytes that are not the device's protocol
        ├── DeviceError           the device answered with an error of its own
        └── WrongDeviceError      another device than the configured one answers; retried slowly

Drivers map ``OSError``, ``struct.error`` and library errors to these at their boundary.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass


def why(error: OSError) -> str:
    """The system's plain reason, e.g. ``Connection refused``, instead of asyncio's wording."""
    if error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    return error.strerror or str(error)


class CellwattError(Exception):
    """Root of all errors that cellwatt raises on purpose."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a settings file.

    ``place`` is ``file:line:column``, ``path`` the dotted key, ``message`` the value found and the value expected.
    """

    place: str
    path: str
    message: str

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        key = f"{self.path}: " if self.path else ""
        return f"{where}{key}{self.message}"


class ConfigError(CellwattError):
    """A settings file is wrong; ``problems`` holds every mistake found, in file order."""

    def __init__(self, problems: Sequence[Problem] | str) -> None:
        self.problems: tuple[Problem, ...] = (
            (Problem("", "", problems),) if isinstance(problems, str) else tuple(problems)
        )
        super().__init__("\n".join(str(p) for p in self.problems))


class RecordingError(CellwattError):
    """A recording cannot be read or written."""


class RepairingError(RecordingError):
    """The requested data may be in a recording that is being repaired: try again later."""


class ModelError(CellwattError):
    """A model or reference file is refused: wrong inputs, units or robot, or damaged."""


class OutletError(CellwattError):
    """An outlet cannot be opened or was closed by the other side."""


class SourceError(CellwattError):
    """A device failed; the daemon restarts the source with back-off."""


class ConnectError(SourceError, ConnectionError):
    """No device answers at the configured address, or the port vanished."""


class ProtocolError(SourceError):
    """The device sent bytes that are not its protocol."""


class DeviceError(SourceError):
    """The device answered with an error of its own."""


class WrongDeviceError(SourceError):
    """Another device than the configured one answers."""
