"""``report.html``: what ``explain`` found, on one page that needs nothing else."""

from cellwatt_plugins.mismatch.report.page import write_report
from cellwatt_plugins.mismatch.report.trace import Trace

__all__ = ["Trace", "write_report"]
