"""The bundle for a bug report: facts about this PC, its settings and its running cell, without secrets."""

from cellwatt.diagnose.bundle import Bundle
from cellwatt.diagnose.contents import bundle_of

__all__ = ["Bundle", "bundle_of"]
