"""cellwatt: aligned, named data with units from robot cells, and alarms about them.

    import cellwatt as cw

    table = cw.open("/var/lib/cellwatt/weld-3").frame()

This is the whole public interface, for drivers, stages and outlets, here or in another repository, and for programs
that use the data. ``Recording``, ``Subscriber`` and the names that packages register under ``cellwatt.api``
(``explain``, ``Arm`` …) are imported when they are first used, so that ``import cellwatt`` stays light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cellwatt.account import Account
from cellwatt.alarms import AlarmBook, Patience
from cellwatt.batch import Batch, Reading, Tick
from cellwatt.channel import Channel, Quality, Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import (
    CellwattError,
    ConfigError,
    ConnectError,
    DeviceError,
    ModelError,
    OutletError,
    ProtocolError,
    RecordingError,
    SourceError,
    WrongDeviceError,
)
from cellwatt.files import Places
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.outlet import CellView, Outlet, OutletSettings
from cellwatt.progress import show_progress
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Result, Task
from cellwatt.stage import CellInfo, Stage, StageSettings
from cellwatt.version import __version__

if TYPE_CHECKING:
    from cellwatt.outlets.forward import ForwardOutlet, ForwardSettings
    from cellwatt.outlets.remote import NotNowError
    from cellwatt.outlets.selection import Row
    from cellwatt.record import Recording
    from cellwatt.subscriber import LinkSettings, Subscriber

_LATER = {
    "ForwardOutlet": "cellwatt.outlets.forward",
    "ForwardSettings": "cellwatt.outlets.forward",
    "LinkSettings": "cellwatt.subscriber",
    "NotNowError": "cellwatt.outlets.remote",
    "Recording": "cellwatt.record",
    "Row": "cellwatt.outlets.selection",
    "Subscriber": "cellwatt.subscriber",
}

__all__ = [
    "Account",
    "Alarm",
    "AlarmBook",
    "Batch",
    "CellInfo",
    "CellView",
    "CellwattError",
    "Channel",
    "ConfigError",
    "ConnectError",
    "DeviceError",
    "Driver",
    "Energy",
    "Event",
    "ForwardOutlet",
    "ForwardSettings",
    "FrameChannel",
    "Frames",
    "Identity",
    "Inlet",
    "Interval",
    "Layout",
    "LinkSettings",
    "ModelError",
    "NotNowError",
    "Outlet",
    "OutletError",
    "OutletSettings",
    "Patience",
    "Prediction",
    "ProtocolError",
    "Quality",
    "Reading",
    "Recording",
    "RecordingError",
    "Result",
    "Row",
    "SourceError",
    "SourceSettings",
    "Stage",
    "StageSettings",
    "Stream",
    "Subscriber",
    "Task",
    "Tick",
    "WrongDeviceError",
    "__version__",
    "open",
    "show_progress",
]


def open(recording: Places) -> Recording:
    """Open a recording: a file, several, or a folder, also one that is being written.

    A ROS 2 bag, an MCAP of joint states or a LeRobot data set is opened as if cellwatt had recorded it.

    Raises ``RecordingError`` if there is no recording, or the recordings are of several cells.
    """
    from cellwatt.logs.recorded import open_recording

    return open_recording(recording)


def __getattr__(name: str) -> Any:
    from cellwatt.registry import available, load

    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
    elif not name.startswith("_") and name in available("cellwatt.api"):
        value = load("cellwatt.api", name)
    else:
        raise AttributeError(f"module 'cellwatt' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    from cellwatt.registry import available

    return sorted({*__all__, "__version__", *available("cellwatt.api")})
