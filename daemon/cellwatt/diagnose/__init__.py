"""The bundle for a bug report: what this PC, its settings and its running cell tell, without secrets."""

from cellwatt.diagnose.bundle import Bundle
from cellwatt.diagnose.contents import bundle_of

__all__ = ["Bundle", "bundle_of"]
