"""Recordings: crash-safe MCAP files, read back exactly.

Recorder    takes items from the event loop and writes MCAP files
Recording   reads files back, in the order and blocks in which they were recorded
History     answers questions about the past during recording
"""

from cellwatt.record.header import Header
from cellwatt.record.history import History
from cellwatt.record.messages import Health
from cellwatt.record.reader import Recording
from cellwatt.record.recovery import Recovery, recover
from cellwatt.record.samples import Samples
from cellwatt.record.settings import RecordSettings
from cellwatt.record.writer import Recorder

__all__ = ["Header", "Health", "History", "RecordSettings", "Recorder", "Recording", "Recovery", "Samples", "recover"]
