"""cellwatt: aligned, named data with units from robot cells, and alarms about them.

This module is the whole public interface for drivers, stages and sinks, in this repository or outside it.
"""

from cellwatt.account import Account
from cellwatt.alarms import AlarmBook, Patience
from cellwatt.batch import Batch, Reading, Tick
from cellwatt.channel import Channel, Quality, Stream
from cellwatt.driver import Driver, Identity, Outlet, SourceSettings
from cellwatt.errors import (
    CellwattError,
    ConfigError,
    ConnectError,
    DeviceError,
    ModelError,
    ProtocolError,
    RecordingError,
    SinkError,
    SourceError,
    WrongDeviceError,
)
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Result, Task
from cellwatt.sink import CellView, Sink, SinkSettings
from cellwatt.stage import CellInfo, Stage, StageSettings

__version__ = "0.1.0"

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
    "FrameChannel",
    "Frames",
    "Identity",
    "Interval",
    "Layout",
    "ModelError",
    "Outlet",
    "Patience",
    "Prediction",
    "ProtocolError",
    "Quality",
    "Reading",
    "RecordingError",
    "Result",
    "Sink",
    "SinkError",
    "SinkSettings",
    "SourceError",
    "SourceSettings",
    "Stage",
    "StageSettings",
    "Stream",
    "Task",
    "Tick",
    "WrongDeviceError",
]
