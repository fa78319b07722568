"""Cuts the motion of an arm into intervals and recognises the tasks that recur."""

from cellwatt_plugins.segment.settings import SegmentSettings
from cellwatt_plugins.segment.stage import SegmentStage

__all__ = ["SegmentSettings", "SegmentStage"]
