"""``report.html``: what ``explain`` found, on one page that needs nothing else."""

from cellwatt_plugins.mismatch.report.page import report
from cellwatt_plugins.mismatch.report.trace import Trace

__all__ = ["Trace", "report"]
