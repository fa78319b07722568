"""``report.html``: where the energy of a robot goes, on one page that needs nothing else."""

from cellwatt_plugins.energy.report.page import write_report

__all__ = ["write_report"]
